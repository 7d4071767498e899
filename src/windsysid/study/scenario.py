"""The reference scenario: a 600 s record of the scale model, made the way the published study describes its own.

Tower channels are noisy accelerometers; blade channels are synthetic displacement, velocity and acceleration with
the published noise
(1e-5 rad and 0.01 rad/s; the acceleration's 0.1 rad/s² is ours, the study names none). The loads, independent
first-order
Gauss–Markov processes on every degree of freedom, are kept next to the record: arm A of the study is given them, arm
B is not.
"""

from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.mechanics.compile import compile_model
from windsysid.records.record import Record
from windsysid.simulation.integrate import Response, constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.turbine.turbine import Turbine

__all__ = ["DURATION", "NOISE", "RATE", "SECTION", "StudyReference", "measure", "simulate_reference"]


RATE = 100.0
DURATION = 600.0
SECTION = (500.0, 600.0)
NOISE = {
    "tower_acceleration": 0.05,  # m/s²
    "lag_displacement": 1e-5,  # rad
    "lag_velocity": 0.01,  # rad/s
    "lag_acceleration": 0.1,  # rad/s²
}


class StudyReference(NamedTuple):
    """The record as measured, the noise-free response behind it, and the inputs that drove it (ψ, Ω, dΩ/dt, loads)."""

    record: Record
    response: Response
    inputs: Array


def simulate_reference(turbine: Turbine, seed: int) -> StudyReference:
    """The reference record of a turbine with independent lags, tower x and y; SI units, reproducible for a seed."""
    rng = np.random.default_rng(seed)
    model = compile_model(turbine.model)
    samples = round(DURATION * RATE)
    loads = draw_loads(turbine.loads, turbine.model.loads, samples, RATE, rng)
    inputs = np.hstack([constant_speed_inputs(turbine.rotor_speed, DURATION, RATE), loads])
    p = np.array([turbine.values[name] for name in model.parameters])
    response = integrate(model, p, inputs, rate=RATE, start=np.zeros(len(model.states)))
    return StudyReference(measure(turbine, response, inputs, rng, f"reference scenario, seed {seed}"), response, inputs)


def measure(turbine: Turbine, response: Response, inputs: Array, rng: np.random.Generator, name: str) -> Record:
    """The scenario's channels of a response, with their noise; `inputs` (T, 2 or more) begin with ψ and Ω."""
    samples, n = len(inputs), len(turbine.model.coordinates)
    channels: dict[str, tuple[Array, str]] = {
        "rotor_azimuth": (inputs[:, 0], "rad"),
        "rotor_speed": (inputs[:, 1], "rad/s"),
    }
    for j, freedom in enumerate(turbine.model.freedoms):
        motion = (response.states[:, j], response.states[:, n + j], response.rates[:, n + j])
        if freedom.blade:
            quantities = ("displacement", "velocity", "acceleration")
            for quantity, values, unit in zip(quantities, motion, ("rad", "rad/s", "rad/s^2"), strict=True):
                noisy = values + NOISE[f"lag_{quantity}"] * rng.standard_normal(samples)
                channels[f"blade_{freedom.blade}_lag_{quantity}"] = (noisy, unit)
        else:
            noisy = motion[2] + NOISE["tower_acceleration"] * rng.standard_normal(samples)
            channels[f"tower_{freedom.name}_acceleration"] = (noisy, "m/s^2")
    return Record(
        time=np.arange(samples) / RATE,
        values=np.column_stack([values for values, _ in channels.values()]),
        channels=tuple(channels),
        units=tuple(unit for _, unit in channels.values()),
        name=name,
    )
