"""A spring that hardens leaves cubes of the motion in what a straight line does not explain; a linear one leaves
none."""

import numpy as np
import pytest
from scipy import stats

from windsysid.checks.nonlinearity import Bending, Law, doubt_bending, find_bent

STEP, OMEGA = 0.02, 2.0 * np.pi


def explained(
    seed: int, hardening: float, samples: int = 4000, *, gusts: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is left of each step's velocity by the best straight line, displacement and velocity: an oscillator at 1 Hz
    that noise drives to an rms of 0.4, in gusts three times as much, its spring stiffer by `hardening` at 1."""
    rng = np.random.default_rng(seed)
    kicks = rng.standard_normal(samples)
    if gusts:
        kicks *= np.where(np.arange(samples) // 500 % 2, 3.0, 1.0)
    q, v = np.zeros(samples), np.zeros(samples)
    for i in range(samples - 1):
        spring = OMEGA**2 * q[i] * (1.0 + hardening * q[i] ** 2)
        v[i + 1] = v[i] - STEP * (spring + 0.1 * OMEGA * v[i]) + 0.4 * kicks[i]
        q[i + 1] = q[i] + STEP * v[i + 1]
    line = np.column_stack([q[:-1], v[:-1]])
    left = v[1:] - line @ np.linalg.lstsq(line, v[1:], rcond=None)[0]
    z = np.concatenate([[0.0], left / left.std()])
    return z[:, None], q[:, None], v[:, None]


def bent(seed: int, hardening: float, chance: float = 1e-3, *, gusts: bool = False):
    z, q, v = explained(seed, hardening, gusts=gusts)
    return find_bent(z, q, v, channels=["a"], coordinates=["x"], chance=chance)


@pytest.mark.slow
def test_a_straight_spring_is_as_bent_as_chance_makes_it():
    # 200 records: what one in 20 exceeds by chance, at most 18 do (one in 100 such tests would see more).
    found = [bent(seed, 0.0, 0.05) for seed in range(200)]
    assert sum(one is not None and one.statistic > one.bound for one in found) <= 18
    statistics = [one.statistic for one in found if one is not None]
    assert np.median(statistics) == pytest.approx(stats.chi2(4).median(), rel=0.2)


@pytest.mark.slow
def test_gusts_do_not_bend_a_straight_spring():
    """Motion and innovations grow together in gusts: of 100 records up to 10 exceed what one in 20 does by chance (one
    in 100 such tests would see more); with the variance of steady records 15 did."""
    found = [bent(seed, 0.0, 0.05, gusts=True) for seed in range(1000, 1100)]
    assert sum(one is not None and one.statistic > one.bound for one in found) <= 10
    hard = bent(4, 0.1, gusts=True)
    assert hard is not None
    assert hard.statistic > hard.bound


def test_a_spring_that_hardens_is_found_and_named():
    for seed in range(5):
        found = bent(seed, 0.5)
        assert found is not None
        assert found.statistic > found.bound
    z, q, v = explained(1, 0.5)
    z[100:110] = np.nan
    found = find_bent(z, q, v, channels=["a"], coordinates=["x"], chance=1e-3)
    assert found is not None
    assert found.statistic > found.bound


def test_what_rests_or_is_too_short_says_nothing():
    z, q, v = explained(2, 0.5, samples=150)
    assert find_bent(z, q, v, channels=["a"], coordinates=["x"], chance=1e-3) is None
    z, q, v = explained(3, 0.5)
    rest = np.zeros_like(q)
    assert find_bent(z, rest, rest, channels=["a"], coordinates=["x"], chance=1e-3) is None


def test_the_bound_grows_with_what_is_looked_at():
    z, q, v = explained(3, 0.0)
    names = [str(i) for i in range(6)]
    found = find_bent(np.tile(z, 6), q, v, channels=names, coordinates=["x"], chance=1e-3)
    assert found is not None
    assert found.bound == pytest.approx(stats.chi2(4).isf(1e-3 / 6.0))


@pytest.mark.parametrize(
    ("law", "sigmas", "said", "cause"),
    [
        ("stiffness", 9.0, "stiffness of x grows with amplitude", "hardens"),
        ("stiffness", -9.0, "stiffness of x falls with amplitude", "softens"),
        ("damping", 9.0, "damping of x falls with amplitude", "dry friction"),
        ("damping", -9.0, "damping of x grows with amplitude", "nonlinear damping"),
    ],
)
def test_what_goes_with_amplitude_is_said_with_its_direction(law: Law, sigmas: float, said: str, cause: str):
    (doubt,) = doubt_bending(Bending(law, ("x",), sigmas, 4.0))
    assert (doubt.code, doubt.data["law"], doubt.data["sigmas"]) == ("amplitude_dependence", law, sigmas)
    assert str(doubt).startswith(said)
    assert cause in str(doubt)
    assert doubt_bending(Bending(law, ("x",), 0.4 * sigmas, 4.0)) == []
