"""Records of the scale model with one thing wrong at a time, for the tests of the diagnosis.

`windsysid` simulates them. How often a verdict is right is counted on records that it did not make
(`validation.adversary`).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.condition.readings import usable_sensors
from windsysid.identification.estimate.time_domain import identify_jointly
from windsysid.identification.model.prior import Prior
from windsysid.identification.verdict.conclude import conclude
from windsysid.mechanics.compile import compile_model
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.simulation.record import MIN_LEAD_IN_SECONDS
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["FAULTS", "faulty_record", "identify_broadband"]

Rng = np.random.Generator


class Fault(NamedTuple):
    """One thing wrong: with the loads (T, n_w) at azimuths ψ (T,), or with the readings (T, m) and their noise (m,)."""

    loads: Callable[[Turbine, Array, Array, float, float, Rng], Array] | None = None
    readings: Callable[[Array, Array, float, Rng], Array] | None = None


def _harmonic(order: int) -> Fault:
    def loads(turbine: Turbine, drawn: Array, psi: Array, rate: float, size: float, rng: Rng) -> Array:
        del rate
        drawn = drawn.copy()
        for j in range(2):
            drawn[:, j] += size * turbine.loads[j].rms * np.cos(order * psi + rng.uniform(0.0, 2.0 * np.pi))
        return drawn

    return Fault(loads=loads)


def _turning(turbine: Turbine, drawn: Array, psi: Array, rate: float, size: float, rng: Rng) -> Array:
    """Effect of a steady load in the fixed frame on the rotating frame: 1P, with an amplitude that varies within
    seconds."""
    drawn = drawn.copy()
    for j, load in enumerate(turbine.loads):
        names = ("cos", "sin")
        pair = draw_loads([GaussMarkov(name, size * load.rms, 2.0) for name in names], names, len(psi), rate, rng)
        drawn[:, j] += pair[:, 0] * np.cos(psi) + pair[:, 1] * np.sin(psi)
    return drawn


def _second_time_constant(turbine: Turbine, drawn: Array, psi: Array, rate: float, size: float, rng: Rng) -> Array:
    faster = [replace(load, rms=size * load.rms, time_constant=0.03 * load.time_constant) for load in turbine.loads]
    return drawn + draw_loads(faster, turbine.model.loads, len(psi), rate, rng)


def _coloured(readings: Array, noise: Array, size: float, rng: Rng) -> Array:
    from scipy.signal import lfilter

    white = rng.standard_normal(readings.shape)
    return np.asarray(readings + noise * lfilter([np.sqrt(1.0 - size**2)], [1.0, -size], white, axis=0))


def _spiked(readings: Array, noise: Array, size: float, rng: Rng) -> Array:
    spikes = 20.0 * rng.standard_normal(readings.shape) * (rng.random(readings.shape) < size)
    return np.asarray(readings + noise * (rng.standard_normal(readings.shape) + spikes))


def _shifted(readings: Array, noise: Array, size: float, rng: Rng) -> Array:
    readings = readings + noise * rng.standard_normal(readings.shape)
    readings[:, 0] += size * noise[0]
    return readings


def _miscalibrated(readings: Array, noise: Array, size: float, rng: Rng) -> Array:
    readings = readings + noise * rng.standard_normal(readings.shape)
    readings[:, 0] *= 1.0 + size
    return readings


FAULTS: dict[str, tuple[Fault, tuple[float, ...]]] = {
    "none": (Fault(), (0.0,)),
    "3P on the hub, amplitude × rms": (_harmonic(3), (0.1, 0.2, 0.3, 1.0)),
    "1P on the hub, amplitude × rms": (_harmonic(1), (0.5, 1.0)),
    "wandering 1P on everything, × rms": (Fault(loads=_turning), (0.2, 0.35, 0.7)),
    "second load, 30 ms, × rms": (Fault(loads=_second_time_constant), (0.2, 0.5)),
    "sensor noise correlated by": (Fault(readings=_coloured), (0.5, 0.9)),
    "spikes of 20σ, share": (Fault(readings=_spiked), (0.001, 0.01)),
    "one sensor off by, × its noise": (Fault(readings=_shifted), (0.5, 2.0)),
    "one sensor's gain off by": (Fault(readings=_miscalibrated), (0.1, 0.3)),
}
"""Kind and size of the fault."""


def faulty_record(fault: Fault, size: float, seed: int, *, duration: float = 100.0, rate: float = 100.0) -> Record:
    """A record of the scale model with one thing wrong, as `simulate_record` makes it without."""
    turbine = load_turbine("verne555").exact()
    rng = np.random.default_rng([seed, 7])
    model = compile_model(turbine.model, turbine.sensors)
    rotor = constant_speed_inputs(turbine.rotor_speed, MIN_LEAD_IN_SECONDS + duration, rate)
    drawn = draw_loads(turbine.loads, model.loads, len(rotor), rate, rng)
    if fault.loads is not None:
        drawn = fault.loads(turbine, drawn, rotor[:, 0], rate, size, rng)
    p = np.array([turbine.values[name] for name in model.parameters])
    response = integrate(model, p, np.hstack([rotor, drawn]), rate=rate, start=np.zeros(len(model.states)))
    noise = np.array([sensor.noise for sensor in turbine.sensors])
    if fault.readings is not None:
        readings = fault.readings(response.readings, noise, size, rng)
    else:
        readings = response.readings + noise * rng.standard_normal(response.readings.shape)
    lead = round(MIN_LEAD_IN_SECONDS * rate)
    return Record(
        time=np.arange(len(rotor) - lead) / rate,
        values=np.hstack([np.mod(rotor[lead:, :1], 2.0 * np.pi), rotor[lead:, 1:2], readings[lead:]]),
        channels=("rotor_azimuth", "rotor_speed", *(sensor.channel for sensor in turbine.sensors)),
        units=("rad", "rad/s", *(sensor.unit for sensor in turbine.sensors)),
        name=f"faulty record, seed {seed}",
    )


def identify_broadband(record: Record, turbine: Turbine, prior: Prior) -> Identification:
    """Identify with the load model of the turbine file and no other, however well another would do."""
    outcome = identify_jointly(record, turbine, usable_sensors(record, turbine, None), prior, loads="broadband")
    return conclude(outcome, record, "joint")
