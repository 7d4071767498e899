"""Integration without drift, filters without phase, and the rotor's azimuth from what was recorded."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from windsysid.errors import RecordError
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.signals import band_pass, integrate, rotor_inputs
from windsysid.signals.azimuth import MIN_GLITCH_RADIANS, steadied

DECAY = Path(__file__).parents[3] / "shared" / "data" / "openfast" / "a2_rot12_decay_min.outb"
needs_decay = pytest.mark.skipif(not DECAY.is_file(), reason="the OpenFAST records are not beside this checkout")

RATE = 100.0
TIME = np.arange(60_000) / RATE
TONES = ((0.5, 1.0, 0.3), (1.3, 0.7, 1.0), (2.7, 2.0, 2.0), (6.0, 5.0, -0.5))  # Hz, amplitude, phase
CUTOFF = 0.1


def tones(order: int) -> np.ndarray:
    """The sum of sines (0), its integral (1) or double integral (2), each with zero mean."""
    waves = [
        a * np.sin(2 * np.pi * f * TIME + phase - order * np.pi / 2) / (2 * np.pi * f) ** order for f, a, phase in TONES
    ]
    return np.asarray(np.sum(waves, axis=0))


def interior(seconds: float) -> slice:
    """What is left of a record without so many seconds at either end."""
    return slice(round(seconds * RATE), -round(seconds * RATE))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# integration


def test_integration_of_sines_above_the_cutoff_is_exact_in_the_interior():
    # The lowest tone lies at five times the cut-off: the power gain is 1 - 5^-8 = 1 - 3e-6. Ends ring for five periods.
    motion = integrate(tones(0), RATE, cutoff=CUTOFF)
    inside = interior(5.0 / CUTOFF)
    for got, order in ((motion.velocity, 1), (motion.displacement, 2)):
        exact = tones(order)
        assert np.abs(got - exact)[inside].max() < 1e-3 * exact.std()


def test_integration_does_not_drift_where_the_trapezoidal_rule_does():
    # A bias of 0.01 m/s² and white noise of 0.05 m/s², as accelerometers have; 600 s. White noise of density σ²/RATE,
    # twice integrated above f_c, leaves a displacement of rms σ √(2 / (3 RATE (2π)⁴ f_c³)): 3.3 mm here, 4 % of the
    # motion.
    noisy = tones(0) + 0.01 + 0.05 * np.random.default_rng(0).standard_normal(len(TIME))
    motion = integrate(noisy, RATE, cutoff=CUTOFF)
    expected = 0.05 * np.sqrt(2.0 / (3.0 * RATE * (2 * np.pi) ** 4 * CUTOFF**3))
    inside = interior(5.0 / CUTOFF)
    assert rms((motion.displacement - tones(2))[inside]) < 1.5 * expected
    assert rms((motion.velocity - tones(1))[inside]) < 0.02 * rms(tones(1))

    velocity = cumulative_trapezoid(noisy, dx=1.0 / RATE, initial=0)
    displacement = cumulative_trapezoid(velocity - velocity.mean(), dx=1.0 / RATE, initial=0)
    assert rms((velocity - velocity.mean() - tones(1))[inside]) > rms(tones(1))  # 5 times the motion itself
    assert rms((displacement - displacement.mean() - tones(2))[inside]) > 100.0 * rms(tones(2))  # 1 300 times


def test_integration_removes_what_lies_below_the_cutoff():
    slow = np.sin(2 * np.pi * 0.3 * CUTOFF * TIME)
    motion = integrate(slow, RATE, cutoff=CUTOFF)
    gain = 0.3**8  # power gain of a fourth-order Butterworth high-pass, far below its cut-off
    w = 2 * np.pi * 0.3 * CUTOFF
    assert np.abs(motion.displacement[interior(150.0)]).max() == pytest.approx(gain / w**2, rel=0.05)


@needs_decay
def test_integrated_openfast_acceleration_is_the_simulators_displacement():
    # Above the cut-off (both sides through the same gain), 20 s from the ends: 0.4 % of the displacement, 0.2 % of the
    # velocity with a cut-off of 0.1 Hz, a third of the tower's 0.3155 Hz; from 50 s on, 5e-5.
    record = read_record(DECAY)
    motion = integrate(record["tower_x_acceleration_kinematic"], record.rate, cutoff=0.1)
    for got, channel in ((motion.displacement, "tower_x_displacement"), (motion.velocity, "tower_x_velocity")):
        truth = band_pass(record[channel], record.rate, (0.1, record.rate / 2.0))
        for seconds, bound in ((20.0, 5e-3), (50.0, 1e-4)):
            inside = interior(seconds)
            assert rms((got - truth)[inside]) < bound * rms(truth[inside]), f"{channel}, {seconds} s from the ends"


# band-pass


def response(frequency: float, band: tuple[float, float]) -> complex:
    """Complex gain of `band_pass` at one frequency."""
    passed = band_pass(np.sin(2 * np.pi * frequency * TIME + 0.4), RATE, band)
    inside = interior(50.0)  # a whole number of periods for multiples of 0.1 Hz
    return complex(2j * np.mean((passed * np.exp(-1j * (2 * np.pi * frequency * TIME + 0.4)))[inside]))


@pytest.mark.parametrize("frequency", [0.2, 0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 6.0])
def test_the_band_pass_has_no_phase_and_the_power_gain_of_butterworth_filters(frequency):
    # The amplitude passes with the power gain of a fourth-order Butterworth filter, as if it ran forward and backward.
    low, high = 0.5, 3.0
    gain = response(frequency, (low, high))
    expected = 1.0 / (1.0 + (low / frequency) ** 8) / (1.0 + (frequency / high) ** 8)
    assert gain.real == pytest.approx(expected, abs=1e-6)
    assert abs(gain.imag) < 1e-6


@pytest.mark.parametrize("edge", [0.5, 3.0])
def test_half_the_amplitude_passes_at_the_edges_of_the_band(edge):
    # Half power a pass, two passes: half the amplitude (a quarter of the power).
    assert abs(response(edge, (0.5, 3.0))) == pytest.approx(0.5, abs=1e-6)


def test_the_band_pass_is_symmetric_in_time():
    values = np.random.default_rng(1).standard_normal(3001)
    np.testing.assert_allclose(
        band_pass(values[::-1], RATE, (1.0, 20.0))[::-1], band_pass(values, RATE, (1.0, 20.0)), atol=1e-12
    )


# missing samples


def test_missing_samples_stay_missing_and_are_bridged_for_their_neighbours():
    whole = tones(0)
    holed = whole.copy()
    holed[[12_345, 30_000, 30_001, 45_678]] = np.nan  # gaps of at most 0.03 s in tones of up to 6 Hz
    inside = interior(50.0)
    motion, truth = integrate(holed, RATE, cutoff=CUTOFF), integrate(whole, RATE, cutoff=CUTOFF)
    passed, expected = band_pass(holed, RATE, (0.2, 10.0)), band_pass(whole, RATE, (0.2, 10.0))
    for got, exact in (
        (motion.velocity, truth.velocity),
        (motion.displacement, truth.displacement),
        (passed, expected),
    ):
        np.testing.assert_array_equal(np.isnan(got), np.isnan(holed))
        difference = (got - exact)[inside]
        assert np.nanmax(np.abs(difference)) < 0.02 * exact.std()


def test_missing_samples_at_the_ends_are_no_trouble():
    holed = tones(0)
    holed[:300] = holed[-200:] = np.nan
    motion = integrate(holed, RATE, cutoff=CUTOFF)
    assert np.isnan(motion.velocity[:300]).all()
    assert np.isfinite(motion.velocity[300:-200]).all()


def test_filters_leave_their_argument_alone():
    values = tones(0)
    integrate(values, RATE, cutoff=CUTOFF)
    band_pass(values, RATE, (0.2, 10.0))
    np.testing.assert_array_equal(values, tones(0))


def test_a_channel_without_numbers_is_refused():
    nothing = np.full(100, np.nan)
    with pytest.raises(RecordError, match="expected numbers, got none"):
        integrate(nothing, RATE, cutoff=1.0)
    with pytest.raises(RecordError, match="expected numbers, got none"):
        band_pass(nothing, RATE, (1.0, 2.0))


@pytest.mark.parametrize(
    "band", [(0.0, 3.0), (-1.0, 3.0), (3.0, 3.0), (3.0, 1.0), (1.0, 50.1), (np.nan, 3.0), (1.0, np.nan)]
)
def test_a_band_that_is_none_is_refused(band):
    with pytest.raises(RecordError, match=r"expected 0 < low < high ≤ 50 Hz \(half the sampling rate\)"):
        band_pass(np.ones(100), RATE, band)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 50.0, np.nan])
def test_a_cutoff_outside_the_sampled_band_is_refused(cutoff):
    with pytest.raises(RecordError, match="cutoff: expected more than 0 and less than 50 Hz"):
        integrate(np.ones(100), RATE, cutoff=cutoff)


# the rotor's inputs: Ω = 1.2 + 0.2 sin(2π 0.05 t) rad/s

R_RATE = 50.0
R_TIME = np.arange(3000) / R_RATE
SLOW = 2 * np.pi * 0.05
SPEED = 1.2 + 0.2 * np.sin(SLOW * R_TIME)
ACCELERATION = 0.2 * SLOW * np.cos(SLOW * R_TIME)
AZIMUTH = 0.4 + 1.2 * R_TIME - 0.2 / SLOW * (np.cos(SLOW * R_TIME) - 1.0)


def rotor_record(azimuth: np.ndarray, speed: np.ndarray | None = None) -> Record:
    columns, channels, units = [np.mod(azimuth, 2 * np.pi)], ["rotor_azimuth"], ["rad"]
    if speed is not None:
        columns.append(speed)
        channels.append("rotor_speed")
        units.append("rad/s")
    return Record(R_TIME, np.column_stack(columns), tuple(channels), tuple(units))


def test_a_wrapped_azimuth_unwraps_and_the_recorded_speed_is_used():
    psi, speed, acceleration = rotor_inputs(rotor_record(AZIMUTH, SPEED), 9.9).T
    np.testing.assert_allclose(psi, AZIMUTH, atol=1e-9)
    np.testing.assert_array_equal(speed, SPEED)
    np.testing.assert_allclose(acceleration, ACCELERATION, atol=0.02 * np.abs(ACCELERATION).max())


def test_a_varying_speed_is_recovered_from_the_azimuth_alone():
    # Slopes over one second of a 20 s sine: (ω/2)²/10 of it is lost, 0.25 %; the second slope loses as much again.
    psi, speed, acceleration = rotor_inputs(rotor_record(AZIMUTH), 1.2).T
    np.testing.assert_allclose(psi, AZIMUTH, atol=1e-9)
    np.testing.assert_allclose(speed, SPEED, atol=0.005 * 0.2)
    np.testing.assert_allclose(acceleration, ACCELERATION, atol=0.02 * np.abs(ACCELERATION).max())


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_the_azimuth_decides_where_the_usual_speed_is_wrong(factor):
    psi, speed, acceleration = rotor_inputs(rotor_record(1.2 * R_TIME), 1.2 * factor).T
    np.testing.assert_allclose(psi, 1.2 * R_TIME, atol=1e-9)
    np.testing.assert_allclose(speed, 1.2, rtol=1e-9)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-9)


@pytest.mark.parametrize("recorded", [True, False])
@pytest.mark.parametrize(("scatter", "left"), [(0.05, 0.01), (0.005, 0.0016)])
def test_azimuths_that_scatter_are_smoothed(recorded, scatter, left):
    # A parabola through W azimuths leaves σ √(9 / 4 W) of their scatter in the middle.
    noise = scatter * np.random.default_rng(3).standard_normal(len(R_TIME))
    noise[2000:2100] = np.nan
    noisy = rotor_record(AZIMUTH + noise, SPEED if recorded else None)
    psi = rotor_inputs(noisy, 1.2)[:, 0]
    assert np.std(np.mod(psi - AZIMUTH + np.pi, 2 * np.pi)[np.isfinite(noise)]) < left
    np.testing.assert_array_equal(np.isnan(steadied(noisy)["rotor_azimuth"]), np.isnan(noise))


@pytest.mark.parametrize("recorded", [True, False])
@pytest.mark.parametrize("degrees", [1.0, 5.0, 10.0])
def test_an_encoder_of_coarse_steps_is_smoothed_over_them(recorded, degrees):
    step = np.radians(degrees)
    read = step * np.round(np.mod(AZIMUTH, 2 * np.pi) / step)
    psi = rotor_inputs(rotor_record(read, SPEED if recorded else None), 1.2)[:, 0]
    left, given = (np.std(np.mod(angle - AZIMUTH + np.pi, 2 * np.pi)) for angle in (psi, read))
    assert left < 0.2 * given


def test_an_azimuth_that_is_lost_now_and_then_is_bridged():
    glitches = np.random.default_rng(7).random(len(R_TIME)) < 0.02
    psi = rotor_inputs(rotor_record(np.where(glitches, 0.0, np.mod(AZIMUTH, 2 * np.pi)), SPEED), 1.2)[:, 0]
    assert np.max(np.abs(np.mod(psi - AZIMUTH + np.pi, 2 * np.pi) - np.pi)) < MIN_GLITCH_RADIANS


def test_a_glitch_of_an_azimuth_is_put_on_the_rotation_and_moves_nothing_beside_it():
    glitched = AZIMUTH.copy()
    glitched[[700, 1500, 2100]] += 0.6
    psi = steadied(rotor_record(glitched, SPEED))["rotor_azimuth"]
    assert np.max(np.abs(np.mod(psi - AZIMUTH + np.pi, 2 * np.pi) - np.pi)) < 0.005


def test_an_encoder_that_slips_is_left_as_it_is():
    slipped = rotor_record(AZIMUTH + np.where(R_TIME > 30.0, 0.8, 0.0), SPEED)
    assert steadied(slipped) is slipped


@pytest.mark.parametrize("scatter", [0.0, 0.001])
def test_a_rotor_that_turns_unevenly_keeps_its_azimuth(scatter):
    # 20 mrad at 2 Hz are far more than azimuths may scatter, and are motion.
    noise = scatter * np.random.default_rng(4).standard_normal(len(R_TIME))
    uneven = rotor_record(AZIMUTH + 0.02 * np.sin(4 * np.pi * R_TIME) + noise, SPEED)
    assert steadied(uneven) is uneven


def test_gaps_longer_than_half_a_turn_are_bridged_by_the_speed():
    # 8 s without azimuth are one and a half turns; unwrapping alone loses a turn there.
    holed = AZIMUTH.copy()
    holed[1000:1400] = np.nan
    holed[:100] = np.nan
    psi = rotor_inputs(rotor_record(holed, SPEED), 9.9)[:, 0]
    np.testing.assert_allclose(psi, AZIMUTH, atol=1e-5)
    assert np.isfinite(psi).all()


def test_gaps_are_bridged_at_the_usual_speed_where_none_is_recorded():
    holed = 1.2 * R_TIME
    holed[1000:1400] = np.nan
    np.testing.assert_allclose(rotor_inputs(rotor_record(holed), 1.2)[:, 0], 1.2 * R_TIME, atol=1e-9)


@pytest.mark.parametrize("speed", [None, SPEED])
def test_an_azimuth_that_runs_backward_is_refused(speed):
    with pytest.raises(RecordError, match=r"expected angles that increase .* got -1\.2 rad/s .* direction of rotation"):
        rotor_inputs(rotor_record(-AZIMUTH, speed), 1.2)


def test_a_parked_rotor_stands_where_it_is():
    psi, speed, _ = rotor_inputs(rotor_record(np.full_like(R_TIME, 0.4), np.zeros_like(R_TIME)), 1.2).T
    np.testing.assert_allclose(psi, 0.4, atol=1e-9)
    np.testing.assert_array_equal(speed, 0.0)
    with pytest.raises(RecordError, match=r"turns at 1\.2 rad/s but rotor_speed says 0 rad/s"):
        rotor_inputs(rotor_record(AZIMUTH, np.zeros_like(R_TIME)), 1.2)


@pytest.mark.parametrize("factor", [1.1, 30.0 / np.pi])
def test_azimuth_and_speed_that_contradict_each_other_are_refused(factor):
    with pytest.raises(RecordError, match=r"turns at 1\.2 rad/s but rotor_speed says .* check the unit"):
        rotor_inputs(rotor_record(AZIMUTH, factor * SPEED), 1.2)


def test_an_azimuth_without_numbers_is_refused():
    with pytest.raises(RecordError, match="'rotor_azimuth': expected angles, got no numbers"):
        rotor_inputs(rotor_record(np.full_like(AZIMUTH, np.nan), SPEED), 1.2)
    with pytest.raises(RecordError, match="no channel 'rotor_azimuth'"):
        rotor_inputs(Record(R_TIME, SPEED[:, None], ("rotor_speed",), ("rad/s",)), 1.2)
    with pytest.raises(RecordError, match="rotor_speed: expected numbers, got none"):
        rotor_inputs(rotor_record(AZIMUTH, np.full_like(SPEED, np.nan)), 1.2)


def test_units_that_are_not_an_angle_are_refused():
    wrong = Record(R_TIME, np.mod(AZIMUTH, 2 * np.pi)[:, None], ("rotor_azimuth",), ("m",))
    with pytest.raises(RecordError, match="channel 'rotor_azimuth': expected rad, got m"):
        rotor_inputs(wrong, 1.2)
    wrong = Record(R_TIME, np.column_stack([AZIMUTH, SPEED]), ("rotor_azimuth", "rotor_speed"), ("rad", "m/s"))
    with pytest.raises(RecordError, match="channel 'rotor_speed': expected rad/s, got m/s"):
        rotor_inputs(wrong, 1.2)


def test_degrees_that_were_written_down_as_radians_are_refused():
    wrong = Record(R_TIME, np.mod(np.degrees(AZIMUTH), 360.0)[:, None], ("rotor_azimuth",), ("rad",))
    with pytest.raises(RecordError, match=r"turns at 68\.\d* rad/s, .* check the unit"):
        rotor_inputs(wrong, 1.2)
