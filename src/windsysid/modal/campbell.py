"""The Campbell diagram: modes against rotor speed, and their distance from the rotor's harmonics."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.modal.matching.result import odds_text
from windsysid.modal.stability import GroundResonance, Unstable
from windsysid.modal.tracking import Curve
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.table import Table
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.posterior import SIGMAS
from windsysid.units import RPM, with_half_width

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["MEASURED_HEADINGS", "Campbell", "Margin", "MeasuredMode", "speed_range"]

Triple = tuple[float, float, float]

MEASURED_HEADINGS = (
    *("record", "rpm", "mode", "f ± 95 % [Hz]", "ζ, 95 % interval [%]"), *("which mode, odds", "off by", "trusted"),
)  # fmt: skip


class Margin(NamedTuple):
    """Distance of a mode from the harmonic nP over the operating range.

    Attributes
    ----------
    mode, order
        Name of the mode, n.
    distance
        f / nP − 1 where it is least, with its interval; zero where the mode crosses nP.
    speed
        Where that is, with the interval of a crossing [rad/s].
    crosses
        Whether the mode crosses nP within the operating range.
    """

    mode: str
    order: int
    distance: Triple
    speed: Triple
    crosses: bool

    @property
    def certain(self) -> bool:
        """True if the interval stays away from the harmonic, too."""
        return not self.crosses and self.distance[1] * self.distance[2] > 0.0

    def text(self) -> str:
        """The distance [%] with its interval, or the speed of the crossing."""
        if self.crosses:
            return f"{self.speed[0] * RPM:.4g} rpm"
        return _band(self.distance, 100.0, 1.0, "+").replace(" ", "")


class MeasuredMode(NamedTuple):
    """Measured mode for the diagram.

    Attributes
    ----------
    record, name, speed
        Where it comes from, what it was called there, and the rotor speed [rad/s].
    frequency, damping_ratio
        [Hz], [1], with their 95 % intervals.
    trusted
        True if its grades are A or B.
    candidate, expected, probability
        The mode of the model that it is (`windsysid.match`), or another cause; the model's frequency [Hz], None for
        other causes; and its probability [1].
    """

    record: str
    name: str
    speed: float
    frequency: IntervalEstimate
    damping_ratio: IntervalEstimate
    trusted: bool
    candidate: str | None = None
    expected: float | None = None
    probability: float = math.nan

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON."""
        both = {"frequency": self.frequency.summary(), "damping_ratio": self.damping_ratio.summary()}
        return {**self._asdict(), **both}


