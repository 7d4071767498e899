"""The drift of a logger's clock, as a value."""

import math
from typing import NamedTuple

from windsysid.checks.limits import CONFLICT_SIGMAS, NEGLIGIBLE_SHARE
from windsysid.identification.limits import MAX_DRIFT_RATE
from windsysid.identification.model.prior_odds import sigma_bound
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["Drift"]


class Drift(NamedTuple):
    """A clock that drifts.

    Attributes
    ----------
    logger
        Whose it is.
    rate, std
        By how much more it is late in every second [s/s], and the standard deviation of that.
    by
        What shows it.
    """

    logger: str
    rate: float
    std: float
    by: str = "gravity in its readings"

    @property
    def note(self) -> Finding:
        """That readings were put back."""
        return Finding("clock_drift", "note", self._asdict())

    def matters(self, turbine: Turbine, duration: float) -> bool:
        """Test whether it is significant, no faster than clocks drift, and shifts vibration in such a record [s]."""
        fastest = max((turbine.natural_frequency(name) for name in turbine.model.coordinates), default=0.0)
        least = NEGLIGIBLE_SHARE / (fastest * duration) if fastest > 0.0 else math.inf
        sigmas = sigma_bound(CONFLICT_SIGMAS, "clock_drift", turbine)
        return max(sigmas * self.std, least) < abs(self.rate) < MAX_DRIFT_RATE
