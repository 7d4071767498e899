"""The calibration of `compare` on windows: which pairs are compared, and what is counted, on made posteriors."""

import math

import numpy as np
import pytest
from validation.window_pairs import Pair, main, page_of, pairs_of, reliability, report, unchanged
from validation.windows import RECORDS, Window

from windsysid.results.posterior import Posterior
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine

TOWER = load_turbine("tower")


def result(stiffness: float, std: float = 0.01) -> Posterior:
    """A result that knows side-side stiffness, relative to the file's, so well."""
    parameters = (Parameter("k_side_side", TOWER.values["k_side_side"], 10.0),)
    turbine = TOWER.with_values({"k_side_side": stiffness * TOWER.values["k_side_side"]})
    return Posterior(turbine, parameters, np.array([math.log(stiffness)]), np.array([[std**2]]), "record", True)


def windows(record: str, count: int, length: float = 180.0) -> list[Window]:
    return [Window(record, i * length, (i + 1) * length) for i in range(count)]


def test_windows_of_one_machine_without_common_time_are_compared_once():
    done = [(window, result(1.0)) for window in (*windows("c2", 2), Window("c2", 90.0, 270.0), *windows("k12", 1))]
    pairs = pairs_of(done)
    assert [(one.before.first, one.after.first) for one in pairs] == [(0.0, 180.0)]
    assert pairs[0].one_record


@pytest.mark.slow
def test_odds_of_drawn_changes_are_worth_what_they_say():
    """Half of the pairs have a change of N(0, 0.1²), as the odds suppose."""
    rng, pairs = np.random.default_rng(4), []
    for i in range(600):
        record = "d1" if i % 2 else "c2"
        change = 0.1 * rng.standard_normal() if record == "d1" else 0.0
        found = [result(math.exp(x + 0.04 * rng.standard_normal()), 0.04) for x in (0.0, change)]
        pairs += pairs_of([(Window("c2", 0.0, 180.0), found[0]), (Window(record, 180.0, 360.0), found[1])])
    rows = reliability(pairs)
    assert sum(no + yes for _, no, yes, *_ in rows) == 600
    for _, no, yes, stated, observed in rows:
        assert observed == pytest.approx(stated, abs=3.0 * 0.5 / math.sqrt(no + yes) + 0.02)
    assert len(unchanged(pairs)) == 300
    text, rows = report(pairs)
    assert "600 pairs; 0 refused" in text
    assert b"Reliability" in page_of(rows, text)


def test_a_refused_pair_is_counted_with_its_reason():
    other = result(1.0)._replace(parameters=(Parameter("c_side_side", 1.0, 1.0),))
    pairs = pairs_of([(windows("c2", 1)[0], result(1.0)), (Window("c2", 180.0, 360.0), other)])
    assert pairs[0].found is None
    text, _ = report([*pairs, *pairs_of([(window, result(1.0)) for window in windows("c2", 2)])])
    assert "2 pairs; 1 refused: expected coefficients that both identified" in text


def test_the_truth_is_the_change_of_the_structure():
    pair = Pair(Window("c2", 0.0, 180.0), Window("d1", 0.0, 180.0), None)
    assert pair.truth("k_side_side") == pytest.approx(100.0 * ((0.2986 / 0.3153) ** 2 - 1.0))
    assert (pair.moved("k_side_side"), pair.moved("k_fore_aft")) == (True, False)
    same = Pair(Window("k06", 0.0, 180.0), Window("p20", 0.0, 180.0), None)
    assert not same.moved("k_side_side")
    assert set(RECORDS) >= {"c2", "d1", "m1", "m2"}


def test_the_command_requires_a_folder(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["window_pairs"])
    with pytest.raises(SystemExit):
        main()
