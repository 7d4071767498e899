"""Mechanics: symbolic equations of motion and sensor readings, compiled to kernels with exact Jacobians."""

from windsysid.mechanics.compile import CompiledModel, Model, compile_model
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensors import Sensor, read_sensors

__all__ = ["CompiledModel", "Model", "RotorModel", "Sensor", "compile_model", "read_sensors"]
