"""Modes in words and numbers: what a band's fit says of each, what moves, which mode of the turbine file it may be."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array, Complex
from windsysid.inspection.spectra import expected_modes
from windsysid.spectral.modal_bands.check import is_flank, mode_doubts, part_fits
from windsysid.spectral.modal_bands.model_order import BandFit, Shapes, full_shapes
from windsysid.spectral.oma.condition import Readings
from windsysid.spectral.oma.result import Doubt, OperationalMode
from windsysid.turbine.turbine import Turbine

__all__ = ["described", "mode_of", "named", "with_neighbours", "with_references", "without_flanks"]

FLANK = 2.0
"""In ζ f: so far a mode reaches into the next band."""

NEAR_REFERENCE = 0.08
"""A mode this near to one that the turbine file gives may be that mode."""

BLADES_MOVE = 3.0
"""Blades move that many times as much as the support in a mode of the blades."""


def described(
    found: BandFit, parts: Sequence[Sequence[tuple[Array, Complex]]], readings: Readings
) -> list[OperationalMode]:
    """The modes of a band with their shapes and doubts, from the transforms of the record's halves and quarters."""
    shapes = full_shapes(found)
    halves, quarters = (part_fits(found, some, readings.samples, readings.rate) for some in parts)
    return [
        mode_of(found, j, shapes, mode_doubts(found, j, shapes, halves, quarters, readings))
        for j in range(len(found.fit.modes.frequency))
        if not is_flank(found, j, readings.samples / readings.rate)
    ]


def mode_of(found: BandFit, j: int, shapes: Shapes, grounds: Sequence[Doubt]) -> OperationalMode:
    """Mode j of a band, without a name."""
    f, z = float(found.fit.modes.frequency[j]), float(found.fit.modes.damping[j])
    std_f, std_z = found.fit.std(j)
    return OperationalMode(
        name="",
        frequency=f,
        frequency_std=f * std_f,
        damping=z,
        ln_damping_std=std_z,
        shape=shapes.shape[:, j],
        shape_std=shapes.std[:, j],
        load=float(shapes.load[j]),
        ln_load_std=float(shapes.load_std[j]),
        band=(float(found.band.frequency[0]), float(found.band.frequency[-1])),
        grounds=tuple(grounds),
        shape_cov=shapes.cov[j],
    )


def without_flanks(bands: list[list[OperationalMode]]) -> list[list[OperationalMode]]:
    """Modes band by band; one at the border of its band that another band's mode reaches is that one's flank."""

    def reach(mode: OperationalMode) -> float:
        return FLANK * mode.damping * mode.frequency

    kept = []
    for band in bands:
        others = [mode for other in bands if other is not band for mode in other if not mode.doubted_for("border")]
        kept.append(
            [
                mode
                for mode in band
                if not mode.doubted_for("border")
                or all(abs(mode.frequency - other.frequency) > reach(mode) + reach(other) for other in others)
            ]
        )
    return kept


def with_neighbours(modes: list[OperationalMode]) -> list[OperationalMode]:
    """Modes of one band: where one is doubtful the others are, since they were found together."""
    doubtful = [mode for mode in modes if any(doubt.kind not in ("shape", "faint") for doubt in mode.grounds)]
    if not doubtful:
        return modes
    why = Doubt("neighbour", f"it was found together with a doubtful one at {doubtful[0].frequency:.4g} Hz")
    return [mode if mode.grounds else replace(mode, grounds=(why,)) for mode in modes]


def named(modes: Sequence[OperationalMode], channels: Sequence[str]) -> list[OperationalMode]:
    """Modes with names: numbers, or where a rotor turns what moves and which way it turns."""
    if not any(name.startswith("blades_") for name in channels):
        return [replace(mode, name=f"mode {i}") for i, mode in enumerate(modes, start=1)]
    known: dict[str, int] = {}
    told = []
    for mode in modes:
        name = _what_moves(np.abs(mode.shape), channels)
        known[name] = known.get(name, 0) + 1
        told.append(replace(mode, name=name if known[name] == 1 else f"{name} {known[name]}"))
    return told


def _what_moves(size: Array, names: Sequence[str]) -> str:
    on_blades = np.array([name.startswith("blades_") for name in names])
    support = size[~on_blades].max(initial=0.0)
    if support * BLADES_MOVE > size[on_blades].max(initial=0.0):
        return " ".join(names[int(np.argmax(np.where(on_blades, -1.0, size)))].split("_")[:2])
    what, _, way = names[int(np.argmax(np.where(on_blades, size, -1.0)))].removeprefix("blades_").rpartition(" ")
    return f"{'flap' if re.search('flap|out', what) else 'lag'} {way}"


def with_references(modes: list[OperationalMode], machine: Turbine | None, rotor_hz: float) -> list[OperationalMode]:
    """Modes with the turbine file's frequencies beside them, each used once, the nearest first."""
    if machine is None:
        return modes
    expected = expected_modes(machine, 2.0 * np.pi * rotor_hz)
    pairs = sorted(
        (abs(mode.frequency / f - 1.0), i, k) for i, mode in enumerate(modes) for k, (_, f, _) in enumerate(expected)
    )
    taken: set[int] = set()
    for off, i, k in pairs:
        if off < NEAR_REFERENCE and modes[i].reference is None and k not in taken:
            name, f, z = expected[k]
            modes[i] = replace(modes[i], name=name, reference=(f, z))
            taken.add(k)
    return modes
