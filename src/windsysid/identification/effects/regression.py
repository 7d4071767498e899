"""Regressors in readings: every waveform that an effect proposes is tested in one pass over the record.

The regressor of the strongest statistic is included with its size, as what the readings have without the structure; the
record is fitted anew from where the fit was, and the test repeated. So a step is not taken for a bias or a trend, each
of which it resembles.
"""

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from windsysid.identification.effects.score_test import Candidate, ScoreTest, score_tests
from windsysid.identification.estimate.linearisation import Column, Linearisation, linearise
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.effect import Detection, Effect
from windsysid.identification.model.regressor import Regressors, Term

__all__ = ["P_EFFECT", "Regression", "RegressorEffect"]

P_EFFECT = 1e-3
"""Probability: share of records without any of these effects in which one is included; each test has an equal share."""

RESIZED = 0.1
"""Size: shift of an estimate, in standard deviations, from which on the sizes of included regressors are estimated
again."""


class RegressorEffect:
    """An effect that is a waveform in readings."""

    code: ClassVar[str]

    def candidates(self, at: Linearisation) -> Sequence[Candidate]:
        """Regressors that a fit may lack."""
        raise NotImplementedError

    def describe(self, terms: Sequence[Term], shift: str) -> str:
        """What the included waveforms in one channel are, and by how much they shifted an estimate, in words."""
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
        known = {(one.code, one.channel) for one in included}
        proposed = (one for effect in self.effects.values() for one in effect.candidates(at))
        new = [one for one in proposed if (one.code, one.channel) not in known]
        tests = score_tests(at, [*included, *new])
        for one in tests[: len(included)]:  # a fit that lacked it bends its size: sizes settle first
            if np.abs(one.shift).max() > RESIZED:
                return Detection(fit, self._with(job, at, one), 0.0, fit)
        if not new:
            return Detection(fit)
        best = min(tests[len(included) :], key=lambda one: one.log10_p)
        digits = -(best.log10_p + math.log10(len(new)))
        if digits < -math.log10(P_EFFECT):
            return Detection(fit)
        return Detection(fit, self._with(job, at, best), digits, fit)

    def _included(self, job: Job, at: Linearisation) -> list[Candidate]:
        """What the job includes, as candidates for a correction of its size."""
        found = []
        for code in self.effects:
            known = _terms(job, code)
            for channel in dict.fromkeys(term.channel for term in known):
                columns = [Column(at.channels.index(channel), one.wave) for one in known if one.channel == channel]
                found.append(Candidate(code, channel, tuple(columns), (1.0, 2.0)))
        return found

    def _with(self, job: Job, at: Linearisation, test: ScoreTest) -> Regressors:
        """What is included of an effect, with what a test says."""
        code, channel = test.candidate.code, test.candidate.channel
        unit = next(sensor.unit for sensor in at.problem.sensors if sensor.channel == channel)
        before = {term[:3]: term.size for term in _terms(job, code)}
        others = [term for term in _terms(job, code) if term.channel != channel]
        std = np.sqrt(np.diag(test.cov)).tolist()
        waves = [column.wave for column in test.candidate.columns]
        terms = [
            Term(channel, unit, wave, size + before.get((channel, unit, wave), 0.0), e)
            for wave, size, e in zip(waves, test.size.tolist(), std, strict=True)
        ]
        n = len(at.problem.parameters)
        worst = int(np.argmax(np.abs(test.shift[:n])))
        shift = f"{at.problem.parameters[worst].name} would shift by {abs(test.shift[worst]):.2g} σ without it"
        included = job.included(code)
        said = included.said if isinstance(included, Regressors) else ()
        widening = included.widening if isinstance(included, Regressors) else 0.0
        if not before:
            said = (*said, self.effects[code].describe(terms, shift))
        return Regressors(code, (*others, *terms), test.widening + widening, said)


def _terms(job: Job, code: str) -> tuple[Term, ...]:
    included = job.included(code)
    return included.terms if isinstance(included, Regressors) else ()
