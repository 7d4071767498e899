"""A mechanical model, a load hypothesis and a sensor that stand in one file outside the package
(`examples/own_turbine_model.py`)."""

import importlib.util
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import windsysid as ws
from tests.conftest import registers_as_before
from windsysid.errors import ConfigurationError
from windsysid.loads.family import candidates
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.mechanics.sensor_lists import as_sensor

FILE = Path(__file__).parents[1] / "examples" / "own_turbine_model.py"


@pytest.fixture(scope="module")
def own() -> Iterator[Any]:
    """The example, registered for the tests of this file."""
    with registers_as_before():
        spec = importlib.util.spec_from_file_location("own_turbine_model", FILE)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        vars(module)["turbine"] = vars(module)["turbine"].exact()
        yield module


@pytest.fixture(scope="module", params=[1, pytest.param(3, marks=pytest.mark.slow)])
def results(own: Any, request: pytest.FixtureRequest) -> list[tuple[ws.Record, ws.results.Identification]]:
    return [own.identify_waves(seed) for seed in range(request.param)]


def modes_by_hand(values: dict[str, float]) -> list[tuple[float, float]]:
    """Frequency [Hz] and damping ratio from mass, stiffness and damping matrices put together here."""
    m_t, k_t, c_t, m_d, k_d, c_d = (values[f"{letter}_{part}"] for part in ("tower", "damper") for letter in "mkc")
    mass = np.diag([m_t, m_d])
    stiffness = np.array([[k_t + k_d, -k_d], [-k_d, k_d]])
    damping = np.array([[c_t + c_d, -c_d], [-c_d, c_d]])
    inverse = np.linalg.inv(mass)
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    found = np.linalg.eigvals(system)
    found = found[found.imag > 0.0]
    return sorted((float(abs(s)) / (2.0 * math.pi), float(-s.real / abs(s))) for s in found)


def test_the_truth_is_within_the_bands(own: Any, results: list[tuple[ws.Record, ws.results.Identification]]):
    """Of twelve ±2σ bands 0.55 should miss, three or more with a probability of 2 %; beyond 4σ none."""
    assert all(result.diagnosis.trusted for _, result in results)
    off = np.array([[(e.estimate - own.TRUTH[e.name]) / e.std for e in result.estimates] for _, result in results])
    assert [e.name for e in results[0][1].estimates] == ["k_tower", "c_tower", "k_damper", "c_damper"]
    assert [(e.unit, e.kind) for e in results[0][1].estimates][:2] == [("N/m", "stiffness"), ("N*s/m", "damping")]
    assert (np.abs(off) > 2.0).sum() < 3
    assert np.abs(off).max() < 4.0


def test_what_the_record_tells_is_told_and_not_the_prior(results: list[tuple[ws.Record, ws.results.Identification]]):
    for _, result in results:
        told = {e.name: e.informed_by_data for e in result.estimates}
        assert min(told["k_tower"], told["k_damper"], told["c_damper"]) > 0.9
        statistics = {s.name: s for s in result.statistics}
        assert {"load_rms_waves", "load_peak", "load_peak_damping", "noise_tower_stroke"} <= set(statistics)
        for name, truth in (("load_rms_waves", 30e3), ("load_peak", 0.12), ("noise_tower_stroke", 0.002)):
            low, high = statistics[name].low, statistics[name].high
            assert low * (low / high) < truth < high * (high / low)  # ±6σ of a logarithm


def test_the_modes_are_those_of_matrices_written_by_hand(
    own: Any, results: list[tuple[ws.Record, ws.results.Identification]]
):
    truth = modes_by_hand(own.TRUTH)
    for _, result in results:
        found = modes_by_hand(own.TRUTH | {e.name: e.estimate for e in result.estimates})
        assert [mode.name for mode in result.modes] == ["damper", "tower"]
        for mode, (frequency, ratio), (true_frequency, true_ratio) in zip(result.modes, found, truth, strict=True):
            assert mode.frequency.estimate == pytest.approx(frequency, rel=1e-9)
            assert mode.damping_ratio.estimate == pytest.approx(ratio, rel=1e-9)
            for one, true in ((mode.frequency, true_frequency), (mode.damping_ratio, true_ratio)):
                assert abs(one.estimate - true) < 4.0 * one.std


