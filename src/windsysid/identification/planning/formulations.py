"""Information of a planned record, by the formulation of the later identification.

Filters: the information of one long simulated record (`windsysid.identification.planning.information`). Spectra: that
of a few of the planned length (`windsysid.identification.planning.spectral_information`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid.errors import WindsysidError
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.identification.planning.information import planned_information
from windsysid.identification.planning.spectral_information import PlannedInformation, PlannedRecord, planned_spectra
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.loads.rotor_wind import RotorWind
from windsysid.output.progress import Progress
from windsysid.results.tolerance import Tolerance
from windsysid.turbine.turbine import Turbine
from windsysid.units import spell

__all__ = ["BY_FORMULATION", "Planned"]

SIMULATED_RELAXATIONS = 100.0
"""Setting: how many times the energy of the least damped mode is renewed in the simulated record: σ is then known to
1/(2√100) = 5 %."""

MAX_SIMULATED_SAMPLES = 50_000
"""Setting: samples of the simulated record, whatever the damping."""


class Planned(NamedTuple):
    """Plan of a record: turbine, unknown parameters, rate [Hz], duration [s], the slowest decay [1/s], time until the
    filter finds the state [s], every how many-th sample is simulated, the seed, the progress callback."""

    turbine: Turbine
    unknown: tuple[str, ...]
    rate: float
    duration: float
    damping: float
    finding: float
    thinning: int
    seed: int
    progress: Progress

    @property
    def simulated_rate(self) -> float:
        """[Hz]."""
        return self.rate / self.thinning

    @property
    def turns(self) -> bool:
        """True if a rotor with blades turns, which wind can drive."""
        return HYPOTHESES[RotorWind.name].applies_to(self.turbine)

    @property
    def settling(self) -> float:
        """Until the vibration is stationary [s]."""
        return min(3.0 / self.damping, self.most)

    @property
    def most(self) -> float:
        """The longest record that is simulated [s]."""
        return max(MAX_SIMULATED_SAMPLES / self.simulated_rate, 2.0 * self.finding)

    @property
    def thinned(self) -> Turbine:
        """The turbine with sensors that have noise of the same spectral density in the samples that are simulated."""
        factor = 1.0 / math.sqrt(self.thinning)
        sensors = (s.model_copy(update={"noise": factor * s.noise}) for s in self.turbine.sensors)
        return replace(self.turbine, sensors=tuple(sensors))


def _by_filters(planned: Planned) -> PlannedInformation:
    """Information for filters, under the loads of the turbine file."""
    length = min(max(SIMULATED_RELAXATIONS / planned.damping, 20.0 * planned.finding), planned.most)
    planned.progress(f"simulating {spell(length)}", None)
    problem = _simulated(planned, length)
    start, growths = planned_information(problem, planned.simulated_rate, planned.finding, planned.progress)
    names = (*planned.unknown, *(s.name for s in problem.statistics), *(one.name for one in problem.tolerances))
    return PlannedInformation(
        names, start, growths, problem.tolerances, length, (_rests_on("filters", length, problem.tolerances),)
    )


def _by_spectra(planned: Planned) -> PlannedInformation:
    """Information for spectra, under wind where a rotor turns, else under loads of any smooth spectrum."""
    length = min(planned.duration, planned.most)
    loads = RotorWind.name if planned.turns else "random"
    record = PlannedRecord(planned.thinned, planned.simulated_rate, planned.settling, length, planned.seed, loads)
    told = planned_spectra(record, planned.unknown, planned.progress)
    return told._replace(notes=(_rests_on("spectra", told.length, told.tolerances), *told.notes))


def _by_what_fits(planned: Planned) -> PlannedInformation:
    """As `windsysid.identify` takes a record of the turbine file's loads."""
    if planned.turns:
        told = _by_filters(planned)
        return told._replace(notes=(*told.notes, "for a rotor in wind, plan with the spectral formulation"))
    try:
        told = _by_spectra(planned)
    except (WindsysidError, np.linalg.LinAlgError):
        return _by_filters(planned)
    return told if told.fits else _by_filters(planned)


def _simulated(planned: Planned, length: float) -> TurbineProblem:
    """The problem that a record of the planned kind poses, from stationary vibration."""
    turbine, settling = planned.thinned, min(planned.settling, length)
    record = PlannedRecord(turbine, planned.simulated_rate, settling, length, planned.seed)
    return pose(record.drawn(), turbine, turbine.sensors, Prior(), planned.unknown)


def _rests_on(what: str, length: float, tolerances: Sequence[Tolerance]) -> str:
    unknown = "loads and noise unknown too, of the kind in the turbine file"
    if tolerances:
        unknown += ", instruments and masses within their tolerances"
    return f"from the data alone, no prior, by {what}; {unknown}; from {spell(length)} of simulated vibration"


BY_FORMULATION = {"auto": _by_what_fits, "joint": _by_filters, "spectral": _by_spectra}
