"""Blades that pass on a mode at a steady speed are seen; those that pass elsewhere, or unsteadily, are not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from windsysid.results.passing import find_passing

RATE, SAMPLES, F = 20.0, 12000, 0.32


def shaken(seed: int, zeta: float, line: float = 0.0, passing: float = F, wander: float = 0.0):
    """Acceleration of a mode under a white load and a line of the passing blades, and the azimuth."""
    rng = np.random.default_rng(seed)
    times = np.arange(SAMPLES + 8000) / RATE
    slow = lfilter([1.0], [1.0, -np.exp(-1.0 / (20.0 * RATE))], rng.standard_normal(len(times)))
    speed = 2.0 * np.pi * passing / 3.0 * (1.0 + wander * slow / slow.std())
    azimuth = np.cumsum(speed) / RATE
    load = rng.standard_normal(len(times)) + line * np.cos(3.0 * azimuth)
    pole = np.exp((-zeta + 1j * np.sqrt(1.0 - zeta**2)) * 2.0 * np.pi * F / RATE)
    y = lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], load)
    noisy = azimuth + 0.02 * rng.standard_normal(len(times))
    return y[8000:, None], noisy[8000:]


def seen(zeta: float, *, seed: int = 1, line: float = 0.0, passing: float = F, wander: float = 0.0) -> bool:
    values, azimuth = shaken(seed, zeta, line, passing, wander)
    return find_passing(values, azimuth, rate=RATE, modes=[(F, zeta)], blades=3) is not None


def test_a_steady_line_in_a_damped_mode_is_seen_and_no_line_is_not():
    assert all(seen(0.06, seed=seed, line=0.3) for seed in range(5))
    assert not any(seen(0.06, seed=seed) for seed in range(20))


def test_in_a_narrow_mode_nothing_can_be_told():
    assert seen(0.005)


@pytest.mark.parametrize(("passing", "wander"), [(0.26, 0.0), (F, 0.1)])
def test_blades_that_pass_elsewhere_or_unsteadily_are_no_doubt(passing: float, wander: float):
    assert not seen(0.06, line=0.3, passing=passing, wander=wander)
