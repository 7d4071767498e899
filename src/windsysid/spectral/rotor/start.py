"""Where a search in the frequency domain begins."""

from collections.abc import Sequence

from windsysid._types import Array
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["damped_start"]

LEAST_DAMPING = 0.3
"""Of a start, in standard deviations of the prior."""


def damped_start(turbine: Turbine, parameters: Sequence[Parameter], mean: Array, std: Array) -> Array:
    """The prior's mean (n,), with damping that is not negative. A spectrum says |c| and not c: from the wrong side the
    search ends at the mirror image."""
    start = mean.copy()
    for i, q in enumerate(parameters):
        if q.kind == "damping" and q.part in turbine.model.coordinates and not q.logarithmic:
            start[i] = max(start[i], LEAST_DAMPING * std[i])
    return start
