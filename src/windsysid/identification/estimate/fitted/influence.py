"""Influence of one frequency on a result.

A machine's line near a mode may become the mode's peak, and the mode its skirt: it stands out less then, or by no
more than chance may. So the frequency that stands out most of the support's readings is taken out where it might be a
line, and spectra are fitted again. A coefficient of a structure under random loads depends little on one frequency, and
that of a line's mode altogether; that of a mode of a few frequencies' width depends on each, and is not asked.
"""

import hashlib
import math
from collections.abc import Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from windsysid._types import Array
from windsysid.checks.lines import SURROUNDING_BINS, Line, find_line, stand_out_of_a_bend
from windsysid.checks.widening import SIGMAS
from windsysid.errors import WindsysidError
from windsysid.identification.estimate.fitted.modal_residuals import channel_of, mode_of, ranges_of_narrow_band
from windsysid.identification.estimate.spectral.frequency_domain import identify_by_spectrum
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.limits import MIN_LINE_POWER
from windsysid.identification.model.agreement import compare, shifts_to
from windsysid.identification.model.fit import Outcome
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.rotor_wind import RotorWind
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.spectral.transforms.harmonics import without_line
from windsysid.turbine.turbine import Turbine

__all__ = ["Dependence", "doubt_line", "doubt_sine", "doubt_standing_out"]

SEARCH_RADIUS_FACTOR = 1.25
"""Setting: factor about a mode's frequency within which a line is looked for."""

NEAR_BINS, FAR_BINS = 3, 8
"""Setting: frequencies of the periodogram to either side of a sinusoid in which a narrow-band load would have left
something, and beyond which their surroundings tell what would be there without one."""


class Dependence(NamedTuple):
    """On which frequency [Hz] of which channel a coefficient depends, and that as a doubt."""

    channel: str
    frequency: float
    doubt: Finding


def doubt_line(job: Job, fit: FittedJob) -> Dependence | None:
    """Test whether a coefficient of a fit depends on one frequency; None if spectra do not apply, and for bands around
    the modes of a real rotor, which have other tests."""
    line = _suspect(fit.outcome, fit.read)
    if line is None or line.ratio < MIN_LINE_POWER:
        return None
    found = _influence(job, fit, line.frequency)
    if found is None or found.sigmas < SIGMAS:
        return None
    return Dependence(line.channel, line.frequency, found.doubt("line_influence", line.frequency))


def doubt_standing_out(line: Line, job: Job, fit: FittedJob, rotor_hz: float) -> tuple[Finding, ...] | None:
    """Reason against a fit that follows from a line which stands out by more than chance: the shift without it; None if
    that is not known."""
    found = _influence(job, fit, line.frequency)
    if found is None:
        return None
    if found.sigmas >= SIGMAS:
        return (found.doubt("line_influence", line.frequency),)
    data = {"channel": line.channel, "frequency": line.frequency, "rotor_frequency": rotor_hz}
    return (Finding("spectral_line", "reason", {**data, "shifts": found.shifts, "chance": 1.0}),)


def doubt_sine(frequency: float, job: Job, fit: FittedJob) -> tuple[Finding, ...]:
    """Reason not to trust a fit if the power that is left around a removed sinusoid at a frequency [Hz] still changes a
    coefficient: a narrow-band load would."""
    found = _influence(job, fit, frequency, NEAR_BINS)
    if found is None or found.sigmas < SIGMAS:
        return ()
    return (found.doubt("tone_influence", frequency),)


class _Influence(NamedTuple):
    """The coefficient that changes most without a frequency, by how many standard deviations, and shifts of all in
    filter coordinates."""

    name: str
    sigmas: float
    shifts: dict[str, float]

    def doubt(self, code: str, frequency: float) -> Finding:
        """The influence as a reason."""
        data = {"frequency": frequency, "sigmas": self.sigmas, "shifts": self.shifts, "chance": 1.0}
        return Finding(code, "reason", data, (self.name,))


_KNOWN: WeakKeyDictionary[Record, list[tuple[Turbine, tuple[Any, ...], _Influence | None]]] = WeakKeyDictionary()
"""Influences on fits of one turbine to a record: filters and spectra that read the same have the same."""


def _influence(job: Job, fit: FittedJob, frequency: float, neighbours: int = 0) -> _Influence | None:
    """Influence of a frequency [Hz] and its neighbours in the periodogram; None if spectra do not apply. Load models
    that only filters have are replaced by broad loads."""
    read, name = fit.read, fit.outcome.hypothesis
    loads = name if name in (RotorWind.name, NarrowBand.name) else "broadband"
    digest = hashlib.sha256(read.values.tobytes()).digest()
    key = digest, read.rate, read.channels, frequency, neighbours, loads, fit.prior, fit.sensors, job.parameters
    known = _KNOWN.setdefault(job.record, [])
    for turbine, known_key, influence in known:
        if turbine is job.turbine and known_key == key:
            return influence
    found = _compute_influence(job, fit, frequency, neighbours, loads)
    if known and known[0][0] is not job.turbine:
        known.clear()
    known.append((job.turbine, key, found))
    return found


