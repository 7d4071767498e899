"""Values of an identification's result: saved, shown and compared."""

from dataclasses import dataclass, field

import numpy as np

from windsysid._types import Array
from windsysid.checks.verdict import Diagnosis
from windsysid.loads.statistics import Statistic
from windsysid.results.budget import Budget
from windsysid.results.estimate import Estimate, FittedSpectrum, Loads
from windsysid.results.finding import Finding
from windsysid.results.mode import Mode
from windsysid.results.posterior import NOT_RECORDED, SIGMAS, Conditions
from windsysid.results.provenance import Provenance
from windsysid.results.tolerance import Tolerance
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["IdentificationValues"]


@dataclass(frozen=True)
class IdentificationValues:
    """The values of an identification; `windsysid.results.Identification` says what each is."""

    method: str
    formulation: str
    record: str
    turbine: str
    sensors: tuple[str, ...]
    section: tuple[float, float]
    rate: float
    samples: int
    elapsed: float
    estimates: tuple[Estimate, ...]
    modes: tuple[Mode, ...]
    parameters: tuple[Parameter, ...]
    time: Array
    mean: Array
    std: Array
    cov: Array
    readings: tuple[str, ...]
    innovation: Array
    whitened: Array
    log_likelihood: float
    statistics: tuple[Statistic, ...] = ()
    loads: Loads | None = None
    machine: Turbine | None = None
    conditions: Conditions = NOT_RECORDED
    provenance: Provenance | None = None
    joint_cov: Array | None = None
    tolerances: tuple[Tolerance, ...] = ()
    budget: Budget = field(default_factory=Budget)
    spectra: tuple[FittedSpectrum, ...] = ()
    diagnosis: Diagnosis = field(kw_only=True)

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of one coefficient."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(f"'{name}' was not identified: expected one of {', '.join(e.name for e in self.estimates)}")

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings for the reader, as data."""
        return self.diagnosis.findings

    @property
    def notes(self) -> tuple[str, ...]:
        """Processing of the record and the model, in sentences."""
        return self.diagnosis.sentences("note")

    @property
    def innovation_time(self) -> Array:
        """Times of the readings of `innovation` [s]: the whole record, or its end if it was processed in segments."""
        if len(self.innovation) == len(self.time):
            return self.time
        return self.section[1] - np.arange(len(self.innovation))[::-1] / self.rate

    def history(self, name: str) -> tuple[Array, Array, Array]:
        """Estimate, low and high of the coefficient `name` after each sample, (T,) each, in its SI unit."""
        i = [parameter.name for parameter in self.parameters].index(self[name].name)
        middle, spread = self.mean[:, i], SIGMAS * self.std[:, i]
        values = (self.parameters[i].physical(theta) for theta in (middle, middle - spread, middle + spread))
        return next(values), next(values), next(values)
