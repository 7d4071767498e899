"""Nonlinearity of springs and dampers: correlation of the innovations of a linear fit with cubes of the motion.

A spring that hardens, dry friction and play are forces q³, sgn q̇ and the like. A fit takes in what of them goes with
displacement q and velocity q̇, and finds the coefficients of this amplitude. What is left goes with the cubes q³, q²q̇,
qq̇² and q̇³, which at one frequency span its third harmonic too, at any lag. Innovations z of a true model are white
and independent of all that was known a reading before, so that with the cubes φ known then (T, 4), what goes with 1, q
and q̇ of every degree of freedom taken out,

    u = Φᵀ z,    uᵀ (Σ z_t² φ_t φ_tᵀ)⁻¹ u

is χ² with four degrees of freedom: the score test (Rao 1948) of four coefficients that the model does not have, with
White's covariance, as motion and innovations grow together in gusts.

Sources: Rao, Proc. Camb. Phil. Soc. 44, 1948, https://doi.org/10.1017/S0305004100023987; White, Econometrica 48, 1980,
https://doi.org/10.2307/1912934.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import MIN_NONLINEARITY_SAMPLES
from windsysid.results.finding import Finding

__all__ = ["Bending", "Bent", "Law", "doubt_bending", "doubt_bent", "find_bent", "standardised"]

Law = Literal["stiffness", "damping"]
"""Force that depends on amplitude: with the cube of displacement, or with the sign of velocity."""

CUBIC_EXPONENTS = ((3, 0), (2, 1), (1, 2), (0, 3))
"""Setting: powers of q and of q̇ in the cubic terms."""


class Bent(NamedTuple):
    """Strongest nonlinearity.

    Attributes
    ----------
    coordinate, channel
        The degree of freedom whose cubes show in the innovations of which channel.
    statistic, bound
        χ² with four degrees of freedom, and what chance exceeds in one record of the share requested.
    """

    coordinate: str
    channel: str
    statistic: float
    bound: float


class Bending(NamedTuple):
    """Strongest amplitude dependence of stiffness or damping (`windsysid.identification.verdict.smoothed_loads`).

    Attributes
    ----------
    law, coordinates
        Which, and of which degrees of freedom, alike where there are several.
    sigmas, bound
        By how many standard deviations of chance stiffness grows, or damping falls, with amplitude; and how many count.
    """

    law: Law
    coordinates: tuple[str, ...]
    sigmas: float
    bound: float


def find_bent(
    z: Array, q: Array, rates: Array, *, channels: Sequence[str], coordinates: Sequence[str], chance: float
) -> Bent | None:
    """Of innovations z (T, m), NaN where missing, and displacements and velocities as they were known at each reading
    (T, n): where cubes of the motion show most, and what chance exceeds in so many records. None of a record too short
    or at rest."""
    from scipy.special import gammainccinv

    q, rates = standardised(q[:-1]), standardised(rates[:-1])
    later = z[1:]
    known = np.column_stack([np.ones(len(q)), q, rates])
    found: list[tuple[float, str, str]] = []
    tested = 0
    for column, channel in enumerate(channels):
        seen = np.isfinite(later[:, column]) & np.isfinite(known).all(axis=1)
        if seen.sum() < MIN_NONLINEARITY_SAMPLES:
            continue
        own = later[seen, column]
        basis = np.linalg.qr(known[seen])[0]
        for j, coordinate in enumerate(coordinates):
            cubes = np.column_stack([q[seen, j] ** a * rates[seen, j] ** b for a, b in CUBIC_EXPONENTS])
            cubes = cubes - basis @ (basis.T @ cubes)
            u = cubes.T @ own
            try:
                scatter = cubes * own[:, None]
                statistic = float(u @ np.linalg.solve(scatter.T @ scatter, u))
            except np.linalg.LinAlgError:  # a degree of freedom at rest
                continue
            tested += 1
            found.append((statistic, coordinate, channel))
    if not found:
        return None
    bound = 2.0 * float(gammainccinv(0.5 * len(CUBIC_EXPONENTS), chance / tested))
    statistic, coordinate, channel = max(found)
    return Bent(coordinate, channel, statistic, bound)


def standardised(values: Array) -> Array:
    """Values (T, n) about their mean, of rms 1."""
    centred = values - np.nanmean(values, axis=0)
    return np.asarray(centred / np.maximum(np.nanstd(centred, axis=0), 1e-300))


def doubt_bent(bent: Bent | None) -> list[Finding]:
    """A reason where cubes of the motion show in innovations."""
    if bent is None or bent.statistic <= bent.bound:
        return []
    return [Finding("nonlinear_force", "reason", bent._asdict())]


def doubt_bending(bending: Bending | None) -> list[Finding]:
    """A reason where stiffness or damping depends on amplitude."""
    if bending is None or abs(bending.sigmas) <= bending.bound:
        return []
    return [Finding("amplitude_dependence", "reason", bending._asdict())]