def test_the_result_says_what_the_hypothesis_warns_of(results: list[tuple[ws.Record, ws.results.Identification]]):
    assert "waves were taken for one peak: a swell beside a wind sea needs two" in results[0][1].notes


def test_a_saved_result_has_its_report_and_comes_back_whole(
    own: Any, results: list[tuple[ws.Record, ws.results.Identification]], tmp_path: Path
):
    record, result = results[0]
    own.save(record, result, tmp_path / "result")
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "k_tower" in page
    assert "waves on the tower" in page
    again = ws.results.load_posterior(tmp_path / "result")
    assert again.turbine.model == own.DampedTower()
    assert again.turbine.sensors == own.turbine.sensors
    assert again.turbine.values == pytest.approx(own.TRUTH | {e.name: e.estimate for e in result.estimates})
    compared = ws.compare(again, again)
    assert (compared.coefficients[0].name, compared.coefficients[0].unit) == ("k_tower", "N/m")
    diagram = ws.modes(again)
    assert [curve.name for curve in diagram.curves] == ["damper", "tower"]


def test_a_turbine_file_holds_the_model(own: Any, tmp_path: Path):
    ws.write_turbine(own.turbine, tmp_path / "own.toml")
    again = ws.load_turbine(tmp_path / "own.toml")
    assert again == own.turbine
    text = (tmp_path / "own.toml").read_text(encoding="utf-8")
    for old, new, complaint in (
        ("damped-tower", "monopile", "model.kind: expected 'rotor' or 'tower' or 'damped-tower', got 'monopile'"),
        ("k_damper = ", "k_dmaper = ", r"\[values\]: expected m_tower, k_tower, .*, got m_tower, .*k_dmaper"),
        ("64000.0 N/m", "64000.0 N", "values.k_damper: expected a unit of the same quantity as N/m, got '64000.0 N'"),
        ("30000.0 N", "30000.0 N*m", "rms of load_tower: expected a unit of the same quantity as N, got"),
        (
            'kind = "damped-tower"',
            'kind = "damped-tower"\nfree = "no"',
            "model: unknown key 'free': expected some of none",
        ),
    ):
        (tmp_path / "bad.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(ConfigurationError, match=complaint) as caught:
            ws.load_turbine(tmp_path / "bad.toml")
        assert "\n" not in str(caught.value)


def test_the_record_chooses_between_the_simplest_and_the_newcomer(own: Any, verne555: ws.Turbine):
    assert candidates(own.turbine, own.turbine.loads) == ("broadband", "waves")
    assert candidates(verne555, verne555.loads) == ("broadband", "rotor-wind")
    assert HYPOTHESES["waves"].text == "waves on the tower"


def test_a_sensor_of_ones_own_is_known_to_sensor_lists(own: Any):
    table = {"channel": "s", "quantity": "stroke", "noise": 0.1}
    assert as_sensor(table) == own.StrokeSensor(channel="s", noise=0.1)
    with pytest.raises(ConfigurationError, match="unknown key 'point'"):
        as_sensor(table | {"point": "tower"})
    with pytest.raises(ConfigurationError, match=r"quantity: expected one of acceleration, .*, stroke, got 'strok'"):
        as_sensor(table | {"quantity": "strok"})


def test_a_record_in_another_unit_is_refused(own: Any, results: list[tuple[ws.Record, ws.results.Identification]]):
    record = results[0][0].with_channels({"damper_stroke": (np.zeros(results[0][0].samples), "m/s")})
    with pytest.raises(ws.RecordError, match="channel 'damper_stroke': expected m for stroke, got m/s"):
        ws.identify(record, own.turbine)
