"""Likelihood of a record: its posterior with the prior divided out."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.loads.statistics import to_logarithms
from windsysid.mechanics.rotor import MEAN_LAG
from windsysid.results.posterior import Posterior
from windsysid.statespace.parameter import Parameter

__all__ = [
    "TYPICAL_CHANGE", "Difference", "common_frame", "difference_between", "estimate_of", "own_information",
    "without_prior",
]  # fmt: skip


TYPICAL_CHANGE = {"stiffness": 0.1, "damping": 0.5, "load": 0.5, "noise": 0.5}
"""Relative prior standard deviation of a change: of stiffness (and anything else), damping, loads' and noise's levels.
"""

PRIOR_SHARE_LEFT = 1e-6
"""Share of the prior's information that is left where it is taken out."""

MIN_VARIANCE_SHARE = 1e-9
"""Least share by which a record must narrow the prior's variance in a direction; less is rounding."""


def own_information(result: Posterior, frame: Sequence[Parameter]) -> tuple[Array, Array]:
    """Information of a record itself: the result's posterior with its prior divided out.

    A stiffness that is linear in the result and logarithmic in `frame`, or the other way round, is taken along its
    tangent at the estimate. The prior is divided out of the model's own posterior, and what remains is then widened as
    the result was: a wider interval about the same estimate has no likelihood that gives it together with the prior.

    Parameters
    ----------
    result
        Of the record.
    frame
        The n coefficients or learned statistics that are requested, in the coordinates that are required; all must be
        in `result`. Their priors do not matter.

    Returns
    -------
    tuple
        Information (n, n), positive semidefinite, and vector (n,): the logarithm of the likelihood is −½ θᵀ J θ + hᵀ θ
        + const.
    """
    known = _Belief.of(result)
    at = [known.names.index(q.name) for q in frame]
    stretch, mean = np.empty(len(frame)), np.empty(len(frame))
    wider = np.array([result.widening.get(q.name, 1.0) for q in frame])
    for i, q in enumerate(frame):
        own = known.parameters[at[i]]
        value = float(own.physical(known.mean[at[i]]))
        stretch[i] = (value if own.logarithmic else own.scale) / (value if q.logarithmic else q.scale)
        mean[i] = q.coordinate(value)
    prior_mean = mean + stretch * (known.prior_mean[at] - known.mean[at])
    wide, prior_cov = (c[np.ix_(at, at)] * np.outer(stretch, stretch) for c in (known.cov, known.prior_cov))
    # In the prior's own measure the information is 1/share − 1 along each axis, with no small difference of large
    # numbers; the data's part of the posterior, 1 − share, is what was widened.
    measure = np.linalg.inv(np.linalg.cholesky(prior_cov))
    share, axes = np.linalg.eigh(measure @ (wide / np.outer(wider, wider)) @ measure.T)
    seen = share < 1.0 - MIN_VARIANCE_SHARE
    rows, share = axes[:, seen].T @ measure, share[seen]
    factor = 1.0 + ((rows @ wide * rows).sum(axis=1) / share - 1.0) / (1.0 - share)
    information = (rows.T * ((1.0 / share - 1.0) / factor)) @ rows
    vector = rows.T @ (rows @ (mean - prior_mean) / (share * factor)) + information @ prior_mean
    return information, np.asarray(vector, dtype=np.float64)


