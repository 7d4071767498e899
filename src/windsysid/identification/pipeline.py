"""Estimate, test for effects, include the strongest, and estimate again: the one loop of an identification."""

from collections.abc import Sequence

from windsysid.identification.effects import ALTERNATIVES, EFFECTS
from windsysid.identification.formulations import estimate
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.limits import MAX_EXTENSIONS
from windsysid.identification.model.effect import Detection, Effect, Inclusion

__all__ = ["run"]


def run(
    job: Job, start: FittedJob | None = None, *, effects: Sequence[Sequence[Effect]] = (EFFECTS, ALTERNATIVES)
) -> tuple[Job, FittedJob]:
    """Answer a job, extended by every effect that is warranted; the job that was answered in the end, too.

    Effects that readings show before anything is fitted come first. Then every effect is tested on the fit, the one
    with the strongest evidence is included, and the record is fitted anew, until no effect is warranted: a step is not
    mistaken for a bias then, nor a narrow-band load for a sinusoid.

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
    fit, rejected = estimate(job, start), set[str]()
    for _ in range(MAX_EXTENSIONS):
        judged, strongest = _test(job, fit, effects, rejected)
        if strongest is None:
            return job, judged
        effect, detection, inclusion = strongest
        longer = job.including(inclusion)
        further = effect.confirm(job, detection, estimate(longer, detection.start))
        if further is None:
            rejected.add(effect.code)
        else:
            job, fit = longer, further
    for stage in effects:
        fit, _ = _tested(job, fit, stage)
    return job, fit


def _test(
    job: Job, fit: FittedJob, stages: Sequence[Sequence[Effect]], rejected: set[str]
) -> tuple[FittedJob, tuple[Effect, Detection, Inclusion] | None]:
    """The fit with what effects that are not included say against it, and the effect of the strongest evidence."""
    for effects in stages:
        tested, warranted = _tested(job, fit, [one for one in effects if one.code not in rejected])
        if warranted:
            return fit, max(warranted, key=lambda one: one[1].log10_odds)
        fit = tested
    return fit, None


def _tested(
    job: Job, fit: FittedJob, effects: Sequence[Effect]
) -> tuple[FittedJob, list[tuple[Effect, Detection, Inclusion]]]:
    warranted = []
    for effect in effects:
        found = effect.detect(job, fit)
        fit = found.fit
        if found.inclusion is not None:
            warranted.append((effect, found, found.inclusion))
    return fit, warranted
