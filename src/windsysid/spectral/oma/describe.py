"""Description of the modes of a band: values, doubts and names."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores
from windsysid.checks.limits import MAX_WIDENING, MIN_RIVAL_PROBABILITY, NEGLIGIBLE_SHARE
from windsysid.checks.widening import mixture_factor
from windsysid.results.estimate import IntervalEstimate
from windsysid.spectral.modal_bands.check import explanations, is_spurious, mode_doubts, variation, with_background_odds
from windsysid.spectral.modal_bands.limits import MAX_STEADINESS
from windsysid.spectral.modal_bands.model_order import BandFit, Shapes, full_shapes
from windsysid.spectral.modal_bands.part_scores import BandWidening, Segments, part_scores, wander_ratio, widening_of
from windsysid.spectral.oma.condition import Readings
from windsysid.spectral.oma.limits import MIN_BLADE_RATIO, PEAK_WIDTH_FACTOR
from windsysid.spectral.oma.mode import Doubt, OperationalMode

__all__ = ["described", "mode_of", "named", "widened", "without_skirts"]


def described(found: BandFit, segments: Segments, readings: Readings) -> list[OperationalMode]:
    """Modes of a band with their shapes, doubts and wider intervals, by the transforms of segments of the record."""
    shapes = full_shapes(found)
    parts = part_scores(found, segments, readings.samples, readings.rate)
    modes = [
        widened(mode_of(found, j, shapes, mode_doubts(found, j, shapes, readings)), found, j, parts)
        for j in range(len(found.fit.modes.frequency))
        if not is_spurious(found, j, readings.samples / readings.rate)
    ]
    return with_background_odds(modes, found)


def widened(mode: OperationalMode, found: BandFit, j: int, parts: Sequence[PartScores]) -> OperationalMode:
    """Widen the intervals of mode j of a band by the dispersion of scores and by other explanations."""
    r, others, (machine, growth) = len(found.fit.modes.frequency), explanations(found, j), variation(found, j)
    factors, grounds, remarks = [], [*mode.grounds], [*mode.remarks]
    for i, what in enumerate(("frequency", "damping ratio")):
        level = BandWidening(math.sqrt(growth), "level")
        over = max(widening_of(parts, i * r + j), level, key=lambda one: one.factor)
        std = over.factor * found.fit.std(j)[i]
        rivals = [(float(shift[i]) / std, 1.0, MIN_RIVAL_PROBABILITY) for _, shift in others]
        factor = over.factor * mixture_factor(rivals)
        factors.append(factor)
        if factor > 1.0 + NEGLIGIBLE_SHARE:
            furthest = others[int(np.argmax([abs(shift) for shift, *_ in rivals]))][0]
            why = furthest if factor > over.factor**2 else over.cause
            text = f"the interval of its {what} is {factor:.2g} times as wide as that of the model: {why}"
            (grounds if factor > MAX_WIDENING else remarks).append(Doubt("scores", text, what))  # type: ignore[arg-type]
    return replace(
        mode,
        frequency=IntervalEstimate.normal(mode.frequency.estimate, factors[0] * mode.frequency.std, "Hz"),
        damping_ratio=IntervalEstimate.lognormal(
            mode.damping_ratio.estimate, factors[1] * mode.damping_ratio.relative_std, "1"
        ),
        grounds=tuple(grounds),
        remarks=tuple(remarks),
        widening=(factors[0], factors[1]),
        steadiness=min(machine * wander_ratio(parts, j), MAX_STEADINESS),
        segments=_in_segments(mode, r, j, parts),
    )


def _in_segments(mode: OperationalMode, r: int, j: int, parts: Sequence[PartScores]) -> Array | None:
    """Times [s], frequencies [Hz] and damping ratios (K, 3) of a mode in segments of the record.

    Each of K equal segments has the score g and about the K-th part of the information: one step of Fisher scoring
    leads from the estimate θ of the whole to θ + K C g.
    """
    for one in parts:
        if one.over == "time":
            cov = np.linalg.inv(one.information.sum(axis=0) + one.precision)
            step = len(one.places) * (one.gradients @ cov)[:, [j, r + j]]
            values = np.array([mode.frequency.estimate, mode.damping_ratio.estimate]) * np.exp(np.clip(step, -1.5, 1.5))
            return np.column_stack([one.places, values])
    return None


def mode_of(found: BandFit, j: int, shapes: Shapes, grounds: Sequence[Doubt]) -> OperationalMode:
    """Mode j of a band, without a name."""
    f, z = float(found.fit.modes.frequency[j]), float(found.fit.modes.damping[j])
    std_f, std_z = found.fit.std(j)
    return OperationalMode(
        name="",
        frequency=IntervalEstimate.normal(f, f * std_f, "Hz"),
        damping_ratio=IntervalEstimate.lognormal(z, std_z, "1"),
        shape=shapes.shape[:, j],
        shape_std=shapes.std[:, j],
        load=float(shapes.load[j]),
        ln_load_std=float(shapes.load_std[j]),
        band=(float(found.band.frequency[0]), float(found.band.frequency[-1])),
        grounds=tuple(grounds),
        shape_cov=shapes.cov[j],
    )


def without_skirts(bands: list[list[OperationalMode]]) -> list[list[OperationalMode]]:
    """Remove modes at the border of their band that are the skirt of another band's mode; a list for each band."""

    def is_apart(mode: OperationalMode, other: OperationalMode) -> bool:
        reach = PEAK_WIDTH_FACTOR * mode.half_width + PEAK_WIDTH_FACTOR * other.half_width
        return abs(mode.frequency.estimate - other.frequency.estimate) > reach

    kept = []
    for band in bands:
        others = [mode for other in bands if other is not band for mode in other if not mode.doubted_for("border")]
        kept.append([m for m in band if not m.doubted_for("border") or all(is_apart(m, other) for other in others)])
    return kept


def named(modes: Sequence[OperationalMode], channels: Sequence[str]) -> list[OperationalMode]:
    """Name modes: by numbers, or if a rotor turns by the channel that moves most and the direction of the whirl."""
    if not any(name.startswith("blades_") for name in channels):
        return [replace(mode, name=f"mode {i}") for i, mode in enumerate(modes, start=1)]
    known: dict[str, int] = {}
    result = []
    for mode in modes:
        name = _motion_name(np.abs(mode.shape), channels)
        known[name] = known.get(name, 0) + 1
        result.append(replace(mode, name=name if known[name] == 1 else f"{name} {known[name]}"))
    return result


_GAUGE = re.compile(r"TwHt\dALg?([xyz])t")  # OpenFAST's accelerometers along the tower, read under their own names


def _motion_name(size: Array, names: Sequence[str]) -> str:
    on_blades = np.array([name.startswith("blades_") for name in names])
    support = size[~on_blades].max(initial=0.0)
    if support * MIN_BLADE_RATIO > size[on_blades].max(initial=0.0):
        name = names[int(np.argmax(np.where(on_blades, -1.0, size)))]
        gauge = _GAUGE.fullmatch(name)
        return f"tower {'zxy'['xyz'.index(gauge[1])]} ({name})" if gauge else " ".join(name.split("_")[:2])
    what, _, way = names[int(np.argmax(np.where(on_blades, size, -1.0)))].removeprefix("blades_").rpartition(" ")
    return f"{'flap' if re.search('flap|out', what) else 'lag'} {way}"
