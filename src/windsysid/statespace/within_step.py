"""Loads within a step: deviation from the straight line between its ends.

The noise that drives a first-order load, dz = −z/τ dt + dβ, never rests. Given the load at both ends of a step of
length h, what it does in addition to the straight line is a Brownian bridge of the noise's density L: its integral over
the step has the covariance L h³/12, and that integral is what moves a mass. A constant of the covariance L h/12 over
the step does the same to velocities, and nearly the same to positions (h⁵/48 instead of h⁵/45). Left out, loads lack a
hundredth of their power at a mode whose period is twenty steps, and a search that sees this takes it for a longer
memory: of ten minutes rms and time constant came out 1.14 and 1.29 times too large (docs/decisions.md).

A load that forgets within few steps leaves the straight line another way, towards zero, and samples of it hold more
power at low frequencies than it has. At ω, straight lines between samples lack (ω²τ² − 1)/(ω²τ² + 1) of what the bridge
adds, to second order in h. That is nearly all of it for a load that remembers long, and less than nothing where ωτ < 1;
then nothing is added. ω is that of the fastest mode which the steps follow.

Loads whose noise enters a derivative only, such as a second-order process, run smoothly: they have no such part.

Source: Van Loan, IEEE TAC 23(3), 1978, https://doi.org/10.1109/TAC.1978.1101743 (loads and motion discretised
together, which the tests hold this against); Särkkä & Solin, Applied Stochastic Differential Equations, 2019, ch. 6.
"""

import numpy as np

from windsysid._types import Array
from windsysid.statespace.load_model import LoadModel

__all__ = ["within_step"]

MAX_STEP_RADIANS = 0.31
"""[rad] that the fastest mode goes in a step."""

INSTANT_STEPS = 1e-4
"""Of a step: so short a time that the noise of a load has hardly moved on to what it drives."""

MIN_DENSITY_SHARE = 1e-4
"""Share of the largest density, each in its state's variance, below which a state has no noise of its own."""


def within_step(load: LoadModel, step: float) -> Array:
    """R (n, r): in addition to a straight line over `step` [s] the n states of a load are R ξ, with r unit normals ξ.

    Noise that no output sees directly is left out.
    """
    size = np.sqrt(np.diag(load.cov))
    size[size == 0.0] = 1.0  # a state that nothing drives
    density = load.discretise(INSTANT_STEPS * step)[1] / (INSTANT_STEPS * step) / np.outer(size, size)
    largest = float(np.diag(density).max(initial=0.0))
    if np.abs(density - np.diag(np.diag(density))).max(initial=0.0) < MIN_DENSITY_SHARE * largest:
        rates, axes = np.diag(density), np.eye(len(size))
    else:
        rates, axes = np.linalg.eigh(density)
    axes = size[:, None] * axes
    rows = np.vstack([np.zeros((1, len(size))), *load.outputs.values()])
    rough = (rates > MIN_DENSITY_SHARE * largest) & (np.abs(rows @ axes).max(axis=0) > 0.0)
    rates, axes = rates[rough], axes[:, rough]
    turned = np.square(2.0 * MAX_STEP_RADIANS / (rates * step))  # ω²τ², as a rate is 2/τ
    return np.asarray(axes * np.sqrt(rates * step / 12.0 * np.maximum(0.0, (turned - 1.0) / (turned + 1.0))))
