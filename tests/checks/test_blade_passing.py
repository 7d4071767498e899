"""Blades that pass on a mode at a steady speed are seen; those that pass elsewhere, or unsteadily, are not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from windsysid.checks.blade_passing import Passing, find_passing

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
    return find_passing([("", F, zeta)], 3, readings=(values, azimuth, RATE)) is not None


def test_a_steady_line_in_a_damped_mode_is_seen_and_no_line_is_not():
    assert all(seen(0.06, seed=seed, line=0.3) for seed in range(5))
    assert not any(seen(0.06, seed=seed) for seed in range(20))


def test_in_a_narrow_mode_nothing_can_be_told():
    assert seen(0.005)


@pytest.mark.parametrize(("passing", "wander"), [(0.26, 0.0), (F, 0.1)])
def test_blades_that_pass_elsewhere_or_unsteadily_are_no_doubt(passing: float, wander: float):
    assert not seen(0.06, line=0.3, passing=passing, wander=wander)


def swinging(swing: float):
    """Readings of a mode of 6 % with a line of the passing blades, and the azimuth of a rotor whose speed swings by a
    share about its mean, three times in the record."""
    rng, time = np.random.default_rng(7), np.arange(SAMPLES) / RATE
    speed = 2.0 * np.pi * F / 3.0 * (1.0 + swing * np.sin(2.0 * np.pi * 3.0 * time / time[-1]))
    azimuth = np.cumsum(speed) / RATE
    return rng.standard_normal((SAMPLES, 1)) + 0.5 * np.cos(3.0 * azimuth)[:, None], azimuth


@pytest.mark.parametrize(("sigmas", "steady"), [(0.9, True), (1.1, False)])
def test_blades_pass_steadily_if_their_frequency_scatters_by_less_than_the_half_width(sigmas: float, steady: bool):
    values, azimuth = swinging(sigmas * 0.06 * np.sqrt(2.0))  # of a sine, the amplitude over the standard deviation
    found = find_passing([("", F, 0.06)], 3, readings=(values, azimuth, RATE))
    assert (found is not None) is steady


@pytest.mark.parametrize(
    ("passing", "natural", "half_width", "code"),
    [
        (0.312, 0.32, 0.002, "blade_passing_on_mode"),
        (0.60, 0.44, 0.17, "blade_passing_in_mode"),
        (0.60, 0.44, 0.03, "blade_passing_unresolved"),
    ],
)
def test_the_blades_are_said_to_pass_on_a_mode_only_where_they_are_near_it(
    passing: float, natural: float, half_width: float, code: str
):
    found = Passing(passing, natural, half_width, 0.14).finding(3)
    assert (found.code, found.severity) == (code, "reason")
    assert (found.data["frequency"], found.data["mode"], found.data["blades"]) == (passing, natural, 3)


def test_what_is_said_of_passing_blades_is_what_was_measured():
    values, azimuth = shaken(1, 0.4, 0.3, 0.44)
    found = find_passing([("", F, 0.4)], 3, readings=(values, azimuth, RATE))
    assert found is not None
    assert found[:4] == pytest.approx((0.44, F, 0.128, 3.0 * RATE / SAMPLES), abs=1e-4)
    assert found.finding(3).code == "blade_passing_in_mode"
    assert found.finding(3).data["damping"] == pytest.approx(0.4)


@pytest.mark.parametrize(("passing", "near"), [(0.26, False), (0.27, True), (0.38, True), (0.39, False), (0.0, False)])
def test_a_load_that_is_not_modelled_is_told_within_a_factor_of_a_natural_frequency(passing: float, near: bool):
    found = find_passing([("pitch", 5.0, 0.01), ("fore_aft", F, 0.01)], 3, passing / 3.0)
    assert (found is not None) is near
    if found is not None:
        assert found.finding(3).code == "blade_passing_near_mode"
        assert found.finding(3).data["coordinate"] == "fore_aft"
