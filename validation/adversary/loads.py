"""Forces in continuous time: exact draws at twice the integrator's rate, whatever a record's rate is.

Every maker of loads takes a generator and how many values there are at `RATE`, and hands back forces on x, y [N] and
on the three blades [N·m] (n, 5). The reference is the paper's scenario: first-order Gauss–Markov, 15 N and 15 N·m rms,
time constant 1 s, independent.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from validation.adversary.machine import RATE as STEPS

__all__ = [
    "RATE", "Loads", "alternative_wind", "common", "gauss_markov", "independent", "narrow_band", "one_sided",
    "plus_line", "plus_narrow_band", "pulses", "scaled_by", "two_speeds",
]  # fmt: skip

Array = NDArray[np.float64]
Loads = Callable[[np.random.Generator, int], Array]

RATE = 2 * STEPS
"""Values per second [Hz]."""

RMS = 15.0
"""Of each load of the reference scenario [N, N·m]."""


def gauss_markov(rng: np.random.Generator, n: int, rms: float, time_constant: float) -> Array:
    """A stationary first-order process (n,), exact at its samples."""
    a = np.exp(-1.0 / (RATE * time_constant))
    noise = rng.standard_normal(n) * np.sqrt(1.0 - a * a)
    noise[0] = rng.standard_normal()
    return np.asarray(rms * lfilter([1.0], [1.0, -a], noise))


def narrow_band(rng: np.random.Generator, n: int, rms: float, frequency: float, damping: float) -> Array:
    """A stationary process (n,) around a frequency [Hz]: the real part of a complex first-order one, exact at its
    samples."""
    omega = 2.0 * np.pi * frequency
    a = np.exp((-damping + 1j) * omega / RATE)
    noise = (rng.standard_normal(n) + 1j * rng.standard_normal(n)) * np.sqrt(1.0 - abs(a) ** 2)
    noise[0] = rng.standard_normal() + 1j * rng.standard_normal()
    return np.asarray(rms * lfilter([1.0], [1.0, -a], noise).real)


def independent(levels: Sequence[float] = (1.0,) * 5, times: Sequence[float] = (1.0,) * 5) -> Loads:
    """The reference with levels in its rms and time constants [s] for x, y and the blades."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        return np.column_stack([gauss_markov(rng, n, RMS * s, t) for s, t in zip(levels, times, strict=True)])

    return draw


def common(mixing: Array) -> Loads:
    """The reference with correlations: `mixing` (5, 5) times independent loads, each row of unit length."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        rows = mixing / np.linalg.norm(mixing, axis=1)[:, None]
        return np.asarray(independent()(rng, n) @ rows.T)

    return draw


def plus_line(frequency: float, share: float, where: Sequence[int], loads: Loads | None = None) -> Loads:
    """Loads, the reference by default, and a sine of steady amplitude: `share` of the power of the reference where it
    adds to them."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        found = (loads or independent())(rng, n)
        for j in where:
            phase = 2.0 * np.pi * frequency * np.arange(n) / RATE + rng.uniform(0.0, 2.0 * np.pi)
            found[:, j] += RMS * np.sqrt(2.0 * share) * np.sin(phase)
        return found

    return draw


def plus_narrow_band(frequency: float, damping: float, level: float, where: Sequence[int]) -> Loads:
    """The reference and a narrow-band process, its rms in the reference's."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        found = independent()(rng, n)
        for j in where:
            found[:, j] += narrow_band(rng, n, RMS * level, frequency, damping)
        return found

    return draw


def two_speeds(level: float, time_constant: float) -> Loads:
    """The reference and a faster process on every degree of freedom."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        return independent()(rng, n) + independent((level,) * 5, (time_constant,) * 5)(rng, n)

    return draw


def scaled_by(level: Callable[[Array], Array]) -> Loads:
    """The reference times a level over time; `level` takes the share of the record that is over, from 0 to 1."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        return independent()(rng, n) * level(np.arange(n) / n)[:, None]

    return draw


def one_sided(rng: np.random.Generator, n: int) -> Array:
    """Loads that push one way: the square of a Gauss–Markov process, skewed, of the reference's rms and memory."""
    drawn = np.column_stack([gauss_markov(rng, n, 1.0, 2.0) for _ in range(5)])
    return np.asarray(RMS * drawn**2 / np.sqrt(2.0))


def pulses(each: float) -> Loads:
    """Pulses at random times, `each` seconds apart on average, that decay in 1 s: of the reference's spectrum."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        a = np.exp(-1.0 / RATE)
        kicks = rng.standard_normal((n, 5)) * (rng.random((n, 5)) < 1.0 / (each * RATE))
        return np.asarray(RMS * np.sqrt(2.0 * each) * lfilter([1.0], [1.0, -a], kicks, axis=0))

    return draw


def alternative_wind(speed_of_rotor: float, mean: float = 6.0, scale: float = 25.0, points: int = 24) -> Loads:
    """Wind with von Kármán's spectrum and Davenport's coherence at the blades' outer thirds, cut by the turning blades.

    The forces on the blades push the hub, too. Blade i has the azimuth ψ + 2π(i−1)/3, ψ = 0 at first.
    """

    def draw(rng: np.random.Generator, n: int) -> Array:
        radius, coarse = 1.9, 40.0
        steps = int(np.ceil(n / RATE * coarse)) + 8
        f = np.fft.rfftfreq(steps, 1.0 / coarse)
        spectrum = 4.0 * scale / mean / (1.0 + 70.8 * (f * scale / mean) ** 2) ** (5.0 / 6.0)
        angle = 2.0 * np.pi * np.arange(points) / points
        distance = 2.0 * radius * np.abs(np.sin(0.5 * (angle[:, None] - angle[None, :])))
        coherence = np.exp(-10.0 * f[:, None, None] * distance / mean) + 1e-9 * np.eye(points)
        drawn = rng.standard_normal((2, len(f), points))
        field = np.einsum("fij,fj->fi", np.linalg.cholesky(coherence), drawn[0] + 1j * drawn[1])
        wind = np.fft.irfft(np.sqrt(spectrum)[:, None] * field, steps, axis=0)
        wind = wind / wind.std()
        time = np.arange(n) / RATE
        around = CubicSpline(np.arange(steps) / coarse, wind)(time)
        psi = speed_of_rotor * time
        found = np.empty((n, 5))
        found[:, :2] = 0.0
        for i in range(3):
            at = np.mod(psi + 2.0 * np.pi * i / 3.0, 2.0 * np.pi) / (2.0 * np.pi) * points
            low = at.astype(np.int64)
            share, rows = at - low, np.arange(n)
            force = (1.0 - share) * around[rows, low % points] + share * around[rows, (low + 1) % points]
            found[:, 2 + i] = RMS * force
            turn = psi + 2.0 * np.pi * i / 3.0
            found[:, 0] -= np.sin(turn) * RMS * force / radius
            found[:, 1] += np.cos(turn) * RMS * force / radius
        return found

    return draw
