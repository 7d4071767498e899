"""Blades' readings in coordinates that stand still.

    a₀ = 1/N Σ y_b,        z = 2/N Σ y_b exp(iψ_b),        ψ_b = ψ + 2π (b − 1)/N.

The transform of z at f > 0 has what turns forward, that at −f what turns backward. A mode of the fixed frame shows at
its one frequency in the support's readings, in a₀ and in both parts of z: they are channels like any others.
"""

import re
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex

__all__ = ["BladeSet", "blade_sets", "is_blade", "multiblade"]

_BLADE = re.compile(r"blade_(\d+)_(.+)")


class BladeSet(NamedTuple):
    """Channels with the same reading on every blade: their quantity, and their columns, blade 1 first."""

    what: str
    columns: tuple[int, ...]


def is_blade(name: str) -> bool:
    """Test whether the name of a channel has the number of its blade, which `blade_sets` requires."""
    return _BLADE.fullmatch(name) is not None


def blade_sets(names: list[str], blades: int | None = None) -> tuple[list[BladeSet], list[int]]:
    """Complete sets of blades' channels, three at least, and the columns of those that are not complete."""
    by_what: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        match = _BLADE.fullmatch(name)
        if match:
            by_what.setdefault(match[2], {})[int(match[1])] = column
    number = blades or max((max(found) for found in by_what.values()), default=0)
    sets, left = [], []
    for what, found in by_what.items():
        if number >= 3 and sorted(found) == list(range(1, number + 1)):
            sets.append(BladeSet(what, tuple(found[b] for b in range(1, number + 1))))
        else:
            left += list(found.values())
    return sets, left


def multiblade(blades: Array, azimuth: Array) -> tuple[Array, Complex]:
    """a₀ (T,) and z (T,) of readings (T, N) at the azimuth of blade 1 (T,) [rad]."""
    number = blades.shape[1]
    angle = azimuth[:, None] + 2.0 * np.pi * np.arange(number) / number
    return blades.mean(axis=1), 2.0 / number * np.sum(blades * np.exp(1j * angle), axis=1)
