"""The published comparison's particle filter: SIR with 2 000 particles on the paper's force balance.

The paper compares its extended Kalman filter (30 s) with it (103 hours, similar errors). What particle filters are
worth on other problems: ``python -m validation.particles``.
"""

import time
from dataclasses import replace
from typing import NamedTuple

from windsysid._types import Array
from windsysid.filters import Info, ParticleFilter, degeneracy
from windsysid.identification.estimate.force_balance import Balance, analysis_band, balance_statespace
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import identifiable
from windsysid.identification.verdict.conclude import conclude
from windsysid.results.finding import Finding
from windsysid.results.identification import Identification
from windsysid.statespace.compose import StateSpace
from windsysid.study.arms import START
from windsysid.study.scenario import RATE, SECTION, StudyReference
from windsysid.turbine.turbine import Turbine

__all__ = ["PUBLISHED_HOURS", "SIR", "LinearCase", "force_balance_case", "identify_section_by_particles"]


SIR = ParticleFilter(particles=2000)
"""As many particles as the paper has."""

PUBLISHED_HOURS = 103.0
"""Published computing time of the SIR particle filter."""


class LinearCase(NamedTuple):
    """A linear Gaussian model with its record."""

    model: StateSpace
    inputs: Array
    readings: Array


def identify_section_by_particles(
    turbine: Turbine,
    reference: StudyReference,
    balance: Balance,
    filter_: ParticleFilter = SIR,
    section: tuple[float, float] = SECTION,
) -> Identification:
    """`windsysid.study.arms.identify_section` with a particle filter instead of the extended Kalman filter.

    The notes say how the particles fared.
    """
    case = force_balance_case(turbine, balance, section)
    start = filter_.init(case.model)
    filter_.run(
        case.model, start, case.inputs[:2], case.readings[:2]
    )  # compiles or loads the kernels outside the clock
    began = time.perf_counter()
    cloud, info = filter_.run(case.model, start, case.inputs, case.readings)
    elapsed = time.perf_counter() - began
    window = slice(round(section[0] * RATE), round(section[1] * RATE))
    outcome = Outcome(
        turbine, case.model, info.mean, info.std, Info(**{name: getattr(info, name) for name in Info._fields}),
        cloud.mean, cloud.cov, reference.inputs[window, :3],
        tuple(c for c in reference.record.channels if not c.startswith("rotor")), elapsed,
        (Finding("particle_weights", "note", {"text": degeneracy(info)}),),
    )  # fmt: skip
    found = conclude(outcome, reference.record.section(*section), "force-balance")
    return replace(found, method=filter_.name)


def force_balance_case(turbine: Turbine, balance: Balance, section: tuple[float, float]) -> LinearCase:
    """A section of the force balance as a linear model with its record."""
    window = slice(round(section[0] * RATE), round(section[1] * RATE))
    cut = Balance(balance.force[window], balance.regressors[window])
    parameters = START.parameters(turbine, identifiable(turbine), linear=True)
    model, inputs = balance_statespace(
        cut, turbine.model.coordinates, parameters, rate=RATE, band=analysis_band(turbine)
    )
    return LinearCase(model, inputs, cut.force)
