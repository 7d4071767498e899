"""The paper's filter on a reference record: the force balance of all of it, and the identification of a section."""

from typing import Literal

from windsysid._types import Array
from windsysid.identification.estimate.force_balance import (
    Balance,
    MeasuredMotion,
    analysis_band,
    balance_forces,
    filter_balance,
    measured_motion,
)
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.identification.verdict.conclude import conclude
from windsysid.results.identification import Identification
from windsysid.study.scenario import RATE, SECTION, StudyReference
from windsysid.turbine.turbine import Turbine

__all__ = ["START", "identify_section", "record_balance"]


START = Prior(stiffness=1.3, damping=0.7, spread=1.0)
"""Start of every identification of the study."""


def record_balance(
    turbine: Turbine,
    reference: StudyReference,
    loads: Array | None,
    jacobian: Literal["exact", "differences"] = "exact",
) -> Balance:
    """The force balance of a whole record, with these loads (T, n) or none."""
    band = analysis_band(turbine)
    motion = measured_motion(reference.record, turbine, cutoff=band[0] / 2.0)
    measured = MeasuredMotion(motion, reference.inputs[:, :3], loads, RATE)
    return balance_forces(turbine, measured, identifiable(turbine), band, jacobian=jacobian)


def identify_section(
    turbine: Turbine,
    reference: StudyReference,
    balance: Balance,
    section: tuple[float, float] = SECTION,
    prior: Prior = START,
) -> Identification:
    """Run the filter over a section [s] of a record's balance."""
    window = slice(round(section[0] * RATE), round(section[1] * RATE))
    cut = Balance(balance.force[window], balance.regressors[window])
    outcome = filter_balance(cut, turbine, reference.inputs[window, :3], prior, rate=RATE, band=analysis_band(turbine))
    outcome = outcome._replace(channels=tuple(c for c in reference.record.channels if not c.startswith("rotor")))
    return conclude(outcome, reference.record.section(*section), "force-balance")
