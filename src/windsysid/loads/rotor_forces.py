"""Load models: stationary random processes that drive the mechanics, as linear blocks that `compose` puts together.

A block holds n states with

    dz = A z dt + noise,    cov(z) = P for all time,    w = H(ψ) z,
    H(ψ) = H₀ + Σ_k (C_k cos kψ + S_k sin kψ),

mean zero and mean-reverting. Several blocks may drive the same degree of freedom, and one block may drive several: that
is how loads on blades and hub are correlated. Over a step h the block is discretised exactly, Φ = exp(A h) and Q = P −
Φ P Φᵀ.

A block is a `Process`, a scalar random process with a rational spectrum, put somewhere: on one degree of freedom
(`load_on`), on one blade and through it on the hub (`blade_force`), or on the whole rotor as a harmonic nP whose
amplitudes wander (`rotor_harmonic`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.statespace.process import PlacedProcess, Process, place_copies

__all__ = ["BladeForces", "blade_force", "rotor_harmonic"]


@dataclass(frozen=True)
class BladeForces:
    """Generalised forces of forces in the plane of the rotor, one on each blade.

    A moment F_i about the blade's link is a force F_i / lever along the tangent t_i = (−sin ψ_i, cos ψ_i), with the
    rotation. It pushes the lag angle with F_i, the hub with F_i / lever, and a roll with F_i (1 + hinge_offset /
    lever).

    Attributes
    ----------
    loads
        Names of the loads that are driven: ``load_x``, ``load_y``, ``load_roll``, ``load_beta_1`` …
    blades
        N.
    hinge_offset
        d [m].
    kappa
        Where x leans the rotor, r = κ x [rad/m]; otherwise 0.
    """

    loads: tuple[str, ...]
    blades: int = 3
    hinge_offset: float = 0.0
    kappa: float = 0.0

    def harmonic(self, n: int, lever: float, *, sine: bool = False, moments: bool = True) -> dict[str, Array]:
        """Loads of F_i = cos nψ_i, or sin nψ_i: rows H₀, C₁, S₁ … of each load."""
        return _at_lever(_harmonic(self, n, sine), lever, self.hinge_offset, moments=moments)

    def single(self, blade: int, lever: float) -> dict[str, Array]:
        """Loads of F = 1 on one blade, counted from 1."""
        return _at_lever(_single(self, blade), lever, self.hinge_offset, moments=True)


def blade_force(process: Process, blade: int, to: BladeForces, lever: float, name: str) -> PlacedProcess:
    """A process in the frame of one blade, its moment about the link [N·m], with its load on the hub."""
    return place_copies(name, process, [to.single(blade, lever)])


def rotor_harmonic(
    process: Process, n: int, to: BladeForces, lever: float, name: str, *, moments: bool = True
) -> PlacedProcess:
    """Forces that turn with the rotor, F_i = a(t) cos nψ_i + b(t) sin nψ_i, a and b two independent copies of a
    process.

    This is one term of the series in azimuth of any load that is homogeneous over the disc: its terms are uncorrelated,
    and slow in the fixed frame, where the blades cut through them n times a turn (Sørensen, Hansen & Rosas 2002,
    https://doi.org/10.1016/S0167-6105(02)00260-X). A blade is loaded at nP, the hub at the two neighbours (n ± 1)P as
    far as they are multiples of N.

    Parameters
    ----------
    n
        0 or more; for 0 there is no b.
    moments
        Whether the forces have moments about the links; without, they push the hub alone.
    """
    phases = (False, True) if n else (False,)
    return place_copies(name, process, [to.harmonic(n, lever, sine=sine, moments=moments) for sine in phases])


class _Pushed(NamedTuple):
    """Rows of unit moments on the blades, and of forces of unit moment and unit lever on the others: rows of
    each load."""

    by_moment: Mapping[str, Array]
    by_force: Mapping[str, Array]
    by_offset: Mapping[str, Array]


@lru_cache(maxsize=256)
def _harmonic(to: BladeForces, n: int, sine: bool) -> _Pushed:
    turns = np.exp(2j * np.pi * n * np.arange(to.blades) / to.blades)
    return _pushed(to, [{n: (-1j if sine else 1.0) * turn} for turn in turns])


@lru_cache(maxsize=256)
def _single(to: BladeForces, blade: int) -> _Pushed:
    return _pushed(to, [{0: 1.0 + 0j} if i == blade else {} for i in range(1, to.blades + 1)])


def _pushed(to: BladeForces, forces: Sequence[Mapping[int, complex]]) -> _Pushed:
    """Loads of forces F_i(ψ) = Re Σ_n f_n e^{inψ}, f given for each blade."""
    found: list[dict[str, dict[int, complex]]] = [{name: {} for name in to.loads} for _ in _Pushed._fields]

    def push(kind: int, name: str, n: int, amount: complex) -> None:
        if name in found[kind]:
            n, amount = (n, amount) if n >= 0 else (-n, amount.conjugate())
            found[kind][name][n] = found[kind][name].get(n, 0.0) + amount

    for i, force in enumerate(forces):
        turn = np.exp(2j * np.pi * i / to.blades)
        for n, amount in force.items():
            push(0, f"load_beta_{i + 1}", n, amount)
            for name, share in (("load_roll", 1.0), ("load_x", to.kappa)):
                push(2, name, n, share * amount)
            # −sin ψ_i = Re(i e^{iψ_i}), cos ψ_i = Re(e^{iψ_i})
            for side, towards in ((1, turn), (-1, turn.conjugate())):
                push(1, "load_x", n + side, 0.5j * side * towards * amount)
                push(1, "load_y", n + side, 0.5 * towards * amount)
    return _Pushed(*_as_rows(found))


def _as_rows(found: Sequence[Mapping[str, Mapping[int, complex]]]) -> list[dict[str, Array]]:
    """Rows of every series that is not zero, all as long as the longest."""
    highest = max(n for kind in found for series in kind.values() for n in series)
    rows = ({name: _rows(series, highest) for name, series in kind.items()} for kind in found)
    return [{name: row for name, row in kind.items() if row.any()} for kind in rows]


def _at_lever(pushed: _Pushed, lever: float, hinge_offset: float, *, moments: bool) -> dict[str, Array]:
    """Rows of every load that moments with this lever drive."""
    total: dict[str, Array] = {}
    for kind, factor in zip(pushed, (float(moments), 1.0 / lever, 1.0 + hinge_offset / lever), strict=True):
        for name, rows in kind.items():
            if factor != 0.0:
                total[name] = factor * rows + total.get(name, 0.0)
    return total


def _rows(series: Mapping[int, complex], highest: int) -> Array:
    """H₀, C₁, S₁ … of Re Σ_n c_n e^{inψ}, n ≥ 0, without the rest of terms that cancel between the blades."""
    rows = np.zeros(1 + 2 * highest)
    for n, c in series.items():
        if abs(c) > 1e-12:
            rows[max(2 * n - 1, 0)] = c.real
            if n > 0:
                rows[2 * n] = -c.imag
    return rows
