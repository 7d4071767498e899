"""A narrow-band load on the support: a machine nearby, waves, or a neighbour's mode.

It is a component of the loads' spectrum, and no regressor: whether it is there is a matter of the evidence of the model
that has it (`windsysid.identification.estimate.spectral.narrow_band`).
"""

import math
from dataclasses import dataclass

import numpy as np

from windsysid.errors import WindsysidError
from windsysid.identification.estimate.prior_conflict import with_wide_priors
from windsysid.identification.estimate.spectral.frequency_domain import identify_by_spectrum
from windsysid.identification.estimate.spectral.narrow_band import (
    NarrowBandFit,
    doubts_of_narrow_band,
    note_narrow_band,
)
from windsysid.identification.estimate.spectral.narrow_band_alternative import (
    heard_on_time,
    narrow_band_beside,
    told_before,
)
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.agreement import disagreement
from windsysid.identification.model.effect import Detection, Effect, Inclusion
from windsysid.loads.family import Broadband
from windsysid.loads.narrow_band import NarrowBand

__all__ = ["NarrowBandIncluded", "NarrowBandLoad"]


@dataclass(frozen=True)
class NarrowBandIncluded(Inclusion):
    """A narrow-band load that explains the spectra, in addition to broad ones: a load of the model, of which the fit
    that includes it has the note."""

    alternative: NarrowBandFit
    code: str = "narrow_band_load"


class NarrowBandLoad(Effect):
    """A narrow-band load, where spectra explain the record much better with it and coefficients change."""

    code = "narrow_band_load"

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        """Compare the evidence of spectra with it and without."""
        if job.inclusion(NarrowBandIncluded) is not None:
            return Detection(fit)
        beside = narrow_band_beside(fit.outcome, fit.read, job.turbine, fit.sensors)
        alone = fit.doubted(*doubts_of_narrow_band(beside, asked=job.loads))
        if beside is None or not beside.is_needed or job.loads != "auto":
            return Detection(alone)
        start = self._start(job, fit) if job.filtered else fit
        if start is None:
            return Detection(fit.doubted(*doubts_of_narrow_band(beside, asked=Broadband.name)))
        return Detection(alone, NarrowBandIncluded(beside), beside.gain / math.log(10.0), start)

    def _start(self, job: Job, fit: FittedJob) -> FittedJob | None:
        """Fit of the spectra with the load, as a start of filters; None if spectra do not apply."""
        of = heard_on_time(fit.read, fit.outcome, job.turbine, fit.sensors), job.turbine, fit.sensors
        try:
            near, _ = with_wide_priors(
                lambda prior: identify_by_spectrum(*of, prior, job.parameters, loads=NarrowBand.name), fit.prior
            )
        except (WindsysidError, np.linalg.LinAlgError):
            return None
        return fit._replace(formulation="spectral", outcome=told_before(near, fit.outcome))

    def confirm(self, job: Job, found: Detection, after: FittedJob) -> FittedJob | None:
        """Describe the load, or that filters do not need it, and compare them with spectra."""
        included = found.inclusion
        if not isinstance(included, NarrowBandIncluded) or after.formulation != "joint" or found.start is None:
            return after
        if after.outcome.hypothesis != NarrowBand.name:
            return after.doubted(*doubts_of_narrow_band(included.alternative, asked=Broadband.name))
        there = found.start.outcome  # where findings speak against it, it is no evidence against filters
        doubtful = any(not one.code.startswith(self.code) for one in there.doubts)
        against = () if doubtful else disagreement(after.outcome, there, job.turbine)
        doubts = doubts_of_narrow_band(included.alternative, asked="auto")
        return after.noting(note_narrow_band(included.alternative), *doubts, *against)
