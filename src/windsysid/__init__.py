"""windsysid: stiffness and damping of a running wind turbine, identified from its vibration.

import windsysid as ws

turbine = ws.load_turbine("nrel5mw")
record = ws.read_record("a2_rot12_decay_min.outb")
result = ws.identify(record, turbine)
print(result)
result.plot().savefig("coefficients.png")

The namespaces: `windsysid.models` for a structure, sensors and loads of one's own, `windsysid.filters` for the filters
alone, `windsysid.signals` for the preparation of records, `windsysid.results` for what the functions return.
"""

from typing import TYPE_CHECKING

from windsysid._lazy import lazily as _lazily
from windsysid._version import __version__

if TYPE_CHECKING:
    from windsysid import filters, models, results, signals
    from windsysid.errors import ConfigurationError, OutputError, RecordError, WindsysidError
    from windsysid.fleet.batch import batch
    from windsysid.identification.estimate.profile import profile_likelihood
    from windsysid.identification.identify import identify
    from windsysid.identification.planning.plan import plan
    from windsysid.identification.streaming.identify_pieces import identify_pieces
    from windsysid.inspection import inspect_record as inspect
    from windsysid.modal.decays.analyse import analyse_decays as free_decay
    from windsysid.modal.linearisation.read import read_linearisation
    from windsysid.modal.matching.match import match_modes as match
    from windsysid.modal.sweep import find_modes as modes
    from windsysid.monitoring.comparison import compare
    from windsysid.monitoring.damping import separate_damping as damping
    from windsysid.monitoring.series import read_blocks
    from windsysid.monitoring.watch import watch as monitor
    from windsysid.records.formats import iterate_record, load_mapping, read_record, write_record
    from windsysid.records.record import Record
    from windsysid.reports.loading import load_result
    from windsysid.simulation.record import simulate_record as simulate
    from windsysid.spectral.oma.analyse import analyse_vibration as oma
    from windsysid.turbine.file import load_turbine, packaged_turbines, write_turbine
    from windsysid.turbine.models.read import turbine_from
    from windsysid.turbine.turbine import Turbine

_PUBLIC, __getattr__ = _lazily(__name__, globals(), {
    "": "filters models results signals",
    "errors": "ConfigurationError OutputError RecordError WindsysidError",
    "fleet.batch": "batch",
    "identification.identify": "identify",
    "identification.streaming.identify_pieces": "identify_pieces",
    "identification.planning.plan": "plan",
    "identification.estimate.profile": "profile_likelihood",
    "inspection": "inspect=inspect_record",
    "modal.decays.analyse": "free_decay=analyse_decays",
    "modal.linearisation.read": "read_linearisation",
    "modal.matching.match": "match=match_modes",
    "modal.sweep": "modes=find_modes",
    "monitoring.comparison": "compare",
    "monitoring.damping": "damping=separate_damping",
    "monitoring.series": "read_blocks",
    "monitoring.watch": "monitor=watch",
    "records.formats": "iterate_record load_mapping read_record write_record",
    "records.record": "Record",
    "reports.loading": "load_result",
    "simulation.record": "simulate=simulate_record",
    "spectral.oma.analyse": "oma=analyse_vibration",
    "turbine.file": "load_turbine packaged_turbines write_turbine",
    "turbine.models.read": "turbine_from",
    "turbine.turbine": "Turbine",
})  # fmt: skip

__all__ = [
    "ConfigurationError", "OutputError", "Record", "RecordError", "Turbine", "WindsysidError", "__version__", "batch",
    "compare", "damping", "filters", "free_decay", "identify", "identify_pieces", "inspect", "iterate_record",
    "load_mapping", "load_result", "load_turbine", "match", "models", "modes", "monitor", "oma", "packaged_turbines",
    "plan", "profile_likelihood", "read_blocks", "read_linearisation", "read_record", "results", "signals", "simulate",
    "turbine_from", "write_record", "write_turbine",
]  # fmt: skip


def __dir__() -> list[str]:
    """Public names, imported or not yet, for completion at a prompt."""
    return [*__all__]