@dataclass(frozen=True, eq=False)
class Campbell(SummarisedAnswer):
    """Campbell diagram: modes over rotor speed, their distance from the harmonics, and instabilities.

    Attributes
    ----------
    turbine, record
        Names; no record for a turbine file.
    banded
        True if there is a posterior, and so intervals.
    speeds, usual
        Rotor speeds (S,) [rad/s], and the index of the usual one, or of the record's mean.
    operating
        Lowest and highest operating speed [rad/s].
    orders
        The harmonics n of nP.
    curves
        The modes, by frequency at the usual speed.
    unstable
        Ranges within `speeds` in which a mode grows.
    ground_resonance
        For each direction of the support that moves.
    method
        ``Coleman``, ``Floquet`` or ``constant``.
    notes
        Remarks.
    measured
        Measured modes, to be drawn with the curves.
    """

    turbine: str
    record: str | None
    banded: bool
    speeds: Array
    usual: int
    operating: tuple[float, float]
    orders: tuple[int, ...]
    curves: tuple[Curve, ...]
    unstable: tuple[Unstable, ...]
    ground_resonance: tuple[GroundResonance, ...]
    method: str
    notes: tuple[str, ...]
    measured: tuple[MeasuredMode, ...] = ()

    def with_measured(self, modes: Sequence[MeasuredMode]) -> "Campbell":
        """Diagram with measured modes on it."""
        return replace(self, measured=tuple(modes))

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each mode and rotor speed: ``mode``, ``speed`` [rad/s], ``frequency`` [Hz], ``damping_ratio``, and
        their standard deviations ``frequency_std`` and ``damping_ratio_std``, zero where there is no posterior; NaN
        where the mode does not oscillate."""
        import pandas as pd

        return pd.concat([
            pd.DataFrame({
                "mode": curve.name, "speed": self.speeds, "frequency": curve.frequency,
                "frequency_std": curve.frequency_std, "damping_ratio": curve.damping,
                "damping_ratio_std": curve.damping_std,
            })
            for curve in self.curves
        ], ignore_index=True)  # fmt: skip

    def to_xarray(self) -> "xr.Dataset":
        """Data of the diagram with the dimensions ``mode`` and ``speed`` [rad/s]."""
        import xarray as xr

        frame = self.to_dataframe()
        shape = len(self.curves), len(self.speeds)
        return xr.Dataset(
            {name: (("mode", "speed"), frame[name].to_numpy().reshape(shape)) for name in frame.columns[2:]},
            coords={"mode": [c.name for c in self.curves], "speed": ("speed", self.speeds, {"units": "rad/s"})},
        )

    @property
    def measured_rows(self) -> list[tuple[str, ...]]:
        """The measured modes as a table under `MEASURED_HEADINGS`."""
        rows: list[tuple[str, ...]] = []
        for mode in self.measured:
            off = "" if mode.expected is None else f"{100.0 * (mode.frequency.estimate / mode.expected - 1.0):+.2f} %"
            which = "" if mode.candidate is None else f"{mode.candidate}, {odds_text(mode.probability)}"
            f, z = mode.frequency, mode.damping_ratio
            rows.append(
                (
                    mode.record, f"{mode.speed * RPM:.2f}", mode.name,
                    with_half_width(f.estimate, SIGMAS * f.std, 4),
                    f"{100.0 * z.estimate:.2f} ({100.0 * z.low:.2f} … {100.0 * z.high:.2f})",
                    which, off, "yes" if mode.trusted else "no",
                )
            )  # fmt: skip
        return rows

    @cached_property
    def margins(self) -> tuple[Margin, ...]:
        """Of every mode from every harmonic, over the operating range."""
        low, high = self.operating
        inside = (self.speeds >= low * (1 - 1e-12)) & (self.speeds <= high * (1 + 1e-12)) & (self.speeds > 0.0)
        found = []
        for curve in self.curves:
            seen = inside & np.isfinite(curve.frequency)
            if seen.any():
                f, std, speed = curve.frequency[seen], curve.frequency_std[seen], self.speeds[seen]
                found += [_margin(curve.name, order, f, std, speed) for order in self.orders]
        return tuple(found)

    @property
    def least_damping(self) -> tuple[str, float, IntervalEstimate]:
        """Name of the least damped mode over all speeds, where [rad/s], and its damping ratio."""
        curve = min(self.curves, key=lambda c: float(np.nanmin(c.damping)))
        i = int(np.nanargmin(curve.damping))
        if curve.damping[self.usual] <= curve.damping[i] + 1e-9:  # the same everywhere, or nowhere less
            i = self.usual
        return curve.name, float(self.speeds[i]), curve.at(i).damping_ratio

    @property
    def sentences(self) -> list[str]:
        """Findings: harmonics, stability, ground resonance."""
        return [self._harmonics(), self._stability(), *(self._ground_resonance(g) for g in self.ground_resonance)]

    def _harmonics(self) -> str:
        if not self.orders:
            return "The rotor is parked: it has no harmonics that a mode could cross."
        over = speed_range(self.operating)
        crossed = [m for m in self.margins if m.crosses]
        if crossed:
            each = "; ".join(f"{m.mode} meets {m.order}P at {_band(m.speed, RPM)} rpm" for m in crossed)
            return f"Resonance {over}: {each}."
        nearest = min(self.margins, key=lambda m: abs(m.distance[0]))
        d = nearest.distance
        harmonics = " or ".join((", ".join(f"{n}P" for n in self.orders[:-1]), f"{self.orders[-1]}P"))
        doubtful = ", ".join(f"{m.mode} and {m.order}P" for m in self.margins if not m.certain)
        sure = f" Within the intervals they may: {doubtful}." if doubtful else ""
        return (
            f"No mode crosses {harmonics} {over}: the nearest is {nearest.mode}, {_distance(d, 1.0)}"
            f" {nearest.order}P at {nearest.speed[0] * RPM:.3g} rpm.{sure}"
        )

    def _stability(self) -> str:
        low, high = self.speeds[0] * RPM, self.speeds[-1] * RPM
        over = speed_range((self.speeds[0], self.speeds[-1]))
        if self.unstable:
            each = "; ".join(
                f"{u.low * RPM:.1f} … {u.high * RPM:.1f} rpm, growth up to {u.growth:.3g} 1/s at"
                f" {u.worst * RPM:.1f} rpm"
                for u in self.unstable
            )
            return f"Unstable between {low:.3g} and {high:.3g} rpm: {each}."
        name, speed, damping = self.least_damping
        text = f"{_band(_triple(damping), 100.0)} %, {name} at {speed * RPM:.3g} rpm"
        if damping.estimate < 1e-6:
            return f"No mode is unstable {over}, but {name} is undamped at {speed * RPM:.3g} rpm."
        doubt = "" if damping.low > 0.0 else "; within its interval it may be unstable"
        return f"Every mode is damped {over}: the least by {text}{doubt}."

    def _ground_resonance(self, g: GroundResonance) -> str:
        meets = f"Ground resonance: lag meets the support in {g.support} at {_band(g.speed, RPM)} rpm, "
        if g.margin[0] == 0.0:
            where = "within the operating range"
        else:
            where = f"{_distance(g.margin, 10.0)} the operating range"
        then = "a mode is unstable there" if g.growing else f"least damping there {_band(g.damping, 100.0)} %"
        return f"{meets}{where}; {then}."

    @property
    def headings(self) -> tuple[str, ...]:
        """Of the table."""
        at = f"{self.speeds[self.usual] * RPM:.3g} rpm"
        return ("mode", f"Hz at {at}", "damping [%]", *(f"{n}P [%]" for n in self.orders))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Of the table: each mode at the usual speed, and its distance from each harmonic over the operating range."""
        margins = {(m.mode, m.order): m for m in self.margins}
        rows = []
        for curve in self.curves:
            seen = math.isfinite(curve.frequency[self.usual])
            if not seen and not any((curve.name, n) in margins for n in self.orders):
                continue  # it oscillates at other speeds only
            rows.append(
                (
                    *self.values_text(curve),
                    *(margins[curve.name, n].text() if (curve.name, n) in margins else "–" for n in self.orders),
                )
            )
        return rows

    def values_text(self, curve: Curve) -> tuple[str, str, str]:
        """Name, frequency [Hz] and damping ratio [%] of a mode, `curve`, at the usual speed, with their intervals."""
        f, z = (_triple(one) for _, one in curve.at(self.usual).quantities)
        seen = math.isfinite(f[0])
        return curve.name, _band(f) if seen else "–", _band(z, 100.0) if seen else "–"

    @property
    def band_source(self) -> str:
        """Source of the intervals."""
        return "of the posterior"

    def table(self) -> Table:
        """The modes at the usual speed, and how far each stays from the rotor's harmonics."""
        low, high = (value * RPM for value in self.operating)
        where = f"over {low:.3g} … {high:.3g} rpm" if low < high else f"at {low:.3g} rpm"
        over = f"distance from nP {where}, or where a mode meets it" if self.orders else "parked"
        return Table(self.headings, self.rows, f"{self.title}: {over}")

    @property
    def title(self) -> str:
        """Turbine and record."""
        return self.turbine if self.record is None else f"{self.turbine}, {self.record}"

    def summary(self) -> dict[str, Any]:
        """Plain values: the content of ``summary.json``."""
        rpm = (self.speeds * RPM).tolist()
        modes: dict[str, Any] = {}
        for curve in self.curves:
            modes[curve.name] = {
                **curve.at(self.usual).summary(),
                "harmonics": {
                    f"{m.order}P": {
                        "distance_percent": _named(m.distance, 100.0),
                        "speed_rpm": _named(m.speed, RPM),
                        "crosses": m.crosses,
                    }
                    for m in self.margins
                    if m.mode == curve.name
                },
                "curve": {
                    "frequency_hz": curve.frequency.tolist(),
                    "frequency_std_hz": curve.frequency_std.tolist(),
                    "damping_ratio": curve.damping.tolist(),
                    "damping_ratio_std": curve.damping_std.tolist(),
                },
            }
        name, speed, damping = self.least_damping
        return {
            "turbine": self.turbine,
            "record": self.record,
            "method": self.method,
            "sentences": self.sentences,
            "speed_rpm": rpm,
            "usual_speed_rpm": rpm[self.usual],
            "operating_range_rpm": [value * RPM for value in self.operating],
            "modes": modes,
            "least_damping": {"mode": name, "speed_rpm": speed * RPM, "damping_ratio": damping.summary()},
            "unstable": [
                {"from_rpm": u.low * RPM, "to_rpm": u.high * RPM, "growth_1_s": u.growth, "worst_rpm": u.worst * RPM}
                for u in self.unstable
            ],
            "ground_resonance": [
                {
                    "support": g.support,
                    "speed_rpm": _named(g.speed, RPM),
                    "margin_percent": _named(g.margin, 100.0),
                    "least_damping_ratio": _named(g.damping),
                    "growing": g.growing,
                }
                for g in self.ground_resonance
            ],
            "notes": list(self.notes),
            **({"measured": [mode.summary() for mode in self.measured]} if self.measured else {}),
        }

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} of {self.title}: {len(self.curves)} modes, {self.speeds[0] * RPM:.3g} to"
            f" {self.speeds[-1] * RPM:.3g} rpm; print it for the table>"
        )

    def contents(self) -> list[Table | str]:
        """The first sentence, the tables, the other sentences, the notes."""
        beside = [Table(MEASURED_HEADINGS, self.measured_rows, "measured", (0, 2, 5, 7))] if self.measured else []
        first, *others = self.sentences
        return [first, self.table(), *beside, *others, *self.notes]


