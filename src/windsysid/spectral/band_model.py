"""Several bands of a record as one function of the unknowns: their likelihoods multiply, the mechanics are shared.

The unknowns are those of `windsysid.spectral.lifted_model.LiftedModel`: the coefficients θ and the mean lag angle,
which all bands share, then the statistics of loads and readings, band by band.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.loads.statistics import Statistic
from windsysid.spectral.lifted_model import LiftedModel
from windsysid.spectral.scoring import Mode, find_mode

__all__ = ["BandModel"]

STAGES = ((0.2, 1), (1.0, 1))
"""Weights of the likelihood, stage by stage."""


class BandModel(NamedTuple):
    """The bands of a record.

    Attributes
    ----------
    bands
        One model each, of the same parameters.
    """

    bands: tuple[LiftedModel, ...]

    @property
    def shared(self) -> int:
        """How many unknowns all bands share: θ, and the mean lag angle where it is one."""
        return len(self.bands[0].parameters) + self.bands[0].lag

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """What η stands for."""
        return tuple(s for band in self.bands for s in band.statistics)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the unknowns."""
        each = [band.prior for band in self.bands]
        mean, spread = (
            np.concatenate([each[0][i][: self.shared], *(part[i][self.shared :] for part in each)]) for i in (0, 1)
        )
        return mean, spread

    def places(self) -> list[NDArray[np.intp]]:
        """For each band which of the unknowns are its own."""
        places, first = [], self.shared
        for band in self.bands:
            count = len(band.statistics)
            places.append(np.r_[0 : self.shared, first : first + count])
            first += count
        return places

    def likelihood(self, unknowns: Array) -> tuple[float, Array, Array]:
        """J, g and F without the prior.

        Raises
        ------
        LinAlgError
            Where a spectrum is not positive definite.
        """
        n = len(unknowns)
        value, gradient, information = 0.0, np.zeros(n), np.zeros((n, n))
        for band, place in zip(self.bands, self.places(), strict=True):
            found = band.likelihood(unknowns[place])
            value += found.value
            gradient[place] += found.gradient
            information[np.ix_(place, place)] += found.information
        return value, gradient, information

    def mode(self, start: Array, stages: Sequence[tuple[float, int]] = STAGES) -> Mode:
        """The mode of the posterior, looked for from `start` (n,)."""
        mean, spread = self.prior
        return find_mode(lambda u, _: self.likelihood(u), start, mean, spread, stages)
