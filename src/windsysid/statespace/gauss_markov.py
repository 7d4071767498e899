"""The Gauss–Markov load: a first-order process on one degree of freedom, or a wandering harmonic of the rotor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    from windsysid._types import Array
    from windsysid.statespace.process import Process

__all__ = ["GaussMarkov"]


CUT_OFF_FACTOR = 1.08
"""Cut-off of a second-order Butterworth filter over the low-pass's frequency.

Samples at twice that have the spectrum of a process cut off there, to within 5 % rms.
"""


@dataclass(frozen=True)
class GaussMarkov:
    """First-order Gauss–Markov load on one degree of freedom: mean zero, correlation exp(−|t| / time_constant).

    With a `harmonic` n, a rotor harmonic nP of varying amplitude: a cos nψ + b sin nψ, where a and b are two such
    processes.

    Attributes
    ----------
    load
        Name of the model's load.
    rms
        Stationary standard deviation [N or N·m].
    time_constant
        Correlation time [s].
    harmonic
        n; 0: the process itself.
    low_pass
        Cut-off [Hz] of the anti-aliasing low-pass of the record: the process is then filtered by a Butterworth low-pass
        at `CUT_OFF_FACTOR` times that frequency. Without it, samples of the process contain power from above half the
        sampling rate that the record does not, which biases the damping of a mode.

    References
    ----------
    Särkkä & Solin, Applied Stochastic Differential Equations, Cambridge 2019, ch. 6.

    Examples
    --------
    >>> import windsysid as ws
    >>> load = ws.models.GaussMarkov("load_x", rms=2e4, time_constant=1.0)  # [N], [s]
    >>> transition, noise = load.discretise(0.5)
    >>> transition.round(3).tolist(), (noise / 1e8).round(3).tolist()
    ([[0.607]], [[2.528]])
    >>> ws.models.GaussMarkov("load_x", rms=5e3, time_constant=10.0, harmonic=3).states
    ('load_x_3P_cosine', 'load_x_3P_sine')
    """

    load: str
    rms: float
    time_constant: float
    harmonic: int = 0
    low_pass: float = math.inf

    def __post_init__(self) -> None:
        if not (self.rms > 0.0 and self.time_constant > 0.0 and math.isfinite(self.rms * self.time_constant)):
            raise ConfigurationError(
                f"load '{self.load}': expected a positive rms and time constant, got {self.rms} and"
                f" {self.time_constant}"
            )

    @property
    def states(self) -> tuple[str, ...]:
        """The load is its own state; a harmonic has two, a and b."""
        line = f"{self.load}_{self.harmonic}P"
        if self.harmonic:
            return (f"{line}_cosine", f"{line}_sine")
        return (
            (self.load,)
            if math.isinf(self.low_pass)
            else tuple(f"{self.load}{end}" for end in ("", "_rate", "_acceleration"))
        )

    @property
    def _passed(self) -> "Process | None":
        """The process behind the low-pass, where there is one."""
        if self.harmonic or math.isinf(self.low_pass):
            return None
        from windsysid.statespace.process import rational

        pole = 2.0 * math.pi * CUT_OFF_FACTOR * self.low_pass * complex(-math.sqrt(0.5), math.sqrt(0.5))
        return rational(self.rms, [-1.0 / self.time_constant, pole, pole.conjugate()])

    @property
    def cov(self) -> "Array":
        """Stationary covariance (n, n)."""
        import numpy as np

        passed = self._passed
        return self.rms**2 * np.eye(len(self.states)) if passed is None else passed.cov

    @property
    def outputs(self) -> "Mapping[str, Array]":
        """It drives its own degree of freedom."""
        import numpy as np

        if passed := self._passed:
            return {self.load: passed.value[None]}
        if not self.harmonic:
            return {self.load: np.ones((1, 1))}
        rows = np.zeros((1 + 2 * self.harmonic, 2))
        rows[-2:] = np.eye(2)
        return {self.load: rows}

    def discretise(self, step: float) -> "tuple[Array, Array]":
        """Φ and Q (n, n) over `step` [s], exact."""
        import numpy as np

        from windsysid.statespace.process import discretise_block

        if passed := self._passed:
            return discretise_block(passed.drift, passed.cov, step)
        variance = self.rms**2 * -np.expm1(-2.0 * step / self.time_constant)
        one = np.eye(len(self.states))
        return np.exp(-step / self.time_constant) * one, variance * one
