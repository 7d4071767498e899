"""Eigenvalues of a linearised model, with names by participation and intervals by the rounding of its files.

Participation of the coordinate k in the mode m is |l_mk r_km|, l and r being the left and right eigenvectors with
l_m r_m = 1: a number without unit, however states are scaled. Source: Pérez-Arriaga, Verghese & Schweppe, Selective
modal analysis, IEEE Trans. Power Apparatus and Systems 101 (1982).

Intervals are those of eigenvalues of A + dA, each entry of dA drawn uniformly within its rounding error: the two tower
modes are closer to each other than four digits can tell, so a linear propagation would understate them.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, cast

import numpy as np

from windsysid._types import Array, Complex
from windsysid.modal.analysis import ModalSpectrum
from windsysid.modal.linearisation.coordinates import ModelCoordinates
from windsysid.modal.linearisation.lin_file import LinearisedModel
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.mode import Mode

__all__ = ["DampedSpectrum", "LinearisedMode", "ModelModes", "model_modes"]

MIN_FREQUENCY_HZ = 1e-3
"""Setting: lowest frequency of a mode [Hz]; moored platforms have 0.003 Hz and more, and a free rotor drifts."""

MIN_PLATFORM_SHARE = 0.75
"""Setting: share of the support's participation from which a mode is one of the platform and not of the tower."""

MIN_STRUCTURAL_SHARE = 0.5
"""Setting: participation of states of second order from which an oscillation is a mode of the structure."""

ROUNDING_DRAWS = 50
"""Setting: number of draws of the rounding errors; a standard deviation from them is known to 10 %."""

MIN_EXACT_DIGITS = 9
"""Setting: number of digits from which rounding is not propagated; at 13 it moves a tower mode by 1e-11."""

_SUPPORT = {
    "tower fore-aft": ("tower fore-aft", "platform surge", "platform pitch"),
    "tower side-side": ("tower side-side", "platform sway", "platform roll"),
}
"""Degrees of freedom that move together in a bending mode of the support."""


@dataclass(frozen=True)
class LinearisedMode(Mode):
    """A mode of a linearised model.

    Attributes
    ----------
    name
        By the largest participation; modes of one kind are numbered by frequency from the second on.
    frequency
        Damped frequency Im λ / 2π [Hz], with its 95 % interval by the rounding of the files.
    damping_ratio
        −Re λ / |λ| [1], likewise.
    participation
        Share of each kind of degree of freedom [1], largest first.
    shape
        Displacement of each kind, of any scale: metres of the tower top and of blade tips, radians of a platform.
    """

    participation: Mapping[str, float]
    shape: Mapping[str, complex]

    @property
    def main_parts(self) -> str:
        """The largest participations, in words."""
        parts = [(kind, round(100.0 * share)) for kind, share in self.participation.items()]
        return ", ".join(f"{kind} {share} %" for kind, share in parts[:3] if share >= 10)

    @property
    def values_text(self) -> tuple[str, str, str]:
        """Name, frequency [Hz] and damping ratio [%], without intervals."""
        return self.name, f"{self.frequency.estimate:.5f}", f"{100.0 * self.damping_ratio.estimate:.3f}"


class DampedSpectrum(ModalSpectrum):
    """Modes at one rotor speed with their damped frequency, to be linked with those at others."""

    @property
    def frequency(self) -> Array:
        """Im λ / 2π (m,) [Hz]."""
        return self.exponents.imag / (2.0 * math.pi)

    def frequency_and_damping_slopes(self) -> tuple[Array, Array]:
        """Derivatives of `frequency` [Hz] and `damping`, (m, n_θ) each."""
        return self.slopes.imag / (2.0 * math.pi), super().frequency_and_damping_slopes()[1]


class ModelModes(NamedTuple):
    """Modes at one operating point, with their spectrum, and the number of oscillations that are not structural."""

    modes: tuple[LinearisedMode, ...]
    spectrum: DampedSpectrum
    left_out: int


