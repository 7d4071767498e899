"""Records too long for memory, piece by piece: the joint formulation on line, interruptible and resumable.

Each piece goes through `windsysid.identification.recursive.advance`, whose memory does not grow; what it knows is written beside the output after every
piece. The same call on the same record goes on from there, and ends where an uninterrupted one would have ended, bit for bit. The checkpoint
says which call it belongs to, and the hash of all samples that were taken in: another call does not take it up. A record that has grown
since is the same record, if what was taken in is still there.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid._version import __version__
from windsysid.errors import RecordError
from windsysid.filters import EKF
from windsysid.identification.conclude import conclude
from windsysid.identification.joint import first_estimate
from windsysid.identification.outcome import Outcome, check_finite, known_inputs, known_loads
from windsysid.identification.prepare import screened, usable_sensors
from windsysid.identification.prior import Prior
from windsysid.identification.problem import Problem, pose
from windsysid.identification.recursive import (
    History,
    Online,
    advance,
    another_call,
    begin,
    check_call,
    finish,
    restore,
    save,
)
from windsysid.inspection.health import Finding
from windsysid.inspection.screening import noted
from windsysid.loads.statistics import learned_statistics
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.results.provenance import RecordHash, record_hash, sensor_tables, trace, turbine_hash
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["identify_pieces"]

Progress = Callable[[float], None]

_BEGINNING = 1000
"""Samples by which another record is told at once; that all others are the same is seen where the checkpoint is reached."""


def identify_pieces(
    pieces: Iterable[Record],
    turbine: TurbineLike,
    *,
    sensors: Sequence[Sensor] | None = None,
    prior: Prior | None = None,
    parameters: Sequence[str] | None = None,
    checkpoint: str | Path | None = None,
    keep_checkpoint: bool = False,
    progress: Progress | None = None,
    options: Mapping[str, Any] | None = None,
) -> Identification:
    """Identify stiffness and damping from a record that comes in pieces, in bounded memory.

    The estimate is the on-line one (docs/online.md): what `windsysid.identify` would find, but for a few per cent of a standard deviation.
    Innovations, and with them the diagnosis, are those of the last piece.

    Parameters
    ----------
    pieces
        Records in order, of one sampling rate: `windsysid.iterate_record` makes them of a file. Samples missing between two pieces are
        missing readings.
    turbine, sensors, prior, parameters
        As for `windsysid.identify`; sensors are chosen on the first piece.
    checkpoint
        Where to write what is known after each piece, and to go on from if it is there; it is deleted at the end.
    keep_checkpoint
        Leave it there: who saves the result deletes it then, and nothing is lost if the disk is full or the process is killed before.
    progress
        Called with the time [s] reached after each piece.
    options
        Plain values that tell more of the call: kept with the result, and with the checkpoint, which another call does not take up.

    Raises
    ------
    RecordError, ConfigurationError
        If a piece does not hold what is needed, an option is out of range, or the checkpoint belongs to another call.
    """
    started = time.perf_counter()
    checkpoint = None if checkpoint is None else Path(checkpoint)
    turbine = as_turbine(turbine)
    run: _Run | None = None
    faults: list[Finding] = []
    for piece in pieces:
        part = piece.on_uniform_grid()
        if run is None:
            found = usable_sensors(part, turbine, sensors)
            faults += screened(piece, turbine, found)
            run = _Run(piece, part, turbine, found, prior or Prior(), parameters, checkpoint, options or {})
            run.take(piece, part)
        else:
            run.take(piece, part)
            faults += screened(piece, turbine, found, refuse=False)
        if progress:
            progress(float(part.time[-1]))
    if run is None:
        raise RecordError("no pieces: expected at least one, got an empty record")
    result = run.conclude(time.perf_counter() - started)
    result = replace(result, notes=(*result.notes, *noted(faults)))
    if checkpoint is not None and not keep_checkpoint:
        checkpoint.unlink(missing_ok=True)
    return result


class _Run:
    """One pass over the pieces."""

    def __init__(
        self, piece: Record, first: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None,
        checkpoint: Path | None, options: Mapping[str, Any],
    ) -> None:  # fmt: skip
        listed = None if chosen is None else list(chosen)
        beginning = replace(piece, time=piece.time[:_BEGINNING], values=piece.values[:_BEGINNING])
        self.call = {
            "version": __version__,
            "turbine": turbine_hash(turbine),
            "sensors": sensor_tables(sensors),
            "prior": asdict(prior),
            "parameters": listed,
            "mapping": options.get("mapping"),
            "length of pieces": first.samples,
            "record": record_hash(beginning),
        }
        resumed = checkpoint is not None and checkpoint.exists()
        if checkpoint is not None and resumed:
            check_call(checkpoint, self.call)
        self.problem: Problem = pose(first, turbine, sensors, prior, chosen)
        self.rate, self.checkpoint = first.rate, checkpoint
        self.begun = float(first.time[0])
        self.known: int = 0  # samples that an earlier run had taken in
        self.taken: int = 0
        self.histories: list[History] = []
        self.last: tuple[Record, Array, Array] | None = None
        self.hash, self.expected = RecordHash(), ""
        self.given: tuple[Record, Turbine, Sequence[Sensor]] = piece, turbine, sensors
        self.options = {"formulation": "joint", "prior": asdict(prior), "parameters": listed, **options}
        columns = self.problem.inputs.shape[1], self.problem.readings.shape[1]
        self.online: Online = begin(*self.problem.prior, first_estimate(self.problem.turbine, self.rate), columns)
        if checkpoint is not None and resumed:
            self.online, earlier, self.expected = restore(self.problem.build, checkpoint)
            self.histories.append(earlier)
            self.known = self.online.reached

    def take(self, whole: Record, piece: Record) -> None:
        """The next piece as it was recorded and on a uniform grid, and the samples missing before it."""
        self.hash.take(whole)
        inputs, readings = self._arrays(piece)
        self.last = piece, inputs, readings
        self.taken += len(readings)
        if self.taken - len(readings) < self.known:
            if self.checkpoint is not None and (
                self.taken > self.known or (self.taken == self.known and str(self.hash) != self.expected)
            ):
                raise another_call(self.checkpoint, ["record"])
            return
        self.online, history = advance(self.problem.build, self.online, inputs, readings, self.problem.start)
        self.histories.append(history)
        if self.checkpoint is not None:
            save(self.online, _joined(self.histories), self.checkpoint, call=self.call, taken=str(self.hash))

    def _arrays(self, piece: Record) -> tuple[Array, Array]:
        """Inputs and readings, continued from the piece before."""
        if abs(piece.rate / self.rate - 1.0) > 0.01:
            raise RecordError(f"{piece.name}: expected pieces of {self.rate:.6g} Hz, got one of {piece.rate:.6g} Hz")
        sensors, turbine = self.problem.sensors, self.problem.turbine
        missing = [sensor.channel for sensor in sensors if sensor.channel not in piece]
        if missing:
            raise RecordError(
                f"{piece.name}: expected the channels of the first piece, got none of {', '.join(missing)}"
            )
        inputs = np.hstack([known_inputs(piece, turbine, sensors), known_loads(piece, turbine)[0]])
        readings = np.column_stack([piece[sensor.channel] for sensor in sensors])
        if self.last is None:
            return inputs, readings
        before, past, _ = self.last
        steps = round((piece.time[0] - before.time[-1]) * self.rate)
        if steps < 1:
            raise RecordError(f"{piece.name}: expected a piece that begins after the one before, got an overlap")
        expected = past[-1, 0] + past[-1, 1] * steps / self.rate  # the azimuth goes on where it was
        inputs[:, 0] += 2.0 * math.pi * round((expected - inputs[0, 0]) / (2.0 * math.pi))
        if steps > 1:
            between = np.linspace(0.0, 1.0, steps + 1)[1:-1, None]
            inputs = np.vstack([past[-1] + between * (inputs[0] - past[-1]), inputs])
            readings = np.vstack([np.full((steps - 1, readings.shape[1]), np.nan), readings])
        return inputs, readings

    def conclude(self, elapsed: float) -> Identification:
        """The result, judged on the last piece."""
        problem = self.problem
        if self.checkpoint is not None and self.taken < self.known:
            raise another_call(self.checkpoint, ["record"])
        self.online, rest = finish(problem.build, self.online, problem.start)
        check_finite(self.online.theta, self.online.precision)
        history = _joined([*self.histories, rest])
        if self.last is None:
            raise RecordError("no pieces: expected at least one, got an empty record")
        piece, inputs, readings = self.last
        first, turbine, sensors = self.given
        n = len(problem.parameters)
        final = problem.build(self.online.theta)
        info = EKF.run(final, EKF.init(final), inputs, readings)[1]
        outcome = Outcome(
            turbine=problem.turbine,
            model=problem.model,
            history_mean=history.mean[:, :n],
            history_std=np.sqrt(np.diagonal(history.cov, axis1=1, axis2=2)[:, :n]),
            final=info,
            theta=self.online.theta[:n],
            cov=self.online.cov[:n, :n],
            rotor=inputs[:, : len(problem.model.compiled.inputs)],
            channels=tuple(sensor.channel for sensor in problem.sensors),
            elapsed=elapsed,
            notes=(
                *problem.notes,
                "taken in piece by piece: the estimate is the on-line one, the innovations are the last piece's",
            ),
            statistics=learned_statistics(problem.statistics, self.online.theta[n:], self.online.cov[n:, n:]),
            joint_cov=self.online.cov,
        )
        return conclude(
            outcome, piece, "joint", section=(self.begun, float(piece.time[-1])), samples=self.taken,
            history_time=self.begun + (history.samples - 1) / self.rate,
            provenance=trace(first, str(self.hash), turbine, sensors, self.options),
        )  # fmt: skip


def _joined(histories: Sequence[History]) -> History:
    return History(*(np.concatenate(parts) for parts in zip(*histories, strict=True)))
