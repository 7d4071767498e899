"""Streaming run: one pass over the segments of a record that accumulates them, interruptible and resumable.

Common to all formulations are the checkpoint after each segment, the hash of all samples, the mean wind speed and the
result; what is kept of the samples is an accumulator's (`windsysid.identification.streaming.time_domain`,
`windsysid.identification.streaming.spectra`).
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from windsysid._types import Array
from windsysid._version import __version__
from windsysid.errors import RecordError
from windsysid.identification.condition.operating_state import in_state
from windsysid.identification.condition.readings import screened, usable_sensors
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming.checkpoint import Checkpoint
from windsysid.identification.verdict.conclude import WholeRecord, conclude
from windsysid.inspection.fault import Fault
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.results.provenance import RecordHash, record_hash, sensor_tables, trace, turbine_hash
from windsysid.turbine.turbine import Turbine

__all__ = ["Accumulator", "SegmentsEstimate", "StreamingJob", "run_segments"]

FIRST_SAMPLES = 1000
"""Setting: samples that are hashed to recognise another record at once."""


class StreamingJob(NamedTuple):
    """Job for the segments of a record, as for `windsysid.identify_pieces`; `sensors` are those
    that were requested, and from the first segment on those that are used."""

    turbine: Turbine
    sensors: Sequence[Sensor] | None
    prior: Prior
    parameters: Sequence[str] | None
    formulation: Literal["joint", "spectral"]
    rate: float | None
    loads: str
    memory: float | None
    checkpoint: Path | None
    keep_checkpoint: bool
    options: Mapping[str, Any]
    state: str = "auto"

    @property
    def own_options(self) -> dict[str, Any]:
        """The options that a result keeps, without those that were added."""
        listed = None if self.parameters is None else list(self.parameters)
        common = {"formulation": self.formulation, "prior": asdict(self.prior), "parameters": listed}
        only = {"rate": self.rate} if self.formulation == "joint" else {"memory": self.memory}
        return {**common, "loads": self.loads, "site": self.turbine.site, "state": self.state, **only}

    def call_on(self, first: Record) -> dict[str, Any]:
        """Options that must agree in a call that resumes: of added options, only how the file is read."""
        beginning = replace(first, time=first.time[:FIRST_SAMPLES], values=first.values[:FIRST_SAMPLES])
        return {
            "version": __version__, "turbine": turbine_hash(self.turbine),
            "sensors": sensor_tables(self.sensors or ()), **self.own_options, "mapping": self.options.get("mapping"),
            "length of pieces": first.on_uniform_grid().samples, "record": record_hash(beginning),
        }  # fmt: skip


class SegmentsEstimate(NamedTuple):
    """Result of a formulation, the last samples as they were read, their number, and the times of the history's
    estimates [s]."""

    outcome: Outcome
    read: Record
    samples: int
    history_time: Array


class Accumulator(Protocol):
    """State of the segments of a record; the sensors as they are used."""

    sensors: tuple[Sensor, ...]

    def replay(self, segment: Record, /) -> None:
        """Take a segment that a checkpoint knows."""

    def take(self, segment: Record, /) -> Record | None:
        """Take the next segment as it was recorded; the samples that were added, None where they are held back."""

    def restore(self, arrays: Mapping[str, Any], progress: Mapping[str, Any], /) -> None:
        """Restore from `stored`."""

    def stored(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Checkpoint without the segments: arrays, and plain values."""

    def finish(self) -> Record | None:
        """Take the samples that were held back."""

    def estimate(self) -> SegmentsEstimate:
        """Estimate from all segments; `elapsed` of the outcome is the time [s] that does not count."""