def without_prior(result: Posterior, frame: Sequence[Parameter]) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of the coefficients of `frame` from the record alone, in its coordinates.

    A millionth of the information of `frame`'s own priors keeps finite what the record does not see.
    """
    information, vector = own_information(result, frame)
    centre, spread = np.array([q.prior for q in frame]).T
    mean, cov = combine_with_prior(
        information * np.outer(spread, spread), vector * spread + PRIOR_SHARE_LEFT * centre / spread, PRIOR_SHARE_LEFT
    )
    return mean * spread, cov * np.outer(spread, spread)


class _Belief(NamedTuple):
    """All that a result knows: coefficients in filter coordinates, statistics as ln(value / given), and the prior."""

    parameters: tuple[Parameter, ...]
    mean: Array
    cov: Array
    prior_mean: Array
    prior_cov: Array

    @classmethod
    def of(cls, result: Posterior) -> "_Belief":
        result = result.given()  # instruments and masses are the same in every result of a machine
        priors = np.array([q.prior for q in result.parameters])
        if result.joint_cov is None:
            return cls(result.parameters, result.theta, result.cov, priors[:, 0], np.diag(priors[:, 1] ** 2))
        n, learned = len(result.parameters), result.statistics
        turn = np.eye(n + len(learned))
        turn[n:, n:] = to_logarithms(learned)
        spread = np.concatenate([priors[:, 1], [s.spread for s in learned]])
        return cls(
            (*result.parameters, *(Parameter(s.name, s.given, s.spread) for s in learned)),
            np.concatenate([result.theta, [math.log(s.estimate / s.given) for s in learned]]),
            turn @ result.joint_cov @ turn.T,
            np.concatenate([priors[:, 0], np.zeros(len(learned))]),
            (turn * spread**2) @ turn.T,
        )

    @property
    def names(self) -> list[str]:
        return [q.name for q in self.parameters]


def common_frame(before: Posterior, after: Posterior) -> tuple[Parameter, ...]:
    """Coordinates of the coefficients that both identified, equal for (A, B) and (B, A).

    The mean lag angle under wind is left out: it is no property of the structure. Priors are as wide as changes by
    damage.
    """
    found = []
    others = {q.name: q for q in after.parameters if q.name != MEAN_LAG}
    for q in before.parameters:
        other = others.get(q.name)
        if other is None:
            continue
        a, b = estimate_of(before, q.name), estimate_of(after, q.name)
        kind = before.turbine.model.coefficient(q.name).kind
        typical = TYPICAL_CHANGE.get(kind, TYPICAL_CHANGE["stiffness"])
        if (q.logarithmic or other.logarithmic) and min(a, b) > 0.0:
            found.append(Parameter(q.name, math.sqrt(a * b), typical))
            continue
        # What the prior expects to be about zero has no size of its own.
        free = q.centre == 0.0 == other.centre
        size = (0.0 if free else 0.5 * (abs(a) + abs(b))) or math.sqrt(q.spread * other.spread)
        found.append(Parameter(q.name, 0.5 * (a + b), typical * size, False, size))
    return tuple(found)


class Difference(NamedTuple):
    """Information of two records on the change, in standard deviations of its prior.

    Eigenvalues (n,) and axes (n, n) of P, and the vector g (n,).
    """

    information: Array
    vector: Array
    spread: Array

    def with_prior(self, width: float) -> tuple[Array, Array]:
        """Mean (n,) and covariance (n, n) in the frame's coordinates; the prior is so many times damage's."""
        mean, cov = combine_with_prior(self.information, self.vector, width**-2.0)
        return mean * self.spread, cov * np.outer(self.spread, self.spread)


def difference_between(before: Posterior, after: Posterior, frame: Sequence[Parameter]) -> Difference:
    """The likelihood of the change in the coordinates of `frame`."""
    spread = np.array([q.prior[1] for q in frame])
    (a, h_a), (b, h_b) = (own_information(result, frame) for result in (before, after))
    a, b, h_a, h_b = a * np.outer(spread, spread), b * np.outer(spread, spread), h_a * spread, h_b * spread
    values, axes = np.linalg.eigh(a + b)
    seen = values > PRIOR_SHARE_LEFT
    pooled = (axes[:, seen] / values[seen]) @ axes[:, seen].T
    shared = a @ pooled @ b
    return Difference(0.5 * (shared + shared.T), a @ (pooled @ h_b) - b @ (pooled @ h_a), spread)


def combine_with_prior(information: Array, vector: Array, prior: float) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of an information and a vector; every direction has the information `prior`."""
    values, axes = np.linalg.eigh(information)
    cov = (axes / (values.clip(0.0) + prior)) @ axes.T
    return cov @ vector, cov


def estimate_of(result: Posterior, name: str) -> float:
    """The estimate of a coefficient or a statistic, in its own unit."""
    learned = {s.name: s.estimate for s in result.statistics}
    return float(learned[name] if name in learned else result.turbine.values[name])
