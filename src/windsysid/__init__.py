"""windsysid: stiffness and damping of a running wind turbine, identified from its vibration.

import windsysid as ws

turbine = ws.load_turbine("nrel5mw")
record = ws.read_record("a2_rot12_decay_min.outb")
result = ws.identify(record, turbine)
print(result)
result.plot().savefig("coefficients.png")
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from windsysid._version import __version__
from windsysid.output.pages import take_pages_from

if TYPE_CHECKING:
    from windsysid.errors import ConfigurationError, OutputError, RecordError, WindsysidError
    from windsysid.filters import EKF, IEKF, UKF, Belief, Filter, Info, Smoothed, load_belief, save_belief, smooth
    from windsysid.filters.particles.filter import ParticleFilter
    from windsysid.filters.particles.raoblackwell import RaoBlackwellised
    from windsysid.fleet.batch import Batch, batch
    from windsysid.identification.condition.readings import add_noise
    from windsysid.identification.estimate.profile import Profile, profile_likelihood
    from windsysid.identification.fit_equations import Fit, Reading, fit
    from windsysid.identification.identify import identify
    from windsysid.identification.model.prior import Prior
    from windsysid.identification.planning.plan import Plan, plan
    from windsysid.identification.streaming.identify_pieces import identify_pieces
    from windsysid.inspection import inspect_record as inspect
    from windsysid.inspection.inspection import Inspection
    from windsysid.loads.hypothesis import LoadHypothesis, SupposedLoads, register_loads
    from windsysid.mechanics.compile import CompiledModel, compile_model
    from windsysid.mechanics.equations import Equations, lagrange
    from windsysid.mechanics.kinematics import RotorLayout
    from windsysid.mechanics.model import Coefficient, Coordinate, MechanicalModel, register_model
    from windsysid.mechanics.rotor import RotorModel
    from windsysid.mechanics.sensor_lists import read_sensors
    from windsysid.mechanics.sensors import (
        Accelerometer,
        AngularRateSensor,
        DisplacementSensor,
        MomentSensor,
        PlacedSensor,
        Sensor,
        StrainGauge,
        VelocitySensor,
        register_sensor,
    )
    from windsysid.mechanics.tower import TowerModel
    from windsysid.modal.campbell import Campbell
    from windsysid.modal.decays.analyse import analyse_decays as free_decay
    from windsysid.modal.linearisation.read import read_linearisation
    from windsysid.modal.linearisation.result import LinearisedModes
    from windsysid.modal.marks import ModeMarks, read_mode_marks
    from windsysid.modal.sweep import find_modes as modes
    from windsysid.monitoring.change import Comparison
    from windsysid.monitoring.changes import Watch
    from windsysid.monitoring.comparison import compare
    from windsysid.monitoring.damping import separate_damping as damping
    from windsysid.monitoring.separation import Separation
    from windsysid.monitoring.series import read_blocks
    from windsysid.monitoring.watch import watch as monitor
    from windsysid.records.formats import iterate_record, load_mapping, read_record, write_record
    from windsysid.records.record import Record
    from windsysid.reports.loading import load_result
    from windsysid.results.estimate import Estimate
    from windsysid.results.identification import Identification
    from windsysid.results.mode import Mode
    from windsysid.results.posterior import Posterior, load_posterior
    from windsysid.results.provenance import Provenance
    from windsysid.simulation.record import simulate_record as simulate
    from windsysid.spectral.oma.analyse import analyse_vibration as oma
    from windsysid.spectral.oma.mode import OperationalMode
    from windsysid.spectral.oma.result import OperationalModes
    from windsysid.spectral.oma.sensors import ModalSensor
    from windsysid.statespace.compose import StateSpace, compose
    from windsysid.statespace.gauss_markov import GaussMarkov
    from windsysid.statespace.parameter import Parameter
    from windsysid.statespace.process import LoadBlock
    from windsysid.turbine.file import load_turbine, packaged_turbines, write_turbine
    from windsysid.turbine.models.read import turbine_from
    from windsysid.turbine.turbine import Turbine

_WHERE = {
    "errors": "ConfigurationError OutputError RecordError WindsysidError",
    "filters": "EKF IEKF UKF Belief Filter Info Smoothed load_belief save_belief smooth",
    "filters.particles.filter": "ParticleFilter",
    "filters.particles.raoblackwell": "RaoBlackwellised",
    "fleet.batch": "Batch batch",
    "identification.identify": "identify",
    "identification.fit_equations": "Fit Reading fit",
    "identification.streaming.identify_pieces": "identify_pieces",
    "identification.planning.plan": "Plan plan",
    "identification.condition.readings": "add_noise",
    "identification.model.prior": "Prior",
    "identification.estimate.profile": "Profile profile_likelihood",
    "inspection": "inspect=inspect_record",
    "inspection.inspection": "Inspection",
    "mechanics.compile": "CompiledModel compile_model",
    "mechanics.equations": "Equations lagrange",
    "loads.hypothesis": "LoadHypothesis SupposedLoads register_loads",
    "mechanics.kinematics": "RotorLayout",
    "mechanics.model": "Coefficient Coordinate MechanicalModel register_model",
    "mechanics.rotor": "RotorModel",
    "mechanics.sensor_lists": "read_sensors",
    "mechanics.sensors": (
        "Accelerometer AngularRateSensor DisplacementSensor MomentSensor PlacedSensor Sensor StrainGauge "
        "VelocitySensor register_sensor"
    ),
    "mechanics.tower": "TowerModel",
    "modal.campbell": "Campbell",
    "modal.decays.analyse": "free_decay=analyse_decays",
    "modal.marks": "ModeMarks read_mode_marks",
    "modal.linearisation.read": "read_linearisation",
    "modal.linearisation.result": "LinearisedModes",
    "modal.sweep": "modes=find_modes",
    "monitoring.change": "Comparison",
    "monitoring.changes": "Watch",
    "monitoring.comparison": "compare",
    "monitoring.damping": "damping=separate_damping",
    "monitoring.separation": "Separation",
    "monitoring.series": "read_blocks",
    "monitoring.watch": "monitor=watch",
    "records.formats": "iterate_record load_mapping read_record write_record",
    "records.record": "Record",
    "reports.loading": "load_result",
    "results.estimate": "Estimate",
    "results.identification": "Identification",
    "results.mode": "Mode",
    "results.posterior": "Posterior load_posterior",
    "results.provenance": "Provenance",
    "simulation.record": "simulate=simulate_record",
    "spectral.oma.sensors": "ModalSensor",
    "spectral.oma.analyse": "oma=analyse_vibration",
    "spectral.oma.mode": "OperationalMode",
    "spectral.oma.result": "OperationalModes",
    "statespace.compose": "StateSpace compose",
    "statespace.gauss_markov": "GaussMarkov",
    "statespace.parameter": "Parameter",
    "statespace.process": "LoadBlock",
    "turbine.file": "load_turbine packaged_turbines write_turbine",
    "turbine.models.read": "turbine_from",
    "turbine.turbine": "Turbine",
}
"""The public names of each module.

