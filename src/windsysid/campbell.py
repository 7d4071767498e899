"""The Campbell diagram: frequencies and damping ratios of all modes against rotor speed, with the bands that follow from a posterior.

Modes are found at each of a row of speeds (`windsysid.modal`) and linked (`windsysid.tracking`). What is asked of them: how far each stays from the
harmonics nP of the rotor over the operating range, and whether any grows (`windsysid.stability`). Bands are ±2σ by the delta method,
σ_f² = ∂f/∂θ Σ ∂f/∂θᵀ. Source: Burton et al., Wind Energy Handbook (3rd ed. 2021), ch. 5.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.coercion import PosteriorLike, TurbineLike, as_posterior, as_turbine
from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.rotor import RotorModel
from windsysid.modal import Spectrum, analyse, directions_of, obstacles, unlocked
from windsysid.output import Saveable
from windsysid.result import SIGMAS, Posterior, finite
from windsysid.stability import NEUTRAL, GroundResonance, Unstable, meeting_speed, unstable_ranges
from windsysid.tracking import Curve, bends, link
from windsysid.turbine import Turbine

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = ["Campbell", "Margin", "find_modes"]

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

POINTS = 41
"""Rotor speeds of a diagram; the operating range has `INSIDE` of its own."""

INSIDE = 9

ROUNDS = 5
"""Of refinement where a curve bends or ends: halfway between the speeds there."""

AROUND = 0.1
"""The operating range by default: the usual speed and this share of it to either side."""

RPM = 30.0 / math.pi


class Margin(NamedTuple):
    """How far a mode stays from the harmonic nP over the operating range.

    Attributes
    ----------
    mode, order
        Name of the mode, n.
    distance
        f / nP − 1 where it is least, with its band; zero where the mode crosses nP.
    speed
        Where that is, with the band of a crossing [rad/s].
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
        """Whether the band stays away from the harmonic too."""
        return not self.crosses and self.distance[1] * self.distance[2] > 0.0

    def text(self) -> str:
        """The distance, or the speed of the crossing, with its band."""
        if self.crosses:
            return f"crosses at {_band(self.speed, RPM)} rpm"
        return f"{_band(self.distance, 100.0, 1.0, '+')} %"


