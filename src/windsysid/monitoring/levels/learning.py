"""Rates of a series, learned from its blocks: random walk of the level, scatter of the blocks about it, and growth of
their variance with the estimate.
"""

import math

import numpy as np

from windsysid._types import Array
from windsysid.monitoring.levels.jumps import LevelBelief, Observations, Rates, track

__all__ = ["LOG_SCATTER_STD", "MEAN_SQUARED_SCATTER", "learn_growth", "learn_rates"]

LOG_RANDOM_WALK_PRIOR = (math.log(1e-2), math.log(10.0))
"""Prior of ln(√q / √r): median and standard deviation.

A block lets the level move by a hundredth of its own σ, give or take a factor of ten: by 12 hundredths in a day of 10
minutes.
"""

LOG_SCATTER_STD = 0.5
"""Prior standard deviation of ln s."""

MEAN_SQUARED_SCATTER = math.exp(2.0 * LOG_SCATTER_STD**2)
"""Mean of s² before anything was learned."""

MAX_GROWTH = 2.0
"""Power with which a variance may grow with its estimate: 1 for a mode under broadband load, 2 for a constant ratio."""


def learn_rates(blocks: Observations, prior: LevelBelief, *, kind: str = "k", logarithmic: bool = True) -> Rates:
    """Random walk and scatter of a series by maximum likelihood, with `LOG_RANDOM_WALK_PRIOR` and `LOG_SCATTER_STD`.

    The wander is averaged over its likelihood. Of a damping, kind ``c``, it is learned how its variance grows, too.
    """
    from scipy.optimize import minimize

    y, r = blocks.y, blocks.r
    usual = float(np.nanmedian(np.where(np.isfinite(y), r, np.nan)))
    growth = learn_growth(y, r, logarithmic) if kind == "c" else 0.0

    def rates(at: Array) -> Rates:
        return Rates(usual * math.exp(2.0 * at[0]), math.exp(2.0 * at[1]), growth, logarithmic)

    def cost(at: Array) -> float:
        if abs(at).max() > 30.0:
            return math.inf
        off = ((at[0] - LOG_RANDOM_WALK_PRIOR[0]) / LOG_RANDOM_WALK_PRIOR[1]) ** 2 + (at[1] / LOG_SCATTER_STD) ** 2
        return 0.5 * float(off) - track(blocks, prior, rates(at), test=False).log_likelihood

    start = np.array([LOG_RANDOM_WALK_PRIOR[0], 0.0])
    simplex = start + np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 0.5]])
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.02, "maxiter": 120},
    )
    # The most likely wander is often next to none where it is only not seen yet: its mean over what is likely is what
    # the level needs.
    around = found.x[0] + np.arange(-3.0, 3.25, 0.5)
    costs = np.array([cost(np.array([at, found.x[1]])) for at in around])
    weight = np.exp(costs.min() - costs)
    tried = [rates(np.array([at, found.x[1]])) for at in around]
    return tried[0]._replace(wander=float(weight @ [one.wander for one in tried] / weight.sum()))


def learn_growth(y: Array, r: Array, logarithmic: bool) -> float:
    """Power with which variances (T,) grow with estimates (T,), 0 … `MAX_GROWTH`, by least squares.

    For values in logarithms r is the variance of a logarithm, and grows by 2 less than that of the value.
    """
    good = np.isfinite(y) & (np.ones(len(y), dtype=bool) if logarithmic else y > 0.0)
    if not good.any():
        return 0.0
    at = y[good] if logarithmic else np.log(y[good])
    at = at - at.mean()
    spread = float(at @ at)
    slope = float(at @ np.log(r[good])) / spread if spread > 0.0 else 0.0
    lowest = -2.0 if logarithmic else 0.0
    return min(max(slope, lowest), lowest + MAX_GROWTH)
