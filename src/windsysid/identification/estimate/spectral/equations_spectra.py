"""Spectral estimate of one's own equations from a stationary record.

The equations are linearised about a working point (`windsysid.spectral.lti.system`), the record becomes sums of
cross-spectra over blocks (`windsysid.spectral.transforms.cross_spectra`), and the mode of the posterior is found by
scoring (`windsysid.spectral.lti.fit`). A whole record is one block. Segments are cut into blocks as long as the first
of them, so that the memory does not grow; what is left at a segment's end is not used.
"""

import time
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError, WindsysidError
from windsysid.identification.condition.segments import SegmentReader
from windsysid.identification.condition.spectral_readings import read_bridged
from windsysid.identification.estimate.equations_time import EquationsEstimate
from windsysid.identification.model.equations_problem import EquationsJob, constant_loads, known_columns
from windsysid.identification.model.fit import no_innovations
from windsysid.inspection.limits import MIN_SAMPLES
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.records.record import LOW_PASS, Record
from windsysid.results.finding import Finding
from windsysid.spectral.lti.check import doubts_of, frequency_ranges
from windsysid.spectral.lti.fit import fit_linear
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.rotor.load_filters import load_shapes
from windsysid.spectral.transforms.block_sums import BlockSums, cut_blocks
from windsysid.spectral.transforms.cross_spectra import CrossSpectra, FixedBlock, transform_block

__all__ = ["fit_by_spectra"]

NYQUIST_SHARE = 0.8
"""Setting: share of half the sampling rate: no frequency above it is used."""

FREQUENCY_RANGE_FACTOR = 2.0
"""Setting: spectra are read from the lowest natural frequency that the priors allow, over this, to the highest, times
this: none beyond informs on the structure, and the shape of a load has to hold over a narrower range."""

MIN_INPUT_VARIATION = 1e-6
"""Numerical: standard deviation of an input, over its size, from which it is no working point."""


def fit_by_spectra(job: EquationsJob, segments: SegmentReader) -> EquationsEstimate:
    """Identify parameters from spectra; `mean` of the job is where the working point is looked for.

    Raises
    ------
    RecordError, ConfigurationError, WindsysidError
        If the record has gaps, an input varies, a load turns, or no spectrum of the model is positive.
    """
    started = time.perf_counter()
    taken = _take(job, segments)
    try:
        found = fit_linear(taken.model, taken.sums)
        doubts = doubts_of(taken.model, taken.sums, found, job.readings, taken.energies)
    except np.linalg.LinAlgError:
        raise WindsysidError(
            "no spectrum of this model is positive: expected a stable system, and loads, noise and priors of the size "
            "of the record's"
        ) from None
    block, total = taken.sums.last, taken.sums.blocks
    data = {
        "blocks": total, "duration": block.samples / block.rate, "low": block.frequency[0], "high": block.frequency[-1],
    }  # fmt: skip
    return EquationsEstimate(
        method="posterior mode, spectral likelihood",
        name=taken.model.compiled.name,
        elapsed=time.perf_counter() - started,
        unknowns=found.unknowns,
        cov=found.cov,
        log_likelihood=found.log_likelihood,
        info=no_innovations(len(job.sensors), found.log_likelihood),
        states=(),
        time=segments.last.time[-1:],
        history=(found.unknowns[None], np.sqrt(np.diag(found.cov))[None]),
        loads=job.loads,
        notes=(*taken.notes, Finding("blocks_read", "note", data)),
        doubts=tuple(doubts),
    )


class _TakenSpectra(NamedTuple):
    """The model of the spectra, their sums, mean squares of parts of the record (n, R, m), and notes."""

    model: LinearModel
    sums: CrossSpectra
    energies: Array
    notes: list[Finding]


