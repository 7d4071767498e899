"""Modes for tests, of which only a few values matter."""

import numpy as np

from windsysid.results.estimate import IntervalEstimate
from windsysid.spectral.oma.mode import Doubt, OperationalMode


def mode(
    frequency: float = 1.0,
    damping: float = 0.01,
    shape: tuple[complex, ...] = (1.0, 0.5),
    doubts: tuple[Doubt, ...] = (),
) -> OperationalMode:
    size, values = len(shape), np.array(shape, dtype=np.complex128)
    std = np.full(size, 0.01)
    band = (0.9 * frequency, 1.1 * frequency)
    cov = 1e-4 * np.eye(2 * size)
    return OperationalMode(
        name="", frequency=IntervalEstimate.normal(frequency, 0.001, "Hz"),
        damping_ratio=IntervalEstimate.lognormal(damping, 0.1, "1"), shape=values, shape_std=std, load=1.0,
        ln_load_std=0.1, band=band, grounds=doubts, shape_cov=cov,
    )  # fmt: skip
