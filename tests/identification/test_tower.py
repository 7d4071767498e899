"""The commonest record, from the front door: two accelerometers at the tower top and SCADA, nothing on the blades."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from validation.trust import identify_broadband

from tests.findings import notes, only, reasons
from tests.identification.fits import identify_without_effects as identify
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification import identify as front
from windsysid.identification.condition.readings import resample_for_model
from windsysid.identification.model.fit import known_loads
from windsysid.identification.model.prior import Prior
from windsysid.mechanics import Sensor, compile_model
from windsysid.mechanics.sensors import Accelerometer
from windsysid.records.formats import read_record
from windsysid.records.record import LOW_PASS, Record
from windsysid.results.identification import Identification
from windsysid.signals import resample, tower_inputs, with_nacelle_axes
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

SHARED = Path(__file__).parents[3] / "shared" / "data"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the records to run against are not here")
RATE = 8.0


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return load_turbine("tower")


@pytest.fixture(scope="module")
def record(tower: Turbine) -> Record:
    return simulate_record(tower, duration=300.0, rate=RATE, seed=1)


@pytest.fixture(scope="module")
def found(tower: Turbine, record: Record) -> Identification:
    return identify(record, tower)


def right(result: Identification) -> bool:
    """Whether every estimate is within four standard deviations of its reference, and the result trusted."""
    near = [abs(e.estimate - (e.reference or 0.0)) < 4.0 * e.std for e in result.estimates]
    return all(near) and result.diagnosis.trusted


def tower_fixed(bearing: float) -> Sensor:
    return Accelerometer(
        channel=f"tower_{bearing:.0f}_acceleration", point="tower", axis="bearing", frame="tower",
        bearing_deg=bearing, feels_gravity=True, noise=0.005, bias=0.1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def yawing(tower: Turbine) -> Record:
    """Six minutes of which two are spent yawing by 72°, seen by sensors that are fixed to the tower."""
    sensors = [tower_fixed(20.0), tower_fixed(-70.0)]
    model = compile_model(tower.model, sensors)
    time = np.arange(0.0, 420.0, 1.0 / RATE)
    yaw = 0.3 + math.radians(0.6) * np.clip(time - 200.0, 0.0, 120.0)
    yaw_rate = np.where((time > 200.0) & (time < 320.0), math.radians(0.6), 0.0)
    psi, rng = tower.rotor_speed * time, np.random.default_rng(3)
    loads = draw_loads(tower.loads, model.loads, len(time), RATE, rng, psi)
    inputs = np.column_stack([psi, np.full_like(time, tower.rotor_speed), yaw, yaw_rate, 0.0 * time, loads])
    p = [tower.values[name] for name in model.parameters]
    read = integrate(model, p, inputs, rate=RATE, start=np.zeros(4)).readings
    read += 0.005 * rng.standard_normal(read.shape)
    late = slice(round(60.0 * RATE), None)
    return Record(
        time[late] - 60.0,
        np.column_stack([np.mod(psi, 2 * math.pi), np.mod(yaw, 2 * math.pi), read])[late],
        ("rotor_azimuth", "nacelle_yaw", *(s.channel for s in sensors)),
        ("rad", "rad", "m/s^2", "m/s^2"),
    )


def test_two_accelerometers_identify_both_directions(found: Identification):
    assert [e.name for e in found.estimates] == ["k_side_side", "c_side_side", "k_fore_aft", "c_fore_aft"]
    assert right(found)
    assert [mode.name for mode in found.modes] == ["tower side-side", "tower fore-aft"]
    assert found["k_side_side"].unit == "N/m"
    assert found["c_fore_aft"].unit == "N*s/m"
    assert found["k_side_side"].informed_by_data > 0.99
    assert {"load_rms_side_side", "load_rms_fore_aft_3P", "load_time_constant_3P"} <= {s.name for s in found.statistics}


def test_what_is_faster_than_the_tower_is_left_out(found: Identification, record: Record, tower: Turbine):
    # Twelve samples for each period of 0.324 Hz.
    assert found.rate == pytest.approx(12 * 0.324)
    assert notes(found)[0].code == "resampled"
    rates = {"recorded": pytest.approx(8.0), "rate": pytest.approx(found.rate)}
    assert notes(found)[0].data == rates | {"lost_mode": None, "steps": 2}
    with pytest.raises(ConfigurationError, match=r"rate: expected more than 0 and at most the record's 8 Hz, got 20"):
        identify(record, tower, rate=20.0)


def test_loads_of_a_record_slowed_down_go_through_its_low_pass(tower: Turbine, record: Record):
    slowed, _, _ = resample_for_model(record, tower, None, tower.sensors)
    passed = {load.low_pass for load in known_loads(slowed, tower)[1]}
    assert passed == {float(slowed.attributes[LOW_PASS])}
    assert passed.pop() == pytest.approx(6 * 0.324, rel=1e-3)  # half of twelve samples for each period


@pytest.mark.slow
def test_a_record_slowed_down_keeps_its_damping(tower: Turbine):
    # From 20 Hz to twelve samples per period: two records of ten minutes, errors over their own standard deviations.
    # Without the load's low-pass fore-aft damping averages −3.
    errors = []
    for seed in range(2):
        slowed = identify(simulate_record(tower, duration=600.0, rate=20.0, seed=seed), tower)
        assert slowed.rate < 4.0
        errors.append([(e.estimate - e.reference) / e.std for e in slowed.estimates if e.reference])
    assert np.all(np.abs(np.mean(errors, axis=0)) < 3.3 / math.sqrt(2.0))


@pytest.mark.slow
def test_a_record_without_azimuth_speed_and_yaw_will_do(found: Identification, record: Record, tower: Turbine):
    # The azimuth serves the blade-passing line alone, whose phase is unknown anyway; the usual speed is the record's
    # here.
    bare = identify(record.select(["tower_x_acceleration", "tower_z_acceleration"]), tower)
    assert right(bare)
    for e in found.estimates:
        assert bare[e.name].estimate == pytest.approx(e.estimate, abs=0.2 * e.std)


@pytest.mark.slow
def test_mass_scales_what_is_found_and_no_frequency(found: Identification, record: Record, tower: Turbine):
    # k, c and loads scale with the modal mass, and the band with them; what is seen is k/m and c/m.
    factor = 2.0
    names = [name for name in tower.values if name.startswith(("mass_", "k_", "c_"))]
    heavy = tower.with_values({name: factor * tower.values[name] for name in names})
    heavy = replace(heavy, loads=tuple(replace(load, rms=factor * load.rms) for load in tower.loads))
    result = identify(record, heavy)
    for e in found.estimates:
        assert result[e.name].estimate == pytest.approx(factor * e.estimate, rel=1e-3)
        assert result[e.name].std == pytest.approx(factor * e.std, rel=1e-2)
    for mode, other in zip(found.modes, result.modes, strict=True):
        one, same = mode.frequency, other.frequency
        assert (one.estimate, one.low, one.high) == pytest.approx((same.estimate, same.low, same.high), rel=1e-4)


@pytest.mark.slow
def test_sensors_that_do_not_yaw_are_turned_by_the_record_s_own_yaw(yawing: Record, tower: Turbine):
    inside = identify(yawing, tower, sensors=[tower_fixed(20.0), tower_fixed(-70.0)])
    assert right(inside)
    # An independent way: signals turned into the nacelle's axes beforehand. Offsets turn along there, so not to the
    # digit.
    turned = with_nacelle_axes(yawing, "tower_20_acceleration", "tower_-70_acceleration", bearing=math.radians(20.0))
    before = identify(turned, tower)
    for e in inside.estimates:
        assert before[e.name].estimate == pytest.approx(e.estimate, abs=0.3 * e.std)


@pytest.mark.slow
def test_one_sensor_fixed_to_the_tower_sees_both_directions_while_the_nacelle_yaws(yawing: Record, tower: Turbine):
    result = identify(yawing, tower, sensors=[tower_fixed(20.0)])
    assert [e.name for e in result.estimates] == ["k_side_side", "c_side_side", "k_fore_aft", "c_fore_aft"]
    assert right(result)


def test_a_sensor_fixed_to_the_tower_needs_the_yaw(yawing: Record, tower: Turbine):
    without = yawing.select([name for name in yawing.channels if name != "nacelle_yaw"])
    with pytest.raises(RecordError, match="expected a channel 'nacelle_yaw'"):
        identify(without, tower, sensors=[tower_fixed(20.0)])


def test_a_direction_without_a_sensor_is_locked(record: Record, tower: Turbine):
    part = record.select(["rotor_speed", "tower_x_acceleration"]).section(0.0, 100.0)
    result = identify(part, tower, loads="broadband")
    assert [e.name for e in result.estimates] == ["k_side_side", "c_side_side"]
    assert only(result.findings, "coordinate_locked").data == {"coordinate": "fore_aft"}


def test_the_force_balance_wants_blades(record: Record, tower: Turbine):
    with pytest.raises(ConfigurationError, match="turbine 'tower' is of the kind 'tower': expected a rotor"):
        identify(record, tower, formulation="force-balance")


def test_inputs_come_from_what_is_recorded():
    time = np.arange(0.0, 100.0, 0.1)
    speed, yaw = 1.0 + 0.2 * np.sin(0.1 * time), 3.0 + 0.01 * time
    channels = {"rotor_speed": (speed, "rad/s"), "nacelle_yaw": (np.mod(yaw, 2 * math.pi), "rad")}
    record = Record(time, np.empty((1000, 0)), (), ()).with_channels(channels)
    inputs = tower_inputs(record, 2.0, needs_yaw=True)
    np.testing.assert_allclose(inputs[:, 0], time + 2.0 * (1.0 - np.cos(0.1 * time)), atol=1e-3)
    np.testing.assert_array_equal(inputs[:, 1], speed)
    np.testing.assert_allclose(inputs[:, 2:] - np.column_stack([yaw, 0.01 + 0 * time, 0 * time]), 0.0, atol=1e-9)
    usual = tower_inputs(record.select(["nacelle_yaw"]), 2.0, needs_yaw=False)
    np.testing.assert_allclose(usual[:, 0], 2.0 * time, atol=1e-9)


def test_a_rotor_that_stands_still_is_no_mistake(tower: Turbine):
    time = np.arange(0.0, 100.0, 0.1)
    channels = {"rotor_speed": (0.0 * time, "rad/s"), "rotor_azimuth": (0.0 * time + 1.0, "rad")}
    parked = Record(time, np.empty((1000, 0)), (), ()).with_channels(channels)
    assert not tower_inputs(parked, tower.rotor_speed, needs_yaw=False).any()


def test_a_yaw_in_steps_is_smoothed_and_a_wrong_unit_refused():
    time = np.arange(0.0, 200.0, 0.1)
    yaw = math.radians(0.5) * np.clip(time - 50.0, 0.0, 100.0)
    steps = math.radians(1.0) * np.round(yaw / math.radians(1.0))
    record = Record(time, steps[:, None], ("nacelle_yaw",), ("rad",))
    inputs = tower_inputs(record, 1.0, needs_yaw=True)
    middle = (time > 60.0) & (time < 140.0)
    assert np.abs(inputs[middle, 3] / math.radians(0.5) - 1.0).max() < 0.15
    with pytest.raises(RecordError, match="channel 'nacelle_yaw': expected rad, got 1"):
        tower_inputs(Record(time, steps[:, None], ("nacelle_yaw",), ("1",)), 1.0, needs_yaw=True)


@needs_shared
@pytest.mark.parametrize(
    ("name", "frequency"),
    [("c2_turb12_full", 0.3153), ("d1_turb12_full_KSS090", 0.2986)],
)
@pytest.mark.slow
def test_an_independent_simulation_in_turbulent_wind_is_found_and_trusted(tower: Turbine, name: str, frequency: float):
    # OpenFAST with everything moving; truth from its linearisation: frequency at 12.1 rpm, damping 0.566 % in steady 12
    # m/s.
    pytest.importorskip("openfast_io", reason="reading OpenFAST files needs openfast_io")
    record = read_record(SHARED / "openfast" / f"{name}.outb").select(["tower_x_acceleration", "tower_z_acceleration"])
    result = identify(record, tower, section=(60.0, 360.0))
    assert result.diagnosis.trusted, result.diagnosis.reasons
    f, z = result.modes[0].frequency, result.modes[0].damping_ratio
    assert f.low < frequency < f.high
    assert f.high - f.low < 0.004
    assert z.low < 0.00566 < z.high


@pytest.mark.slow
@needs_shared
def test_without_the_blade_passing_line_the_same_record_is_not_trusted(tower: Turbine):
    pytest.importorskip("openfast_io", reason="reading OpenFAST files needs openfast_io")
    record = resample(read_record(SHARED / "openfast" / "c2_turb12_full.outb").section(60.0, 600.0), 12 * 0.324)
    result = identify_broadband(record, replace(tower.exact(), loads=tower.loads[:2]), Prior())
    assert result.modes[0].frequency.low > 0.3153  # its bands do not hold the tower
    assert not result.diagnosis.trusted


@pytest.mark.slow
def test_spectra_doubt_themselves_where_blades_pass_the_tower_at_its_mode():
    """At 6.2 rpm 3P is at 0.31 Hz, 2 % from the side-side mode: filters, which know that load, are asked."""
    tower = load_turbine("tower")
    slow = replace(tower, rotor_speed=6.2 / RPM)
    record = simulate_record(slow, duration=600.0, rate=20.0, seed=3)
    spectral = identify(record, slow, formulation="spectral")
    assert not spectral.diagnosis.trusted
    passing = reasons(spectral)[0]
    assert passing.code == "blade_passing_near_mode"
    assert passing.data["frequency"] == pytest.approx(0.31, abs=0.001)
    found = front.identify(record, slow)
    assert found.formulation == "joint"
    assert found.diagnosis.trusted
    assert max(abs(e.estimate - tower.values[e.name]) / e.std for e in found.estimates) < 3.0


def test_a_record_of_six_samples_says_how_many_are_needed():
    values = np.random.default_rng(6).standard_normal((6, 2))
    channels = ("tower_x_acceleration", "tower_z_acceleration")
    record = Record(0.05 * np.arange(6.0), values, channels, ("m/s^2", "m/s^2"), name="short")
    with pytest.raises(RecordError, match=r"short: 6 samples in 0\.25 s are too few: expected at least 103 at 20 Hz"):
        identify(record, load_turbine("tower"))
