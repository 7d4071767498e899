"""Watched series of a window's row: coefficients without their prior, noise of sensors."""

import math
from typing import NamedTuple

from windsysid.fleet.rows import Row, stored_grade
from windsysid.mechanics.rotor import MEAN_LAG
from windsysid.mechanics.sensors import noise_source
from windsysid.results.posterior import SIGMAS

__all__ = ["Said", "Watched", "band_of", "in_coordinates_of", "said_of"]


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


class Said(NamedTuple):
    """Estimate of a series by one window, in filter coordinates, its standard deviation, and its grade; empty of noise,
    which has none."""

    theta: float = math.nan
    std: float = math.nan
    grade: str = ""

    @property
    def usable(self) -> "Said":
        """Estimate without its values if its grade is C."""
        return Said() if self.grade == "C" else self


def said_of(row: Row) -> dict[Watched, Said]:
    """Estimates of each series in a row."""
    if row["status"] != "ok":
        return {}
    found = {}
    for one in row["parameters"]:
        name, logarithmic = one["name"], bool(one["logarithmic"])
        if name == MEAN_LAG:  # the wind's
            continue
        reference = float(one["prior_centre"] if logarithmic else one["coordinate_scale"])
        kind = "c" if one["kind"] == "damping" else "k"
        said = Said(float(one["own"]), float(one["own_std"]), stored_grade(row, one))
        found[Watched(name, one["unit"], kind, logarithmic, reference)] = said
    for one in row["statistics"]:
        if noise_source(one["name"]) and all(map(_is_positive, (one["estimate"], one["low"], one["high"]))):
            std = math.log(one["high"] / one["low"]) / (2.0 * SIGMAS)
            found[Watched(one["name"], one["unit"], "noise", True, 1.0)] = Said(math.log(one["estimate"]), std)
    return found


def _is_positive(value: float | None) -> bool:
    return value is not None and 0.0 < value < math.inf


def in_coordinates_of(known: Watched, one: Watched, said: Said) -> Said:
    """Estimate of a row in the coordinates of a known series: another prior has another reference."""
    theta, std, grade = said
    if one.logarithmic and known.logarithmic:
        return Said(theta + math.log(one.reference / known.reference), std, grade)
    value = one.value(theta)
    slope = abs(value if one.logarithmic else one.reference)
    if known.logarithmic:
        return Said(math.log(value / known.reference), std * slope / value, grade) if value > 0.0 else Said()
    return Said(value / known.reference, std * slope / abs(known.reference), grade)


def band_of(one: Watched, theta: float, std: float) -> tuple[float | None, float | None, float | None]:
    """Value, and its 95 % interval, in the unit of the series; None where there is none."""
    if not (math.isfinite(theta) and math.isfinite(std)):
        return None, None, None
    ends = sorted(one.value(theta + side * std) for side in (-SIGMAS, SIGMAS))
    return one.value(theta), ends[0], ends[1]
