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

if TYPE_CHECKING:
    from windsysid.campbell import Campbell, find_modes
    from windsysid.comparison import Comparison, compare
    from windsysid.damping import Separation, separate_damping
    from windsysid.errors import ConfigurationError, OutputError, RecordError, WindsysidError
    from windsysid.filters import EKF, IEKF, UKF, Belief, Filter, Info, Smoothed, load_belief, save_belief, smooth
    from windsysid.fitting import Fit, Reading, fit
    from windsysid.formats import iterate_record, load_mapping, read_record, write_record
    from windsysid.formulation import Prior
    from windsysid.identification import add_noise, identify
    from windsysid.loads import GaussMarkov, LoadBlock
    from windsysid.mechanics.compile import CompiledModel, compile_model
    from windsysid.mechanics.equations import Equations, lagrange
    from windsysid.mechanics.rotor import RotorModel
    from windsysid.mechanics.sensors import Sensor, read_sensors
    from windsysid.mechanics.tower import TowerModel
    from windsysid.modal import Mode
    from windsysid.planning import Plan, plan
    from windsysid.profiling import Profile, profile_likelihood
    from windsysid.record import Record
    from windsysid.result import Estimate, Identification, Posterior, load_posterior
    from windsysid.simulate import simulate_record
    from windsysid.statespace import Parameter, StateSpace, compose
    from windsysid.turbine import Turbine, load_turbine, packaged_turbines, write_turbine

__version__ = "0.1.0"

_WHERE = {
    "campbell": ("Campbell", "find_modes"),
    "comparison": ("Comparison", "compare"),
    "damping": ("Separation", "separate_damping"),
    "errors": ("ConfigurationError", "OutputError", "RecordError", "WindsysidError"),
    "filters": ("EKF", "IEKF", "UKF", "Belief", "Filter", "Info", "Smoothed", "load_belief", "save_belief", "smooth"),
    "fitting": ("Fit", "Reading", "fit"),
    "formats": ("iterate_record", "load_mapping", "read_record", "write_record"),
    "formulation": ("Prior",),
    "result": ("Estimate", "Identification", "Posterior", "load_posterior"),
    "identification": ("add_noise", "identify"),
    "mechanics.compile": ("CompiledModel", "compile_model"),
    "mechanics.equations": ("Equations", "lagrange"),
    "mechanics.rotor": ("RotorModel",),
    "mechanics.sensors": ("Sensor", "read_sensors"),
    "mechanics.tower": ("TowerModel",),
    "modal": ("Mode",),
    "planning": ("Plan", "plan"),
    "profiling": ("Profile", "profile_likelihood"),
    "record": ("Record",),
    "simulate": ("simulate_record",),
    "loads": ("GaussMarkov", "LoadBlock"),
    "statespace": ("Parameter", "StateSpace", "compose"),
    "turbine": ("Turbine", "load_turbine", "packaged_turbines", "write_turbine"),
}
_MODULE_OF = {name: module for module, names in _WHERE.items() for name in names}

__all__ = [
    "EKF", "IEKF", "UKF", "Belief", "Campbell", "Comparison", "CompiledModel", "ConfigurationError", "Equations", "Estimate", "Filter", "Fit", "GaussMarkov",
    "Identification", "Info", "LoadBlock", "Mode", "OutputError", "Parameter", "Plan", "Posterior", "Prior", "Profile", "Reading", "Record", "RecordError", "RotorModel", "Sensor", "Separation", "Smoothed",
    "StateSpace", "TowerModel", "Turbine", "WindsysidError", "add_noise", "compare", "compile_model", "compose", "find_modes", "fit", "identify",
    "iterate_record", "lagrange", "load_belief", "load_mapping", "load_posterior",
    "load_turbine", "packaged_turbines", "plan", "profile_likelihood", "read_record", "read_sensors", "save_belief", "separate_damping", "simulate_record", "smooth", "write_record",
    "write_turbine",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `import windsysid` itself loads nothing heavy."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'windsysid' has no attribute '{name}'")
    value = getattr(import_module(f"windsysid.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, imported or not yet: what a prompt completes."""
    return sorted({*globals(), *__all__})
