"""The study of matches: what it draws, and that odds are right as often as they say on a few hundred machines."""

import numpy as np
import pytest
from validation.matching import Outcome, draw_machine, main, of_machine, table


def test_a_model_has_what_its_machine_has_in_another_order():
    machine = draw_machine(np.random.default_rng(5))
    names = [mode.name for mode in machine.model]
    assert {name for name in machine.truth if name} <= set(names)
    assert names != sorted(names)


@pytest.mark.slow
def test_probabilities_of_matches_are_those_of_being_right():
    outcomes = [one for seed in range(300) for one in of_machine(seed)]
    expected, right = (np.array([one[i] for one in outcomes], dtype=float) for i in (0, 1))
    assert right.mean() == pytest.approx(expected.mean(), abs=0.02)
    unsure = expected < 0.95
    assert right[unsure].mean() == pytest.approx(expected[unsure].mean(), abs=0.12)


def test_the_table_counts_matches_by_probability(capsys: pytest.CaptureFixture[str]):
    text = table("machines", [Outcome(0.9, True, True), Outcome(0.9, False, True), Outcome(0.999, True, False)])
    assert "3 measured modes; 1 of 2 that are named are right" in text
    assert "| 0.8 to 0.95 | 2 | 50.0 % | 90.0 % |" in text
    main(["--machines", "2", "--records", "0"])
    assert "records: 0 measured modes" in capsys.readouterr().out
