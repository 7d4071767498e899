"""Figures: one function per picture, a Matplotlib `Figure` out, nothing shown and nothing saved.

Blue is the estimate with its 95 % interval, dashed black the reference, grey what was measured, orange an error.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.records.record import Record
from windsysid.reports.figures.canvas import DisplayedFigure, canvas, label
from windsysid.results.identification import Identification, coefficient_errors
from windsysid.units import unit_text

__all__ = [
    "balance_error_comparison", "coefficient_histories", "envelope", "record_overview", "response_comparison",
    "start_indifference", "symbol", "tidy",
]  # fmt: skip


ESTIMATE, BAND, REFERENCE, MEASURED, ERROR = "#1764ab", "#a9cbe8", "#111111", "#9a9a9a", "#d1661b"
MAX_POINTS = 4000
MAX_UNIT_CHARACTERS = 16
"""Largest length of a unit in a figure; units of unknown quantities are texts from files."""
GREEK = (
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "rho", "sigma",
    "tau", "omega",
)  # fmt: skip


def symbol(name: str) -> str:
    """A name as formulas have it, ``k_beta_1`` → k_β1, ``k_side_side`` → k side-side; words stay words."""
    letter, *words = name.split("_")
    plain = name.isascii() and name.isidentifier() and all((letter, *words))
    if not plain or not _is_letter(letter):
        return label(name.replace("_", " "))
    if sum(not _is_letter(word) for word in words) > 1:
        return f"${_escaped(letter)}$ {'-'.join(words)}"
    of = " ".join(_escaped(word) if _is_letter(word) else rf"\mathrm{{{word}}}" for word in words)
    return f"${_escaped(letter)}_{{{of}}}$" if of else f"${_escaped(letter)}$"


def _is_letter(word: str) -> bool:
    return len(word) == 1 or word in GREEK


def _escaped(letter: str) -> str:
    return rf"\{letter}" if letter in GREEK else letter


def coefficient_histories(
    identification: Identification, names: Sequence[str] | None = None, *, place: Axes | None = None
) -> Figure:
    """Estimate, ±2σ band and reference of each coefficient over the record, off the file by (Eq 24) below."""
    names = list(names or [e.name for e in identification.estimates])
    columns = min(4 if len(names) > 6 else 3, len(names))
    rows = -(-len(names) // columns)
    width, height, legend = 12.6 / columns, 3.3, 0.3
    size = 12.6, rows * height + legend
    figure = DisplayedFigure(figsize=size) if place is None else canvas(size, place)
    for i, name in enumerate(names):
        known = identification[name].reference is not None
        left, bottom = i % columns * width, (rows - 1 - i // columns) * height
        axes = _panels(
            figure, (left + 0.8, bottom + 0.46, left + width - 0.12, bottom + height - 0.2),
            heights=[3, 1.4] if known else [1], apart=0.14, size=size,
        )  # fmt: skip
        _history(axes[0], identification, name)
        if known:
            _error(axes[1], identification, name)
        axes[-1].set_xlabel("time [s]")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=4, frameon=False, fontsize=9)
    return figure


def _panels(
    figure: Figure, box: tuple[float, float, float, float], *,
    heights: Sequence[float], apart: float, size: tuple[float, float] | None = None,
) -> NDArray[Any]:  # fmt: skip
    """Axes (rows,) over common times in a `box` (left, bottom, right, top), `apart` from each other, all in inches of a
    figure of some `size`, its own by default.

    Matplotlib's constrained layout finds such margins by measuring every label, which takes longer than the drawing.
    """
    left, bottom, right, top = box
    width, height = size or figure.get_size_inches()
    grid = figure.add_gridspec(
        len(heights), 1, height_ratios=heights,
        left=left / width, right=right / width, bottom=bottom / height, top=top / height,
        hspace=apart * len(heights) / (top - bottom - apart * (len(heights) - 1)),
    )  # fmt: skip
    axes: NDArray[Any] = grid.subplots(squeeze=False, sharex="col")[:, 0]
    for ax in axes:
        ax.set_in_layout(False)  # somebody's figure may have a layout that would pile all boxes up
        ax.ticklabel_format(axis="y", scilimits=(-3, 5))  # no label of more than six characters
        ax.yaxis.get_offset_text().set(x=-0.015, horizontalalignment="right", fontsize=8)  # next to the name, not on it
        ax.yaxis.set_label_coords(-0.56 / (ax.get_position().width * width), 0.5)
    return axes


def _history(ax: Axes, identification: Identification, name: str) -> None:
    estimate = identification[name]
    every = _thin(len(identification.time))
    time = identification.time[every]
    middle, low, high = (values[every] for values in identification.history(name))
    ax.fill_between(time, low, high, color=BAND, lw=0, label="95 % interval")
    ax.plot(time, middle, color=ESTIMATE, lw=1.2, label="on-line estimate")
    if estimate.reference is not None:
        ax.axhline(estimate.reference, color=REFERENCE, ls="--", lw=1, label="reference")
    ax.errorbar(
        time[-1], estimate.estimate, yerr=[[estimate.estimate - estimate.low], [estimate.high - estimate.estimate]],
        fmt="o", ms=4, color=REFERENCE, capsize=3, label="result, 95 % interval", clip_on=False, zorder=5,
    )  # fmt: skip
    late = slice(len(time) // 8, None)
    bounds = (low[late].min(), high[late].max(), estimate.low, estimate.high, estimate.reference)
    shown = [bound for bound in bounds if bound is not None and np.isfinite(bound)]
    centre, half = 0.5 * (max(shown) + min(shown)), 0.5 * (max(shown) - min(shown))
    ax.set_ylim(centre - 1.4 * half, centre + 1.4 * half)
    ax.set_ylabel(symbol(name) + (f" [{unit_text(estimate.unit)}]" if estimate.unit else ""))
    ax.yaxis.set_major_locator(MaxNLocator(5))
    tidy(ax)


def _error(ax: Axes, identification: Identification, name: str) -> None:
    estimate = identification[name]
    every = _thin(len(identification.time))
    reference = estimate.reference or 1.0
    errors = coefficient_errors(identification.history(name)[0], reference)
    ax.semilogy(identification.time[every], np.maximum(errors[every], 1e-4), color=ERROR, lw=0.9)
    ax.set_ylabel("off file [%]")
    ax.yaxis.set_major_locator(LogLocator(numticks=4))
    ax.minorticks_off()
    mean = f"mean {float(f'{np.mean(errors):.2g}'):g} %"
    ax.text(0.98, 0.92, mean, transform=ax.transAxes, ha="right", va="top", fontsize=8)
    tidy(ax)


def record_overview(record: Record, channels: Sequence[str], section: tuple[float, float] | None = None) -> Figure:
    """Channels over time, the section that is used marked (the paper's Fig 3)."""
    height = 1.5 * len(channels) + 0.8
    figure = Figure(figsize=(10, height))
    axes = _panels(figure, (0.8, 0.5, 9.9, height - 0.25), heights=[1.0] * len(channels), apart=0.3)
    for ax, channel in zip(axes, channels, strict=True):
        time, low, high = envelope(record.time, record[channel])
        ax.fill_between(time, low, high, color=MEASURED, lw=0.4, edgecolor=MEASURED)
        if section is not None:
            ax.axvspan(*section, color=BAND, alpha=0.6, lw=0)
        unit = record.units[record.channels.index(channel)]
        ax.set_title(label(channel.replace("_", " ")), fontsize=9, loc="left", y=1.0, pad=2)
        ax.set_ylabel(f"[{label(unit_text(unit), MAX_UNIT_CHARACTERS)}]")
        tidy(ax)
    if section is not None:
        axes[0].text(
            np.mean(section), 1.02, "section used", transform=axes[0].get_xaxis_transform(), ha="center", fontsize=9
        )
    axes[-1].set_xlabel("time [s]")
    axes[-1].set_xlim(record.time[0], record.time[-1])
    return figure


def response_comparison(
    time: Array,
    curves: Mapping[str, tuple[Array, Array]],
    label: str,
    units: tuple[str, str],
    window: tuple[float, float],
) -> Figure:
    """Displacement and velocity of one degree of freedom: measured, reference and model (the paper's Figs 10–12).

    `curves` maps ``measured``, ``reference`` and ``model`` to displacement and velocity (T,).
    """
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    styles = {
        "measured": {"color": MEASURED, "lw": 3.2},
        "model": {"color": ESTIMATE, "lw": 1.6},
        "reference": {"color": REFERENCE, "lw": 1.1, "ls": (0, (4, 3))},
    }
    inside = (time >= window[0]) & (time <= window[1])
    for ax, row, quantity, unit in zip(
        figure.subplots(2, 1, sharex=True), (0, 1), ("displacement", "velocity"), units, strict=True
    ):
        for name, style in styles.items():
            text = "model with identified coefficients" if name == "model" else name
            ax.plot(time[inside], curves[name][row][inside], label=text, **style)
        ax.set_ylabel(f"{label}\n{quantity} [{unit}]")
        tidy(ax)
    figure.axes[-1].set_xlabel("time [s]")
    figure.axes[-1].set_xlim(*window)
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=9
    )
    return figure