@dataclass(frozen=True, eq=False)
class Campbell(Saveable):
    """Modes of a turbine against rotor speed, and what follows.

    Attributes
    ----------
    turbine, record
        Names; no record for a turbine file.
    banded
        Whether there is a posterior, and so bands.
    speeds, usual
        Rotor speeds (S,) [rad/s], and which of them is the usual or the record's mean one.
    operating
        Least and greatest operating speed [rad/s].
    orders
        The harmonics n of nP.
    curves
        The modes, by frequency at the usual speed.
    unstable
        Ranges within `speeds` in which something grows.
    ground_resonance
        For each direction of the support that moves.
    method
        ``Coleman``, ``Floquet`` or ``constant``.
    notes
        What a reader must know.
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
    def least_damping(self) -> tuple[str, float, Triple]:
        """Name of the least damped mode over all speeds, where [rad/s], and its damping ratio with the band."""
        curve = min(self.curves, key=lambda c: float(np.nanmin(c.damping)))
        i = int(np.nanargmin(curve.damping))
        if curve.damping[self.usual] <= curve.damping[i] + 1e-9:  # the same everywhere, or nowhere less
            i = self.usual
        return curve.name, float(self.speeds[i]), curve.at(i)[1]

    @property
    def sentences(self) -> list[str]:
        """What there is to say: harmonics, stability, ground resonance."""
        return [self._harmonics(), self._stability(), *(self._ground_resonance(g) for g in self.ground_resonance)]

    def _harmonics(self) -> str:
        if not self.orders:
            return "The rotor is parked: it has no harmonics that a mode could meet."
        low, high = (value * RPM for value in self.operating)
        over = f"from {low:.3g} to {high:.3g} rpm" if low < high else f"at {low:.3g} rpm"
        crossed = [m for m in self.margins if m.crosses]
        if crossed:
            each = "; ".join(f"{m.mode} meets {m.order}P at {_band(m.speed, RPM)} rpm" for m in crossed)
            return f"Resonance {over}: {each}."
        nearest = min(self.margins, key=lambda m: abs(m.distance[0]))
        d = nearest.distance
        size = _band(d if d[0] > 0.0 else (-d[0], -d[2], -d[1]), 100.0, 1.0)
        harmonics = " or ".join((", ".join(f"{n}P" for n in self.orders[:-1]), f"{self.orders[-1]}P"))
        doubtful = [f"{m.mode} and {m.order}P" for m in self.margins if not m.certain]
        sure = f" Within the bands they may: {', '.join(doubtful)}." if doubtful else ""
        return (
            f"No mode meets {harmonics} {over}: the nearest is {nearest.mode}, {size} % {'above' if d[0] > 0.0 else 'below'} {nearest.order}P "
            f"at {nearest.speed[0] * RPM:.3g} rpm.{sure}"
        )

    def _stability(self) -> str:
        low, high = self.speeds[0] * RPM, self.speeds[-1] * RPM
        if self.unstable:
            each = "; ".join(
                f"{u.low * RPM:.1f} … {u.high * RPM:.1f} rpm, growth up to {u.growth:.3g} 1/s at {u.worst * RPM:.1f} rpm"
                for u in self.unstable
            )
            return f"Unstable between {low:.3g} and {high:.3g} rpm: {each}."
        name, speed, damping = self.least_damping
        text = f"{_band(damping, 100.0)} %, {name} at {speed * RPM:.3g} rpm"
        if damping[0] < 1e-6:
            return f"Nothing grows from {low:.3g} to {high:.3g} rpm, but {name} is not damped at {speed * RPM:.3g} rpm."
        doubt = "" if damping[1] > 0.0 else "; within its band it may grow"
        return f"Every mode is damped from {low:.3g} to {high:.3g} rpm: the least by {text}{doubt}."

    def _ground_resonance(self, g: GroundResonance) -> str:
        meets = f"Ground resonance: lag meets the support in {g.support} at {_band(g.speed, RPM)} rpm, "
        if g.margin[0] == 0.0:
            where = "within the operating range"
        else:
            size = _band(g.margin if g.margin[0] > 0.0 else (-g.margin[0], -g.margin[2], -g.margin[1]), 100.0, 10.0)
            where = f"{size} % {'above' if g.margin[0] > 0.0 else 'below'} the operating range"
        then = "a mode grows there" if g.growing else f"least damping there {_band(g.damping, 100.0)} %"
        return f"{meets}{where}; {then}."

    @property
    def headings(self) -> tuple[str, ...]:
        """Of the table."""
        at = f"{self.speeds[self.usual] * RPM:.3g} rpm"
        return ("mode", f"Hz at {at}", "damping [%]", *(f"from {n}P" for n in self.orders))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Of the table: each mode at the usual speed, and its distance from each harmonic over the operating range."""
        margins = {(m.mode, m.order): m for m in self.margins}
        rows = []
        for curve in self.curves:
            f, z = curve.at(self.usual)
            seen = math.isfinite(f[0])
            if not seen and not any((curve.name, n) in margins for n in self.orders):
                continue  # it oscillates at other speeds only
            rows.append(
                (
                    curve.name,
                    _band(f) if seen else "–",
                    _band(z, 100.0) if seen else "–",
                    *(margins[curve.name, n].text() if (curve.name, n) in margins else "–" for n in self.orders),
                )
            )
        return rows

    def table(self) -> "Table":
        """`rows` as a Rich table."""
        from rich.table import Table

        low, high = (value * RPM for value in self.operating)
        over = f"distance from nP over {low:.3g} … {high:.3g} rpm" if self.orders else "parked"
        table = Table(title=f"{self.title}: {over}", title_justify="left")
        for heading in self.headings:
            table.add_column(heading, justify="left" if heading == "mode" else "right")
        for row in self.rows:
            table.add_row(*row)
        return table

    @property
    def title(self) -> str:
        """Turbine and record."""
        return self.turbine if self.record is None else f"{self.turbine}, {self.record}"

    def summary(self) -> dict[str, Any]:
        """As plain values: what ``summary.json`` holds."""
        rpm = (self.speeds * RPM).tolist()
        modes: dict[str, Any] = {}
        for curve in self.curves:
            f, z = curve.at(self.usual)
            modes[curve.name] = {
                "frequency_hz": _named(f),
                "damping_ratio": _named(z),
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
            "least_damping": {"mode": name, "speed_rpm": speed * RPM, "damping_ratio": _named(damping)},
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
        }

    def to_json(self) -> str:
        """`summary` as JSON text; null where a mode does not oscillate."""
        return json.dumps(finite(self.summary()), indent=2, ensure_ascii=False) + "\n"

    def plot(self) -> "Figure":
        """Frequencies and damping ratios against rotor speed."""
        from windsysid.campbellreport import campbell_diagram

        return campbell_diagram(self)

    def files(self) -> dict[str, bytes]:
        """What `save` writes: ``report.html``, ``campbell.png`` and ``summary.json``."""
        from windsysid.campbellreport import campbell_files

        return campbell_files(self)

    def __repr__(self) -> str:
        return f"<Campbell of {self.title}: {len(self.curves)} modes, {self.speeds[0] * RPM:.3g} to {self.speeds[-1] * RPM:.3g} rpm; print it for the table>"

    def __str__(self) -> str:
        from windsysid.console import render

        return render(self.table(), *self.sentences, *self.notes)


