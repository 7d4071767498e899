"""Conditional covariance of a Gaussian posterior."""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array

__all__ = ["hold"]


def hold(mean: Array, cov: Array, at: Sequence[int], values: Array | float = 0.0) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) given that the unknowns `at` have those values; they stay, without variance.

    N(m_a + C_ab C_bb⁻¹ (v − m_b), C_aa − C_ab C_bb⁻¹ C_ba), for instance Bishop, Pattern Recognition and Machine
    Learning, Eq. (2.81).
    """
    held = np.asarray(at, dtype=np.intp)
    if not held.size:
        return mean.copy(), cov.copy()
    across = cov[:, held]
    gain = np.linalg.lstsq(cov[np.ix_(held, held)], across.T, rcond=None)[0].T  # some may be held already
    found, left = mean + gain @ (values - mean[held]), cov - gain @ across.T
    found[held] = values
    left[held] = left[:, held] = 0.0
    return found, 0.5 * (left + left.T)
