"""Ranking of explanations by log odds."""

import pytest

from windsysid.identification.estimate.evidence import rank

EVIDENCE = {"broadband": -110.0, "rotor-wind": -98.0, "narrow-band": -98.4}


def test_the_best_comes_first_with_its_log_odds_over_the_others():
    ranking = rank(EVIDENCE, EVIDENCE.__getitem__)
    assert ranking.order == ("rotor-wind", "narrow-band", "broadband")
    assert ranking.margins == pytest.approx((0.0, 0.4, 12.0))
    assert ranking.rivals() == pytest.approx({"narrow-band": 0.4, "broadband": 12.0})


def test_rivals_are_within_the_log_odds_given_and_the_best_is_always():
    ranking = rank(EVIDENCE, EVIDENCE.__getitem__)
    assert ranking.within(12.0) == ("rotor-wind", "narrow-band")
    assert ranking.within(12.1) == ranking.order
    assert rank(["only"], lambda _: -5.0).within(1e-9) == ("only",)


def test_equals_keep_their_order_the_simplest_first():
    assert rank(["simple", "rich"], lambda _: 1.0).best == "simple"


def test_nothing_cannot_be_ranked():
    with pytest.raises(ValueError, match="at least one"):
        rank([], float)
