"""Segments in which a channel falls silent at once while others go on: a loose plug, no power, a logger that fills in.

A segment within the record counts if a channel's power over each of its own periods is far below the usual one, for
several periods in a row, if another channel vibrates meanwhile, and if at one end the errors of a linear prediction
from the previous readings are larger than by chance: one error by χ² with one degree of freedom, or their sum over the
order of the prediction. Vibration fades and comes back as it was predicted, in beats of two close modes, too.
"""

import math
from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, OUTLIER_SIGMAS
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults.continuity import PREDICTOR_READINGS, normalised_errors, prediction_errors
from windsysid.inspection.faults.runs import runs_of
from windsysid.inspection.limits import MAX_SILENT_RMS_RATIO, MIN_SILENT_PERIODS
from windsysid.records.record import Record

__all__ = ["silent_stretches"]

MIN_WINDOW_SAMPLES = 16
"""Setting: smallest number of samples of a window, which is one period long otherwise."""


def silent_stretches(record: Record, channels: Sequence[str]) -> list[Fault]:
    """Segments in which one of these channels, which vibrate, has only noise."""
    found = []
    for channel in channels:
        others = [other for other in channels if other != channel]
        runs = [run for run in _silent(record[channel]) if any(_goes_on(record[other], run) for other in others)]
        runs = _abrupt(record[channel], runs)
        if not runs:
            continue
        spans = np.array([[record.time[first], record.time[end - 1]] for first, end in runs])
        count = sum(end - first for first, end in runs)
        longest = float(np.diff(spans, axis=1).max()) + 1.0 / record.rate
        data = {"longest": longest, "share": count / record.samples}
        found.append(Fault(channel, "silent", "warning", count, spans, data))
    return found


def _silent(x: Array) -> list[tuple[int, int]]:
    """First and one-past-last sample of each stretch in which a channel falls silent for some periods."""
    seen = np.isfinite(x)
    centred = np.where(seen, x - (np.median(x[seen]) if seen.any() else 0.0), 0.0)
    size, steps = float(np.linalg.norm(centred)), float(np.linalg.norm(np.diff(centred[seen])))
    width = max(MIN_WINDOW_SAMPLES, round(2.0 * math.pi * size / steps) if steps else len(x))
    count = len(x) // width
    if count < 2 * MIN_SILENT_PERIODS:
        return []
    windows, known = (array[: count * width].reshape(count, width) for array in (centred, seen))
    samples = known.sum(axis=1)
    told = samples >= width // 2
    if not told.any():
        return []
    mean, square = windows.sum(axis=1) / np.maximum(samples, 1), (windows**2).sum(axis=1) / np.maximum(samples, 1)
    rms = np.sqrt(np.maximum(square - mean**2, 0.0))
    usual = float(np.median(rms[told]))
    runs = runs_of((rms < MAX_SILENT_RMS_RATIO * usual) & told)
    long = runs[:, 1] - runs[:, 0] >= MIN_SILENT_PERIODS
    silent = (width * runs[long & (runs[:, 0] > 1) & (runs[:, 1] < count - 1)]).tolist()
    # what repeats one value is frozen
    return [_widened(x, *run) for run in silent if np.nanmax(x[slice(*run)]) > np.nanmin(x[slice(*run)])]


def _widened(x: Array, first: int, end: int) -> tuple[int, int]:
    """Segment extended to the last sample on either side that is as small."""
    middle, size = float(np.nanmean(x[first:end])), OUTLIER_SIGMAS * float(np.nanstd(x[first:end]))
    while first > 0 and abs(x[first - 1] - middle) < size:
        first -= 1
    while end < len(x) and abs(x[end] - middle) < size:
        end += 1
    return first, end


def _abrupt(x: Array, runs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Select the segments at one end of which the prediction from the previous readings fails."""
    from scipy.special import chdtri

    if not runs:
        return []
    seen = np.isfinite(x)
    place = np.arange(len(x))
    power = normalised_errors(prediction_errors(np.interp(place, place[seen], x[seen]))) ** 2
    one, several = (chdtri(count, FALSE_ALARM_PROBABILITY) for count in (1, PREDICTOR_READINGS + 2))

    def breaks(at: int) -> bool:
        around = power[max(at - 2, 0) : at + PREDICTOR_READINGS]
        return bool(around.max() > one or around.sum() > several)

    return [run for run in runs if breaks(run[0]) or breaks(run[1])]


def _goes_on(x: Array, run: tuple[int, int]) -> bool:
    """Test whether a channel vibrates in a segment as in the rest."""
    stretch = x[slice(*run)]
    inside, usual = stretch[np.isfinite(stretch)], float(np.nanstd(x))
    return len(inside) > 0 and float(np.std(inside)) > MAX_SILENT_RMS_RATIO * usual > 0.0
