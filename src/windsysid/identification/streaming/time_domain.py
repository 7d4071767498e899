"""Records too long for memory, piece by piece: the same way from samples to an estimate, interruptible and resumable.

Each piece is brought to the model's rate as the whole record would be (`windsysid.identification.condition.blockwise`),
written to a file on disk that has no name (`windsysid.identification.condition.samples`), and taken in on line
(`windsysid.identification.estimate.online`). The load model is chosen as soon as there are enough samples for that.
After the last piece the mode of the posterior is found from the samples on disk, as for a whole record
(`windsysid.identification.estimate.search`).

What is known on line is written beside the output after every piece. The same call on the same record goes on from
there, and ends where an uninterrupted one would have ended, bit for bit. The checkpoint says which call it belongs to,
and the hash of all samples that were taken in: another call does not take it up. A record that has grown since is the
same record, if what was taken in is still there.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from windsysid._version import __version__
from windsysid.errors import ConfigurationError, RecordError, as_numerical_error
from windsysid.identification.condition.blockwise import Prepared, Windows
from windsysid.identification.condition.readings import check_length, thin_to_readings
from windsysid.identification.condition.samples import SamplesOnDisk
from windsysid.identification.effects.bias import find_biases
from windsysid.identification.estimate.load_selection import Question, choose
from windsysid.identification.estimate.online import (
    MEMORY,
    History,
    Online,
    advance,
    another_call,
    check_call,
    join_histories,
    restore,
    save,
)
from windsysid.identification.estimate.prior_conflict import note_wide_priors, solve_with_wide_priors
from windsysid.identification.estimate.search import expect_search
from windsysid.identification.estimate.time_domain import describe_solution, first_estimate, load_models
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.identification.streaming.driver import take_in
from windsysid.identification.streaming.spectra import identify_spectra_of_pieces
from windsysid.identification.verdict.conclude import conclude
from windsysid.inspection.fault import Fault
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding, read_finding
from windsysid.results.identification import Identification
from windsysid.results.provenance import RecordHash, record_hash, sensor_tables, trace, turbine_hash
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["identify_pieces"]

Progress = Callable[[float], None]

_BEGINNING = 1000
"""Samples by which another record is told at once; that all others are the same is seen where the checkpoint is
reached."""


@one_thread()
@as_numerical_error("the identification")
def identify_pieces(
    pieces: Iterable[Record],
    turbine: TurbineLike,
    *,
    sensors: Sequence[Sensor] | None = None,
    prior: Prior | None = None,
    parameters: Sequence[str] | None = None,
    formulation: Literal["joint", "spectral"] = "joint",
    rate: float | None = None,
    loads: str = "auto",
    memory: float | None = None,
    checkpoint: str | Path | None = None,
    keep_checkpoint: bool = False,
    progress: Progress | None = None,
    options: Mapping[str, Any] | None = None,
) -> Identification:
    """Identify stiffness and damping from a record that comes in pieces, in bounded memory.

    The estimate is what `windsysid.identify` would find. Samples are held on disk, beside the checkpoint or in the
    system's folder for temporary files: 8 bytes for each number that a filter reads. The diagnosis judges all
    innovations; kept are those of the last samples.

    Parameters
    ----------
    pieces
        Records in order, of one sampling rate: `windsysid.iterate_record` makes them of a file. Samples missing between
        two pieces are missing readings.
    turbine, sensors, prior, parameters, rate, loads
        As for `windsysid.identify`; sensors are chosen on the first piece.
    formulation
        joint, or spectral: then sums over blocks are all that is kept, pieces may be of several records of one machine
        in one state, and the result is within a third of a standard deviation of a whole record's
        (`windsysid.identification.streaming.spectra`).
    memory
        Of the spectral formulation: time [s] in which what was taken in comes to count as 1/e, so that the result is
        that of late; None where nothing is forgotten.
    checkpoint
        Where to write what is known after each piece, and to go on from if it is there; it is deleted at the end.
    keep_checkpoint
        Leave it there: who saves the result deletes it then, and nothing is lost if the disk is full or the process is
        killed before.
    progress
        Called with the time [s] reached after each piece.
    options
        Plain values that tell more of the call: kept with the result, and with the checkpoint, which another call does
        not take up.

    Returns
    -------
    Identification
        As of `windsysid.identify`; what was known on line is kept once for each estimate, not for each sample.

    Raises
    ------
    RecordError, ConfigurationError
        If a piece does not hold what is needed, an option is out of range, or the checkpoint belongs to another call.
    OutputError
        If the disk is full.
    WindsysidError
        As `windsysid.identify` raises it.
    """
    started = time.perf_counter()
    checkpoint = None if checkpoint is None else Path(checkpoint)
    turbine = as_turbine(turbine)
    if formulation == "spectral":
        if rate is not None:
            raise ConfigurationError("the spectral formulation reads the bands that it needs: leave the rate out")
        if memory is not None and not memory > 0.0:
            raise ConfigurationError(f"memory: expected seconds greater than 0, got {memory:g}")
        return identify_spectra_of_pieces(
            pieces, turbine, sensors=sensors, prior=prior or Prior(), parameters=parameters, loads=loads,
            memory=memory, checkpoint=checkpoint, keep_checkpoint=keep_checkpoint, progress=progress,
            options=options or {},
        )  # fmt: skip
    if formulation != "joint" or memory is not None:
        raise ConfigurationError(
            f"pieces: expected the formulation joint without a memory, or spectral, got '{formulation}'"
        )

    def begin(first: Record, found: tuple[Sensor, ...]) -> _Run:
        return _Run(first, turbine, found, prior or Prior(), parameters, rate, loads, checkpoint, options or {})

    return take_in(
        pieces, turbine, sensors, begin, started, checkpoint=checkpoint, keep_checkpoint=keep_checkpoint,
        progress=progress,
    )  # fmt: skip


class _Run:
    """One pass over the pieces."""

    def __init__(
        self, first: Record, turbine: Turbine, sensors: tuple[Sensor, ...], prior: Prior, chosen: Sequence[str] | None,
        rate: float | None, loads: str, checkpoint: Path | None, options: Mapping[str, Any],
    ) -> None:  # fmt: skip
        listed = None if chosen is None else list(chosen)
        beginning = replace(first, time=first.time[:_BEGINNING], values=first.values[:_BEGINNING])
        self.call = {
            "version": __version__,
            "turbine": turbine_hash(turbine),
            "sensors": sensor_tables(sensors),
            "prior": asdict(prior),
            "parameters": listed,
            "rate": rate,
            "loads": loads,
            "mapping": options.get("mapping"),
            "length of pieces": first.on_uniform_grid().samples,
            "record": record_hash(beginning),
        }
        self.checkpoint = checkpoint
        self.stopped: dict[str, Any] = {"samples": 0, "taken": "", "chosen": None}
        if checkpoint is not None and checkpoint.exists():
            self.stopped = check_call(checkpoint, self.call)
        biases = find_biases(first.on_uniform_grid(), turbine, sensors)
        self.offsets = () if biases is None else (biases.note,)
        if biases is not None:
            sensors = biases.correct(first, turbine, sensors, filtered=True)[1]
        self.windows = Windows(first.on_uniform_grid(), turbine, sensors, rate)
        check_length(first.name, math.inf, self.windows.rate, turbine)
        self.turbine, self.sensors, self.prior, self.chosen = turbine, sensors, prior, chosen
        self.loads = load_models(first, turbine, loads)
        self.options = {
            "formulation": "joint", "prior": asdict(prior), "parameters": listed, "rate": rate, "loads": loads,
            **options,
        }  # fmt: skip
        self.first, self.name, self.hash, self.taken = first, first.name, RecordHash(), 0
        self.beginning: list[Prepared] = []
        self.enough = MEMORY * first_estimate(turbine, self.windows.rate)
        self.samples: SamplesOnDisk | None = None
        self.problem: TurbineProblem | None = None
        self.online: Online | None = None
        self.why = Finding("load_model_chosen", "note", {"model": "", "reason": ""})
        self.histories, self.warming = list[History](), 0.0
        self.ended, self.wind = float(first.time[0]), [0.0, 0.0]

    def take(self, piece: Record) -> None:
        """The next piece as it was recorded."""
        self.hash.take(piece)
        self.taken, self.name = self.taken + piece.samples, piece.name
        known = int(self.stopped["samples"])
        if self.taken - piece.samples < known and (
            self.taken > known or (self.taken == known and str(self.hash) != self.stopped["taken"])
        ):
            raise another_call(self._path, ["record"])
        self._append(self.windows.take(piece))
        if self.checkpoint is not None and self.taken > known:
            chosen = None if self.problem is None else [self.problem.loads.name, self.why.summary()]
            progress = {"samples": self.taken, "taken": str(self.hash), "chosen": chosen}
            history = join_histories(self.histories) if self.histories else None
            save(self.online, history, self.checkpoint, call=self.call, progress=progress)

    @property
    def _path(self) -> Path:
        assert self.checkpoint is not None
        return self.checkpoint

    def _append(self, more: Prepared | None) -> None:
        """Hold what is ready, and take it in on line."""
        if more is None:
            return
        if self.samples is None:
            columns = more.inputs.shape[1], more.readings.shape[1]
            beside = None if self.checkpoint is None else self.checkpoint.absolute().parent
            folder = beside if beside is not None and beside.is_dir() else None
            self.samples = SamplesOnDisk(columns, folder, every=self.windows.steps)
        self.samples.append(more.inputs, more.readings)
        self.ended = float(more.record.time[-1])
        if "wind_speed" in more.record:
            wind = more.record["wind_speed"]
            self.wind[0] += float(np.nansum(wind))
            self.wind[1] += float(np.isfinite(wind).sum())
        if self.problem is None:
            self.beginning.append(more)
            if self.samples.count < self.enough:
                return
            self._choose()
        self._go_on()

    def _choose(self) -> None:
        """Pose the problem on the beginning of the record, with the load model that it chooses, or chose before an
        interruption."""
        parts = [prepared.record for prepared in self.beginning]
        beginning = replace(
            parts[0],
            time=np.concatenate([part.time for part in parts])[: self.enough],
            values=np.vstack([part.values for part in parts])[: self.enough],
        )
        self.beginning = []
        question = Question(beginning, self.turbine, self.sensors, self.prior, self.chosen)
        if self.stopped["chosen"] is not None:
            name, why = self.stopped["chosen"]
            self.why = read_finding(why)
            self.problem = pose(*question, name)
            self.online, earlier = restore(self.problem.build, self._path)
            self.histories = [earlier]
            return
        choice = choose(question, self.loads, first_estimate(self.turbine, self.windows.rate))
        self.why, self.warming = choice.why, choice.warming
        self.problem, self.online, self.histories = choice.best.problem, choice.best.online, [choice.best.history]

    def _go_on(self) -> None:
        """Take in on line what is held and new."""
        assert self.problem is not None
        assert self.online is not None
        assert self.samples is not None
        if self.samples.count > self.online.reached:
            new = self.samples.rows(self.online.reached, self.samples.count)
            self.online, history = advance(self.problem.build, self.online, *new, self.problem.start)
            self.histories.append(history)

    def conclude(self, started: float, faults: Sequence[Fault]) -> Identification:
        """The result."""
        if self.taken < int(self.stopped["samples"]):
            raise another_call(self._path, ["record"])
        self._append(self.windows.finish())
        if self.problem is None and self.beginning:
            self._choose()
            self._go_on()
        if self.problem is None or self.online is None or self.samples is None:
            raise RecordError(f"{self.name}: expected at least two samples, got fewer")
        begun, steps = float(self.first.time[0]), self.windows.steps
        check_length(self.name, self.ended - begun, self.windows.rate, self.turbine)
        problem, samples = self.problem, self.samples
        expect_search(samples.count)
        given = problem.parameters
        problem, solution = solve_with_wide_priors(problem, samples, self.online, rate=self.windows.rate)
        samples.close()
        history = join_histories([*self.histories, *filter(None, [solution.history])])
        known = history.mean, np.sqrt(np.diagonal(history.cov, axis1=1, axis2=2))
        elapsed = time.perf_counter() - started - self.warming
        outcome: Outcome = describe_solution(problem, solution, self.turbine, self.why, known, elapsed)
        outcome = note_wide_priors(outcome._replace(given_priors=given))
        last = len(solution.info.innovation)
        kept_seconds = last / self.windows.rate if last < solution.samples else None
        pieces = Finding("pieces", "note", {"kept": kept_seconds})
        thin = thin_to_readings(outcome, steps)._replace(
            history_mean=outcome.history_mean,
            history_std=outcome.history_std,
            notes=(*self.windows.notes, *self.offsets, *outcome.notes, pieces),
        )
        count = -(-solution.samples // steps)
        kept = min(last, 2)
        end = self.ended - np.arange(kept)[::-1] * steps / self.windows.rate
        read = replace(self.first, name=self.name, time=end, values=self.first.values[:kept])
        return conclude(
            thin, read, "joint", section=(begun, self.ended), samples=count,
            history_time=begun + (history.samples - 1) / self.windows.rate,
            wind_speed=self.wind[0] / self.wind[1] if self.wind[1] else None,
            provenance=trace(self.first, str(self.hash), self.turbine, self.sensors, self.options), faults=faults,
        )  # fmt: skip
