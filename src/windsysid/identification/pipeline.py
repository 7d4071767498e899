"""Estimate, test for effects, include the strongest, and estimate again: the one loop of an identification."""

from collections.abc import Mapping, Sequence

import numpy as np

from windsysid.errors import WindsysidError
from windsysid.identification.effects import ALTERNATIVES, EFFECTS
from windsysid.identification.formulations import estimate
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.effect import Detection, Effect, Inclusion
from windsysid.results.finding import Finding

__all__ = ["FAILURES", "run"]

MAX_EXTENSIONS = 8
"""Setting: largest number of effects in a record, each of which costs a search."""

FAILURES = (WindsysidError, np.linalg.LinAlgError)
"""Errors of a step of the loop, after which the fit before it stands."""

Refused = Mapping[str, str]
"""Codes of effects that are not to be included, and the error; empty where a refit showed that it is something else."""


def run(
    job: Job, start: FittedJob | None = None, *, effects: Sequence[Sequence[Effect]] = (EFFECTS, ALTERNATIVES)
) -> tuple[Job, FittedJob]:
    """Answer a job, extended by every effect that is warranted; the job that was answered in the end, too.

    Effects that readings show before anything is fitted come first. Then every effect is tested on the fit, the one
    with the strongest evidence is included, and the record is fitted anew, until no effect is warranted: a step is not
    mistaken for a bias then, nor a narrow-band load for a sinusoid. An effect that is warranted and cannot be included
    speaks against the fit.

    Parameters
    ----------
    start
        The fit from which the first search begins; the prior by default.
    effects
        Effects that are tested, in stages: a later one where no effect of those before is warranted.
    """
    for effect in EFFECTS:
        found = effect.find(job) if job.included(effect.code) is None else None
        job = job if found is None else job.including(found)
    fit, refused = estimate(job, start), dict[str, str]()
    for _ in range(MAX_EXTENSIONS):
        judged, strongest = _test(job, fit, effects, refused)
        if strongest is None:
            return job, judged
        effect, detection, inclusion = strongest
        longer = job.including(inclusion)
        try:
            further = effect.confirm(job, detection, estimate(longer, detection.start))
        except FAILURES as error:
            refused[effect.code] = str(error)
            continue
        if further is None:
            refused[effect.code] = ""
        else:
            job, fit = longer, further
    full = {one.code: f"{MAX_EXTENSIONS} effects are included" for stage in effects for one in stage}
    return job, _test(job, fit, effects, full | refused)[0]


def _test(
    job: Job, fit: FittedJob, stages: Sequence[Sequence[Effect]], refused: Refused
) -> tuple[FittedJob, tuple[Effect, Detection, Inclusion] | None]:
    """Fit with the findings on effects that are not included, and the effect of the strongest evidence; none if the
    search has ended too early to test any."""
    if any(one.code == "search_exhausted" for one in fit.outcome.doubts):
        return fit, None
    for effects in stages:
        tested, warranted = _tested(job, fit, effects, refused)
        if warranted:
            return fit, max(warranted, key=lambda one: one[1].log10_odds)
        fit = tested
    return fit, None


def _tested(
    job: Job, fit: FittedJob, effects: Sequence[Effect], refused: Refused
) -> tuple[FittedJob, list[tuple[Effect, Detection, Inclusion]]]:
    warranted = []
    for effect in effects:
        try:
            found = effect.detect(job, fit)
        except FAILURES as error:
            fit = fit.noting(
                Finding("effect_not_tested", "note", {"effect": effect.code.replace("_", " "), "error": str(error)})
            )
            continue
        fit = found.fit
        if found.inclusion is not None and effect.code not in refused:
            warranted.append((effect, found, found.inclusion))
        elif found.inclusion is not None and refused[effect.code]:
            data = {"effect": found.inclusion.code.replace("_", " "), "error": refused[effect.code]}
            fit = fit.lacking(Finding("effect_not_included", "reason", data))
    return fit, warranted
