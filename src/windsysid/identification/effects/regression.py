"""Regressors in readings: every waveform that an effect proposes is tested in one pass over the record.

The regressor of the strongest statistic is included with its size, as what the readings have without the structure; the
record is fitted anew from where the fit was, and the test repeated. So a step is not taken for a bias or a trend, each
of which it resembles.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.identification.effects.score_test import RegressorCandidate, ScoreTest, promising, score_tests
from windsysid.identification.estimate.fitted.linearisation import Linearisation, RegressorColumn, linearise
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.effect import Detection, Effect
from windsysid.identification.model.prior_odds import odds_of
from windsysid.identification.model.regressor import Regressors, Term

__all__ = ["Regression", "RegressorEffect"]

MIN_LOG_STD_CHANGE = 0.3
"""Tolerance: of the logarithm of an effect's standard deviation, within which its size is not estimated again."""


MAX_REVISIONS = 2
"""Setting: how often the size of included regressors is estimated again, as two fits may alternate."""


class RegressorEffect:
    """An effect that is a waveform in readings."""

    code: ClassVar[str]

    def candidates(self, at: Linearisation) -> Sequence[RegressorCandidate]:
        """Regressors that a fit may lack."""
        raise NotImplementedError

    def describe(self, terms: Sequence[Term]) -> dict[str, Any]:
        """Description of the included waveforms in one channel: the data of its finding."""
        raise NotImplementedError


class Regression(Effect):
    """All effects that are waveforms in readings."""

    code = "regression"

    def __init__(self, effects: Sequence[RegressorEffect]) -> None:
        self.effects = {effect.code: effect for effect in effects}

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        """Test every waveform that a fit may lack, and those that it has for their sizes."""
        at = linearise(job, fit)
        if at is None:
            return Detection(fit)
        included = self._included(job, at)
        new = self._proposed(at, included)
        tests = score_tests(at, [*included, *promising(at, new)])
        settling = [one for one in tests if one.candidate in included]
        for one in settling:  # a fit that lacked it bends its size: sizes settle first
            known_of = _known(job, self.effects[one.candidate.code])
            revised = known_of.revisions[one.candidate.channel] >= MAX_REVISIONS
            if not revised and (_is_other_std(known_of, one) or at.depends_on(one.shift)):
                return Detection(fit, self._with(job, at, fit, one), 0.0, fit)
        odds = {code: odds_of(code, job.turbine) for code in self.effects}
        shared = sum(odds[one.code] for one in new)  # each test has its share of the probability
        ranked = [(math.log10(odds[one.candidate.code]) - one.log10_p, one) for one in tests[len(settling) :]]
        digits, best = max(ranked, key=lambda one: one[0], default=(0.0, None))
        if best is None or digits - math.log10(shared) < -math.log10(FALSE_ALARM_PROBABILITY):
            return Detection(fit)
        found = self._with(job, at, fit, best)
        if not at.depends_on(best.shift):
            return Detection(fit.noting(found.finding(best.candidate.channel, None)))
        return Detection(fit, found, digits, fit)

    def _included(self, job: Job, at: Linearisation) -> list[RegressorCandidate]:
        """Included regressors, as candidates for a correction of their sizes."""
        found = []
        for code, effect in self.effects.items():
            known = _known(job, effect)
            for channel in known.before:
                columns = [RegressorColumn(at.channels.index(channel), one.wave) for one in known.of(channel)]
                found.append(RegressorCandidate(code, channel, tuple(columns)))
        return found

    def _proposed(self, at: Linearisation, included: Sequence[RegressorCandidate]) -> list[RegressorCandidate]:
        """Candidates that the job does not include."""
        known = {(one.code, one.channel) for one in included}
        proposed = (one for effect in self.effects.values() for one in effect.candidates(at))
        return [one for one in proposed if (one.code, one.channel) not in known]

    def _with(self, job: Job, at: Linearisation, fit: FittedJob, test: ScoreTest) -> Regressors:
        """Regressors of an effect, updated with the sizes of a test."""
        channel, columns = test.candidate.channel, test.candidate.columns
        known = _known(job, self.effects[test.candidate.code])
        unit = next(sensor.unit for sensor in at.problem.sensors if sensor.channel == channel)
        before = [one.size for one in known.of(channel)] or [0.0] * len(columns)
        sizes, stds = test.size + before, np.sqrt(np.diag(test.cov))
        terms = [
            Term(channel, unit, column.wave, float(size), float(std))
            for column, size, std in zip(columns, sizes, stds, strict=True)
        ]
        others = [term for term in known.terms if term.channel != channel]
        return replace(
            known,
            terms=(*others, *terms),
            widenings={**known.widenings, channel: test.widening},
            before={channel: fit.outcome, **known.before},
            revisions={**known.revisions, channel: known.revisions.get(channel, -1) + 1},
        )


def _known(job: Job, effect: RegressorEffect) -> Regressors:
    """Regressors of an effect that a job includes."""
    included = job.included(effect.code)
    return included if isinstance(included, Regressors) else Regressors(effect.code, effect.describe)


def _is_other_std(known: Regressors, test: ScoreTest) -> bool:
    """Test for standard deviations of sizes that differ much from those of the fit that includes them."""
    before = np.array([one.std for one in known.of(test.candidate.channel)])
    return bool(np.any(np.abs(np.log(before / np.sqrt(np.diag(test.cov)))) > MIN_LOG_STD_CHANGE))