def _margin(name: str, order: int, frequency: Array, std: Array, speed: Array) -> Margin:
    """Distance of a mode from nP, given at some speeds, where it is least."""
    harmonic = order * speed / (2.0 * math.pi)
    distance = frequency / harmonic - 1.0
    i = int(np.argmin(np.abs(distance)))
    half = SIGMAS * std[i] / harmonic[i]
    change = np.flatnonzero(distance[:-1] * distance[1:] <= 0.0)
    if len(change):
        j = int(change[0])
        gap = frequency - harmonic
        share = gap[j] / (gap[j] - gap[j + 1]) if gap[j] != gap[j + 1] else 0.0
        at = float(speed[j] + share * (speed[j + 1] - speed[j]))
        slope = abs(gap[j + 1] - gap[j]) / (speed[j + 1] - speed[j])
        spread = SIGMAS * float(std[j]) / slope if slope > 0.0 else math.inf
        here = SIGMAS * float(std[j] / harmonic[j])
        return Margin(name, order, (0.0, -here, here), (at, at - spread, at + spread), True)
    d, at = float(distance[i]), float(speed[i])
    return Margin(name, order, (d, d - float(half), d + float(half)), (at, at, at), False)


def speed_range(ends: tuple[float, float]) -> str:
    """A range of rotor speeds [rad/s] in words."""
    low, high = (value * RPM for value in ends)
    return f"from {low:.3g} to {high:.3g} rpm" if low < high else f"at {low:.3g} rpm"


def _band(triple: Triple, factor: float = 1.0, least: float = 0.0, sign: str = "") -> str:
    """A value ± its interval, to two digits of the interval or of `least`; to four digits where it has none."""
    value, half = factor * triple[0], factor * (triple[2] - triple[1]) / 2.0
    if half == 0.0 and least == 0.0:
        return f"{value:{sign}.4g}"
    digits = max(0, 1 - math.floor(math.log10(max(half, least))))
    return f"{value:{sign}.{digits}f}" + (f" ± {half:.{digits}f}" if half > 0.0 else "")


def _triple(one: IntervalEstimate) -> Triple:
    return one.estimate, one.low, one.high


def _distance(triple: Triple, least: float) -> str:
    """A relative distance in % with its interval, and whether it is above or below."""
    size = triple if triple[0] > 0.0 else (-triple[0], -triple[2], -triple[1])
    return f"{_band(size, 100.0, least)} % {'above' if triple[0] > 0.0 else 'below'}"


def _named(triple: Triple, factor: float = 1.0) -> dict[str, float]:
    return dict(zip(("estimate", "low", "high"), (factor * v for v in triple), strict=True))
