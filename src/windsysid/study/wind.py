"""The study under turbulent wind: a change of direction between 20 s and 40 s of the section, and its effect on the
estimates.

The paper sees its estimates scatter there (Figs 4, 5, 7, 8) and names the direction as the cause, but its equations
hold no wind. So the same record is identified three times: with the loads that acted, with the loads of the old
direction, and with no loads. ``python -m validation.wind_study --output DIR`` writes two figures and prints
the numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from windsysid._types import Array
from windsysid.mechanics.compile import compile_model
from windsysid.reports.figures.plots import BAND, ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.results.identification import Identification
from windsysid.signals.textbook import short_spectra
from windsysid.simulation.integrate import constant_speed_inputs
from windsysid.simulation.wind import (
    Direction,
    DirectionChange,
    SimulatedWindLoads,
    extreme_direction_change,
    kaimal_spectrum,
    packaged_wind,
    wind_loads,
)
from windsysid.simulation.wind.feedback import integrate_with_feedback
from windsysid.study.arms import identify_section, record_balance
from windsysid.study.scenario import DURATION, RATE, SECTION, StudyReference, measure
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import unit_text

__all__ = [
    "ARMS", "WINDOW", "DirectionChangeStudy", "WindReference", "direction_change_figure", "direction_change_study",
    "load_spectra_figure", "mean_spectrum", "simulate_wind_reference",
]  # fmt: skip


WINDOW = (20.0, 40.0)
"""Times of the other wind direction, in seconds of the section."""

TURNING_SECONDS = 6.0
"""Seconds that the wind takes to turn, the IEC's for an extreme direction change."""

SPREAD_DEG = 4.0
"""Standard deviation of the direction besides [deg], assumed."""

ARMS = ("loads known", "loads of the old direction", "loads withheld")
SHOWN = ("k_x", "c_x")
SETTLING_SECONDS = 8.0
"""Seconds after which the figure's axes must show the estimates."""


class WindReference(NamedTuple):
    """A reference record under wind, its wind, and the loads at rest that the old direction would have made."""

    reference: StudyReference
    wind: SimulatedWindLoads
    old_direction: Array


@dataclass(frozen=True)
class DirectionChangeStudy:
    """Effect of the change of direction.

    Attributes
    ----------
    turbine
        The scale model.
    change_deg
        How far the wind turns [deg].
    under
        The record with the change.
    steady
        The wind of the same seed without it.
    arms
        Identifications of the section by arm (`ARMS`).
    unchanged
        The same arms on the record without the change.
    loads_at_rest
        Identification when only the loads at rest are known: its damping is structure and aerodynamics together.
    """

    turbine: Turbine
    change_deg: float
    under: WindReference
    steady: WindReference
    arms: Mapping[str, Identification]
    unchanged: Mapping[str, Identification]
    loads_at_rest: Identification

    def wander(self, arm: str, name: str, *, changed: bool = True) -> float:
        """Greatest less smallest on-line estimate while the wind is turned away, relative to the reference."""
        found = (self.arms if changed else self.unchanged)[arm]
        time = found.time - SECTION[0]
        inside = (time >= WINDOW[0]) & (time <= WINDOW[1])
        return float(np.ptp(found.history(name)[0][inside])) / self.turbine.values[name]


def direction_change_study(seed: int = 0) -> DirectionChangeStudy:
    """Simulate the reference record under turbulent wind that turns, and identify its section three ways."""
    turbine = load_turbine("verne555").exact()
    conditions, blade = packaged_wind("verne555")
    diameter = 2.0 * blade.radii[-1] + blade.widths[-1]
    size = float(np.rad2deg(extreme_direction_change(conditions, diameter)))
    away, back = SECTION[0] + WINDOW[0], SECTION[0] + WINDOW[1] - TURNING_SECONDS
    changes = (DirectionChange(away, size, TURNING_SECONDS), DirectionChange(back, -size, TURNING_SECONDS))
    under = simulate_wind_reference(turbine, seed, Direction(std_deg=SPREAD_DEG, changes=changes))
    steady = simulate_wind_reference(turbine, seed, Direction(std_deg=SPREAD_DEG))
    return DirectionChangeStudy(
        turbine=turbine,
        change_deg=size,
        under=under,
        steady=steady,
        arms=_arms(turbine, under),
        unchanged=_arms(turbine, steady),
        loads_at_rest=_identify(turbine, under.reference, under.wind.loads),
    )


