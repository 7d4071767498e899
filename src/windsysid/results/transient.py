"""Transients: detection of vibration that decreases over a record, as in a free decay, and of bursts.

Tests of residuals assume stationary loads. In a free decay they fail for other reasons than those they test for: the
level decreases, the only frequency resembles a sinusoid, and most of the squared residuals are at the beginning. So if
the vibration decreases, a result that is in doubt gives this as the reason.

From the segment with the largest power on, the mean squares of consecutive quarters of the rest are compared. Of 1500
stationary records of a mode with 3 to 16 equivalent degrees of freedom, the rms decreases by a factor of `MIN_RMS_FALL`
in at most one of 160, and of its root in one of 20: the root counts only if all channels exceed it.

A burst is a segment that holds most of the power of a record: a blow, a pull, a start. Cochran's C is the largest of N
variances over their sum. For N segments with ν equivalent degrees of freedom each, P(C > c) ≤ N P(B > c), where B has
the beta distribution of ν/2 and (N − 1) ν/2 (Cochran 1941, Annals of Eugenics 11, 47–52). A random vibration of
spectrum S has ν = 2 B_e T with B_e = (∫S df)² / ∫S² df (Bendat & Piersol, Random Data, section 8.3), which is small
where a mode is lightly damped: there nothing is certain.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, MIN_RMS_FALL
from windsysid.checks.verdict import Diagnosis
from windsysid.results.finding import Finding
from windsysid.results.sentences import names_cause

__all__ = ["Burst", "Transient", "explain_by_transient", "find_burst", "find_transient"]

SEGMENTS, QUARTERS = 16, 4
"""Setting: number of segments of the record, and of parts into which the rest from the strongest segment on is
divided."""


class Transient(NamedTuple):
    """Channels whose vibration decreases, and ratio of rms values of the first one."""

    channels: tuple[str, ...]
    fall: float

    @property
    def finding(self) -> Finding:
        """The reason why checks of a result fail."""
        return Finding("transient", "reason", {"channels": self.channels, "ratio": self.fall})


class Burst(NamedTuple):
    """The segment that holds most of the power of a channel, and that share.

    Attributes
    ----------
    channel
        With the least probable share.
    segment
        Number of the segment, from 0 to `SEGMENTS` − 1.
    share
        Of the channel's power.
    duration
        Of the record [s].
    """

    channel: str
    segment: int
    share: float
    duration: float

    @property
    def data(self) -> dict[str, Any]:
        """Channel, share, start and end [s], for a finding."""
        start, end = (self.duration * edge / SEGMENTS for edge in (self.segment, self.segment + 1))
        return {"channel": self.channel, "share": self.share, "start": start, "end": end}


def find_burst(values: Array, channels: Sequence[str], rate: float) -> Burst | None:
    """Find the least probable burst in readings (T, m) at `rate` [Hz]; None if chance explains every channel."""
    found = [(*_largest_share(column), name) for name, column in zip(channels, values.T, strict=True)]
    least = MIN_RMS_FALL**2 / (MIN_RMS_FALL**2 + SEGMENTS - 1)
    bursts = [one for one in found if one[2] >= least and one[0] * len(found) <= FALSE_ALARM_PROBABILITY]
    if not bursts:
        return None
    _, segment, share, name = min(bursts)
    return Burst(name, segment, share, len(values) / rate)


def _largest_share(readings: Array) -> tuple[float, int, float]:
    """Probability of Cochran's C of readings (T,), the segment of the largest variance, and C."""
    from scipy.special import betaincc

    known = _detrended(readings[np.isfinite(readings)])
    power = np.abs(np.fft.rfft(known)) ** 2
    if len(known) < 2 * SEGMENTS or not power.sum() > 0.0:
        return 1.0, 0, 0.0
    freedom = 4.0 * power.sum() ** 2 / np.sum(power**2) / SEGMENTS  # exponential ordinates: twice the mean's square
    variances = _mean_squares(known, SEGMENTS)
    largest = int(np.argmax(variances))
    share = float(variances[largest] / variances.sum())
    chance = SEGMENTS * betaincc(0.5 * freedom, 0.5 * (SEGMENTS - 1) * freedom, share)
    return float(chance), largest, share


def find_transient(values: Array, channels: Sequence[str]) -> Transient | None:
    """Find the channels of readings (T, m) whose vibration decreases; None if there are none."""
    falls = {name: _fall(column) for name, column in zip(channels, values.T, strict=True)}
    common = len(falls) > 1 and min(falls.values()) ** 2 >= MIN_RMS_FALL
    least = MIN_RMS_FALL**0.5 if common else MIN_RMS_FALL
    falling = sorted((name for name in falls if falls[name] >= least), key=lambda name: -falls[name])
    return Transient(tuple(falling), falls[falling[0]]) if falling else None


def explain_by_transient(diagnosis: Diagnosis, found: Transient, readings: Sequence[str]) -> Diagnosis:
    """Replace the reasons of tests that assume stationary loads by the transient, and leave out the causes that their
    remarks and notes name.

    A reason that concerns one of the `readings` that do not decrease is kept.
    """
    steady = set(readings).difference(found.channels)
    left = [
        one
        for one in diagnosis.findings
        if one.severity != "reason" or not names_cause(one.code) or steady.intersection(one.channels)
    ]
    explained = [found.finding] if len(left) < len(diagnosis.findings) else []
    return replace(
        diagnosis,
        findings=(*explained, *(one if one.severity == "reason" else one.caused_by("transient") for one in left)),
    )


def _fall(readings: Array) -> float:
    """Ratio by which the rms of readings (T,) about a straight line decreases after their strongest segment.

    It is 0 if the rms does not decrease throughout.
    """
    known = readings[np.isfinite(readings)]
    if len(known) < 2 * SEGMENTS:
        return 0.0
    known = _detrended(known)
    power = _mean_squares(known, SEGMENTS)
    loudest = int(np.argmax(power))
    earlier = power[: max(loudest - 1, 0)].max(initial=0.0)
    if loudest > SEGMENTS // 2 or not MIN_RMS_FALL * earlier <= power[loudest]:
        return 0.0
    rest = _mean_squares(known[len(known) * loudest // SEGMENTS :], QUARTERS)
    rises = rest[1:] > rest[:-1]
    if (rises & (rest[1:] > rest[0] / MIN_RMS_FALL**2)).any():  # below that is noise
        return 0.0
    return float(np.sqrt(rest[0] / max(rest[-1], 1e-300)))


def _detrended(readings: Array) -> Array:
    """Readings (T,) about a straight line."""
    if len(readings) < 2:
        return readings
    time = np.linspace(-1.0, 1.0, len(readings))
    centred = readings - readings.mean()
    return np.asarray(centred - time * (time @ centred) / (time @ time))


def _mean_squares(values: Array, parts: int) -> Array:
    return np.array([np.mean(np.square(part)) for part in np.array_split(values, parts)])
