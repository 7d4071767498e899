"""Job of an identification, and the fit of a formulation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeVar

from windsysid.checks.lines import Line
from windsysid.identification.condition.readings import resample_for_model, screened, usable_sensors, without_faulty
from windsysid.identification.model.effect import Inclusion
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.inspection.fault import Fault
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["Conditioned", "FittedJob", "Formulation", "Job"]

_Included = TypeVar("_Included", bound=Inclusion)

Formulation = Literal["joint", "force-balance", "spectral"]


class Conditioned(NamedTuple):
    """A record without faulty readings, corrected for the effects that a job includes.

    Attributes
    ----------
    record, sensors, faults
        The record, its sensors, and the faults of their channels.
    steps, notes
        Samples of the record for each reading, and what resampling did.
    """

    record: Record
    sensors: tuple[Sensor, ...]
    faults: Sequence[Fault]
    steps: int = 1
    notes: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Job:
    """Arguments of `windsysid.identify`.

    Attributes
    ----------
    record, part
        The record, and its section that is identified.
    turbine, sensors, prior, parameters, rate, loads
        As for `windsysid.identify`.
    formulation
        By which the question is answered.
    effects
        Effects that the model includes.
    """

    record: Record
    part: Record
    turbine: Turbine
    sensors: Sequence[Sensor] | None
    prior: Prior | None
    parameters: Sequence[str] | None
    rate: float | None
    loads: str
    formulation: Formulation = "joint"
    effects: tuple[Inclusion, ...] = ()

    @property
    def filtered(self) -> bool:
        """True if filters read the samples."""
        return self.formulation == "joint"

    def by(self, formulation: Formulation) -> "Job":
        """Job for another formulation."""
        return replace(self, formulation=formulation)

    def including(self, effect: Inclusion) -> "Job":
        """Job with an effect, in place of one of its code."""
        return replace(self, effects=(*self.without(effect.code).effects, effect))

    def with_effects_of(self, other: "Job", *codes: str) -> "Job":
        """Job with those effects of another job that have these codes."""
        return replace(self, effects=tuple(one for one in other.effects if one.code in codes))

    def without(self, code: str) -> "Job":
        """Job without the effect of this code."""
        return replace(self, effects=tuple(one for one in self.effects if one.code != code))

    def included(self, code: str) -> Inclusion | None:
        """The effect of this code, if it is included."""
        return next((one for one in self.effects if one.code == code), None)

    def inclusion(self, kind: type[_Included]) -> _Included | None:
        """The effect of this class, if it is included."""
        return next((one for one in self.effects if isinstance(one, kind)), None)

    def condition(self) -> Conditioned:
        """The readings as the model has them."""
        part = self.part.on_own_times() if self.filtered else self.part.on_uniform_grid()
        sensors = usable_sensors(part, self.turbine, self.sensors)
        part, faults = without_faulty(part, screened(self.part, self.turbine, sensors))
        for effect in self.effects:
            part, sensors = effect.correct(part, self.turbine, sensors, filtered=self.filtered)
        return Conditioned(part, sensors, faults)

    def resampled(self) -> Conditioned:
        """The readings at the rate that filters of the model need."""
        at = self.condition()
        read, steps, notes = resample_for_model(
            at.record, self.turbine, self.rate, self.sensors or self.turbine.sensors
        )
        return at._replace(record=read, steps=steps, notes=notes)

    def notes(self, outcome: Outcome) -> tuple[Finding, ...]:
        """Notes on the effects that a fit includes."""
        return tuple(note for effect in self.effects for note in effect.notes(outcome, filtered=self.filtered))


class FittedJob(NamedTuple):
    """Result of a formulation.

    Attributes
    ----------
    formulation, outcome
        Which one, and what it found.
    read, sensors, faults
        The record that it read, with which sensors, and the faults of their channels.
    prior
        As it was in the end.
    line
        What stands out most of the readings near a mode, if anything depends on it.
    unmodelled
        What effects that are not included say against it.
    """

    formulation: Formulation
    outcome: Outcome
    read: Record
    sensors: tuple[Sensor, ...]
    faults: Sequence[Fault]
    prior: Prior = Prior()
    line: Line | None = None
    unmodelled: tuple[Finding, ...] = ()

    def noting(self, note: Finding, *doubts: Finding) -> "FittedJob":
        """Fit with a note and the findings against it."""
        fit = self.doubted(*doubts)
        return fit._replace(outcome=fit.outcome._replace(notes=(*fit.outcome.notes, note)))

    def doubted(self, *doubts: Finding) -> "FittedJob":
        """Fit with findings against it."""
        return self._replace(outcome=self.outcome._replace(doubts=(*self.outcome.doubts, *doubts)))

    def lacking(self, *unmodelled: Finding) -> "FittedJob":
        """Fit with findings on effects that are not included."""
        return self._replace(unmodelled=(*self.unmodelled, *unmodelled))