def start_indifference(
    names: Sequence[str],
    starts: Mapping[float, Sequence[Array]],
    time: Array,
    sections: Mapping[float, Mapping[str, tuple[float, float]]],
) -> Figure:
    """Left: relative estimates over time from priors 0.3 to 3 times off; right: results of sections from any start.

    `starts` maps each factor to one relative history (T,) per name; `sections` maps each start [s] to the relative
    estimate and its relative 2σ by name.
    """
    figure = Figure(figsize=(10, 2.1 * len(names) + 0.6), layout="constrained")
    axes = figure.subplots(len(names), 2, sharex="col", squeeze=False, width_ratios=[1.3, 1])
    colours = {factor: _ramp(i / max(1, len(starts) - 1)) for i, factor in enumerate(starts)}
    every = np.unique(np.round(np.geomspace(1, len(time), 800)).astype(int)) - 1
    for row, name in enumerate(names):
        left, right = axes[row]
        for factor, histories in starts.items():
            left.semilogx(
                time[every] - time[0] + time[1] - time[0],
                histories[row][every],
                color=colours[factor],
                lw=1.1,
                label=f"{factor:g} ×",
            )
        left.axhline(1.0, color=REFERENCE, ls="--", lw=1)
        left.set_ylabel(f"{symbol(name)} / reference")
        for start, estimates in sections.items():
            value, half = estimates[name]
            right.errorbar(start, value, yerr=half, fmt="o", ms=4, color=ESTIMATE, capsize=2)
        right.axhline(1.0, color=REFERENCE, ls="--", lw=1)
        right.ticklabel_format(axis="y", useOffset=False)
        tidy(left)
        tidy(right)
    axes[-1, 0].set_xlabel("time since the start [s], logarithmic")
    axes[-1, 1].set_xlabel("section starts at [s], 100 s long")
    axes[0, 0].set_title("priors off by a factor", fontsize=10)
    axes[0, 1].set_title("any starting point of the record, 95 % intervals", fontsize=10)
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=len(starts), frameon=False, fontsize=8
    )
    return figure