def find_modes(
    source: "TurbineLike | PosteriorLike",
    *,
    speeds: tuple[float, float] | None = None,
    operating: tuple[float, float] | None = None,
    progress: Callable[[str], object] = lambda _: None,
) -> Campbell:
    """Modes against rotor speed: of a turbine file, without bands, or of an identification, with the bands of its posterior.

    Parameters
    ----------
    source
        A turbine, its packaged name or TOML file; or what was identified, or the folder it was saved in.
    speeds
        Least and greatest rotor speed of the diagram [rad/s]; 0.1 and 1.3 times the usual one by default.
    operating
        Least and greatest operating speed [rad/s]; 10 % around the usual one by default.
    progress
        Called with a word on what is being done.

    Raises
    ------
    ConfigurationError
        If a range of speeds is none, or no mode can be found in it.
    """
    if isinstance(source, str | Path) and not Path(source).is_dir():
        source = as_turbine(source)
    if isinstance(source, Turbine):
        posterior = Posterior(source, (), np.zeros(0), np.zeros((0, 0)), "", True)
    else:
        posterior = as_posterior(source)
    machine = _Machine(posterior)
    usual = machine.turbine.rotor_speed
    parked = usual == 0.0 and operating is None
    usually = (0.1 * usual, 1.3 * usual) if usual > 0.0 else (0.0, 0.5 * machine.turbine.slowest_frequency)
    chosen = _checked("speeds", speeds or usually)
    working = (0.0, 0.0)
    if not parked:
        working = _checked("operating range", operating or ((1.0 - AROUND) * usual, (1.0 + AROUND) * usual))
    chosen = (min(chosen[0], working[0]), max(chosen[1], working[1]))
    reference = usual if chosen[0] <= usual <= chosen[1] else 0.5 * (working[0] + working[1])
    known: dict[float, Spectrum] = {}
    left_out: dict[str, list[float]] = {}
    new = [*np.linspace(*chosen, POINTS).tolist(), *np.linspace(*working, INSIDE).tolist(), reference]
    for _ in range(ROUNDS):
        for speed in new:
            progress(f"{speed * RPM:.3g} rpm")
            try:
                known[speed] = machine.spectrum(speed)
            except ConfigurationError as error:
                left_out.setdefault(str(error), []).append(speed)
        if not known:
            raise ConfigurationError(next(iter(left_out)))
        grid = np.array(sorted(known))
        grid = grid[np.diff(grid, prepend=-1.0) > 1e-9 * grid[-1]]
        found = [known[speed] for speed in grid.tolist()]
        at = int(np.argmin(np.abs(grid - reference)))
        curves = link(found, grid, at, posterior.cov)
        new = bends(curves, grid)
        if not new:
            break
    if not curves:
        raise ConfigurationError(
            f"turbine '{machine.turbine.name}': nothing oscillates between {grid[0] * RPM:.3g} and {grid[-1] * RPM:.3g} rpm"
        )
    progress("stability")
    unstable = unstable_ranges(lambda s: known[s].growth if s in known else machine.growth(s), grid)
    notes = [*machine.notes(found[at].method, posterior), *(
        f"left out, {len(where)} speeds up to {max(where) * RPM:.3g} rpm: {why}" for why, where in left_out.items()
    )]  # fmt: skip
    N = machine.turbine.model.blades
    return Campbell(
        machine.turbine.name, posterior.record or None, bool(posterior.parameters), grid, at, working,
        () if parked else tuple(sorted({1, N, 2 * N})),
        curves, tuple(unstable), () if parked else tuple(machine.ground_resonance(working)), found[at].method, tuple(notes),
    )  # fmt: skip


