"""Several bands of a record as one function of the unknowns: their likelihoods multiply, the mechanics are shared.

The unknowns are those of `windsysid.spectral.rotor.model.LiftedModel`: coefficients, mean lag angle and tolerances,
which all bands share, and the statistics of loads and readings, band by band.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.loads.statistics import Statistic
from windsysid.spectral.rotor.fit import WHOLE
from windsysid.spectral.rotor.model import Inexact, LiftedModel
from windsysid.spectral.rotor.scoring import SpectralMode, find_in_stages, find_nearby
from windsysid.spectral.rotor_bands.channels import Row
from windsysid.statespace.unknowns import Unknowns

__all__ = ["BandModel", "RotorBand", "RotorBandFit"]

ROUGH = ((0.2, 3),)
"""Setting: weight of the likelihood, and step between bins, of the stage far from the mode."""

COMPARISON_TOLERANCE = 0.01
"""Numerical: squared length of the last step, in standard deviations, if results are only compared."""


class RotorBand(NamedTuple):
    """One band.

    Attributes
    ----------
    model
        Its spectrum as a function of the unknowns.
    smoothed
        The same smoothed by the taper's window; None where `model` is.
    rows
        What its entries are.
    """

    model: LiftedModel
    smoothed: LiftedModel | None
    rows: tuple[Row, ...]


class RotorBandFit(NamedTuple):
    """The mode of a posterior, and the model that has it."""

    model: "BandModel"
    mode: SpectralMode


class BandModel(NamedTuple):
    """The bands of a record: models of the same parameters."""

    bands: tuple[RotorBand, ...]

    @property
    def unknowns(self) -> Unknowns:
        """Names of the unknowns."""
        return self.bands[0].model.unknowns._replace(statistics=tuple(s.name for s in self.statistics))

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """Statistics of η."""
        return tuple(s for band in self.bands for s in band.model.statistics)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the unknowns."""
        mean, spread = np.zeros((2, self.unknowns.size))
        for band, place in zip(self.bands, self.places(), strict=True):
            mean[place], spread[place] = band.model.prior
        return mean, spread

    def places(self) -> list[NDArray[np.intp]]:
        """For each band which of the unknowns are its own."""
        known, places = self.unknowns, []
        every = np.arange(known.size)
        first = known.of("statistics").start
        for band in self.bands:
            count = len(band.model.statistics)
            own = every[first : first + count]
            places.append(np.r_[every[known.of("parameters", "lag")], own, every[known.of("tolerances", "clocks")]])
            first += count
        return places

    def likelihood(self, unknowns: Array, every: int = 1) -> tuple[float, Array, Array]:
        """J, g and F without the prior; of wide modes every n-th bin, as much as all of them would be.

        Raises
        ------
        LinAlgError
            Where a spectrum is not positive definite.
        """
        n = len(unknowns)
        value, gradient, information = 0.0, np.zeros(n), np.zeros((n, n))
        matrices = self.bands[0].model.matrices(unknowns[self.places()[0]], slopes=True)
        for band, place in zip(self.bands, self.places(), strict=True):
            found = band.model.likelihood(unknowns[place], every, matrices=matrices)
            value += found.value
            gradient[place] += found.gradient
            information[np.ix_(place, place)] += found.information
        return value, gradient, information

    def start_from(self, unknowns: Array, other: "BandModel") -> Array:
        """The unknowns (n,) of another model as those of this one: levels that both have stay what they are."""
        levels = zip(other.statistics, unknowns[other.unknowns.of("statistics")].tolist(), strict=True)
        known = {theirs.name: eta + math.log(theirs.given) for theirs, eta in levels}
        found = self.unknowns.from_other(unknowns, other.unknowns)
        ours = [known.get(s.name, math.log(s.given)) - math.log(s.given) for s in self.statistics]
        found[self.unknowns.of("statistics")] = ours
        return found

    def admit(self, at: Array, inexact: Inexact) -> "RotorBandFit":
        """The mode of the posterior with instruments and masses as additional unknowns besides, looked for from that
        without (n,)."""
        wide = self.with_inexact(inexact)
        start = wide.unknowns.from_other(at, self.unknowns)
        found = find_nearby(wide.likelihood, start, wide.prior)
        if not found.converged:
            found = find_in_stages(wide.likelihood, found.point, wide.prior, WHOLE, tolerance=COMPARISON_TOLERANCE)
        return RotorBandFit(wide, found)

    def near(self, start: Array) -> Array:
        """Unknowns (n,) roughly at the mode of the posterior, looked for from afar."""
        return find_in_stages(self.likelihood, start, self.prior, ROUGH).point

    def fit(self, start: Array) -> RotorBandFit:
        """The mode of the posterior, looked for from `start` (n,).

        What the taper's window adds to the spectra of wide modes, and how alike gusts make neighbouring bins, is taken
        at the mode without them, and the mode found anew.
        """
        mode = find_in_stages(self.likelihood, start, self.prior, WHOLE, tolerance=COMPARISON_TOLERANCE)
        whole = self.smeared_at(mode.point)
        return RotorBandFit(whole, find_in_stages(whole.likelihood, mode.point, self.prior, WHOLE))

    def scores(self, unknowns: Array) -> tuple[Array, Array, Array]:
        """Base frequency (P,) [Hz], gradient (P, n) and Fisher information (P, n, n) of parts of the bands."""
        found = []
        for band, at in zip(self.bands, self.places(), strict=True):
            (g, F), own = band.model.scores(unknowns[at]), np.eye(len(unknowns))[at]
            found.append((np.linspace(band.model.base[0], band.model.base[-1], len(g)), g @ own, own.T @ F @ own))
        places, gradients, information = (np.concatenate(each) for each in zip(*found, strict=True))
        return places, gradients, information

    def with_inexact(self, inexact: Inexact) -> "BandModel":
        """The model with instruments and masses as additional unknowns."""
        return BandModel(tuple(b._replace(model=b.model._replace(inexact=inexact)) for b in self.bands))

    def smeared_at(self, unknowns: Array) -> "BandModel":
        """The model with what the taper's window adds to wide modes at the unknowns (n,), and with c_h of the
        record."""
        bands = []
        for band, place in zip(self.bands, self.places(), strict=True):
            if band.smoothed is not None:
                at = unknowns[place]
                smear = band.smoothed.spectrum(at).spectrum - band.model.spectrum(at).spectrum
                band = band._replace(model=band.model._replace(smear=smear))
            bands.append(band)
        return BandModel(tuple(bands))._with_gusts(unknowns)

    def _with_gusts(self, unknowns: Array) -> "BandModel":
        """Problem with c_h from the record: that of the taper, or more. Bands have few bins, so all have one."""
        models = [band.model for band in self.bands]
        told = [
            m.shared_by_neighbours(m.spectrum(unknowns[at]).spectrum)
            for m, at in zip(models, self.places(), strict=True)
        ]
        alike = 1.0 + 2.0 * sum(shared * count for shared, count in told) / sum(count for _, count in told)
        bands = (
            b._replace(model=b.model._replace(overlap=b.model.gusts * max(b.model.overlap, alike))) for b in self.bands
        )
        return BandModel(tuple(bands))
