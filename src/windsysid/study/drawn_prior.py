"""Priors whose centres are drawn from themselves."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from windsysid.identification.model.prior import Prior
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["DrawnPrior"]


@dataclass(frozen=True)
class DrawnPrior(Prior):
    """Priors with centres drawn from themselves, so that the reference is a fair draw; the same at every call."""

    seed: int = 0

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        """As `Prior.parameters`, each centre moved."""
        rng, drawn = np.random.default_rng([self.seed, 2]), []
        for q in super().parameters(turbine, names, linear=linear):
            off = q.spread * rng.standard_normal()
            drawn.append(replace(q, centre=q.centre * math.exp(off) if q.logarithmic else q.centre + off))
        return tuple(drawn)
