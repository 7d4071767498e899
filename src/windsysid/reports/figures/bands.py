"""The coefficients of a result with their bands, with the prior and the turbine file."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import BAND, ESTIMATE, REFERENCE, symbol, tidy
from windsysid.results.identification import Estimate, Identification
from windsysid.results.posterior import SIGMAS
from windsysid.units import unit_text

__all__ = ["WIDER", "caption", "coefficient_bands", "prior_limits", "relative_values"]

ROW, WIDTH, MARGIN = 0.32, 12.6, 0.95
"""Inches: height of a coefficient, width of the figure, height of title and axis."""

WIDER = 1.6
"""So many times the widest band of what the file knows is shown; what is wider is cut off."""


def caption(found: Identification) -> str:
    """Captions of the figures of the coefficients."""
    text = "95 % intervals of the result (blue) and of the prior (grey), as differences from the turbine file."
    if all(e.reference for e in found.estimates):
        return text
    return f"{text} *: the file has no value; the interval is drawn about the result."


def prior_limits(found: Identification) -> dict[str, list[float]]:
    """Limits (±2σ) of the prior of each coefficient [SI]."""
    return {
        q.name: [float(q.physical(q.prior[0] + k * q.prior[1])) for k in (-SIGMAS, SIGMAS)] for q in found.parameters
    }


def relative_values(e: Estimate, prior: Sequence[float]) -> list[float]:
    """Estimate, its limits and those of the prior, as differences from the turbine file [%], from the result where the
    file has no value."""
    base = e.reference or e.estimate or 1.0
    return [100.0 * (x / base - 1.0) for x in (e.estimate, e.low, e.high, *prior)]


def coefficient_bands(found: Identification, place: Axes | None = None) -> Figure:
    """One line a coefficient, as differences from the turbine file [%], from the result where the file has no value;
    stiffness and damping apart, as damping is known far less."""
    kinds = [[e for e in found.estimates if e.kind == kind] for kind in ("stiffness", "damping", "parameter")]
    kinds = [kind for kind in kinds if kind]
    rows = max(len(kind) for kind in kinds)
    figure = canvas((WIDTH, MARGIN + ROW * rows), place)
    priors = prior_limits(found)
    for ax, kind in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        _draw(ax, kind, priors, rows)
    return figure


def _draw(ax: Axes, estimates: Sequence[Estimate], priors: dict[str, list[float]], rows: int) -> None:
    known = any(e.reference for e in estimates)
    half = 0.0
    for row, e in enumerate(estimates):
        low, high = _draw_row(ax, row, e, priors[e.name])
        told = f"{e.estimate:.4g} {unit_text(e.unit)}".removesuffix(" 1")
        if e.reference or not known:
            half = max(half, abs(low), abs(high))
        else:
            told += " *"
        ax.text(1.01, row, told, transform=ax.get_yaxis_transform(), va="center", fontsize=8.5)
    ax.axvline(0.0, color=REFERENCE, ls="--", lw=1)
    ax.set(ylim=(rows - 0.5, -0.6), xlim=(-WIDER * half, WIDER * half))
    ax.set_yticks(range(len(estimates)), [symbol(e.name) for e in estimates])
    tidy(ax)
    ax.tick_params(axis="y", labelsize=10, length=0)
    ax.set_title(estimates[0].kind, fontsize=10, loc="left")
    ax.set_xlabel("difference from the turbine file [%]" if known else "difference from the result [%]", fontsize=9)


def _draw_row(ax: Axes, row: int, e: Estimate, prior: Sequence[float]) -> tuple[float, float]:
    """One coefficient; the ends of its band [%]."""
    value, low, high, before, after = relative_values(e, prior)
    ax.barh(row, after - before, left=before, height=0.62, color=BAND, alpha=0.45, lw=0)
    ax.plot([low, high], [row, row], color=ESTIMATE, lw=2.2, solid_capstyle="butt")
    ax.plot(value, row, "o", color=ESTIMATE, ms=5, mfc=None if e.reference else "white")
    return low, high