def balance_error_comparison(names: Sequence[str], ours: Array, published: Mapping[str, float]) -> Figure:
    """Average errors over many seeds (S, n_names) [%], compared with the published ones."""
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    ax = figure.subplots()
    for i, name in enumerate(names):
        jitter = np.linspace(-0.16, 0.16, len(ours))
        ax.semilogy(
            i + jitter,
            ours[:, i],
            "o",
            ms=3.5,
            color=ESTIMATE,
            alpha=0.7,
            label="ours, one dot a seed" if i == 0 else None,
        )
        ax.plot(
            [i - 0.25, i + 0.25],
            [np.median(ours[:, i])] * 2,
            color=ESTIMATE,
            lw=2,
            label="our median" if i == 0 else None,
        )
        if name in published:
            ax.plot([i - 0.3, i + 0.3], [published[name]] * 2, color=ERROR, lw=2, label="published" if i == 0 else None)
    ax.set_xticks(range(len(names)), [symbol(name) for name in names])
    ax.set_ylabel("average error, Eq (24) [%]")
    ax.legend(frameon=False, fontsize=8, ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.14))
    tidy(ax)
    return figure


def tidy(ax: Axes) -> None:
    """House style of an axes: no box, a faint grid, small ticks."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(alpha=0.25, lw=0.6)
    ax.tick_params(labelsize=8)


def _thin(samples: int) -> slice:
    """Decimation that keeps a figure small."""
    return slice(None, None, max(1, samples // MAX_POINTS))


def envelope(time: Array, values: Array) -> tuple[Array, Array, Array]:
    """Least and greatest value in each of some thousand stretches, so that no spike is lost to thinning."""
    size = max(1, len(values) // MAX_POINTS)
    stretches = len(values) // size
    cut = values[: stretches * size].reshape(stretches, size)
    empty = ~np.isfinite(cut).any(axis=1)
    low = np.where(empty, np.nan, np.nanmin(np.where(np.isfinite(cut), cut, np.inf), axis=1))
    high = np.where(empty, np.nan, np.nanmax(np.where(np.isfinite(cut), cut, -np.inf), axis=1))
    return time[: stretches * size : size], low, high


def _ramp(fraction: float) -> tuple[float, float, float]:
    """A colour between blue and orange."""
    low, high = np.array([23, 100, 171]) / 255.0, np.array([209, 102, 27]) / 255.0
    red, green, blue = low + fraction * (high - low)
    return float(red), float(green), float(blue)
