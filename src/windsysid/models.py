"""A structure of one's own: equations of motion, sensors, loads, and a fit of what is unknown in them.

`docs/tutorials/own_model.md` builds one.
"""

from windsysid._lazy import naming_arguments
from windsysid.identification.fit_equations import Fit, Reading, fit
from windsysid.identification.model.prior import Prior
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
from windsysid.spectral.oma.sensors import ModalSensor
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import LoadBlock

__all__ = [
    "Accelerometer", "AngularRateSensor", "Coefficient", "CompiledModel", "Coordinate", "DisplacementSensor",
    "Equations", "Fit", "GaussMarkov", "LoadBlock", "LoadHypothesis", "MechanicalModel", "ModalSensor", "MomentSensor",
    "Parameter", "PlacedSensor", "Prior", "Reading", "RotorLayout", "RotorModel", "Sensor", "StateSpace", "StrainGauge",
    "SupposedLoads", "TowerModel", "VelocitySensor", "compile_model", "compose", "fit", "lagrange", "read_sensors",
    "register_loads", "register_model", "register_sensor",
]  # fmt: skip

globals().update({name: naming_arguments(name, globals()[name]) for name in __all__})
