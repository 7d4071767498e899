"""Comparison of turbines of the same type, and outliers among them.

The level of a coefficient at turbine i is the fleet's, plus what the turbine has of its own, plus the error of its own
estimate:

    y_i = μ + u_i + e_i,    u_i ~ N(0, τ²),    e_i ~ N(0, σ_i²).

A turbine is held against all the others: with their mean m and variance s² (τ² and their σ² together), y_i − m over
s √(1 + 1/(n − 1)) follows Student's t with n − 2 degrees of freedom (the externally studentised residual: Cook &
Weisberg, Residuals and Influence in Regression, 1982, §2.2). Where σ_i² is above the others' mean, the difference is
added to s². The chance that a healthy fleet has an outlier at all is shared out evenly among turbines and coefficients
(Bonferroni).
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

__all__ = ["MIN_TURBINES_OF_TYPE", "Standing", "stand"]

MIN_TURBINES_OF_TYPE = 5
"""Turbines of one kind that are needed to call one of them an outlier."""


class Standing(NamedTuple):
    """Coefficient of a turbine compared with those of the others of its type.

    Attributes
    ----------
    turbine, name
        Which.
    percent, low, high
        Above the mean of the others, and the 95 % interval of the turbine's own estimate [%].
    spread
        Standard deviation of the others, their estimates' errors included [%].
    score
        Student's t of the turbine against the others.
    outlier
        Whether it stands out.
    """

    turbine: str
    name: str
    percent: float
    low: float
    high: float
    spread: float
    score: float
    outlier: bool

    @property
    def sentence(self) -> str:
        """The sentence."""
        off = f"{self.percent:+.2g} % ({self.low:+.2g} … {self.high:+.2g} %) off the turbines of its type"
        return f"{self.name} is {off}, which scatter by {self.spread:.2g} %"


def stand(levels: Mapping[str, tuple[float, float]], name: str, chance: float) -> list[Standing]:
    """Each turbine of a coefficient against the others.

    Parameters
    ----------
    levels
        Of each turbine: estimate and its standard deviation, in one unit.
    name
        Of the coefficient.
    chance
        That any of them is called an outlier where none is.
    """
    from scipy.stats import t as student

    turbines = list(levels)
    n = len(turbines)
    if n < MIN_TURBINES_OF_TYPE:
        return []
    y, sigma = np.array([levels[turbine] for turbine in turbines]).T
    limit = float(student.isf(0.5 * chance / n, n - 2))
    found = []
    for i, turbine in enumerate(turbines):
        others = np.arange(n) != i
        mean = float(y[others].mean())
        variance = float(y[others].var(ddof=1)) + max(0.0, sigma[i] ** 2 - float(np.square(sigma[others]).mean()))
        score = (y[i] - mean) / math.sqrt(max(variance, 1e-300) * (1.0 + 1.0 / (n - 1)))
        percent, band, spread = (
            100.0 * value / abs(mean) for value in (y[i] - mean, 2.0 * sigma[i], math.sqrt(variance))
        )
        stands_out = bool(abs(score) > limit)
        found.append(Standing(turbine, name, percent, percent - band, percent + band, spread, float(score), stands_out))
    return found