def run_segments(
    segments: Iterable[Record], job: StreamingJob, begin: Callable[[Record, StreamingJob], Accumulator],
    progress: Callable[[float], None] | None = None,
) -> Identification:  # fmt: skip
    """Accumulate segment by segment and estimate; a checkpoint that is not kept is deleted then.

    Raises
    ------
    RecordError, ConfigurationError
        If there is no segment, a segment does not hold what is needed, or the checkpoint belongs to another call.
    """
    started = time.perf_counter()
    run: _StreamingRun | None = None
    faults: list[Fault] = []
    for segment in segments:
        if run is None:
            used = usable_sensors(segment, job.turbine, job.sensors)
            faults += screened(segment, job.turbine, used)
            run = _StreamingRun(segment, job._replace(sensors=used), begin)
            run.take(segment)
        else:
            run.take(segment)
            faults += screened(segment, job.turbine, used, refuse=False)
        if progress:
            progress(float(segment.time[-1]))
    if run is None:
        raise RecordError("no pieces: expected at least one, got an empty record")
    result = run.conclude(started, faults)
    if job.checkpoint is not None and not job.keep_checkpoint:
        job.checkpoint.unlink(missing_ok=True)
    return result


class _StreamingRun:
    """The state of one pass over the segments."""

    def __init__(self, first: Record, job: StreamingJob, begin: Callable[[Record, StreamingJob], Accumulator]) -> None:
        self.first, self.job, self.hash, self.taken, self.wind = first, job, RecordHash(), 0, [0.0, 0.0]
        self.checkpoint = None if job.checkpoint is None else Checkpoint(job.checkpoint, job.call_on(first))
        self.known = (self.checkpoint.progress() if self.checkpoint else None) or {"samples": 0}
        machine, self.notes = in_state(job.turbine, first, job.state)
        self.accumulator = begin(first, job._replace(turbine=machine))

    def take(self, segment: Record) -> None:
        """Take the next segment as it was recorded."""
        self.hash.take(segment)
        before, self.taken = self.taken, self.taken + segment.samples
        if self.taken <= self.known["samples"]:
            self.accumulator.replay(segment)
            if self.taken == self.known["samples"]:
                self._resume()
            return
        self._require_same_record(before >= self.known["samples"])
        self._add_wind(self.accumulator.take(segment))
        if self.checkpoint:
            arrays, progress = self.accumulator.stored()
            common = {"samples": self.taken, "taken": str(self.hash), "wind": self.wind}
            self.checkpoint.write(arrays, common | progress)

    def _resume(self) -> None:
        """Restore the state after the segments so far."""
        self._require_same_record(str(self.hash) == self.known["taken"])
        if self.checkpoint:
            with self.checkpoint.opened() as arrays:
                self.accumulator.restore(arrays, self.known)
        self.wind = list(self.known["wind"])

    def _require_same_record(self, same: bool) -> None:
        if self.checkpoint and not same:
            raise self.checkpoint.of_another_call(["record"])

    def _add_wind(self, added: Record | None) -> None:
        if added is not None and "wind_speed" in added:
            wind = added["wind_speed"]
            self.wind[0] += float(np.nansum(wind))
            self.wind[1] += float(np.isfinite(wind).sum())

    def conclude(self, started: float, faults: Sequence[Fault]) -> Identification:
        """Estimate, and put the result into physical units."""
        self._require_same_record(self.taken >= self.known["samples"])
        self._add_wind(self.accumulator.finish())
        found, job = self.accumulator.estimate(), self.job
        options = {**job.own_options, **job.options}
        section = float(self.first.time[0]), float(found.read.time[-1])
        elapsed = time.perf_counter() - started - found.outcome.elapsed
        wind_speed = self.wind[0] / self.wind[1] if self.wind[1] else None
        return conclude(
            found.outcome._replace(elapsed=elapsed, notes=(*found.outcome.notes, *self.notes)), found.read,
            job.formulation,
            whole=WholeRecord(section, found.samples, found.history_time, wind_speed),
            provenance=trace(self.first, str(self.hash), job.turbine, self.accumulator.sensors, options),
            faults=faults,
        )  # fmt: skip
