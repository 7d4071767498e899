"""Stretches in which a channel falls silent at once while others go on: a loose plug, no power, a logger that fills in.

Vibration fades and comes back; an instrument is gone from one sample to the next. So a stretch counts where a channel's
power over each of its own periods is far below the usual, for several periods in a row, where it is back within a
few periods on either side, and where another channel vibrates meanwhile. Beats of two close modes pass through zero as
fast, but there a linear prediction from the previous readings is as accurate as in the rest.
"""

import math
from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults.continuity import PREDICTOR_READINGS, normalised_errors, prediction_errors
from windsysid.inspection.faults.runs import runs_of
from windsysid.inspection.limits import (
    MAX_QUIET_POWER,
    MAX_SILENT_RMS_RATIO,
    MIN_ABRUPT_POWER,
    MIN_ABRUPT_SIGMAS,
    MIN_OTHER_RMS_RATIO,
    MIN_QUIET_SAMPLES,
    MIN_RETURN_RMS_RATIO,
    MIN_SILENT_PERIODS,
    SILENT_SIGMAS,
)
from windsysid.records.record import Record

__all__ = ["silent_stretches"]

NEIGHBOUR_WINDOWS = 4
"""Setting: number of windows next to a silent segment within which vibration is back."""

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
    runs = runs_of((rms < MAX_SILENT_RMS_RATIO * usual) & told).tolist()
    silent = [(first * width, end * width) for first, end in runs if _is_silent(rms, usual, first, end)]
    # what repeats one value is frozen
    return [_widened(x, *run) for run in silent if np.nanmax(x[slice(*run)]) > np.nanmin(x[slice(*run)])]


def _is_silent(rms: Array, usual: float, first: int, end: int) -> bool:
    """Test whether a run of quiet windows is long enough, and vibration is back before and after it."""
    before = rms[max(first - NEIGHBOUR_WINDOWS, 0) : max(first - 1, 0)]
    after = rms[end + 1 : end + NEIGHBOUR_WINDOWS]
    return end - first >= MIN_SILENT_PERIODS and _is_back(before, usual) and _is_back(after, usual)


def _is_back(rms: Array, usual: float) -> bool:
    """Test whether a channel vibrates as usual in a window next to a segment, the nearest left out: it may be
    half silent."""
    return len(rms) > 0 and float(rms.max()) > MIN_RETURN_RMS_RATIO * usual


def _widened(x: Array, first: int, end: int) -> tuple[int, int]:
    """Segment extended to the last sample on either side that is as small."""
    middle, size = float(np.nanmean(x[first:end])), SILENT_SIGMAS * float(np.nanstd(x[first:end]))
    while first > 0 and abs(x[first - 1] - middle) < size:
        first -= 1
    while end < len(x) and abs(x[end] - middle) < size:
        end += 1
    return first, end


def _abrupt(x: Array, runs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Select the segments that vibration does not explain.

    At one end the prediction from the previous readings fails, or within the segment prediction errors are far smaller
    than usual, as without any load.
    """
    if not runs:
        return []
    seen = np.isfinite(x)
    place = np.arange(len(x))
    raw = prediction_errors(np.interp(place, place[seen], x[seen]))
    errors, usual = normalised_errors(raw), float(np.median(np.abs(raw))) / 0.6745

    def breaks(at: int) -> bool:
        around = errors[max(at - 2, 0) : at + PREDICTOR_READINGS]
        large = np.abs(around) > MIN_ABRUPT_SIGMAS
        return bool(large.any()) or float(np.mean(around**2)) > MIN_ABRUPT_POWER

    def quiet(first: int, end: int) -> bool:
        inside = raw[first + PREDICTOR_READINGS : end]
        return len(inside) >= MIN_QUIET_SAMPLES and float(np.mean(inside**2)) < MAX_QUIET_POWER * usual**2

    return [run for run in runs if breaks(run[0]) or breaks(run[1]) or quiet(*run)]


def _goes_on(x: Array, run: tuple[int, int]) -> bool:
    """Test whether a channel vibrates in a segment as in the rest."""
    stretch = x[slice(*run)]
    inside, usual = stretch[np.isfinite(stretch)], float(np.nanstd(x))
    return len(inside) > 0 and float(np.std(inside)) > MIN_OTHER_RMS_RATIO * usual > 0.0
