"""Regressors: waveforms of known shape and unknown size, in readings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from windsysid._types import Array
from windsysid.identification.model.agreement import compare
from windsysid.identification.model.fit import Outcome
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["Constant", "Legendre", "Regressors", "StepAt", "Term", "Waveform", "widening_of"]


class Waveform(Protocol):
    """A function of time, of size one."""

    def __call__(self, time: Array, /) -> Array:
        """Its values (T,) at times (T,) [s]."""


@dataclass(frozen=True)
class Constant:
    """1."""

    def __call__(self, time: Array, /) -> Array:
        """See `Waveform`."""
        return np.ones(len(time))


@dataclass(frozen=True)
class Legendre:
    """The Legendre polynomial of an order over a section [s]."""

    order: int
    first: float
    last: float

    def __call__(self, time: Array, /) -> Array:
        """See `Waveform`."""
        x = 2.0 * (time - self.first) / (self.last - self.first) - 1.0
        return np.asarray(np.polynomial.legendre.legval(x, [0.0] * self.order + [1.0]))


@dataclass(frozen=True)
class StepAt:
    """0 before a time [s], 1 from there on."""

    time: float

    def __call__(self, time: Array, /) -> Array:
        """See `Waveform`."""
        return np.asarray(time >= self.time, dtype=np.float64)


class Term(NamedTuple):
    """A waveform in a channel.

    Attributes
    ----------
    channel, unit
        Of the readings.
    wave
        Of size one.
    size, std
        The estimate of its size, and its standard deviation, in the channel's unit.
    """

    channel: str
    unit: str
    wave: Waveform
    size: float
    std: float


@dataclass(frozen=True)
class Regressors:
    """Waveforms that a job includes: the mean of the readings without the structure.

    Attributes
    ----------
    code
        Of the effect.
    describe
        The numbers that say what its terms in one channel are.
    terms
        What is subtracted from the readings before the structure is fitted.
    widenings
        For each channel, what the uncertainty of its terms adds to the covariance of the fit's unknowns (n, n).
    before
        For each channel, the fit that lacked its terms.
    revisions
        For each channel, how often the sizes of its terms were estimated again.
    """

    code: str
    describe: Callable[[Sequence[Term]], dict[str, Any]]
    terms: tuple[Term, ...] = ()
    widenings: Mapping[str, Array] = field(default_factory=dict)
    before: Mapping[str, Outcome] = field(default_factory=dict)
    revisions: Mapping[str, int] = field(default_factory=dict)

    def of(self, channel: str) -> tuple[Term, ...]:
        """The terms in a channel."""
        return tuple(term for term in self.terms if term.channel == channel)

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        """Subtract the waveforms."""
        held = {term.channel: record[term.channel] for term in self.terms}
        for term in self.terms:
            held[term.channel] = held[term.channel] - term.size * term.wave(record.time)
        known = {channel: (values, record.unit(channel)) for channel, values in held.items()}
        return record.with_channels(known), tuple(sensors)

    def finding(self, channel: str, shift: tuple[str, float] | None) -> Finding:
        """Terms in a channel, and the estimate that they shift, in standard deviations."""
        terms, (name, sigmas) = self.of(channel), shift or ("", 0.0)
        data = {"channel": channel, "unit": terms[0].unit, **self.describe(terms), "sigmas": sigmas}
        return Finding(self.code, "note", data, (name,) if name else ())

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        """Terms, and differences of estimates from those of the fit without them."""
        return tuple(self.finding(channel, compare(outcome, before)) for channel, before in self.before.items())


def widening_of(effects: Sequence[object], n: int) -> Array:
    """Covariance that the uncertain sizes of included regressors and forces add to n unknowns (n, n)."""
    total = np.zeros((n, n))
    for effect in effects:
        for one in getattr(effect, "widenings", {}).values():
            total += one if one.shape == total.shape else 0.0
    return total
