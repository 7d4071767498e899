"""Whether parts of a record say the same: its halves, and the scatter of many parts against Fisher information.

A likelihood over time is a sum of what each part of the record adds, and so is its gradient to the unknowns θ. Where
the model is true, the gradients g_k of parts are uncorrelated and have their part F_k of Fisher information as
covariance. At the mode of the posterior, with the prior information Λ and C = (Σ F_k + Λ)⁻¹, they have

    cov g_k = F_k − F_k C F_k,      cov (g_j, g_k) = −F_j C F_k,

as the mode has moved with each of them. C g_k is by how much part k moves the mode. Of each unknown two questions are
asked. Do the first and the second half pull apart by more than chance? That is the score test of a step in a parameter.
And do parts scatter by more than Fisher information tells? The sum of their squares over its expectation is the
sandwich covariance over the inverse of the information, and χ² about 1: where it is 2, bands are √2 too narrow.

Sources: Nyblom, J. Am. Statist. Ass. 84, 1989, https://doi.org/10.1080/01621459.1989.10478759 (constancy of parameters
by their scores); White, Econometrica 50, 1982, https://doi.org/10.2307/1912526 (the sandwich and the information test).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, MIN_INFORMED_SHARE, SCATTER_FALSE_ALARM_PROBABILITY
from windsysid.results.finding import Finding

__all__ = [
    "Constancy",
    "Part",
    "chances",
    "doubt_constancy",
    "doubt_halves",
    "doubt_scatter",
    "join_parts",
    "judge_constancy",
    "sum_of",
]

MAX_SEGMENTS, MIN_SEGMENTS = 10, 4
"""Setting: number of segments of a record whose scatter is tested, and the smallest number that has a scatter."""

MAX_STORED_SEGMENTS = 64
"""Setting: number of segments from which on neighbours are joined, so that memory is bounded."""


class Part(NamedTuple):
    """What a part of a record says of n unknowns.

    Attributes
    ----------
    samples
        How many it has.
    gradient, fisher
        Of its log-likelihood (n,), and its Fisher information (n, n).
    """

    samples: int
    gradient: Array
    fisher: Array

    def plus(self, more: "Part") -> "Part":
        """What both say together."""
        return Part(self.samples + more.samples, self.gradient + more.gradient, self.fisher + more.fisher)


class Constancy(NamedTuple):
    """What parts of a record say of n unknowns; zero and one where they say nothing.

    Attributes
    ----------
    apart
        By how many standard deviations of chance the second half says more than the first (n,).
    scatter
        The variance that parts scatter with over what Fisher information tells (n,).
    freedom
        Degrees of freedom of the χ² that the latter is, over them (n,); zero where it is not asked.
    """

    apart: Array
    scatter: Array
    freedom: Array


def join_parts(parts: Sequence[Part]) -> tuple[Part, ...]:
    """The same in at most `MAX_STORED_SEGMENTS` parts."""
    found = tuple(parts)
    while len(found) > MAX_STORED_SEGMENTS:
        pairs = [one.plus(other) for one, other in zip(found[::2], found[1::2], strict=False)]
        found = (*pairs, *found[2 * len(pairs) :])
    return found


def sum_of(parts: Sequence[Part], n: int) -> Part:
    """What parts say together of n unknowns."""
    whole = Part(0, np.zeros(n), np.zeros((n, n)))
    for part in parts:
        whole = whole.plus(part)
    return whole


def judge_constancy(parts: Sequence[Part], prior_cov: Array, step: Array) -> Constancy:
    """What the parts of a record say.

    Parameters
    ----------
    parts
        In the order of time, near the mode of the posterior.
    prior_cov
        Of the unknowns (n, n).
    step
        From there to the mode (n,).
    """
    n = len(step)
    C = np.linalg.inv(sum_of(parts, n).fisher + np.linalg.inv(prior_cov))
    informed = np.diag(C) < (1.0 - MIN_INFORMED_SHARE) * np.diag(prior_cov)
    apart, scatter, freedom = np.zeros(n), np.ones(n), np.zeros(n)

    if len(parts) > 1:
        first, second = _grouped(parts, 2)
        both, more = first.plus(second), second.fisher - first.fisher
        pull = second.gradient - first.gradient - more @ step
        own = np.diag(C @ (both.fisher - more @ C @ more) @ C)
        asked = informed & (own > 0.0)
        apart[asked] = (C @ pull)[asked] / np.sqrt(own[asked])
    if len(parts) >= MIN_SEGMENTS:
        some = _grouped(parts, min(MAX_SEGMENTS, len(parts)))
        by = np.array([C @ (part.gradient - part.fisher @ step) for part in some])
        known = np.array([np.diag(C @ (part.fisher - part.fisher @ C @ part.fisher) @ C) for part in some])
        total = known.sum(axis=0)
        asked = informed & (known > 0.0).all(axis=0)
        scatter[asked] = (by**2).sum(axis=0)[asked] / total[asked]
        freedom[asked] = total[asked] ** 2 / (known**2).sum(axis=0)[asked]
    return Constancy(apart, scatter, freedom)


def _grouped(parts: Sequence[Part], count: int) -> list[Part]:
    """Neighbours taken together, in so many groups of nearly as many samples each."""
    ends = np.cumsum([part.samples for part in parts])
    middles = ends - 0.5 * np.array([part.samples for part in parts])
    groups: list[Part | None] = [None] * count
    for part, at in zip(parts, (count * middles / ends[-1]).astype(int).tolist(), strict=True):
        before = groups[at]
        groups[at] = part if before is None else before.plus(part)
    return [group for group in groups if group is not None]


def chances(found: Constancy, n: int) -> tuple[Array, Array]:
    """How rarely parts of a record say so different things by chance: its halves, and the scatter of its parts, of each
    of the first n unknowns (n,)."""
    from scipy.special import gammaincc, ndtr

    half = 0.5 * np.maximum(found.freedom[:n], 1e-300)
    scattered = np.where(found.freedom[:n] > 0.0, gammaincc(half, half * found.scatter[:n]), 1.0)
    return np.asarray(2.0 * ndtr(-np.abs(found.apart[:n]))), np.asarray(scattered)


def doubt_constancy(names: Sequence[str], found: Constancy | None) -> list[Finding]:
    """Reasons where segments of the record disagree on the first unknowns, which have these names."""
    return [*doubt_halves(names, found), *doubt_scatter(names, found)]


def doubt_halves(names: Sequence[str], found: Constancy | None) -> list[Finding]:
    """A reason where the halves of the record disagree; arguments as for `doubt_constancy`."""
    if found is None or not names:
        return []
    halves = chances(found, len(names))[0]
    i = int(np.argmin(halves))
    if halves[i] >= FALSE_ALARM_PROBABILITY / len(names):
        return []
    return [Finding("halves_disagree", "reason", {"sigmas": found.apart[i]}, (names[i],))]


def doubt_scatter(names: Sequence[str], found: Constancy | None) -> list[Finding]:
    """A reason where segments scatter more than their information allows; arguments as for `doubt_constancy`."""
    if found is None or not names:
        return []
    scattered = chances(found, len(names))[1]
    j = int(np.argmin(scattered))
    if scattered[j] >= SCATTER_FALSE_ALARM_PROBABILITY / len(names):
        return []
    return [Finding("segments_scatter", "reason", {"ratio": np.sqrt(found.scatter[j])}, (names[j],))]
