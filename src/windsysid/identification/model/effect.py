"""Nuisance effects: components of a record that do not come from the structure.

An effect is a few parameters φ that are added to the model, φ = 0 being the model without it. Every effect is one file
in `windsysid.identification.effects`, and its line in the registry there; the loop that detects, includes and confirms
effects is `windsysid.identification.pipeline`. Data are never edited for good: an included effect corrects what the
model reads, each time from the record as it is.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol

from windsysid.identification.model.fit import Outcome
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

if TYPE_CHECKING:
    from windsysid.identification.job import FittedJob, Job

__all__ = ["Detection", "Effect", "Inclusion"]


class Inclusion(Protocol):
    """An effect as the model takes it into account; a subclass may leave the readings as they are, without a note."""

    @property
    def code(self) -> str:
        """Of the effect; a job includes one of each."""

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        """The record and the sensors that know of the effect, as filters read them or spectra."""
        return record, tuple(sensors)

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        """Note on the effect for the reader of the result."""
        return ()


class Detection(NamedTuple):
    """Result of a test of an effect on a fit.

    Attributes
    ----------
    fit
        The fit that was tested, with what is to be said if the effect is not included.
    inclusion
        The effect as it is to be included; None where that is not warranted.
    log10_odds
        Prior odds times evidence: the evidence is −log₁₀ of the chance of the test's statistic without the effect, or
        log₁₀ of odds.
    start
        The fit from which the search that includes the effect begins; None where that begins at the prior.
    """

    fit: "FittedJob"
    inclusion: Inclusion | None = None
    log10_odds: float = 0.0
    start: "FittedJob | None" = None


class Effect:
    """One kind of nuisance effect: subclasses define its detection."""

    code: ClassVar[str]
    """Its name in programs, such as ``clock_drift``."""

    def find(self, job: "Job") -> Inclusion | None:
        """The effect where readings alone show it, before anything is fitted."""
        return None

    def detect(self, job: "Job", fit: "FittedJob") -> Detection:
        """Test whether a fit lacks the effect."""
        return Detection(fit)

    def confirm(self, job: "Job", found: Detection, after: "FittedJob") -> "FittedJob | None":
        """Fit that includes the effect, with its finding; None to keep the one before."""
        return after
