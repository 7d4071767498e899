"""A tower's question and its problem from a short record."""

import numpy as np
import pytest

from windsysid.identification.model.prior import Prior
from windsysid.mechanics.compile import compile_model
from windsysid.simulation.record import simulate_record
from windsysid.spectral.rotor.build import pose_lifted
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.turbine.file import load_turbine


@pytest.fixture(scope="package")
def question() -> RotorQuestion:
    turbine = load_turbine("tower").exact()
    record = simulate_record(turbine, duration=300.0, rate=10.0, seed=5)
    parameters = Prior().parameters(turbine, list(turbine.coefficients), linear=False)
    inputs = np.zeros((record.samples, 5))
    inputs[:, 0], inputs[:, 1] = np.unwrap(record["rotor_azimuth"]), turbine.rotor_speed
    readings = np.column_stack([record[s.channel] for s in turbine.sensors])
    compiled = compile_model(turbine.model, turbine.sensors)
    return RotorQuestion(turbine, turbine.sensors, readings, record.rate, inputs, compiled, parameters, turbine.loads)


@pytest.fixture(scope="package")
def posed(question: RotorQuestion) -> Posed:
    return pose_lifted(question, "broadband")
