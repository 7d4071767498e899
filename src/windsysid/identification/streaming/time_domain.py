"""Accumulator of the joint formulation: all samples on disk, and recursive estimates.

Each segment is brought to the model's rate as the whole record would be
(`windsysid.identification.condition.blockwise`), written to a file on disk that has no name
(`windsysid.identification.condition.samples`), and read by the recursive estimator
(`windsysid.identification.estimate.online`). The load model is chosen as soon as there are enough samples for that.
After the last segment the mode of the posterior is found from the samples on disk, as for a whole record
(`windsysid.identification.estimate.search`).

A call that resumes ends where an uninterrupted one would have ended, bit for bit. A record that has grown since is the
same record, if what was taken in is still there.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import RecordError
from windsysid.identification.condition.blockwise import BlockwiseConditioner, ConditionedSamples
from windsysid.identification.condition.readings import check_length, thin_to_readings
from windsysid.identification.condition.samples import SamplesOnDisk
from windsysid.identification.effects.bias import find_biases
from windsysid.identification.estimate.load_selection import Question, choose
from windsysid.identification.estimate.online import (
    MEMORY,
    History,
    Online,
    advance,
    join_histories,
    restored,
    stored,
)
from windsysid.identification.estimate.prior_conflict import note_wide_priors, solve_with_wide_priors
from windsysid.identification.estimate.search import expect_search
from windsysid.identification.estimate.time_domain import describe_solution, first_estimate, load_models
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.identification.streaming.run import SegmentsEstimate, StreamingJob
from windsysid.records.record import Record
from windsysid.results.finding import Finding, read_finding

__all__ = ["SampleAccumulator"]


class SampleAccumulator:
    """Samples of the segments on disk, and what is known of the unknowns so far."""

    def __init__(self, first: Record, job: StreamingJob) -> None:
        self.first, self.job = first, job
        uniform, self.sensors = first.on_uniform_grid(), tuple(job.sensors or ())
        biases = find_biases(uniform, job.turbine, self.sensors)
        self.offsets = () if biases is None else (biases.note,)
        if biases is not None:
            self.sensors = biases.correct(uniform, job.turbine, self.sensors, filtered=True)[1]
        self.windows = BlockwiseConditioner(first.on_uniform_grid(), job.turbine, self.sensors, job.rate)
        check_length(first.name, math.inf, self.windows.rate, job.turbine)
        self.loads = load_models(first, job.turbine, job.loads)
        self.beginning: list[ConditionedSamples] = []
        self.enough = MEMORY * first_estimate(job.turbine, self.windows.rate)
        self.samples: SamplesOnDisk | None = None
        self.problem: TurbineProblem | None = None
        self.online: Online | None = None
        self.why = Finding("load_model_chosen", "note", {"model": "", "reason": ""})
        self.histories, self.warming = list[History](), 0.0
        self.ended = float(first.time[0])

    def replay(self, segment: Record) -> None:
        """Take a segment that a checkpoint knows: the samples on disk are gone."""
        self._hold(self.windows.take(segment))

    def take(self, segment: Record) -> Record | None:
        """Take the next segment as it was recorded."""
        return self._append(self.windows.take(segment))

    def finish(self) -> Record | None:
        """Take the samples that were held back, of a short record the first that are read."""
        added = self._append(self.windows.finish())
        if self.problem is None and self.beginning:
            self._choose()
            self._advance()
        return added

    def stored(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """State so far, and the load model with the reason of its choice."""
        if self.problem is None or self.online is None:
            return {}, {"chosen": None}
        return stored(self.online, join_histories(self.histories)), {
            "chosen": [self.problem.loads.name, self.why.summary()]
        }

    def restore(self, arrays: Mapping[str, Any], progress: Mapping[str, Any]) -> None:
        """Restore from `stored`, after the samples have been replayed."""
        if progress["chosen"] is None:
            return
        name, why = progress["chosen"]
        self.why = read_finding(why)
        self.problem = pose(*self._question(), name)
        self.online, earlier = restored(self.problem.build, arrays)
        self.histories = [earlier]

    def _hold(self, more: ConditionedSamples | None) -> Record | None:
        """Write samples to disk; the first ones stay in memory, too, until the load model is chosen."""
        if more is None:
            return None
        if self.samples is None:
            columns = more.inputs.shape[1], more.readings.shape[1]
            self.samples = SamplesOnDisk(columns, _folder_beside(self.job.checkpoint), every=self.windows.steps)
        if self.problem is None and self.samples.count < self.enough:
            self.beginning.append(more)
        self.samples.append(more.inputs, more.readings)
        self.ended = float(more.record.time[-1])
        return more.record

    def _append(self, more: ConditionedSamples | None) -> Record | None:
        """Hold samples, and estimate on line as soon as there are enough."""
        added = self._hold(more)
        if added is None or self.samples is None:
            return None
        if self.problem is None and self.samples.count >= self.enough:
            self._choose()
        self._advance()
        return added

    def _question(self) -> Question:
        """The question that the beginning of the record poses."""
        parts = [prepared.record for prepared in self.beginning]
        beginning = replace(
            parts[0],
            time=np.concatenate([part.time for part in parts])[: self.enough],
            values=np.vstack([part.values for part in parts])[: self.enough],
        )
        self.beginning = []
        return Question(beginning, self.job.turbine, self.sensors, self.job.prior, self.job.parameters)

    def _choose(self) -> None:
        """Choose the load model on the beginning of the record."""
        choice = choose(self._question(), self.loads, first_estimate(self.job.turbine, self.windows.rate))
        self.why, self.warming = choice.why, choice.warming
        self.problem, self.online, self.histories = choice.best.problem, choice.best.online, [choice.best.history]

    def _advance(self) -> None:
        """Estimate on line from the samples that are new."""
        if self.problem is None or self.online is None or self.samples is None:
            return
        if self.samples.count > self.online.reached:
            new = self.samples.rows(self.online.reached, self.samples.count)
            self.online, history = advance(self.problem.build, self.online, *new, self.problem.start)
            self.histories.append(history)

    def estimate(self) -> SegmentsEstimate:
        """Find the mode of the posterior from all samples."""
        name, rate, begun = self.first.name, self.windows.rate, float(self.first.time[0])
        if self.problem is None or self.online is None or self.samples is None:
            raise RecordError(f"{name}: expected at least two samples, got fewer")
        check_length(name, self.ended - begun, rate, self.job.turbine)
        expect_search(self.samples.count)
        given = self.problem.parameters
        problem, solution = solve_with_wide_priors(self.problem, self.samples, self.online, rate=rate)
        self.samples.close()
        history = join_histories([*self.histories, *filter(None, [solution.history])])
        known = history.mean, np.sqrt(np.diagonal(history.cov, axis1=1, axis2=2))
        outcome = describe_solution(problem, solution, self.job.turbine, self.why, known, self.warming)
        outcome = note_wide_priors(outcome._replace(given_priors=given))
        steps, last = self.windows.steps, len(solution.info.innovation)
        kept = min(last, 2)
        end = self.ended - np.arange(kept)[::-1] * steps / rate
        return SegmentsEstimate(
            self._noted(outcome, last, solution.samples),
            replace(self.first, time=end, values=self.first.values[:kept]),
            -(-solution.samples // steps), begun + (history.samples - 1) / rate,
        )  # fmt: skip

    def _noted(self, outcome: Outcome, last: int, samples: int) -> Outcome:
        """Outcome at the readings' rate, with the history of the whole record, and notes on the kept part."""
        pieces = Finding("pieces", "note", {"kept": last / self.windows.rate if last < samples else None})
        return thin_to_readings(outcome, self.windows.steps)._replace(
            history_mean=outcome.history_mean,
            history_std=outcome.history_std,
            notes=(*self.windows.notes, *self.offsets, *outcome.notes, pieces),
        )


def _folder_beside(checkpoint: Path | None) -> Path | None:
    """The folder of a checkpoint, if it is there."""
    folder = None if checkpoint is None else checkpoint.absolute().parent
    return folder if folder is not None and folder.is_dir() else None
