"""Which measured mode is which: modes of turbines and linearisations, harmonics, loads, and what is not measured."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import windsysid as ws
from tests.modal.linearisation.whirling_rotor import Rotor
from tests.spectral.oma import modes as operational
from windsysid.errors import ConfigurationError
from windsysid.inspection.spectra import expected_modes
from windsysid.modal.matching.likelihood import ModelMode
from windsysid.modal.matching.match import candidates_of, match_modes, with_references
from windsysid.modal.matching.result import ModeMatch
from windsysid.modal.matching.sensor_shapes import linearised_shape
from windsysid.spectral.oma.known_modes import KnownMode, KnownModes

SPEED = 12.1 * math.pi / 30.0


def seen(name: str, frequency: float, damping: float = 0.01, *doubts: str, **shape: complex) -> KnownMode:
    logs = (math.log(frequency), 0.002, math.log(damping), 0.1)
    return KnownMode(name, *logs, shape, True, dict.fromkeys(shape, 0.02), doubts)


def record(*modes: KnownMode, speed: float = 0.0) -> KnownModes:
    return KnownModes("record", None, None, None, modes, True, speed)


MODEL = [ModelMode("first", 1.0, 0.0, 0.01, 0.0, {}), ModelMode("second", 2.0, 0.0, 0.01, 0.0, {})]


def test_each_mode_of_the_model_is_given_once():
    found = candidates_of([seen("a", 1.01), seen("b", 1.06), seen("c", 2.02)], MODEL, 0.0)
    assert [mode.best.name for mode in found] == ["first", "unknown", "second"]
    assert [mode.reference for mode in found] == [(1.0, 0.01), (None, None), (2.0, 0.01)]
    for mode in found:
        assert sum(one.probability for one in mode.candidates) == pytest.approx(1.0)


def test_a_match_is_saved_with_its_page_and_loaded_again(tmp_path: Path):
    modes = candidates_of([seen("a", 1.01), seen("c", 2.02)], MODEL, 0.0)
    found = ModeMatch("record", "model", 0.0, modes, ("a note",))
    found.save(tmp_path / "match")
    names = {path.name for path in (tmp_path / "match").iterdir()}
    assert names >= {"report.html", "matches.csv", "summary.json"}
    assert ws.load_result(tmp_path / "match") == found
    assert "a note" in found._repr_html_()
    assert [text.get_text() for text in found.plot().axes[0].texts].count("0") == 0


@pytest.mark.parametrize(
    ("frequency", "doubts", "cause"),
    [
        (3.3, (), "unknown"),
        (3.3, ("load",), "load"),
        (0.6, (), "3P, blade passing"),
        (1.21, (), "6P, blade passing"),
        (0.404, (), "2P"),
    ],
)
def test_peaks_that_the_model_lacks_have_a_cause(frequency: float, doubts: tuple[str, ...], cause: str):
    (mode,) = candidates_of([seen("a", frequency, 0.01, *doubts)], MODEL, 0.2017)
    assert mode.best.name == cause
    assert mode.reference == (None, None)


def test_a_mode_of_the_model_near_a_harmonic_is_not_sure():
    (alone,) = candidates_of([seen("a", 1.01)], MODEL, 0.0)
    (near,) = candidates_of([seen("a", 1.01)], MODEL, 1.01 / 3.0)
    assert near.best.name == "first"
    assert near.best.probability < 0.6 < 0.9 < alone.best.probability


def test_modes_of_a_rotor_are_found_by_shape_where_frequencies_mislead():
    """A lag mode of the record at the frequency of the tower's, and the other way round."""
    machine = ws.load_turbine("nrel5mw")
    tower, lag = (dict.fromkeys(names, 0.0j) for names in [("tower_x_acceleration",)] * 2)
    for way in ("collective", "forward", "backward"):
        tower[f"blades_tip_lag_acceleration {way}"] = lag[f"blades_tip_lag_acceleration {way}"] = 0.0j
    tower["tower_x_acceleration"] = 1.0
    lag["blades_tip_lag_acceleration backward"] = 1.0
    found = match_modes(record(seen("a", 0.88, 0.005, **lag), seen("b", 0.9, 0.005, **tower), speed=SPEED), machine)
    assert found.modes[0].best.name == "lag backward"
    mac = found.modes[0].best.mac
    assert mac is not None
    assert mac[0] > 0.95
    assert found.modes[1].best.name == "unknown"


def test_the_shapes_of_a_rotor_are_those_that_its_record_shows():
    """A simulated record: the tower's mode shows on the blades as well, forward and backward."""
    simulated = ws.simulate("nrel5mw", duration=400.0, rate=10.0, seed=3)
    measured = ws.oma(simulated, turbine="nrel5mw", limits=(0.2, 0.6))
    (mode,) = measured.modes
    assert mode.name == "tower x"
    best = mode.candidates[0]
    assert best.mac is not None
    assert best.mac[0] > 0.95
    assert best.mac[1] < best.mac[0] <= best.mac[2]
    assert "which mode, odds" in measured.headings
    assert measured.rows[0][-1].startswith("tower x, ")
    plain = measured.summary()["modes"][0]
    assert plain["candidates"][0]["name"] == "tower x"


