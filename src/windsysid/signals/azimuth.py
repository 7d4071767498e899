"""Azimuths as encoders and loggers give them: with glitches, with scatter, and in coarse steps.

A rotor is heavy and turns smoothly. What it cannot have done is taken for the instrument's.
"""

import math

import numpy as np

from windsysid._types import Array
from windsysid.records.kept import kept_with_record
from windsysid.records.record import Record
from windsysid.signals.band import bridged
from windsysid.signals.textbook import local_parabolas

__all__ = ["MAX_SCATTER_RADIANS", "steadied"]

MAX_SCATTER_RADIANS = 2e-3
"""Scatter of azimuths [rad] beyond which they are smoothed: 0.1°, with which gravity on a blade reads 0.02 m/s²."""

MIN_AZIMUTHS = 50
"""Fewer azimuths than this are left as they are."""

MIN_SAMPLES, MAX_SECONDS = 5, 40.0
"""Samples over which azimuths are smoothed, at least, and seconds, at most."""

MAX_CORRELATION = 0.5
"""Greatest autocorrelation, over ten lags, of what scatters: beyond it, the rotor may have turned like that."""

GLITCH_SAMPLES = 11
"""Samples whose median a glitch stands out of."""

MIN_GLITCH_RADIANS = 0.1
"""Least error of a glitch [rad], and ten times that of others; more than a tenth of azimuths are none."""

MAX_DISTINCT_SHARE, MIN_SMOOTHED_STEPS = 0.25, 4.0
"""Distinct azimuths of a coarse encoder, as a share of all, and how many of its steps it is smoothed over at least."""


@kept_with_record
def steadied(record: Record) -> Record:
    """The record with azimuths put onto a smooth rotation: those that stand alone, all that scatter beyond
    `MAX_SCATTER_RADIANS`, and those of a coarse encoder; other records as they are.

    The rotation is known from neighbours: local parabolas (Savitzky & Golay 1964) with the recorded speed, or the
    median one, over the length that predicts each azimuth best from the others (leave-one-out). A rotor that did turn
    like that leaves residuals that are correlated, and is left alone.
    """
    if "rotor_azimuth" not in record or record.unit("rotor_azimuth") != "rad":
        return record
    azimuth = record["rotor_azimuth"]
    known = np.isfinite(azimuth)
    if known.sum() < MIN_AZIMUTHS:
        return record
    time = record.time - record.time[0]
    steps = np.mod(np.diff(azimuth[known]) + np.pi, 2.0 * np.pi) - np.pi
    if "rotor_speed" in record and np.isfinite(record["rotor_speed"]).any():
        speed = bridged(record["rotor_speed"], "rotor_speed")
        turned = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    else:
        turned = float(np.median(steps / np.diff(time[known]))) * time
    read = np.interp(time, time[known], np.unwrap((azimuth - turned)[known]))
    offset = _without_glitches(read)
    levels = np.unique(np.round(azimuth[known], 9))
    shortest = float(MIN_SAMPLES)
    coarse = len(levels) < MAX_DISTINCT_SHARE * known.sum()
    if coarse and len(levels) > 1:
        shortest = max(
            shortest, MIN_SMOOTHED_STEPS * float(np.median(np.diff(levels))) / max(abs(float(np.mean(steps))), 1e-9)
        )
    smooth = _without_scatter(offset, record.rate, shortest, coarse=coarse)
    if smooth is read:
        return record
    psi = np.where(known, np.mod(turned + smooth, 2.0 * np.pi), np.nan)
    return record.with_channels({"rotor_azimuth": (psi, "rad")})


def _without_glitches(psi: Array) -> Array:
    """Angles (T,) [rad] with those that stand out of their neighbours' median put on it; the same array if none do."""
    from scipy.ndimage import median_filter

    near = np.asarray(median_filter(psi, GLITCH_SAMPLES, mode="nearest"), dtype=np.float64)
    off = np.abs(psi - near)
    glitch = off > max(MIN_GLITCH_RADIANS, 10.0 * float(np.median(off)))
    return np.where(glitch, near, psi) if 0.0 < np.mean(glitch) < 0.1 else psi


def _without_scatter(psi: Array, rate: float, shortest: float, *, coarse: bool) -> Array:
    """Angles (T,) [rad] smoothed over `shortest` samples at least; the same array where they do not scatter, or, unless
    they are `coarse`, where what scatters is correlated."""
    smooth, scatter, predicted = psi, np.zeros(1), math.inf
    window = 2 * math.ceil(0.5 * min(shortest, len(psi))) + 1 if shortest > MIN_SAMPLES else MIN_SAMPLES
    while window <= min(max(MAX_SECONDS * rate, shortest), len(psi) / 4):
        fit = local_parabolas(psi, window)
        own = 0.75 * (3 * window**2 - 7) / (window * (window**2 - 4))  # weight of an angle in its own fit
        left = (psi - fit)[window // 2 : -(window // 2)]
        error = float(np.mean(np.square(left))) / (1.0 - own)  # the variance of white scatter
        if error < MAX_SCATTER_RADIANS**2:
            break
        if error / (1.0 - own) < predicted:
            smooth, scatter, predicted = fit, left, error / (1.0 - own)
        window = 2 * window + 1
    power = float(scatter @ scatter)
    lags = [abs(float(scatter[lag:] @ scatter[:-lag])) for lag in range(1, min(11, scatter.size))]
    return psi if not coarse and max(lags, default=0.0) > MAX_CORRELATION * power else smooth