class _Machine:
    """A turbine compiled, with what is known of its coefficients."""

    def __init__(self, posterior: Posterior) -> None:
        self.turbine, self.parameters = posterior.turbine, posterior.parameters
        self.cov = posterior.cov
        self.model = compile_model(self.turbine.model)
        self.p = np.array([self.turbine.values[name] for name in self.model.parameters])
        self.directions = directions_of(self.model, self.parameters, posterior.theta)

    def spectrum(self, speed: float) -> Spectrum:
        """The modes at a speed, or a hair beside it where one is locked to the rotor and so narrowly that its band would vanish."""
        return unlocked(self.turbine.model, self.model, self.p, speed, self.directions)

    def growth(self, speed: float) -> float:
        return analyse(self.turbine.model, self.model, self.p, speed).growth

    def notes(self, method: str, posterior: Posterior) -> list[str]:
        """How it was computed, and from what."""
        why = obstacles(self.turbine.model, dict(zip(self.model.parameters, self.p.tolist(), strict=True)))
        how = {
            "Coleman": "multi-blade coordinates (Coleman): three or more equal blades, nothing that pulls in the rotor plane",
            "Floquet": f"Floquet's theory about the periodic motion, Coleman's transform does not apply: {', '.join(why)}",
            "constant": "the equations are constant: the rotor is rigid",
        }[method]
        notes = [
            how + (f"; bands are ±{SIGMAS:g}σ of the posterior, by exact derivatives" if posterior.parameters else "")
        ]
        if method == "Floquet" and self.turbine.model.blades == 2:
            notes.append(
                "two blades: lag differential is given as the blades feel it; the ground feels it at f − Ω, backward where f > Ω, and at f + Ω, forward"
            )
        if not posterior.parameters:
            notes.append(
                "the turbine file's values are taken as exact: bands come with the result of an identification"
            )
        elif not posterior.trusted:
            notes.append(
                "WARNING: the identification is not trusted (its summary says why): the bands may be too narrow"
            )
        return notes

    def ground_resonance(self, operating: tuple[float, float]) -> list[GroundResonance]:
        """Where lag and support meet, for each direction in which the support moves."""
        turbine = self.turbine
        if not isinstance(turbine.model, RotorModel) or turbine.model.lag == "locked" or turbine.model.blades < 2:
            return []
        found = []
        for axis in ("x", "y"):
            if axis not in turbine.model.coordinates:
                continue
            centre = meeting_speed(turbine, axis)
            if centre is None:
                continue
            slopes = []
            for q, direction in zip(self.parameters, self.directions, strict=True):
                step = 1e-4 * float(np.abs(direction).max())
                moved = (
                    meeting_speed(turbine.with_values({q.name: turbine.values[q.name] + sign * step}), axis)
                    for sign in (1, -1)
                )
                above, below = (value if value is not None else centre for value in moved)
                slopes.append((above - below) / 2e-4)
            std = math.sqrt(max(float(np.array(slopes) @ self.cov @ np.array(slopes)), 0.0)) if slopes else 0.0
            speed = (centre, centre - SIGMAS * std, centre + SIGMAS * std)
            low, high = operating
            end = high if centre > high else low
            margin = (
                tuple(value / end - 1.0 for value in speed) if not low <= centre <= high and end > 0.0 else (0.0,) * 3
            )
            try:
                there = self.spectrum(centre)
            except ConfigurationError:
                continue
            i = int(np.argmin(there.damping))
            slope = there.frequency_and_damping_slopes()[1][i]
            spread = SIGMAS * math.sqrt(max(float(slope @ self.cov @ slope), 0.0))
            z = float(there.damping[i])
            found.append(
                GroundResonance(
                    axis,
                    speed,
                    (margin[0], margin[1], margin[2]),
                    (z, z - spread, z + spread),
                    there.growth > NEUTRAL * centre,
                )
            )
        return found


def _checked(what: str, ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not (math.isfinite(low) and math.isfinite(high) and 0.0 <= low <= high and high > 0.0):
        raise ConfigurationError(
            f"{what}: expected two rotor speeds from 0 on, the lower first, got {low * RPM:.4g} and {high * RPM:.4g} rpm"
        )
    return low, high


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


def _band(triple: Triple, factor: float = 1.0, least: float = 0.0, sign: str = "") -> str:
    """A value ± its band, to two digits of the band or of `least`; to four digits where it has none."""
    value, half = factor * triple[0], factor * (triple[2] - triple[1]) / 2.0
    if half == 0.0 and least == 0.0:
        return f"{value:{sign}.4g}"
    digits = max(0, 1 - math.floor(math.log10(max(half, least))))
    return f"{value:{sign}.{digits}f}" + (f" ± {half:.{digits}f}" if half > 0.0 else "")


def _named(triple: Triple, factor: float = 1.0) -> dict[str, float]:
    return dict(zip(("estimate", "low", "high"), (factor * v for v in triple), strict=True))