def simulate_wind_reference(turbine: Turbine, seed: int, direction: Direction) -> WindReference:
    """The reference scenario's record under turbulent wind with aerodynamic damping; reproducible for a seed."""
    rotor = constant_speed_inputs(turbine.rotor_speed, DURATION, RATE)
    of = turbine, *packaged_wind(turbine.name), rotor
    wind, old = wind_loads(*of, rate=RATE, direction=direction, seed=seed), replace(direction, changes=())
    without_change = wind if old == direction else wind_loads(*of, rate=RATE, direction=old, seed=seed)
    model = compile_model(turbine.model)
    p = np.array([turbine.values[name] for name in model.parameters])
    response, acted = integrate_with_feedback(
        model, p, np.hstack([rotor, wind.loads]), wind.damping, rate=RATE, start=np.zeros(len(model.states))
    )
    inputs = np.hstack([rotor, acted])
    record = measure(turbine, response, rotor, np.random.default_rng([seed, 1]), f"wind, seed {seed}")
    return WindReference(StudyReference(record, response, inputs), wind, without_change.loads)


def _arms(turbine: Turbine, under: WindReference) -> dict[str, Identification]:
    acted = under.reference.inputs[:, 3:]
    told = (acted, acted - under.wind.loads + under.old_direction, None)
    return {arm: _identify(turbine, under.reference, loads) for arm, loads in zip(ARMS, told, strict=True)}


def _identify(turbine: Turbine, reference: StudyReference, loads: Array | None) -> Identification:
    """The paper's filter over the section, with these loads."""
    return identify_section(turbine, reference, record_balance(turbine, reference, loads))


def direction_change_figure(study: DirectionChangeStudy, names: Sequence[str] = SHOWN) -> Figure:
    """Plot wind direction and on-line estimates: left with loads given, right without; dotted in a steady wind."""
    figure = Figure(figsize=(12, 2.5 * len(names) + 2.4), layout="constrained")
    axes = figure.subplots(len(names) + 1, 2, sharex=True, height_ratios=[0.8] + [1.4] * len(names))
    window = slice(round(SECTION[0] * RATE), round(SECTION[1] * RATE))
    time = np.arange(window.stop - window.start) / RATE
    columns = ((ARMS[:2], "loads known to the filter"), (ARMS[2:], "the loads are withheld"))
    for column, (arms, title) in enumerate(columns):
        top = axes[0, column]
        top.plot(time, np.rad2deg(study.under.wind.misalignment[window]), color=REFERENCE, lw=1.0)
        top.set_title(title, fontsize=10)
        for ax, name in zip(axes[1:, column], names, strict=True):
            _draw_histories(ax, study, name, arms, time)
        for ax in axes[:, column]:
            ax.axvspan(*WINDOW, color=BAND, alpha=0.45, lw=0)
            tidy(ax)
        axes[-1, column].set_xlabel(f"time since {SECTION[0]:g} s [s]")
    axes[0, 0].set_ylabel("wind direction\n[deg]")
    for ax, name in zip(axes[1:, 0], names, strict=True):
        ax.set_ylabel(f"{symbol(name)} [{unit_text(study.arms[ARMS[0]][name].unit)}]")
    axes[-1, 0].set_xlim(0.0, time[-1])
    lines = {line.get_label(): line for ax in axes[1] for line in ax.lines if not str(line.get_label()).startswith("_")}
    lines["reference"] = Line2D([], [], color=REFERENCE, ls="--", lw=1)
    lines["same wind, not turning"] = Line2D([], [], color=REFERENCE, ls=":", lw=1)
    figure.legend(
        list(lines.values()),
        [str(label) for label in lines],
        loc="outside upper center",
        ncols=5,
        frameon=False,
        fontsize=9,
    )
    return figure


