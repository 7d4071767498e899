"""Loggers on one clock."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.record import Record
from windsysid.signals import align, clock_offset


def speed(t: np.ndarray) -> np.ndarray:
    """A rotor speed that wanders without repeating itself."""
    rng = np.random.default_rng(7)
    f = rng.uniform(0.005, 0.3, 40)
    waves = np.sin(2 * np.pi * np.outer(t, f) + rng.uniform(0, 6.28, 40))
    return np.asarray(7.0 + 0.05 * waves.sum(axis=1))


def logger(rate: float, offset: float, drift: float, other: str, noise: float = 0.01, seed: int = 0) -> Record:
    """Own clock: t_true = t + offset + drift (t − 150)."""
    t = np.arange(round(300 * rate)) / rate
    true = t + offset + drift * (t - 150.0)
    read = speed(true) + noise * np.random.default_rng(seed).standard_normal(len(t))
    return Record(t, np.column_stack([read, np.sin(2 * np.pi * 0.4 * true)]), ("rotor_speed", other), ("rad/s", "m"))


@pytest.mark.parametrize(("offset", "drift"), [(3.217, 0.0), (-12.403, 0.0), (3.217, 40e-6), (-7.7, -100e-6)])
def test_offset_and_drift_are_found_between_samples_and_honestly(offset, drift):
    found = clock_offset(logger(50.0, 0.0, 0.0, "a"), logger(20.0, offset, drift, "b", seed=1))
    middle = found.offset + found.drift * (150.0 - found.middle)
    assert abs(middle - offset) < 0.02  # 0.4 of a step of the slower logger
    assert abs(middle - offset) < 4.0 * found.offset_std + 1e-3
    assert abs(found.drift - drift) < 4.0 * found.drift_std + 5e-6


def test_two_loggers_become_one_record():
    one, other = (
        logger(50.0, 0.0, 0.0, "tower_x_displacement"),
        logger(20.0, 3.217, 0.0, "tower_y_displacement", seed=1),
    )
    whole, offsets = align([one, other])
    assert whole.channels == ("rotor_speed", "tower_x_displacement", "tower_y_displacement")
    assert whole.rate == pytest.approx(50.0)
    assert len(offsets) == 1
    inside = slice(100, -100)
    np.testing.assert_allclose(
        whole["tower_y_displacement"][inside], whole["tower_x_displacement"][inside], atol=2 * np.pi * 0.4 * 0.02
    )


@pytest.mark.parametrize("drift", [1e-3, -1e-3])
def test_a_clock_that_drifts_is_put_right_from_end_to_end(drift: float):
    # 0.15 s off at either end; the wrong sign would double that.
    one, other = logger(20.0, 0.0, 0.0, "a"), logger(20.0, 3.2, drift, "b", seed=1)
    whole, (found,) = align([one, other])
    true = other.time + 3.2 + drift * (other.time - 150.0)
    np.testing.assert_allclose(found.corrected(other.time), true, atol=0.02)
    inside = slice(40, -40)
    np.testing.assert_allclose(whole["b"][inside], whole["a"][inside], atol=2 * np.pi * 0.4 * 0.02)


def test_an_azimuth_at_constant_speed_leaves_whole_turns_open_and_says_so():
    def turning(offset: float) -> Record:
        t = np.arange(6000) / 50.0
        return Record(t, np.mod(1.267 * (t + offset), 2 * np.pi)[:, None], ("rotor_azimuth",), ("rad",))

    found = clock_offset(turning(0.0), turning(2.0))
    turn = 2 * np.pi / 1.267
    assert abs((found.offset - 2.0 + turn / 2) % turn - turn / 2) < 0.01
    assert "other offsets fit as well" in found.note


def test_records_with_nothing_in_common_are_refused():
    one, other = logger(50.0, 0.0, 0.0, "a"), logger(20.0, 0.0, 0.0, "b")
    with pytest.raises(RecordError, match="share no channel"):
        align([one.select(["a"]), other.select(["b"])])
    noise = other.with_channels({"rotor_speed": (np.random.default_rng(3).standard_normal(other.samples), "rad/s")})
    with pytest.raises(RecordError, match="correlate by"):
        align([one, noise])
    with pytest.raises(RecordError, match="two or more"):
        align([one])