A function that answers what a command answers has the command's name here and a verb's name in its module:
`modes=find_modes`.
"""

_PUBLIC = {
    public: (module, name or public)
    for module, names in _WHERE.items()
    for public, _, name in (entry.partition("=") for entry in names.split())
}

__all__ = [  # noqa: RUF022
    "Accelerometer",
    "AngularRateSensor",
    "Batch",
    "Belief",
    "Campbell",
    "Coefficient",
    "Comparison",
    "CompiledModel",
    "ConfigurationError",
    "Coordinate",
    "DisplacementSensor",
    "EKF",
    "Equations",
    "Estimate",
    "Filter",
    "Fit",
    "GaussMarkov",
    "IEKF",
    "Identification",
    "Info",
    "Inspection",
    "LinearisedModes",
    "LoadBlock",
    "LoadHypothesis",
    "MechanicalModel",
    "ModalSensor",
    "Mode",
    "MomentSensor",
    "OperationalMode",
    "OperationalModes",
    "OutputError",
    "Parameter",
    "ParticleFilter",
    "PlacedSensor",
    "Plan",
    "Posterior",
    "Prior",
    "Profile",
    "Provenance",
    "RaoBlackwellised",
    "Reading",
    "Record",
    "RecordError",
    "RotorLayout",
    "RotorModel",
    "Sensor",
    "Separation",
    "Smoothed",
    "StateSpace",
    "StrainGauge",
    "SupposedLoads",
    "TowerModel",
    "Turbine",
    "UKF",
    "VelocitySensor",
    "Watch",
    "WindsysidError",
    "__version__",
    "add_noise",
    "batch",
    "compare",
    "compile_model",
    "compose",
    "damping",
    "fit",
    "identify",
    "identify_pieces",
    "inspect",
    "iterate_record",
    "lagrange",
    "load_belief",
    "load_mapping",
    "load_posterior",
    "load_result",
    "load_turbine",
    "modes",
    "monitor",
    "ModeMarks",
    "free_decay",
    "oma",
    "read_mode_marks",
    "packaged_turbines",
    "plan",
    "profile_likelihood",
    "read_blocks",
    "read_linearisation",
    "read_record",
    "read_sensors",
    "register_loads",
    "register_model",
    "register_sensor",
    "save_belief",
    "simulate",
    "smooth",
    "turbine_from",
    "write_record",
    "write_turbine",
]

take_pages_from(lambda: import_module("windsysid.reports"))


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `import windsysid` itself loads nothing heavy."""
    if name not in _PUBLIC:
        raise AttributeError(f"module 'windsysid' has no attribute '{name}'")
    module, original = _PUBLIC[name]
    value = getattr(import_module(f"windsysid.{module}"), original)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, imported or not yet: what a prompt completes."""
    return sorted({*globals(), *__all__})
