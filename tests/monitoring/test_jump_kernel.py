"""The steps of the compiled filter, each against NumPy."""

from typing import Any

import numpy as np
import pytest

from windsysid.monitoring.levels import jump_kernel
from windsysid.monitoring.levels.jumps import LevelBelief, Observations, Rates, track

KERNEL: Any = jump_kernel
"""With `py_func` of each compiled function."""


def test_a_correction_is_josephs_form():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 3))
    cov, h, noise = root @ root.T, rng.standard_normal(3), 0.7
    cross = cov @ h
    variance = float(h @ cross) + noise
    gain, mean, after = np.empty(3), np.zeros(3), cov.copy()
    KERNEL._correct.py_func(0.5, variance, gain, cross, mean, after)
    np.testing.assert_allclose(gain, cross / variance)
    np.testing.assert_allclose(mean, 0.5 * gain)
    left = np.eye(3) - np.outer(gain, h)
    np.testing.assert_allclose(after, left @ cov @ left.T + noise * np.outer(gain, gain), atol=1e-12)


def test_candidates_that_are_kept_lie_a_share_of_their_age_apart_and_none_is_too_old():
    begun, sums = np.arange(100), np.arange(300.0).reshape(100, 3)
    kept = KERNEL._thin.py_func(begun, sums, 100, 99, 80, 0.1)
    ages = 100 - begun[:kept]
    assert ages.max() < 80
    assert begun[kept - 1] == 99
    np.testing.assert_array_equal(sums[:kept, 0], 3.0 * begun[:kept])
    assert (begun[2:kept] - begun[: kept - 2] > 0.1 * ages[1:-1]).all()


@pytest.mark.parametrize(("logarithmic", "expected"), [(1.0, np.exp(-0.5)), (0.0, 1.5 / 2.0)])
def test_the_foreseen_value_over_the_blocks_own(logarithmic: float, expected: float):
    assert KERNEL._value_ratio.py_func(2.0, 0.5, logarithmic, 4.0) == pytest.approx(expected)
    assert KERNEL._value_ratio.py_func(2.0, 50.0, 1.0, 4.0) == 0.25


def test_the_compiled_run_is_the_recursive_mean_of_a_constant_level():
    y = np.random.default_rng(2).normal(1.0, 0.1, 50)  # far within the limits of innovations
    blocks = Observations.of(y, np.ones(50), np.empty((50, 0)))
    done = track(blocks, LevelBelief(np.zeros(1), np.full((1, 1), 1e6)), Rates(0.0, 1.0), test=False)
    assert done.belief.mean[0] == pytest.approx(y.mean(), rel=1e-6)
    assert done.belief.cov[0, 0] == pytest.approx(1.0 / 50, rel=1e-6)
