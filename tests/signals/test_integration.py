"""Methods of integration against closed forms, against each other, and against OpenFAST's known motion."""

from pathlib import Path

import numpy as np
import pytest
from validation.integration import Truth, integration_table

from windsysid.errors import RecordError
from windsysid.records.formats import read_record
from windsysid.signals import METHODS, causal_integrator, causal_response, integrate, integrate_causally

DATA = Path(__file__).parents[3] / "shared" / "data" / "openfast"
needs_openfast = pytest.mark.skipif(not DATA.is_dir(), reason="the OpenFAST records are not beside this checkout")

RATE, CUTOFF = 100.0, 0.2


def chirp(samples: int = 6000) -> tuple[np.ndarray, np.ndarray]:
    """x = sin(φ(t)), 0.8 to 2 Hz, and its second derivative."""
    t = np.arange(samples) / RATE
    slope = 1.2 / t[-1]
    phase, rate, bend = 2 * np.pi * (0.8 * t + 0.5 * slope * t**2), 2 * np.pi * (0.8 + slope * t), 2 * np.pi * slope
    return np.sin(phase), bend * np.cos(phase) - rate**2 * np.sin(phase)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


@pytest.mark.parametrize(("method", "bound"), [("high-pass", 0.05), ("frequency", 1e-3), ("kalman", 1e-3)])
def test_every_method_integrates_a_chirp_in_the_interior(method, bound):
    x, a = chirp()
    motion = integrate(a, RATE, cutoff=CUTOFF, method=method)
    inside = slice(1500, -1500)
    assert rms((motion.displacement - x)[inside]) < bound * rms(x)


def test_the_smoother_has_no_bad_ends_and_plain_cumulation_drifts():
    x, a = chirp()
    read = a + 3.0 + 0.1 * np.arange(len(a)) / RATE  # a bias and a drift of 6 m/s² over the minute
    error = {method: rms(integrate(read, RATE, cutoff=CUTOFF, method=method).displacement - x) for method in METHODS}
    assert error["kalman"] < 0.01
    assert error["frequency"] > 10 * error["kalman"]
    assert error["cumulative"] > 100.0


def test_smoother_and_frequency_method_have_the_same_gain():
    # ω⁸/(ω⁸ + ω_c⁸) is derived in the module; white noise tests every frequency at once.
    a = np.random.default_rng(0).standard_normal(60_000)
    one, other = (integrate(a, RATE, cutoff=CUTOFF, method=m).displacement for m in ("kalman", "frequency"))
    inside = slice(10_000, -10_000)
    assert rms((one - other)[inside]) < 2e-3 * rms(other[inside])


def test_the_smoother_stays_sound_at_a_tiny_ratio_of_cutoff_to_rate():
    # 2 kHz and 0.02 Hz: step · ω_c = 6e-5, its eighth power 1e-34. The ends keep 0.4 %, as they do at 100 Hz.
    fine, coarse = (np.arange(200 * rate) / rate for rate in (2000, 100))
    dense = integrate(-((2 * np.pi) ** 2) * np.sin(2 * np.pi * fine), 2000.0, cutoff=0.02).displacement
    sparse = integrate(-((2 * np.pi) ** 2) * np.sin(2 * np.pi * coarse), 100.0, cutoff=0.02).displacement
    assert rms(dense - np.sin(2 * np.pi * fine)) < 0.01
    assert rms(dense[::20] - sparse) < 1e-3


def test_the_smoother_bridges_a_gap_better_than_the_frequency_method():
    x, a = chirp()
    a[3000:3060] = np.nan  # 0.6 s, most of a period
    errors = {}
    for method in ("frequency", "kalman"):
        got = integrate(a, RATE, cutoff=CUTOFF, method=method).displacement
        assert np.isnan(got[3000:3060]).all()
        errors[method] = rms((got - x)[2000:4000])
    assert errors["kalman"] < 0.5 * errors["frequency"]


@pytest.mark.parametrize("method", ["frequency", "kalman"])
def test_gravity_in_a_rolling_accelerometer_is_undone(method):
    x, a = chirp()
    kappa = -0.02
    read = a + 9.80665 * kappa * x
    inside = slice(1500, -1500)
    blind = integrate(read, RATE, cutoff=CUTOFF, method=method).displacement
    seeing = integrate(read, RATE, cutoff=CUTOFF, method=method, roll_per_metre=kappa).displacement
    assert rms((seeing - x)[inside]) < 4e-4 < 1.5e-3 < rms((blind - x)[inside])


