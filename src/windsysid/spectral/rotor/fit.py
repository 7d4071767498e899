"""The mode of the posterior of a lifted spectrum, and its evidence."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.scoring import covariance, laplace_evidence
from windsysid.spectral.rotor.likelihood import Likelihood
from windsysid.spectral.rotor.model import Inexact, LiftedModel
from windsysid.spectral.rotor.scoring import FINE_TOLERANCE, SpectralMode, find_in_stages, find_nearby

__all__ = ["COARSE", "WHOLE", "RotorFit", "admit", "fit"]

COARSE = ((0.03, 4), (0.2, 4), (1.0, 2))
"""Setting: weight of the likelihood, and step between the bins in use, of all stages of a search but the last."""

WHOLE = ((1.0, 1),)
"""Setting: weight and step of the last stage."""


class RotorFit(NamedTuple):
    """Log-likelihood of a record, its gradient and information.

    Attributes
    ----------
    unknowns, cov
        Mode of the posterior (n,) and Laplace's covariance (n, n).
    log_likelihood
        At the mode.
    log_evidence
        ln ∫ p(y | u) p(u) du by Laplace's approximation.
    steps, settled
        Steps of the search, and whether it ended by itself.
    model
        With what the taper's window adds at the mode.
    """

    unknowns: Array
    cov: Array
    log_likelihood: float
    log_evidence: float
    steps: int
    settled: bool
    model: LiftedModel

    def evidence_at(self, overlap: float) -> float:
        """The log evidence if as many bins counted as one: only so are two models compared."""
        return self.log_evidence + (self.model.overlap / overlap - 1.0) * self.log_likelihood


def fit(
    model: LiftedModel, start: Array, stages: Sequence[tuple[float, int]] = (*COARSE, *WHOLE),
    smoothed: LiftedModel | None = None, *, rough: bool = False, enough: float = FINE_TOLERANCE,
) -> RotorFit:  # fmt: skip
    """The mode of the posterior from a start (n,).

    What the taper's window adds to the spectra is the difference of those of `smoothed` and of `model`. It hardly
    changes with the unknowns, so it is taken where the stages before the last one end, and once more at the mode that
    is found with it; and so is how alike neighbouring bins are. A `rough` search is for comparing models; another one
    ends with a step whose squared length in standard deviations is `enough`.

    Raises
    ------
    LinAlgError
        If the spectrum is not positive definite at the start.
    """
    if model.window is not None:  # all bins at once
        stages = [(weight, 1) for weight, _ in stages]
    if smoothed is None:
        mode = find_in_stages(_evaluator(model), start, model.prior, stages, rough=rough)
    else:
        unknowns, plain = start, model
        if before := stages[:-1]:
            unknowns = find_in_stages(_evaluator(model), start, model.prior, before, rough=True).point
        for last in (False, True):
            full = smoothed.spectrum(unknowns).spectrum
            smear = full - plain.spectrum(unknowns).spectrum
            model = plain._replace(smear=smear, overlap=model.likeness(full))
            of = _evaluator(model)
            mode = find_in_stages(of, unknowns, model.prior, stages[-1:], rough=not last, tolerance=enough)
            unknowns = mode.point
    return _described(model, mode)


def admit(found: RotorFit, inexact: Inexact) -> RotorFit:
    """The mode of the posterior with instruments and masses as additional unknowns, searched from that without."""
    model = found.model._replace(inexact=inexact)
    start = model.unknowns.from_other(found.unknowns, found.model.unknowns)
    mode = find_nearby(_evaluator(model), start, model.prior)
    return _described(model, mode._replace(converged=mode.converged and found.settled))


def _described(model: LiftedModel, mode: SpectralMode) -> RotorFit:
    """Evaluation at a mode."""
    mean, spread = model.prior
    off = (mode.point - mean) / spread
    log_likelihood = -(mode.value - 0.5 * float(off @ off))
    evidence = laplace_evidence(-mode.value, np.diag(spread**-2.0), mode.evaluation.information)
    cov = covariance(mode.evaluation.information)
    return RotorFit(mode.point, cov, log_likelihood, evidence, mode.steps, mode.converged, model)


def _evaluator(model: LiftedModel) -> Callable[[Array, int], tuple[float, Array, Array]]:
    """J, g and F of a model; a later stage begins where another one ended."""
    known = dict[tuple[bytes, int], Likelihood]()

    def evaluate(unknowns: Array, every: int) -> tuple[float, Array, Array]:
        key = unknowns.tobytes(), every
        found = known[key] = known.get(key) or model.likelihood(unknowns, every)
        return found.value, found.gradient, found.information

    return evaluate
