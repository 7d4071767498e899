"""The spectral formulation from record to result."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from validation.adversary.scenarios import record
from validation.tolerances import Errors, record_of

import windsysid as ws
from tests.findings import codes, reasons
from tests.identification.fits import identify_without_effects, std_of_model
from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine


@pytest.fixture(scope="module")
def tower_record() -> Record:
    return simulate_record("tower", duration=600.0, rate=20.0, seed=5)


def test_tower_is_found_from_its_spectra(tower_record: Record) -> None:
    tower = load_turbine("tower").exact()
    found = ws.identify(tower_record, tower, formulation="spectral", prior=DrawnPrior(seed=3))
    assert found.diagnosis.trusted
    assert found.tolerances == ()
    for e in found.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 3.0 * e.std
    assert found["k_side_side"].std < 0.01 * found["k_side_side"].estimate


def test_masses_that_are_known_to_two_per_cent_widen_the_band_of_a_stiffness_by_as_much(tower_record: Record) -> None:
    """A vibration shows k/m: var(ln k) grows by the variance of ln m, and what a frequency needs stays."""
    exact = load_turbine("tower").exact()
    known = ws.identify(tower_record, exact, formulation="spectral")
    found = ws.identify(tower_record, replace(exact, mass_tolerance=0.02), formulation="spectral")
    assert [one.name for one in found.tolerances] == ["masses of top"]
    assert found.tolerances[0].std == pytest.approx(0.02, rel=0.02)  # the size of the loads is learned
    for name in ("k_side_side", "k_fore_aft"):
        i = [q.name for q in found.parameters].index(name)
        assert found.cov[i, i] == pytest.approx(known.cov[i, i] + 0.02**2, rel=0.05)
        assert found[name].estimate == pytest.approx(known[name].estimate, rel=2e-3)
    for one, other in zip(found.modes, known.modes, strict=True):
        assert one.frequency.std == pytest.approx(other.frequency.std, rel=0.02)
    row = next(row for row in found.budget.rows if row.name == "k_side_side")
    shares = dict(zip(found.budget.causes, row.causes, strict=True))
    assert row.alone + sum(shares.values()) == pytest.approx(1.0)
    # levels of loads are known relative to masses: what both explain is shared between them
    assert shares["masses"] < 0.02**2 / found.cov[0, 0] < 1.05 * (shares["masses"] + shares["load statistics"])


@pytest.mark.slow
def test_filters_and_spectra_know_instruments_and_masses_alike(tower_record: Record) -> None:
    record = tower_record.section(0.0, 300.0)
    joint, spectral = (
        identify_without_effects(record, "tower", formulation=formulation) for formulation in ("joint", "spectral")
    )
    assert [one.name for one in spectral.tolerances] == [one.name for one in joint.tolerances]
    assert spectral.joint_cov is not None
    assert len(spectral.joint_cov) == len(spectral.parameters) + len(spectral.statistics) + len(spectral.tolerances)
    for e, other in zip(spectral.estimates, joint.estimates, strict=True):
        assert e.std == pytest.approx(other.std, rel=0.4)
        assert abs(e.estimate - other.estimate) < 1.5 * other.std
    for one, known in zip(spectral.tolerances, joint.tolerances, strict=True):
        if one.group != "alignment":  # a tower's filters also read what lies between its bands
            assert one.std == pytest.approx(known.std, rel=0.1)
            assert abs(one.estimate - known.estimate) < 0.2 * one.spread


@pytest.mark.slow
def test_an_axis_and_a_clock_that_are_off_are_found_and_said() -> None:
    turbine = load_turbine("verne555")
    record = record_of(turbine, Errors(turn={0: np.radians(5.0)}, late={"rotor": 0.002}), 91_700)
    options: dict[str, Any] = {"formulation": "spectral", "prior": DrawnPrior(seed=5), "loads": "broadband"}
    found = identify_without_effects(record, turbine, **options)
    off = {one.name: one for one in found.tolerances}
    axis, clock = off["alignment of tower_x_acceleration"], off["clock of rotor"]
    assert axis.off
    assert abs(axis.estimate - np.radians(5.0)) < 3.0 * axis.std
    assert clock.off
    assert abs(clock.estimate - 0.002) < 3.0 * clock.std
    said = [one.data for one in found.findings if one.code == "tolerance_off"]
    assert ("clock", "rotor") in [(one["group"], one["of"]) for one in said]
    for e in found.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 3.0 * e.std
    exact = identify_without_effects(record, turbine.exact(), **options)
    errors = [(e.estimate - e.reference) / std_of_model(exact, e.name) for e in exact.estimates if e.reference]
    assert max(np.abs(errors)) > 3.0


def test_a_prior_on_the_wrong_side_of_no_damping_does_not_end_at_the_mirror_image(tower_record: Record) -> None:
    """A spectrum says the size of a damping and not its sign."""
    tower = load_turbine("tower").exact()
    found = ws.identify(tower_record, tower, formulation="spectral", prior=DrawnPrior(seed=91_005))
    assert found.parameters[1].centre < 0.0
    assert found["c_side_side"].estimate > 0.0
    assert found.diagnosis.trusted


@pytest.mark.slow
def test_intervals_hold_in_records_in_which_a_resonance_is_narrower_than_a_bin() -> None:
    """With independent bins, one frequency in twelve was 3.6 to 13 σ off."""
    tower = ws.load_turbine("tower")
    record, errors = ws.simulate(tower, duration=1200.0, rate=4.0, seed=77), []
    for start in np.arange(0.0, 1200.0, 120.0):
        part = record.section(start, start + 119.75)
        found = identify_without_effects(part, tower, formulation="spectral")
        one = found.modes[0].frequency if "side" in found.modes[0].name else found.modes[1].frequency
        assert one.grade in "AB"
        errors.append((one.estimate - 0.3163) / ((one.high - one.low) / 4.0))
    assert np.max(np.abs(errors)) < 3.0
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.slow
def test_a_rotor_that_idles_leaves_all_frequencies_to_spectra() -> None:
    """At 0.6 rpm a harmonic was left out around each hundredth of a hertz: with it the whole spectrum."""
    tower = replace(ws.load_turbine("tower"), rotor_speed=0.063)
    record = ws.simulate(tower, duration=400.0, rate=4.0, seed=78)
    found = ws.identify(record, tower, formulation="spectral")
    assert found.diagnosis.trusted
    for e in found.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 3.0 * e.std


def test_result_is_saved_and_reported(tower_record: Record, tmp_path: object) -> None:
    found = ws.identify(tower_record, "tower", formulation="spectral")
    files = found.files()
    assert b'"formulation": "spectral"' in files["summary.json"]
    from windsysid.reports.identification import identification_report

    assert b"Online estimates" not in identification_report(found, tower_record)  # spectra have no history


@pytest.mark.slow
def test_rotor_under_random_loads_is_found() -> None:
    turbine = load_turbine("verne555")
    record = simulate_record(turbine, duration=60.0, rate=100.0, seed=8)
    found = ws.identify(record, turbine, formulation="spectral", prior=DrawnPrior(seed=8), loads="broadband")
    assert found.diagnosis.trusted
    z = [(e.estimate - e.reference) / e.std for e in found.estimates if e.reference is not None]
    assert len(z) == 10
    assert np.abs(z).max() < 4.0


@pytest.mark.parametrize(("duration", "trusted"), [pytest.param(100.0, True, marks=pytest.mark.slow), (180.0, False)])
def test_rotor_under_wind_is_trusted_for_as_long_as_its_bands_were_proven(duration: float, trusted: bool) -> None:
    record = simulate_record("verne555", duration=duration, rate=100.0, seed=8002, loads="wind")
    options: dict[str, Any] = {"prior": DrawnPrior(seed=8002), "loads": "rotor-wind"}
    found = identify_without_effects(record, "verne555", formulation="spectral", **options)
    assert found.diagnosis.trusted == trusted
    assert trusted or "long_record_under_wind" in codes(reasons(found))


def test_decay_is_not_trusted(tower_record: Record) -> None:
    """What rings down is not stationary: the halves of the record differ."""
    t = tower_record.time
    decay = 10.0 * np.exp(-0.012 * t) * np.cos(2.0 * np.pi * 0.3163 * t)
    channel = "tower_x_acceleration"
    record = tower_record.with_channels({channel: (tower_record[channel] + decay, "m/s^2")})
    found = ws.identify(record, "tower", formulation="spectral")
    assert not found.diagnosis.trusted
    assert "nonstationary" in codes(reasons(found))


def test_record_that_grows_calm_is_not_trusted(tower_record: Record) -> None:
    values = tower_record["tower_z_acceleration"]
    values[6000:] *= 0.2
    found = ws.identify(
        tower_record.with_channels({"tower_z_acceleration": (values, "m/s^2")}), "tower", formulation="spectral"
    )
    assert "nonstationary" in codes(reasons(found))


def test_gaps_are_refused(tower_record: Record) -> None:
    values = tower_record["tower_x_acceleration"]
    values[1000:2000] = np.nan
    record = tower_record.with_channels({"tower_x_acceleration": (values, "m/s^2")})
    with pytest.raises(RecordError, match="expected at most 2 % missing or faulty samples"):
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
        ({"loads": "second-order"}, "expected auto, broadband, narrow-band or rotor-wind"),
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


def test_short_record_is_refused_for_its_length_and_for_no_rate(tower_record: Record) -> None:
    for formulation in ("auto", "joint"):
        with pytest.raises(RecordError, match=r"60 samples in 2\.95 s are too few: expected at least 103"):
            ws.identify(tower_record.section(0.0, 3.0), "tower", formulation=formulation)


def test_short_record_is_refused(tower_record: Record) -> None:
    with pytest.raises(RecordError, match="choose a longer record"):
        ws.identify(replace(tower_record).section(0.0, 20.0), "tower", formulation="spectral")


@pytest.mark.slow
def test_five_readings_for_each_period_of_the_fastest_mode_are_enough() -> None:
    """Spectra were refused below ten and a half, which filters need and spectra do not."""
    turbine = load_turbine("verne555")
    found = ws.identify(record("20 Hz", 110406), turbine, formulation="spectral", prior=DrawnPrior(seed=110406))
    assert found.diagnosis.trusted
    assert all(abs(e.estimate - turbine.values[e.name]) < 3.0 * e.std for e in found.estimates)
