"""Watched series of a window's row: coefficients without their prior, noise of sensors."""

import math
from typing import NamedTuple

from windsysid.fleet.rows import Row
from windsysid.mechanics.rotor import MEAN_LAG
from windsysid.mechanics.sensors import noise_source
from windsysid.results.posterior import SIGMAS

__all__ = ["Watched", "band_of", "in_coordinates_of", "said_of"]


class Watched(NamedTuple):
    """A series: its name, SI unit, kind, whether θ is a logarithm, and the value at θ = 0 (logarithmic) or θ = 1."""

    name: str
    unit: str
    kind: str
    logarithmic: bool
    reference: float

    def value(self, theta: float) -> float:
        """In `unit`; infinite where it is beyond all numbers."""
        try:
            return self.reference * (math.exp(theta) if self.logarithmic else theta)
        except OverflowError:
            return math.inf


def said_of(row: Row) -> dict[Watched, tuple[float, float]]:
    """What a row says of each series, in filter coordinates, and its standard deviation."""
    if row["status"] != "ok":
        return {}
    found = {}
    for one in row["parameters"]:
        name, logarithmic = one["name"], bool(one["logarithmic"])
        if name == MEAN_LAG:  # the wind's
            continue
        reference = float(one["prior_centre"] if logarithmic else one["coordinate_scale"])
        kind = "c" if one["kind"] == "damping" else "k"
        found[Watched(name, one["unit"], kind, logarithmic, reference)] = (float(one["own"]), float(one["own_std"]))
    for one in row["statistics"]:
        if noise_source(one["name"]) and all(map(_is_positive, (one["estimate"], one["low"], one["high"]))):
            std = math.log(one["high"] / one["low"]) / (2.0 * SIGMAS)
            found[Watched(one["name"], one["unit"], "noise", True, 1.0)] = (math.log(one["estimate"]), std)
    return found


def _is_positive(value: float | None) -> bool:
    return value is not None and 0.0 < value < math.inf


def in_coordinates_of(known: Watched, one: Watched, theta: float, std: float) -> tuple[float, float]:
    """What a row says in the coordinates of a series that is known: another prior has another reference."""
    if one.logarithmic and known.logarithmic:
        return theta + math.log(one.reference / known.reference), std
    value = one.value(theta)
    slope = abs(value if one.logarithmic else one.reference)
    if known.logarithmic:
        return (math.log(value / known.reference), std * slope / value) if value > 0.0 else (math.nan, math.nan)
    return value / known.reference, std * slope / abs(known.reference)


def band_of(one: Watched, theta: float, std: float) -> tuple[float | None, float | None, float | None]:
    """Value, and its ±2σ band, in the unit of the series; None where there is none."""
    if not (math.isfinite(theta) and math.isfinite(std)):
        return None, None, None
    ends = sorted(one.value(theta + side * std) for side in (-SIGMAS, SIGMAS))
    return one.value(theta), ends[0], ends[1]
