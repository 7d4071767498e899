"""Assignment of the modes of several records to tracks, by frequency and by shape.

Records come one after the other. Each mode is assigned to the track whose last mode is nearest by the distance

    (ln f_a/f_b / 0.1)² + (1 − MAC) / 0.6,        MAC = |φ_aᴴ φ_b|² / (φ_aᴴ φ_a φ_bᴴ φ_b),

the modal assurance criterion over the sensors that both have (Allemang, Sound and Vibration 2003), or begins a track.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Complex
from windsysid.inspection.limits import MAX_REFERENCE_DISTANCE
from windsysid.modal.shapes import assurance
from windsysid.spectral.oma.limits import MIN_ASSURANCE

__all__ = ["Seen", "follow_modes"]


class Seen(NamedTuple):
    """Mode of one record: frequency [Hz], and shape (N,) in the sensors of all records, NaN without a sensor."""

    frequency: float
    shape: Complex


def follow_modes(records: Sequence[Sequence[Seen]]) -> list[dict[int, int]]:
    """Return tracks by rising frequency: for each, the number of its mode in each record, {record: mode}."""
    from scipy.optimize import linear_sum_assignment

    tracks: list[dict[int, int]] = []
    last: list[Seen] = []
    for number, modes in enumerate(records):
        cost = np.array([[_distance(old, new) for new in modes] for old in last]).reshape(len(last), len(modes))
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


def _distance(a: Seen, b: Seen) -> float:
    step = float(np.log(b.frequency / a.frequency))
    alike = assurance(a.shape, b.shape)
    if abs(step) > MAX_REFERENCE_DISTANCE or alike < MIN_ASSURANCE:
        return float("inf")
    return (step / MAX_REFERENCE_DISTANCE) ** 2 + (0.0 if np.isnan(alike) else (1.0 - alike) / (1.0 - MIN_ASSURANCE))
