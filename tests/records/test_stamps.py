"""Time stamps that scatter, and readings that were taken at uneven times: the motion is known at any time."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records import stamps
from windsysid.records.record import Record

RATE = 50.0
FREQUENCIES = (0.7, 1.9, 4.1)


def motion(time, rng):
    phases = rng.uniform(0, 2 * np.pi, (2, len(FREQUENCIES)))
    return np.sum(np.sin(2 * np.pi * np.multiply.outer(time, FREQUENCIES)[:, None] + phases), axis=2)


def record(taken, stamped, seed, *, noise=0.05, azimuth=False):
    rng = np.random.default_rng(seed)
    values = motion(taken, rng)
    values += noise * rng.standard_normal(values.shape)
    made = Record(stamped, values, ("tower_x_acceleration", "tower_y_acceleration"), ("m/s^2", "m/s^2"))
    return made.with_channels({"rotor_azimuth": (np.mod(7.4 * taken, 2 * np.pi), "rad")}) if azimuth else made


def times(seed, scatter, samples=3000):
    grid = np.arange(samples) / RATE
    return grid, grid + scatter / RATE * np.random.default_rng(seed).uniform(-1, 1, samples)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scatter", [0.2, 0.4])
def test_stamps_that_scatter_are_put_on_the_grid_that_readings_show(seed, scatter):
    grid, stamps = times(seed, scatter)
    made = record(grid, stamps, seed)
    found = made.on_uniform_grid()
    assert found.samples == 3000
    np.testing.assert_array_equal(found.values, made.values)
    np.testing.assert_allclose(found.time, grid, atol=0.02 / RATE)


@pytest.mark.parametrize("azimuth", [False, True])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scatter", [0.2, 0.4])
def test_readings_that_were_taken_at_uneven_times_keep_them(seed, scatter, azimuth):
    _, stamps = times(seed, scatter)
    made = record(stamps, stamps, seed, azimuth=azimuth)
    assert not made.has_grid
    with pytest.raises(RecordError, match="irregular sampling"):
        made.on_uniform_grid()
    assert len(made.on_own_times().intervals()[0]) > 10


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("azimuth", [False, True])
def test_stamps_that_are_late_keep_their_order_and_go_back(seed, azimuth):
    # A computer that is busy for more than a step stamps several readings at once, in their order.
    grid, _ = times(seed, 0.0)
    late = np.maximum.accumulate(grid + 0.3 / RATE * np.random.default_rng(seed).exponential(size=3000))
    late += 1e-6 * np.arange(3000) / RATE
    found = record(grid, late, seed, azimuth=azimuth).on_uniform_grid()
    assert found.samples == 3000
    np.testing.assert_allclose(np.diff(found.time), 1.0 / RATE, rtol=1e-3)
    if not azimuth:
        assert not record(late, late, seed).has_grid


def test_samples_that_were_lost_are_missing_on_the_grid():
    grid, stamps = times(1, 0.3)
    kept = np.ones(3000, dtype=bool)
    kept[[700, 701, 1900]] = False
    found = record(grid, stamps, 1)
    found = Record(found.time[kept], found.values[kept], found.channels, found.units).on_uniform_grid()
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.values[:, 0])), [700, 701, 1900])


def test_channels_that_disagree_leave_the_stamps():
    # An azimuth that follows the stamps and accelerations that follow the grid: nobody knows which clock is right.
    grid, stamps = times(2, 0.3)
    made = record(grid, stamps, 2)
    both = made.with_channels({"rotor_azimuth": (np.mod(7.4 * stamps, 2 * np.pi), "rad")})
    assert made.has_grid
    assert not both.has_grid


@pytest.mark.parametrize("seed", range(4))
def test_one_spike_does_not_speak_for_its_channel(seed):
    grid, stamps = times(seed, 0.3)
    made, uneven = record(grid, stamps, seed), record(stamps, stamps, seed)
    for values in (made.values, uneven.values):
        values[1000, 0], values[2000, 1] = -999.0, 300.0
    assert made.has_grid
    assert not uneven.has_grid


@pytest.mark.parametrize("seed", range(5))
def test_noise_does_not_tell(seed):
    _, stamps = times(seed, 0.3)
    noise = np.random.default_rng(seed).standard_normal((3000, 2))
    still = Record(stamps, noise, ("tower_x_acceleration", "tower_speed"), ("m/s^2", "m/s"))
    assert not still.has_grid
    constant = still.with_channels({"tower_speed": (np.full(3000, 3.0), "m/s")})
    assert not constant.has_grid


@pytest.mark.parametrize(("late", "taken"), [(4.0, True), (7.0, False)])
def test_the_last_stamp_may_be_late_by_five_steps(late, taken):
    grid, _ = times(3, 0.0)
    stamps = np.maximum.accumulate(grid + 0.3 / RATE * np.random.default_rng(3).exponential(size=3000))
    stamps += 1e-6 * np.arange(3000) / RATE
    stamps[-1] = grid[-1] + late / RATE
    assert record(grid, stamps, 3).has_grid is taken


@pytest.mark.parametrize(
    ("evidence", "taken"), [([7.0], False), ([9.0], True), ([20.0, -7.0], True), ([20.0, -9.0], False)]
)
def test_a_grid_needs_a_likelihood_ratio_of_eight_in_logarithm(monkeypatch, evidence, taken):
    grid, scattered = times(4, 0.3)
    monkeypatch.setattr(stamps, "_log_ratio", lambda *_: np.array(evidence))
    assert record(grid, scattered, 4).has_grid is taken


@pytest.mark.parametrize("lost", [2, 4, 30])
def test_samples_that_were_lost_where_stamps_are_late_are_missing(lost):
    grid, _ = times(5, 0.0)
    late = np.maximum.accumulate(grid + 0.3 / RATE * np.random.default_rng(5).exponential(size=3000))
    late += 1e-6 * np.arange(3000) / RATE
    kept = np.delete(np.arange(3000), np.arange(1500, 1500 + lost))
    found = record(grid, late, 5)
    found = Record(found.time[kept], found.values[kept], found.channels, found.units).on_uniform_grid()
    assert found.samples == 3000
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.values[:, 0])), np.arange(1500, 1500 + lost))
