"""The mode of a posterior in stages: the likelihood is given more weight, and more of the bins, from stage to stage.

Each stage is a search by Fisher scoring (`windsysid.scoring`) under an independent Gaussian prior of every unknown.
"""

from collections.abc import Callable, Sequence

import numpy as np

from windsysid._types import Array
from windsysid.scoring import Evaluation, SearchLimits, SearchResult, find_mode

__all__ = ["FINE_TOLERANCE", "SpectralMode", "find_in_stages", "find_nearby"]

FINE_TOLERANCE, COARSE_TOLERANCE = 1e-3, 0.1
"""Numerical: Newton decrement of the last step: 0.03 standard deviations in the last stage, 0.3 before it."""

FINE = SearchLimits(FINE_TOLERANCE, max_steps=60)
"""Numerical: limits of the last stage."""
COARSE = SearchLimits(COARSE_TOLERANCE, max_steps=8)
"""Numerical: limits of the stages before it."""
NEARBY = SearchLimits(COARSE_TOLERANCE, max_steps=60, unseen=0.5, damping=0.0)
"""Numerical: limits of a search that starts near the mode: a step of 0.7 standard deviations is taken untested."""

MAX_STEP = 1.0
"""Numerical: longest step of an unknown with a wider prior: a factor e of a level."""

Likelihood = Callable[[Array, int], tuple[float, Array, Array]]
"""(u, every n-th bin) → J, g, F."""


SpectralMode = SearchResult[Array, Evaluation]
"""A mode of a posterior: its information is Fisher's with that of the prior."""


def find_in_stages(
    likelihood: Likelihood, start: Array, prior: tuple[Array, Array], stages: Sequence[tuple[float, int]], *,
    rough: bool = False, tolerance: float = FINE_TOLERANCE,
) -> SpectralMode:  # fmt: skip
    """Minimise weight · J(u) + ½ Σ ((u − m)/s)² in stages of (weight, every n-th bin).

    Parameters
    ----------
    prior
        Means m and standard deviations s (n,).
    rough
        Whether the last stage, too, ends as those before it.
    tolerance
        Newton's decrement of the step that ends the last stage.
    """
    point, steps = start, 0
    for number, stage in enumerate(stages, start=1):
        limits = COARSE if rough or number < len(stages) else FINE._replace(tolerance=tolerance)
        found = _search(likelihood, point, prior, stage, limits)
        point, steps = found.point, steps + found.steps
    return found._replace(steps=steps)


def find_nearby(likelihood: Likelihood, start: Array, prior: tuple[Array, Array]) -> SpectralMode:
    """Minimise the same from a start that is near the mode, with few evaluations of all bins."""
    return _search(likelihood, start, prior, (1.0, 1), NEARBY)


def _search(
    likelihood: Likelihood, start: Array, prior: tuple[Array, Array], stage: tuple[float, int], limits: SearchLimits
) -> SpectralMode:
    mean, std = prior
    precision, (weight, every) = np.diag(std**-2.0), stage

    def evaluate(unknowns: Array) -> Evaluation:
        found = Evaluation(*likelihood(unknowns, every))
        if not (np.isfinite(found.value) and np.isfinite(found.information).all()):
            raise np.linalg.LinAlgError("the spectrum is not finite")
        return found.with_prior(unknowns - mean, precision, weight)

    return find_mode(evaluate, start, limits, max_step=np.minimum(std, MAX_STEP))
