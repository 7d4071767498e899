"""A profile of the posterior as a figure."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.identification.estimate.profile import Profile, interpolate_on
from windsysid.reports.figures.canvas import single
from windsysid.reports.figures.plots import BAND, ESTIMATE, REFERENCE, symbol, tidy
from windsysid.results.posterior import SIGMAS
from windsysid.units import unit_text

__all__ = ["figure"]


def figure(profile: Profile, place: Axes | None = None) -> Figure:
    """The profile, its band, and the parabola that the Gaussian band stands for."""
    drawn, ax = single((6.4, 4.2), place)
    grid = np.linspace(profile.values[0], profile.values[-1], 200)
    root = np.sign(profile.values - profile.estimate) * np.sqrt(-2.0 * profile.log_posterior)
    low, high = max(profile.low, profile.values[0]), min(profile.high, profile.values[-1])
    ax.axvspan(low, high, color=BAND, alpha=0.5, lw=0, label="drop of 2")
    ax.plot(grid, -0.5 * np.square(interpolate_on(profile.values, root, grid)), color=ESTIMATE, lw=1.4, label="profile")
    ax.plot(profile.values, profile.log_posterior, "o", ms=4, color=ESTIMATE)
    half = np.where(
        grid < profile.estimate, profile.estimate - profile.gaussian[0], profile.gaussian[1] - profile.estimate
    )
    ax.plot(
        grid,
        -0.5 * np.square(SIGMAS * (grid - profile.estimate) / half),
        color=REFERENCE,
        ls="--",
        lw=1,
        label="Gaussian 95 % interval",
    )
    ax.axhline(-0.5 * SIGMAS**2, color=REFERENCE, ls=":", lw=0.8)
    ax.set(
        xlabel=f"{symbol(profile.name)} [{unit_text(profile.unit)}]", ylabel="log posterior", xlim=(grid[0], grid[-1])
    )
    ax.set_ylim(min(profile.log_posterior.min(), -3.0), 0.3)
    ax.legend(frameon=False, fontsize=8, loc="lower center")
    tidy(ax)
    return drawn  # fmt: skip
