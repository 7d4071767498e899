"""The spectral formulation from record to result."""

from dataclasses import replace

import numpy as np
import pytest

import windsysid as ws
from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine


@pytest.fixture(scope="module")
def tower_record() -> Record:
    return simulate_record("tower", duration=600.0, rate=20.0, seed=3)


def test_tower_is_found_from_its_spectra(tower_record: Record) -> None:
    found = ws.identify(tower_record, "tower", formulation="spectral", prior=DrawnPrior(seed=3))
    assert found.diagnosis.trusted
    for e in found.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 3.0 * e.std
    assert found["k_side_side"].std < 0.01 * found["k_side_side"].estimate


def test_result_is_saved_and_reported(tower_record: Record, tmp_path: object) -> None:
    found = ws.identify(tower_record, "tower", formulation="spectral")
    files = found.files()
    assert b'"formulation": "spectral"' in files["summary.json"]
    from windsysid.reports.identification import identification_report

    assert b"spectra have no history" in identification_report(found, tower_record)


def test_rotor_under_random_loads_is_found() -> None:
    turbine = load_turbine("verne555")
    record = simulate_record(turbine, duration=60.0, rate=100.0, seed=8)
    found = ws.identify(record, turbine, formulation="spectral", prior=DrawnPrior(seed=8), loads="broadband")
    assert found.diagnosis.trusted
    z = [(e.estimate - e.reference) / e.std for e in found.estimates if e.reference is not None]
    assert len(z) == 10
    assert np.abs(z).max() < 4.0


@pytest.mark.parametrize(("duration", "trusted"), [(100.0, True), (180.0, False)])
def test_rotor_under_wind_is_trusted_for_as_long_as_its_bands_were_proven(duration: float, trusted: bool) -> None:
    record = simulate_record("verne555", duration=duration, rate=100.0, seed=8002, loads="wind")
    found = ws.identify(record, "verne555", formulation="spectral", prior=DrawnPrior(seed=8002), loads="rotor-wind")
    assert found.diagnosis.trusted == trusted
    assert trusted or any("bands under wind were proven for" in reason for reason in found.diagnosis.reasons)


def test_decay_is_not_trusted(tower_record: Record) -> None:
    """What rings down is not stationary: the halves of the record differ."""
    t = tower_record.time
    decay = 3.0 * np.exp(-0.012 * t) * np.cos(2.0 * np.pi * 0.3163 * t)
    channel = "tower_x_acceleration"
    record = tower_record.with_channels({channel: (tower_record[channel] + decay, "m/s^2")})
    found = ws.identify(record, "tower", formulation="spectral")
    assert not found.diagnosis.trusted
    assert any("not stationary" in reason for reason in found.diagnosis.reasons)


def test_record_that_grows_calm_is_not_trusted(tower_record: Record) -> None:
    values = tower_record["tower_z_acceleration"]
    values[6000:] *= 0.2
    found = ws.identify(
        tower_record.with_channels({"tower_z_acceleration": (values, "m/s^2")}), "tower", formulation="spectral"
    )
    assert any("not stationary" in reason for reason in found.diagnosis.reasons)


def test_gaps_are_refused(tower_record: Record) -> None:
    values = tower_record["tower_x_acceleration"]
    values[1000:2000] = np.nan
    record = tower_record.with_channels({"tower_x_acceleration": (values, "m/s^2")})
    with pytest.raises(RecordError, match="expected at most 1 % missing samples"):
        ws.identify(record, "tower", formulation="spectral")


def test_varying_speed_is_refused() -> None:
    record = simulate_record("verne555", duration=40.0, rate=100.0, seed=1)
    speed = 7.288 * (1.0 + 0.05 * np.sin(0.3 * record.time))
    azimuth = np.cumsum(speed) / 100.0
    record = record.with_channels(
        {"rotor_azimuth": (np.mod(azimuth, 2 * np.pi), "rad"), "rotor_speed": (speed, "rad/s")}
    )
    with pytest.raises(RecordError, match="speed varies by"):
        ws.identify(record, "verne555", formulation="spectral")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"loads": "second-order"}, "expected auto, broadband or rotor-wind"),
        ({"loads": "rotor-wind"}, "expected a rotor"),
        ({"rate": 2.0}, "leave the rate out"),
    ],
)
def test_what_does_not_go_with_spectra_is_refused(
    tower_record: Record, options: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        ws.identify(tower_record, "tower", formulation="spectral", **options)  # type: ignore[arg-type]


def test_measured_loads_are_refused(tower_record: Record) -> None:
    record = tower_record.with_channels({"load_fore_aft": (np.zeros(tower_record.samples), "N")})
    with pytest.raises(ConfigurationError, match="takes no measured loads"):
        ws.identify(record, "tower", formulation="spectral")


def test_short_record_is_refused(tower_record: Record) -> None:
    with pytest.raises(RecordError, match="choose a longer record"):
        ws.identify(replace(tower_record).section(0.0, 40.0), "tower", formulation="spectral")