def _take(job: EquationsJob, segments: SegmentReader) -> _TakenSpectra:
    """Pose the problem on the first segment, and add up the blocks of all of them."""
    notes: list[Finding] = []
    sums: CrossSpectra | None = None
    for part in segments:
        readings = read_bridged(part, job.readings, notes)
        if sums is None:
            model, length = _pose(job, part), len(readings)
            limits = _limits(model, part)
            ranges = frequency_ranges(limits)
        for place in cut_blocks(len(readings), length)[0]:
            block = transform_block(readings[place], part.rate, limits, ranges)
            sums = _begun(block) if sums is None else sums.plus(block)
    assert sums is not None  # a reader has a segment
    energies = sums.energies
    if segments.whole:  # one block is compared with itself
        halves = readings[: length // 2], readings[length // 2 : 2 * (length // 2)]
        energies = np.array([transform_block(half, part.rate, limits, ranges).energies for half in halves])
    return _TakenSpectra(model._replace(blur=sums.last.rate / length), sums, energies, notes)


def _begun(block: FixedBlock) -> CrossSpectra:
    """The sums over the first block; RecordError where it has too few bins."""
    if len(block.data) < MIN_SAMPLES:
        seconds = block.samples / block.rate
        raise RecordError(
            f"expected {seconds * MIN_SAMPLES / max(len(block.data), 1):.3g} s or more for spectra, got {seconds:.3g} "
            f"s: choose a longer record"
        )
    return BlockSums.of(block)


def _pose(job: EquationsJob, part: Record) -> LinearModel:
    """The spectrum as a function of the unknowns, at the inputs of a record."""
    compiled = compile_model(job.model, job.sensors)
    values = _all_values(job, compiled)
    inputs, at, start = _working_point(job, compiled, part)
    noise = 2.0 * np.array([sensor.noise for sensor in job.sensors]) ** 2 / part.rate
    drift = 2.0 * (np.array([sensor.drift for sensor in job.sensors]) / (2.0 * np.pi)) ** 2
    return LinearModel(
        compiled, values, inputs, at, start, job.parameters, noise, drift, load_shapes(job.loads, compiled.loads),
        job.levels,
    )  # fmt: skip


def _all_values(job: EquationsJob, compiled: CompiledModel) -> Array:
    """All parameters (n_p,), those that are identified at the centres of their priors."""
    values = job.centres
    missing = [name for name in compiled.parameters if name not in values]
    if missing:
        raise ConfigurationError(f"parameters without a value: expected it in `values` for {', '.join(missing)}")
    unknown = [q.name for q in job.parameters if q.name not in compiled.parameters]
    if unknown:
        raise ConfigurationError(f"parameters: expected some of {', '.join(compiled.parameters)}; got {unknown[0]}")
    return np.array([values[name] for name in compiled.parameters])


def _working_point(job: EquationsJob, compiled: CompiledModel, part: Record) -> tuple[Array, Array, Array]:
    """Constant inputs (n_u,) and loads (n_w,), and where the state at rest is looked for (n,)."""
    columns = known_columns(compiled, part, job, constant_loads(compiled.loads, part, job))
    size = np.abs(columns).max(axis=0, initial=0.0)
    varying = np.flatnonzero(columns.std(axis=0) > MIN_INPUT_VARIATION * size)
    if len(varying):
        name = (*compiled.inputs, *compiled.loads)[varying[0]]
        raise ConfigurationError(f"'{name}' varies: expected constant inputs for spectra; use formulation='joint'")
    if not job.loads:
        raise ConfigurationError("loads: expected models of what drives the structure for spectra, got none")
    start = np.zeros(len(compiled.states)) if job.mean is None else np.array(job.mean, dtype=np.float64)
    if start.shape != (len(compiled.states),):
        raise ConfigurationError(f"mean: expected {len(compiled.states)} states, got shape {start.shape}")
    inputs, loads = np.split(columns.mean(axis=0), [len(compiled.inputs)])
    return np.ascontiguousarray(inputs), np.ascontiguousarray(loads), start


def _limits(posed: LinearModel, part: Record) -> tuple[float, float]:
    """Between which frequencies spectra are read [Hz]."""
    most = min(0.5 * part.rate, float(part.attributes.get(LOW_PASS, np.inf))) * NYQUIST_SHARE
    mean, std = posed.prior
    found = []
    for at in (mean + std, mean, mean - std):
        try:
            found.append(posed.natural_frequencies(at[None])[0])
        except ConfigurationError:
            continue
    hz = np.exp(np.concatenate(found)) / (2.0 * np.pi) if found else np.empty(0)
    if not len(hz):
        return 0.0, most
    creeps = len(posed.compiled.states) > 2 * len(found[-1])  # what does not oscillate says something down to 0
    return 0.0 if creeps else float(hz.min()) / FREQUENCY_RANGE_FACTOR, min(
        most, FREQUENCY_RANGE_FACTOR * float(hz.max())
    )