def test_nothing_integrates_to_nothing():
    for method in METHODS:
        for values in integrate(np.full(50, 3.0), RATE, cutoff=1.0, method=method):
            np.testing.assert_array_equal(values, 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "expected one of cumulative, high-pass"),
        ({"noise": 0.0}, "expected a positive number"),
        ({"method": "high-pass", "roll_per_metre": 0.1}, "cannot undo gravity"),
        ({"roll_per_metre": 10.0}, "gravity outweighs"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(RecordError, match=message):
        integrate(np.arange(100.0), RATE, cutoff=CUTOFF, **options)


def test_a_table_of_an_array_that_is_no_channel_is_refused():
    with pytest.raises(RecordError, match=r"expected \(T,\)"):
        integrate(np.ones((10, 2)), RATE, cutoff=CUTOFF)


@needs_openfast
def test_openfast_displacement_is_found_to_a_few_percent_ends_included():
    # Table in docs/signals.md: 2.9 % of the displacement in 30 s of the free decay, nothing below the cut-off being
    # lost.
    record = read_record(DATA / "a2_rot12_decay_min.outb").section(100.0, 130.0)
    for channel, kappa, bound in (
        ("tower_x_acceleration_kinematic", 0.0, 0.05),
        ("tower_x_acceleration", -0.020889, 0.06),
    ):
        got = integrate(record[channel], record.rate, cutoff=0.1, roll_per_metre=kappa).displacement
        truth = record["tower_x_displacement"] - record["tower_x_displacement"].mean()
        assert rms(got - truth) < bound * rms(truth)


# streams


def test_a_stream_in_pieces_is_bit_for_bit_the_whole():
    rng = np.random.default_rng(1)
    a = rng.standard_normal(5000)
    a[[0, 1, 700, 701, 4999]] = np.nan
    integrator = causal_integrator(RATE, cutoff=CUTOFF)
    end, whole = integrate_causally(integrator, a)
    state, pieces = None, []
    for part in np.split(a, [1, 2, 3, 700, 701, 702, 3000, 3000]):
        state, motion = integrate_causally(integrator, part, state)
        pieces.append(motion)
    for k in range(2):
        np.testing.assert_array_equal(np.concatenate([piece[k] for piece in pieces]), whole[k])
        assert state is not None
        np.testing.assert_array_equal(end[k], state[k])


def test_the_causal_integrator_leads_by_what_it_says():
    f = 1.0
    t = np.arange(20_000) / RATE
    integrator = causal_integrator(RATE, cutoff=CUTOFF)
    _, motion = integrate_causally(integrator, -((2 * np.pi * f) ** 2) * np.cos(2 * np.pi * f * t) + 5.0)
    wave = np.exp(-2j * np.pi * f * t[10_000:])
    got = 2 * np.mean(motion.displacement[10_000:] * wave)
    gain = causal_response(integrator, f)[1][0]
    assert got == pytest.approx(gain, abs=1e-6)
    assert np.angle(gain) == pytest.approx(2 * CUTOFF / f, rel=0.1)  # the rule of thumb in the module
    assert abs(gain) == pytest.approx(1 / np.sqrt(1 + (CUTOFF / f) ** 6), rel=2e-3)


def test_the_causal_integrator_starts_without_a_transient_of_the_bias():
    _, motion = integrate_causally(causal_integrator(RATE, cutoff=CUTOFF), np.full(3000, 9.81))
    assert np.abs(motion.displacement).max() < 1e-9


def test_a_stream_that_begins_with_nothing_waits():
    integrator = causal_integrator(RATE, cutoff=CUTOFF)
    state, motion = integrate_causally(integrator, np.full(5, np.nan))
    assert np.isnan(motion.velocity).all()
    _, motion = integrate_causally(integrator, np.full(5, 9.81), state)
    assert np.abs(motion.displacement).max() < 1e-9


# the table


def test_the_table_tells_the_methods_apart():
    t = np.arange(6000) / RATE
    w = 2 * np.pi
    truth = Truth("sine", RATE, CUTOFF, -(w**2) * np.sin(w * t), w * np.cos(w * t), np.sin(w * t))
    rows = integration_table([truth], noise=(0.0, 0.2), durations=(30.0,))
    assert rows == integration_table([truth], noise=(0.0, 0.2), durations=(30.0,))
    assert len(rows) == 2 * 2 * len(METHODS)
    best = {row.method: row.displacement_in_band for row in rows if row.drifting and row.noise == 0.0}
    assert min(best, key=lambda method: best[method]) == "kalman"
    noisy = next(row for row in rows if row.method == "kalman" and row.noise == 0.2)
    quiet = next(row for row in rows if row.method == "kalman" and row.noise == 0.0)
    assert noisy.displacement > 3 * quiet.displacement
