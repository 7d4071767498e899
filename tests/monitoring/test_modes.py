"""Results of operational modal analysis, compared and watched."""

import math

import numpy as np
import pytest

import windsysid as ws
from windsysid.modal.matching.match import on_diagram
from windsysid.modal.shapes import assurance
from windsysid.monitoring.comparison import compare
from windsysid.monitoring.series import gather_modes
from windsysid.monitoring.watch import watch
from windsysid.spectral.oma.known_modes import KnownMode, KnownModes
from windsysid.spectral.oma.mode_tracking import Seen, follow_modes

SHAPES = ({"a": 1.0 + 0j, "b": 0.6 + 0j, "c": 0.2 + 0j}, {"a": 1.0 + 0j, "b": -0.7 + 0j, "c": -0.9 + 0j})


def record_of(number, frequencies, *, std=0.002, damping=0.012, damping_std=0.2, trusted=(True, True), order=(0, 1)):
    """Modes of a record as oma would tell them."""
    modes = [
        KnownMode(f"mode {k + 1}", math.log(f), std, math.log(damping), damping_std, SHAPES[which], trusted[k])
        for k, (f, which) in enumerate(zip(frequencies, order, strict=True))
    ]
    return KnownModes(f"record {number}", None, (0.0, 600.0), None, tuple(modes), True)


def test_a_frequency_that_fell_has_moved_and_damping_has_not():
    found = compare(record_of(1, (1.1, 2.7)), record_of(2, (1.06, 2.7)))
    assert [change.name for change in found.moved] == ["frequency of mode 1"]
    percent = next(c for c in found.coefficients if c.name == "frequency of mode 1")
    assert percent.low < 100.0 * (1.06 / 1.1 - 1.0) < percent.high
    back = compare(record_of(2, (1.06, 2.7)), record_of(1, (1.1, 2.7)))
    assert back.moved[0].log_odds == pytest.approx(found.moved[0].log_odds)


def test_modes_that_change_places_are_told_by_their_shapes():
    # at 1.00 and 1.03 Hz: one fell below the other
    found = compare(record_of(1, (1.00, 1.03)), record_of(2, (0.99, 1.01), order=(1, 0)))
    changes = {change.name: change.percent for change in found.coefficients if change.kind == "frequency"}
    assert changes["frequency of mode 1"] == pytest.approx(1.0, abs=0.02)
    assert changes["frequency of mode 2"] == pytest.approx(100.0 * (0.99 / 1.03 - 1.0), abs=0.02)


def test_what_is_not_trusted_in_both_is_not_compared():
    found = compare(record_of(1, (1.1, 2.7)), record_of(2, (1.1, 2.5), trusted=(True, False)))
    assert {change.name for change in found.coefficients} == {"frequency of mode 1", "damping of mode 1"}
    assert any("not trusted in both" in note for note in found.notes)
    with pytest.raises(ws.ConfigurationError, match="a mode that both found and trust"):
        compare(record_of(1, (1.1, 2.7), trusted=(False, False)), record_of(2, (1.1, 2.7)))


def test_results_of_two_kinds_are_not_compared(verne555):
    tower = ws.identify(ws.simulate("tower", duration=600.0, rate=5.0, seed=1), "tower", formulation="spectral")
    with pytest.raises(ws.ConfigurationError, match="got one of oma and one of identify: give the same command"):
        compare(record_of(1, (1.1, 2.7)), tower)


def test_a_folder_of_another_kind_is_refused_with_what_is_accepted_and_what_it_is(tmp_path):
    """The message named `identify` only, and asked to identify the record first."""
    (tmp_path / "answer.json").write_text('{"answer": "Comparison", "fields": {}}')
    expected = "expected a result of windsysid identify or oma, got one of compare: give another folder"
    for read in (lambda: compare(tmp_path, tmp_path), lambda: ws.read_blocks([tmp_path])):
        with pytest.raises(ws.ConfigurationError, match=expected):
            read()
    with pytest.raises(ws.ConfigurationError, match="no such folder, expected a result of windsysid identify or oma"):
        compare(tmp_path / "nowhere", tmp_path)
    with pytest.raises(ws.ConfigurationError, match="expected a result of windsysid identify, got one of compare"):
        ws.damping([tmp_path])


def test_a_mode_that_falls_is_found_among_many_records():
    rng = np.random.default_rng(3)
    made = []
    for i in range(200):
        level = np.array([1.1 * (0.985 if i >= 150 else 1.0), 2.7])
        made.append(record_of(i, level * np.exp(0.002 * rng.normal(size=2)), trusted=(True, i % 10 != 3)))
    found = watch(gather_modes(made))
    assert [change.name for change in found.changes] == ["frequency of mode 1"]
    assert 148 <= found.changes[0].time / 600.0 <= 152
    assert found.changes[0].low < -1.5 < found.changes[0].high
    assert [series.unit for series in found.series] == ["Hz", "1", "Hz", "1"]


def test_a_mode_that_few_records_trust_is_not_followed():
    made = [record_of(i, (1.1, 2.7), trusted=(True, i < 3)) for i in range(20)]
    blocks = gather_modes(made)
    assert blocks.names == ("frequency of mode 1", "damping of mode 1")
    assert any("2.7 Hz (3 of 20)" in note for note in blocks.notes)


def test_the_assurance_of_a_turned_and_scaled_shape_is_one():
    rng = np.random.default_rng(4)
    shape = rng.normal(size=5) + 1j * rng.normal(size=5)
    assert assurance(shape, 2.0 * np.exp(0.7j) * shape) == pytest.approx(1.0)
    assert math.isnan(assurance(shape, np.where(np.arange(5) < 1, shape, np.nan)))


def test_a_mode_that_is_missing_in_one_record_goes_on_in_the_next():
    def seen(*frequencies):
        return [Seen(f, np.array([1.0, 0.5 * k], dtype=complex)) for k, f in enumerate(frequencies)]

    both, one = seen(1.0, 1.2), seen(1.01, 1.19)[1:]
    assert follow_modes([both, one, both]) == [{0: 0, 2: 0}, {0: 1, 1: 0, 2: 1}]


def test_measured_modes_stand_beside_the_nearest_curve(nrel5mw_diagram, tmp_path):
    usual = float(nrel5mw_diagram.speeds[nrel5mw_diagram.usual])
    curve = nrel5mw_diagram.curves[0]
    f = float(curve.frequency[nrel5mw_diagram.usual])
    known = record_of(1, (1.01 * f, 0.6 * f), trusted=(True, False))._replace(rotor_speed=usual)
    found = nrel5mw_diagram.with_measured(on_diagram(known, nrel5mw_diagram))
    assert [mode.candidate for mode in found.measured] == [curve.name, "unknown"]
    assert found.measured[0].expected == pytest.approx(f, rel=1e-6)
    assert "+1.00 %" in str(found)
    found.save(tmp_path / "diagram")
    assert b"What was measured" in (tmp_path / "diagram" / "report.html").read_bytes()


@pytest.fixture(scope="module")
def nrel5mw_diagram():
    return ws.modes("nrel5mw", speeds=(1.0, 1.4))