def test_a_match_names_what_was_not_measured_and_is_saved_as_text(tmp_path: Path):
    diagram = ws.modes("nrel5mw", speeds=(1.0, 1.4))
    f = diagram.curves[0].frequency[diagram.usual], diagram.curves[3].frequency[diagram.usual]
    found = ws.match(record(seen("a", f[0]), seen("b", f[1]), speed=SPEED), diagram)
    assert "not measured: lag backward" in found.notes[0]
    assert "tower x" in str(found)
    assert [one["name"] for one in json.loads(found.to_json())["modes"]] == ["a", "b"]
    frame = found.to_dataframe()
    assert set(frame["mode"]) == {"a", "b"}
    np.testing.assert_allclose(frame.groupby("mode")["probability"].sum(), 1.0)


def test_a_model_at_another_rotor_speed_is_warned_of():
    diagram = ws.modes("nrel5mw", speeds=(1.0, 1.4))
    found = ws.match(record(seen("a", 0.3), speed=0.6), diagram)
    assert found.notes[0].startswith("Warning: 9.55 rpm is the nearest speed of the model, the record has 5.73")


def test_shapes_of_a_linearisation_are_those_of_the_same_mode_at_the_records_speed(tmp_path: Path):
    """Participations change with the speed, and names with them: a curve and another mode have one name."""
    speeds = (0.3, 0.8, 1.2)
    rotors = [Rotor(blade=2.6, mass=3.0, speed=speed) for speed in speeds]
    diagram = ws.read_linearisation([path for i, one in enumerate(rotors) for path in one.write(tmp_path, f"point{i}")])
    channels = ["tower_x_acceleration", *(f"blades_tip_lag_acceleration {way}" for way in ("forward", "backward"))]
    whirls = [mode for mode in diagram.points[0].modes if mode.name != "edge collective"]
    shapes = [linearised_shape(mode, speeds[0], channels) for mode in whirls]
    measured = [seen(m.name, m.frequency.estimate, 0.01, **shape) for m, shape in zip(whirls, shapes, strict=True)]
    found = match_modes(record(*measured, speed=speeds[0]), diagram)
    assert len(found.modes) > 2
    for mode in found.modes:
        (same,) = (one for one in mode.candidates if one.frequency == pytest.approx(mode.frequency.estimate))
        assert same.mac is not None
        assert same.mac[0] == pytest.approx(1.0)


def test_nothing_is_matched_with_nothing():
    assert candidates_of([], MODEL, 0.2) == ()
    (alone,) = candidates_of([seen("a", 1.0)], [], 0.0)
    assert alone.best.name == "unknown"


def test_a_result_without_modes_is_refused_in_one_line():
    with pytest.raises(ConfigurationError, match="expected measured modes, got none in record"):
        ws.match(record(), "nrel5mw")


X, Z, BACKWARD = "tower_x_acceleration", "tower_z_acceleration", "blades_tip_lag_acceleration backward"

TOWER = [
    ModelMode("side-side", 0.315, 0.0, 0.006, 0.0, {X: 1.0, Z: 0.05, BACKWARD: 1.6}),
    ModelMode("fore-aft", 0.322, 0.0, 0.06, 0.0, {X: 0.05, Z: 1.0, BACKWARD: 0.1}),
]


@pytest.mark.parametrize("exchanged", [False, True])
def test_exchanged_axes_are_found_and_said(monkeypatch: pytest.MonkeyPatch, exchanged: bool):
    """As with a nacelle yawed by 90° over sensors below the yaw bearing: the light mode moves what is called z."""
    x, z = (Z, X) if exchanged else (X, Z)
    modes = (
        seen("a", 0.316, 0.007, **{x: 1.0, z: 0.04, BACKWARD: 1.5}),
        seen("b", 0.324, 0.05, **{x: 0.03, z: 1.0, BACKWARD: 0.12}),
    )
    monkeypatch.setattr("windsysid.modal.matching.match._model_modes", lambda *_: ("model", TOWER, 3, []))
    found = match_modes(record(*modes), "model")
    assert [mode.best.name for mode in found.modes] == ["side-side", "fore-aft"]
    assert any("x and z of the sensors are exchanged" in note for note in found.notes) == exchanged


def test_the_nearest_mode_takes_the_name_of_the_turbine_file():
    turbine = ws.load_turbine("nrel5mw")
    name, f, damping = expected_modes(turbine, 0.0)[0]
    channels = ("a", "b")
    found = with_references(
        [operational.mode(1.05 * f), operational.mode(1.01 * f), operational.mode(1.25 * f)], channels, turbine, 0.0
    )
    references = [(one.name, one.frequency.reference, one.damping_ratio.reference) for one in found]
    assert references == [("", None, None), (name, f, damping), ("", None, None)]
    assert [one.candidates[0].name for one in found] == ["unknown", name, "unknown"]
