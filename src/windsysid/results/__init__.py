"""Results of the functions: estimates, posteriors, modes, comparisons, watches, plans."""

from typing import TYPE_CHECKING

from windsysid._lazy import lazily as _lazily

if TYPE_CHECKING:
    from windsysid.fleet.batch import Batch
    from windsysid.identification.estimate.profile import Profile
    from windsysid.identification.planning.plan import Plan
    from windsysid.inspection.inspection import Inspection
    from windsysid.modal.campbell import Campbell
    from windsysid.modal.linearisation.result import LinearisedModes
    from windsysid.modal.marks import ModeMarks, read_mode_marks
    from windsysid.modal.matching.result import ModeMatch
    from windsysid.monitoring.change import Comparison
    from windsysid.monitoring.changes import Watch
    from windsysid.monitoring.separation import Separation
    from windsysid.results.estimate import Estimate, IntervalEstimate
    from windsysid.results.identification import Identification
    from windsysid.results.mode import Mode
    from windsysid.results.posterior import Posterior, load_posterior
    from windsysid.results.provenance import Provenance
    from windsysid.spectral.oma.mode import OperationalMode
    from windsysid.spectral.oma.result import OperationalModes

_PUBLIC, __getattr__ = _lazily(__name__, globals(), {
    "fleet.batch": "Batch",
    "identification.estimate.profile": "Profile",
    "identification.planning.plan": "Plan",
    "inspection.inspection": "Inspection",
    "modal.campbell": "Campbell",
    "modal.linearisation.result": "LinearisedModes",
    "modal.marks": "ModeMarks read_mode_marks",
    "modal.matching.result": "ModeMatch",
    "monitoring.change": "Comparison",
    "monitoring.changes": "Watch",
    "monitoring.separation": "Separation",
    "results.estimate": "Estimate IntervalEstimate",
    "results.identification": "Identification",
    "results.mode": "Mode",
    "results.posterior": "Posterior load_posterior",
    "results.provenance": "Provenance",
    "spectral.oma.mode": "OperationalMode",
    "spectral.oma.result": "OperationalModes",
})  # fmt: skip

__all__ = [
    "Batch", "Campbell", "Comparison", "Estimate", "Identification", "Inspection", "IntervalEstimate",
    "LinearisedModes", "Mode", "ModeMarks", "ModeMatch", "OperationalMode", "OperationalModes", "Plan", "Posterior",
    "Profile", "Provenance", "Separation", "Watch", "load_posterior", "read_mode_marks",
]  # fmt: skip


def __dir__() -> list[str]:
    """Public names, imported or not yet, for completion at a prompt."""
    return [*__all__]