def model_modes(files: Sequence[LinearisedModel], coordinates: ModelCoordinates) -> ModelModes:
    """Modes of the average over the azimuths of some files, in multi-blade coordinates.

    The slopes of the spectrum are those to two standard normal variables, which stand for the rounding of the files.
    """
    from scipy.linalg import eig

    average = np.mean([coordinates.transformed(one) for one in files], axis=0)
    exponents, left, right = cast("tuple[Complex, Complex, Complex]", eig(average, left=True))
    seen = np.flatnonzero(exponents.imag > 2.0 * math.pi * MIN_FREQUENCY_HZ)
    seen = seen[np.argsort(exponents[seen].imag)]
    exponents, r = exponents[seen], right[:, seen]
    rows = np.conj(left[:, seen]).T
    rows /= np.einsum("mi,im->m", rows, r)[:, None]
    U = coordinates.whirls()
    participation = np.abs((rows @ np.conj(U).T) * (U @ r).T)
    participation /= participation.sum(axis=1, keepdims=True)
    shares = [coordinates.shares(p) for p in participation]
    motions = coordinates.motions(U @ r)
    keep = [m for m, (_, structural) in enumerate(shares) if structural >= MIN_STRUCTURAL_SHARE]
    slopes = _rounding_slopes(files, coordinates, exponents)
    spectrum = DampedSpectrum(
        exponents[keep], _numbered([_name(shares[m][0]) for m in keep]),
        np.asarray(participation[keep] / np.linalg.norm(participation[keep], axis=1)[:, None], dtype=complex),
        slopes[keep], float(np.max(exponents[keep].real, initial=-math.inf)),
        "Coleman" if coordinates.rotates else "constant",
    )  # fmt: skip
    stds = [np.linalg.norm(d, axis=1) for d in spectrum.frequency_and_damping_slopes()]
    f, f_std, z, z_std = (v.tolist() for v in (spectrum.frequency, stds[0], spectrum.damping, stds[1]))
    modes = tuple(
        LinearisedMode(
            name,
            IntervalEstimate.normal(f[i], f_std[i], "Hz"),
            IntervalEstimate.normal(z[i], z_std[i], "1"),
            shares[m][0],
            {kind: complex(v[m]) for kind, v in motions.items()},
        )
        for i, (m, name) in enumerate(zip(keep, spectrum.names, strict=True))
    )
    return ModelModes(modes, spectrum, len(seen) - len(keep))


def _rounding_slopes(files: Sequence[LinearisedModel], coordinates: ModelCoordinates, exponents: Complex) -> Complex:
    """dλ (m, 2) to two standard normal variables, which have the covariance of Re λ and Im λ by rounding."""
    from scipy.optimize import linear_sum_assignment

    if min(found.digits for found in files) >= MIN_EXACT_DIGITS:
        return np.zeros((len(exponents), 2), dtype=complex)
    random = np.random.default_rng(0)
    draws = np.zeros((ROUNDING_DRAWS, len(exponents)), dtype=complex)
    for draw in draws:
        drawn = _with_rounding(files, random)
        here = np.linalg.eigvals(np.mean([coordinates.transformed(one) for one in drawn], axis=0))
        here = here[here.imag >= 0.0]
        rows, columns = linear_sum_assignment(np.abs(exponents[:, None] - here))
        draw[rows] = here[columns] - exponents[rows]
    real, imaginary = np.mean(draws.real**2, axis=0), np.mean(draws.imag**2, axis=0)
    along = np.mean(draws.real * draws.imag, axis=0) / np.sqrt(np.maximum(real, np.finfo(float).tiny))
    return np.column_stack([np.sqrt(real) + 1j * along, 1j * np.sqrt(np.maximum(imaginary - along**2, 0.0))])


def _with_rounding(files: Sequence[LinearisedModel], random: np.random.Generator) -> list[LinearisedModel]:
    """Draw the rounding errors of some files; entries with equal values, as equal blades have them, have equal
    errors."""
    entries = np.array([one.A for one in files])
    values, which = np.unique(np.abs(entries), return_inverse=True)
    errors = np.sign(entries) * random.uniform(-1.0, 1.0, len(values))[which.reshape(entries.shape)]
    return [replace(one, A=one.A + one.rounding * error) for one, error in zip(files, errors, strict=True)]


def _name(shares: Mapping[str, float]) -> str:
    """The kind with the largest participation, the support's degrees of freedom being taken together."""
    totals = dict(shares)
    for kind, members in _SUPPORT.items():
        totals[kind] = sum(totals.pop(member, 0.0) for member in members)
    largest = max(totals, key=totals.__getitem__)
    platform = {member: shares.get(member, 0.0) for member in _SUPPORT.get(largest, ())[1:]}
    if platform and sum(platform.values()) >= MIN_PLATFORM_SHARE * totals[largest]:
        return max(platform, key=platform.__getitem__)
    return largest


def _numbered(names: Sequence[str]) -> tuple[str, ...]:
    """Names with a number from the second of a kind on."""
    seen = Counter[str]()
    found = []
    for name in names:
        seen[name] += 1
        found.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return tuple(found)