def _compute_influence(job: Job, fit: FittedJob, frequency: float, neighbours: int, loads: str) -> _Influence | None:
    """The influence, by fits of spectra under a load model; None where they fail or a shift is not finite."""

    def estimated(record: Record) -> Outcome:
        return identify_by_spectrum(record, job.turbine, fit.sensors, fit.prior, job.parameters, loads=loads)

    without = _without(fit.read, fit.outcome.channels, frequency, neighbours)
    try:
        left = estimated(without)
        whole = fit.outcome if fit.formulation == "spectral" else estimated(fit.read)
    except (WindsysidError, np.linalg.LinAlgError):
        return None
    shifts = shifts_to(left, whole)
    return _Influence(*compare(left, whole), shifts) if len(shifts) == len(whole.theta) else None


def _suspect(outcome: Outcome, record: Record) -> Line | None:
    """The line that stands out most near the frequencies of a support, whose modes are not narrower than the file's."""
    if not record.is_uniform:
        return None
    values = {q.name: float(q.physical(t)) for q, t in zip(outcome.model.parameters, outcome.theta, strict=True)}
    both = outcome.turbine.with_values(values), outcome.turbine
    channels = _channels_of_supports(outcome, record, both)
    if not channels:
        return None
    read = tuple(dict.fromkeys(channels.values()))
    turned = [i for i, name in enumerate(outcome.model.compiled.inputs) if name == "rotor_speed"]
    speed = float(outcome.rotor[:, turned[0]].mean()) if turned else outcome.turbine.rotor_speed
    rotor_hz = abs(speed) / (2.0 * math.pi)
    modes = [(mode_of(both[0], name)[0], max(mode_of(one, name)[1] for one in both)) for name in channels]
    return find_line(
        np.column_stack([record[channel] for channel in read]), read, rate=record.rate,
        modes=modes, rotor_hz=rotor_hz,
        reach=SEARCH_RADIUS_FACTOR, known=ranges_of_narrow_band(outcome, record, rotor_hz),
    )  # fmt: skip


def _channels_of_supports(outcome: Outcome, record: Record, turbines: Sequence[Turbine]) -> dict[str, str]:
    """The channel of each degree of freedom of the support that has one, and is a mode of all these turbines."""
    freedoms = [one.name for one in outcome.turbine.model.freedoms if not one.blade]
    supports = [name for name in freedoms if min(one.critical_damping(name) for one in turbines) > 0.0]
    found = {name: channel_of(outcome, record, name) for name in supports}
    return {name: channel for name, channel in found.items() if channel is not None}


def _without(record: Record, channels: Sequence[str], frequency: float, neighbours: int = 0) -> Record:
    """Record without a sinusoid in these channels, or with the power of its surroundings at the frequencies to either
    side."""
    values = np.column_stack([record[channel] for channel in channels])
    known = np.nan_to_num(values - np.nanmean(values, axis=0))
    if not neighbours:
        left = without_line(known, record.rate, frequency)
    else:
        near = frequency + np.arange(-neighbours, neighbours + 1) * record.rate / record.samples
        wave = np.exp(2j * np.pi * np.outer(np.arange(record.samples) / record.rate, near))
        design = np.column_stack([wave.real, wave.imag])
        there = design @ np.linalg.lstsq(design, known, rcond=None)[0]
        over = _standing_out(known, frequency * record.samples / record.rate, neighbours)
        left = known - there * (1.0 - np.maximum(over, 1.0) ** -0.5)
    left = values - (known - left)
    return record.with_channels(
        {channel: (column, record.unit(channel)) for channel, column in zip(channels, left.T, strict=True)}
    )


def _standing_out(values: Array, line: float, neighbours: int) -> Array:
    """Mean power of values (T, m) at a frequency of their periodogram, and at so many to either side, over that of
    their surroundings (m,); infinite where there are none."""
    power = np.abs(np.fft.rfft(np.hanning(len(values))[:, None] * values, axis=0)) ** 2
    at = round(line) + np.arange(-neighbours, neighbours + 1)
    if at[0] <= SURROUNDING_BINS or at[-1] >= len(power) - SURROUNDING_BINS:
        return np.full(values.shape[1], np.inf)
    return np.asarray(stand_out_of_a_bend(power, at, SURROUNDING_BINS, FAR_BINS).mean(axis=0))