def _draw_histories(ax: Axes, study: DirectionChangeStudy, name: str, arms: Sequence[str], time: Array) -> None:
    """Plot the on-line estimates of a coefficient; dotted in a steady wind."""
    colours = dict(zip(ARMS, (ESTIMATE, ERROR, MEASURED), strict=True))
    reference = study.turbine.values[name]
    seen = [reference]
    for arm in arms:
        found, calm = study.arms[arm].history(name)[0], study.unchanged[arm].history(name)[0]
        ax.plot(time, calm, color=colours[arm], lw=1.0, ls=":")
        ax.plot(time, found, color=colours[arm], lw=1.5, label=arm)
        for history in (found, calm):
            seen += [history[time >= SETTLING_SECONDS].min(), history[time >= SETTLING_SECONDS].max()]
    ax.axhline(reference, color=REFERENCE, ls="--", lw=1)
    margin = 0.1 * (max(seen) - min(seen))
    ax.set_ylim(min(seen) - margin, max(seen) + margin)


def load_spectra_figure(study: DirectionChangeStudy) -> Figure:
    """Spectra of the wind, a blade's load and a hub load, with the rotor's multiples and the Kaimal target."""
    conditions, aerodynamics = packaged_wind(study.turbine.name)
    wind, once = study.steady.wind, study.turbine.rotor_speed / (2.0 * np.pi)
    figure = Figure(figsize=(10, 8.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    outer = wind.blade_speed[:, :, -1] - wind.blade_speed[:, :, -1].mean()
    frequency, hub = mean_spectrum(wind.hub_speed[:, None])
    axes[0].loglog(
        frequency, mean_spectrum(outer)[1], color=ERROR, lw=1.1, label=f"blades, r = {aerodynamics.radii[-1]:g} m"
    )
    axes[0].loglog(frequency, hub, color=ESTIMATE, lw=1.1, label="hub")
    axes[0].loglog(
        frequency, kaimal_spectrum(frequency, conditions), color=REFERENCE, ls="--", lw=1, label="Kaimal (IEC)"
    )
    axes[0].set_ylabel("wind speed\n[m²/s² / Hz]")
    n = study.turbine.model.coordinates.index("beta_1")
    axes[1].loglog(
        frequency, mean_spectrum(wind.loads[:, n:])[1], color=ERROR, lw=1.1, label="lag moment, mean of the blades"
    )
    axes[1].set_ylabel("blade load\n[(N·m)² / Hz]")
    axes[2].loglog(frequency, mean_spectrum(wind.loads[:, :1])[1], color=ESTIMATE, lw=1.1, label="hub force x")
    axes[2].set_ylabel("hub load\n[N² / Hz]")
    for ax in axes:
        for multiple in (1, 2, 3, 6):
            ax.axvline(multiple * once, color=MEASURED, lw=0.8, ls=":" if multiple in (2,) else "-", zorder=0)
        ax.legend(frameon=False, fontsize=8, loc="lower left")
        tidy(ax)
    for multiple in (1, 2, 3, 6):
        axes[0].text(
            multiple * once, 1.02, f"{multiple}P", transform=axes[0].get_xaxis_transform(), ha="center", fontsize=9
        )
    axes[0].set_xlim(0.03, 20.0)
    for ax in axes:
        _fit(ax)
    axes[-1].set_xlabel("frequency [Hz]")
    return figure


def mean_spectrum(values: Array) -> tuple[Array, Array]:
    """One-sided spectrum (Welch, 41 s pieces), the mean over columns."""
    found = [short_spectra(column, RATE, 4096, 2048) for column in values.T]
    return found[0][0][1:], np.asarray(np.mean([one[2].mean(axis=1) for one in found], axis=0))[1:]


def _fit(ax: Axes) -> None:
    """Limits from visible points only."""
    low, high = ax.get_xlim()
    seen = [
        np.asarray(line.get_ydata())[(x >= low) & (x <= high)]
        for line in ax.lines
        if len(x := np.asarray(line.get_xdata())) > 2
    ]
    ax.set_ylim(0.5 * min(map(np.min, seen)), 2.0 * max(map(np.max, seen)))
