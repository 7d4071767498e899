"""Mechanics: symbolic equations of motion and sensor readings, compiled to kernels with exact Jacobians."""

from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.mechanics.model import MechanicalModel, Model
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensor_lists import read_sensors
from windsysid.mechanics.sensors import Sensor
from windsysid.mechanics.tower import TowerModel

__all__ = [
    "CompiledModel", "MechanicalModel", "Model", "RotorModel", "Sensor", "TowerModel", "compile_model", "read_sensors",
]  # fmt: skip
