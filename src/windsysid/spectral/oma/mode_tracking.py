"""Which modes of several records are the same: by frequency and by shape.

Records come one after the other. Each mode goes to the track whose last mode is like it, the least unlike first, by

    (ln f_a/f_b / 0.05)² + (1 − MAC) / 0.3,        MAC = |φ_aᴴ φ_b|² / (φ_aᴴ φ_a φ_bᴴ φ_b),

the modal assurance criterion over the sensors that both have (Allemang, Sound and Vibration 2003), or begins a track.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Complex

__all__ = ["Seen", "assurance", "follow_modes"]

APART = 0.1
"""Greatest step of ln f from one record to the next."""

LEAST_ASSURANCE = 0.4
"""Least modal assurance criterion of two shapes of one mode, where they have two sensors in common."""

FREQUENCY_SCALE, SHAPE_SCALE = 0.05, 0.3


class Seen(NamedTuple):
    """A mode of one record: frequency [Hz], and the shape (N,) in the sensors of all records, NaN where it has none."""

    frequency: float
    shape: Complex


def assurance(a: Complex, b: Complex) -> float:
    """Modal assurance criterion of two shapes (N,) over the sensors that both have; NaN where that is one or none."""
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 2:
        return float("nan")
    a, b = a[both], b[both]
    size = float(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2))
    return float(np.abs(np.vdot(a, b)) ** 2 / size) if size > 0.0 else float("nan")


def follow_modes(records: Sequence[Sequence[Seen]]) -> list[dict[int, int]]:
    """Tracks by rising frequency: for each, which mode of which record, {record: mode}."""
    from scipy.optimize import linear_sum_assignment

    tracks: list[dict[int, int]] = []
    last: list[Seen] = []
    for number, modes in enumerate(records):
        cost = np.array([[_unlikeness(old, new) for new in modes] for old in last]).reshape(len(last), len(modes))
        allowed: NDArray[np.bool_] = np.isfinite(cost)
        rows, columns = linear_sum_assignment(np.where(allowed, cost, 1e6))
        placed = {int(j): int(i) for i, j in zip(rows, columns, strict=True) if allowed[i, j]}
        for j, mode in enumerate(modes):
            if j in placed:
                tracks[placed[j]][number] = j
                known = last[placed[j]]
                last[placed[j]] = Seen(mode.frequency, np.where(np.isfinite(mode.shape), mode.shape, known.shape))
            else:
                tracks.append({number: j})
                last.append(mode)
    order = np.argsort([mode.frequency for mode in last], kind="stable")
    return [tracks[i] for i in order]


def _unlikeness(a: Seen, b: Seen) -> float:
    step = float(np.log(b.frequency / a.frequency))
    alike = assurance(a.shape, b.shape)
    if abs(step) > APART or alike < LEAST_ASSURANCE:
        return float("inf")
    return (step / FREQUENCY_SCALE) ** 2 + (0.0 if np.isnan(alike) else (1.0 - alike) / SHAPE_SCALE)
