"""Wind direction: a mean-reverting process with changes at given times.

    dδ = −δ/τ dt + σ √(2/τ) dB   (Ornstein–Uhlenbeck, drawn exactly at the samples),   plus   Σ Δ_k ½ (1 − cos π s_k),

s_k running from 0 to 1 over the k-th change: the shape of the IEC's extreme direction change (IEC 61400-1 ed. 4, 6.3).
"""

import math
from dataclasses import dataclass

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError

__all__ = ["Direction", "DirectionChange", "simulate_direction"]


@dataclass(frozen=True)
class DirectionChange:
    """The mean direction turns `by_deg` from the time `at` [s] on and takes `over` [s] to do it; 0 is a step."""

    at: float
    by_deg: float
    over: float = 6.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.at, self.by_deg, self.over))) or self.over < 0.0:
            raise ConfigurationError(
                f"direction change: expected a time [s], an angle [deg] and a duration of 0 s or more, "
                f"got {self.at:g}, {self.by_deg:g}, {self.over:g}"
            )


@dataclass(frozen=True)
class Direction:
    """Direction of the wind against the rotor's axis; positive blows towards +x (to the right, looking upwind).

    Attributes
    ----------
    mean_deg
        Mean misalignment before any change [deg].
    std_deg
        Standard deviation of the mean-reverting part [deg].
    time_constant
        τ [s], how long it takes to come back.
    changes
        Steps and ramps of the mean.
    """

    mean_deg: float = 0.0
    std_deg: float = 0.0
    time_constant: float = 20.0
    changes: tuple[DirectionChange, ...] = ()

    def __post_init__(self) -> None:
        if not math.isfinite(self.mean_deg):
            raise ConfigurationError(f"mean direction: expected a number of deg, got {self.mean_deg}")
        if not 0.0 <= self.std_deg < 90.0:
            raise ConfigurationError(f"spread of direction: expected 0 to 90 deg, got {self.std_deg}")
        if not (math.isfinite(self.time_constant) and self.time_constant > 0.0):
            raise ConfigurationError(
                f"time constant of direction: expected a positive number of s, got {self.time_constant}"
            )


def simulate_direction(
    direction: Direction, samples: int, *, rate: float, seed: int | np.random.Generator = 0
) -> Array:
    """Misalignment δ of wind and rotor axis, (T,) [rad]; reproducible for a seed.

    Parameters
    ----------
    samples
        T.
    rate
        Samples per second [Hz].

    Raises
    ------
    ConfigurationError
        If T is negative or the rate is not positive.
    """
    from windsysid.simulation.random_loads import draw_loads
    from windsysid.statespace.gauss_markov import GaussMarkov

    if samples < 0 or not (math.isfinite(rate) and rate > 0.0):
        raise ConfigurationError(f"expected 0 or more samples at a positive rate, got {samples} at {rate:g} Hz")
    time = np.arange(samples) / rate
    delta = np.full(samples, direction.mean_deg)
    if direction.std_deg > 0.0:
        process = GaussMarkov("direction", direction.std_deg, direction.time_constant)
        delta += draw_loads([process], ["direction"], samples, rate, np.random.default_rng(seed))[:, 0]
    for change in direction.changes:
        delta += change.by_deg * _ramp(time, change)
    return np.asarray(np.deg2rad(delta))


def _ramp(time: Array, change: DirectionChange) -> Array:
    if change.over == 0.0:
        return (time >= change.at).astype(np.float64)
    return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.clip((time - change.at) / change.over, 0.0, 1.0))))
