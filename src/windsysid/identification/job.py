"""What a caller of `identify` asks, and what a formulation finds."""

from collections.abc import Sequence
from typing import NamedTuple

from windsysid.identification.condition.readings import usable_sensors
from windsysid.identification.effects.clock_drift import Drift
from windsysid.identification.effects.sinusoid import APART, Sine, without_sines
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.verdict.conclude import Formulation
from windsysid.identification.verdict.influence import Dependence
from windsysid.inspection.fault import Fault
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["Asked", "Found"]


class Asked(NamedTuple):
    """What a caller of `identify` wants to know.

    Attributes
    ----------
    record, part
        The record, and its section that is asked about.
    turbine, sensors, prior, parameters, rate, loads
        As for `windsysid.identification.identify`.
    sines
        Steady lines that were found before.
    near
        Where filters that knew less have ended.
    spectra
        What spectra have said of the same.
    drifts
        Drifts of clocks that were found before.
    leaning
        Whether sensors that feel gravity may drift, too (`windsysid.identification.effects.random_walk_bias`).
    """

    record: Record
    part: Record
    turbine: Turbine
    sensors: Sequence[Sensor] | None
    prior: Prior | None
    parameters: Sequence[str] | None
    rate: float | None
    loads: str
    sines: tuple[Sine, ...] = ()
    near: Outcome | None = None
    spectra: "Found | None" = None
    drifts: tuple[Drift, ...] = ()
    leaning: bool = False

    @property
    def quiet(self) -> Record:
        """The part without the steady lines that were found."""
        if not self.sines:
            return self.part
        return without_sines(self.part, self.turbine, usable_sensors(self.part, self.turbine, self.sensors), self.sines)

    def with_sines(self, sines: Sequence[Sine], found: Outcome) -> "Asked":
        """The same with more steady lines that were found, where a search has ended near if they bend it little."""
        known, apart = [*self.sines], APART / self.part.duration
        for sine in sines:
            if not any(sine.same_as(other, apart) for other in known):
                known.append(sine)
        bent = any(not sine.order for sine in known[len(self.sines) :])
        return self._replace(sines=tuple(known), near=None if bent else found, spectra=None)


class Found(NamedTuple):
    """What a formulation found.

    Attributes
    ----------
    formulation, outcome
        Which one, and what it found.
    read, sensors, faults
        The record that it read, with which sensors, and the faults of their channels.
    prior
        As it was in the end.
    drifts
        Drifts of clocks whose readings were put back.
    dependence
        The frequency that a coefficient depends on.
    felt
        Steady lines that are left in the innovations.
    narrow
        What a narrow-band load says against it.
    """

    formulation: Formulation
    outcome: Outcome
    read: Record
    sensors: tuple[Sensor, ...]
    faults: Sequence[Fault]
    prior: Prior = Prior()
    drifts: tuple[Drift, ...] = ()
    dependence: Dependence | None = None
    felt: tuple[Sine, ...] = ()
    narrow: tuple[Finding, ...] = ()

    def saying(self, note: Finding, *doubts: Finding) -> "Found":
        """The same with a note, and what speaks against it."""
        found = self.doubted(*doubts)
        return found._replace(outcome=found.outcome._replace(notes=(*found.outcome.notes, note)))

    def doubted(self, *doubts: Finding) -> "Found":
        """The same with what speaks against it."""
        return self._replace(outcome=self.outcome._replace(doubts=(*self.outcome.doubts, *doubts)))

    def beside(self, *narrow: Finding) -> "Found":
        """The same with what a narrow-band load says against it."""
        return self.doubted(*narrow)._replace(narrow=narrow)
