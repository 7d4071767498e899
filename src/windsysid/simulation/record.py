"""Simulation: the reference response of a model and the readings of its sensors, by RK4 between samples.

The simulator calls the kernels that the filters call (`windsysid.mechanics.compile`). Inputs run linearly between
samples; random loads move the machine as they do in continuous time (`windsysid.statespace.within_step`).
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.loads.family import hypothesis
from windsysid.loads.hypothesis import HYPOTHESES, SupposedLoads
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.records.record import Record
from windsysid.signals.inputs import TURNING, steady_inputs
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads, draw_within_steps
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["simulate_record"]

WIND = ("wind", "wind-feedback")
"""Loads that are simulated from turbulence and not drawn from a hypothesis."""

MAX_MEMORY_SHARE = 0.7
"""Largest share of a machine's memory for a simulation."""

MIN_LEAD_IN_SECONDS = 60.0
"""Seconds simulated, at least, before a record starts."""

LEAD_IN_RELAXATIONS, MAX_LEAD_IN_SECONDS = 6.0, 1800.0
"""Memories 1/ζω of the slowest mode until a machine that began at rest under its weight vibrates stationarily, and the
longest time [s] that is simulated for that."""


def simulate_record(
    turbine: TurbineLike, *, duration: float, rate: float, seed: int = 0, loads: str = "random"
) -> Record:
    """Simulate the record of the turbine's sensors at its usual rotor speed.

    Parameters
    ----------
    turbine : Turbine, str or Path
        A turbine, the name of a packaged one, or the path of a TOML file.
    duration : float
        Length of the record [s]; it has T = `duration` · `rate` samples, rounded.
    rate : float
        Sampling rate [Hz].
    seed : int, default 0
        Seed of loads and sensor noise: the same seed gives the same record.
    loads : str, default "random"
        Loads that act. ``"random"``: the Gauss–Markov loads of the turbine file. The name of a load hypothesis
        (`windsysid.loads.family`), with the statistics of the file. ``"wind"``: turbulent wind on the packaged blades
        (docs/wind.md) without the motion of tower and blades. ``"wind-feedback"``: with their motion, aerodynamic
        damping included.

    Returns
    -------
    Record
        The channels (T,) of the sensors in SI units, with ``rotor_azimuth`` [rad] and ``rotor_speed`` [rad/s] if the
        rotor turns.

    Raises
    ------
    ConfigurationError
        If duration or rate are out of range, there are no such loads or none for this turbine, or the motion grows
        without bound.

    See Also
    --------
    identify : Identification from a record.
    plan : Accuracy of a planned record.
    windsysid.simulation.examples : Records to try the commands on.

    Notes
    -----
    Gauss–Markov loads are discretised exactly; the motion is integrated by the fourth-order Runge–Kutta method.

    References
    ----------
    Särkkä & Solin, Applied Stochastic Differential Equations, Cambridge 2019, ch. 6.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=60.0, rate=20.0, seed=1)
    >>> record.samples, record.channels[-2:]
    (1200, ('tower_x_acceleration', 'tower_z_acceleration'))
    """
    turbine = as_turbine(turbine)
    if loads not in (playable := ("random", *WIND, *HYPOTHESES)):
        raise ConfigurationError(f"loads: expected one of {', '.join(playable)}; got '{loads}'")
    played = next(iter(HYPOTHESES)) if loads == "random" else loads
    supposed = hypothesis(played, turbine, turbine.loads) if played not in WIND else None
    turbine = turbine if supposed is None else supposed.turbine
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * np.pi)
    _check_sampling(duration, rate, fastest)
    before = MIN_LEAD_IN_SECONDS  # the air damps, and what it does before is costly
    if supposed is not None:
        before = max(MIN_LEAD_IN_SECONDS, min(LEAD_IN_RELAXATIONS / turbine.slowest_decay, MAX_LEAD_IN_SECONDS))
    _check_memory(turbine, duration, rate, before)
    machine = _Machine.turning(turbine, before + duration, rate, max(1, int(np.ceil(20.0 * fastest / rate))))
    rng = np.random.default_rng(seed)
    if supposed is not None:
        readings = _under_random_loads(machine, supposed, rng)
    else:
        readings = _in_wind(machine, seed, feedback=loads == "wind-feedback")
    record = machine.recorded(_with_noise(readings, turbine.sensors, rng), round(before * rate))
    about = f"windsysid simulate, turbine {turbine.name}, loads {loads}, seed {seed}"
    return replace(record, name=f"simulated record, seed {seed}", attributes={"source": about})


class _Machine(NamedTuple):
    """A turbine, compiled, with its parameters (n_p,), the rotor's motion (T, 3), the model's inputs (T, n_u), their
    rate [Hz] and the integration steps between two samples."""

    turbine: Turbine
    model: CompiledModel
    p: Array
    rotor: Array
    inputs: Array
    rate: float
    substeps: int

    @classmethod
    def turning(cls, turbine: Turbine, duration: float, rate: float, substeps: int) -> "_Machine":
        """A turbine that turns at its usual speed for `duration` [s]."""
        model = compile_model(turbine.model, turbine.sensors)
        p = np.array([turbine.values[name] for name in model.parameters])
        turning = (turbine.rotor_speed, duration, rate)
        rotor, inputs = constant_speed_inputs(*turning), steady_inputs(model.inputs, *turning)
        return cls(turbine, model, p, rotor, inputs, rate, substeps)

    @property
    def at_rest(self) -> dict[str, Any]:
        """Settings of an integration from rest."""
        return {"rate": self.rate, "start": np.zeros(len(self.model.states)), "substeps": self.substeps}

    def recorded(self, readings: Array, lead: int) -> Record:
        """The record of readings (T, m) and of the rotor's motion from the sample `lead` on."""
        names = [name for name in TURNING if name in self.model.inputs]
        columns = [self.inputs[lead:, self.model.inputs.index(name)] for name in names]
        motion = [
            np.mod(psi, 2.0 * np.pi) if name == "rotor_azimuth" else psi
            for name, psi in zip(names, columns, strict=True)
        ]
        values = np.column_stack([*motion, readings[lead:]])
        return Record(
            time=np.arange(len(values)) / self.rate,
            values=values,
            channels=(*names, *(sensor.channel for sensor in self.turbine.sensors)),
            units=(
                *("rad/s" if name == "rotor_speed" else "rad" for name in names),
                *(sensor.unit for sensor in self.turbine.sensors),
            ),
        )


def _with_noise(readings: Array, sensors: Sequence[Any], rng: np.random.Generator) -> Array:
    """Readings (T, m) with the noise and the biases of their sensors."""
    noise = rng.standard_normal(readings.shape) * [sensor.noise for sensor in sensors]
    bias = rng.standard_normal(len(sensors)) * [sensor.bias for sensor in sensors]
    return np.asarray(readings + noise + bias)


def _under_random_loads(machine: _Machine, supposed: SupposedLoads, rng: np.random.Generator) -> Array:
    """Readings without noise (T, m) under loads that are drawn from a hypothesis."""
    model, psi = machine.model, machine.rotor[:, 0]
    asked, (apart,) = (supposed.given(), model.loads, len(psi), machine.rate), rng.spawn(1)
    inputs = np.hstack([machine.inputs, draw_loads(*asked, rng, psi)])
    within = draw_within_steps(*asked, apart, psi)
    return integrate(model, machine.p, inputs, within=within, **machine.at_rest).readings


def _in_wind(machine: _Machine, seed: int, *, feedback: bool) -> Array:
    """Readings without noise (T, m) in turbulent wind, with aerodynamic damping if `feedback`."""
    from windsysid.simulation.wind import packaged_wind, wind_loads
    from windsysid.simulation.wind.feedback import integrate_with_feedback

    turbine = machine.turbine
    wind = wind_loads(turbine, *packaged_wind(turbine.name), machine.rotor, rate=machine.rate, seed=seed)
    damping = wind.damping if feedback else np.zeros_like(wind.damping)
    inputs = np.hstack([machine.inputs, wind.loads])
    return integrate_with_feedback(machine.model, machine.p, inputs, damping, **machine.at_rest).response.readings


def _check_sampling(duration: float, rate: float, fastest: float) -> None:
    """Refuse a duration [s] that is none, and a rate [Hz] too low for the fastest spring [Hz]."""
    if not (np.isfinite(rate) and 4.0 * fastest <= rate <= 1e5):
        raise ConfigurationError(
            f"rate: expected {4.0 * fastest:.3g} to 100000 Hz (four samples per period of the fastest spring), got "
            f"{rate:g}"
        )
    if not (np.isfinite(duration) and duration > 0.0):
        raise ConfigurationError(f"duration: expected a positive time in seconds, got {duration:g}")


def _check_memory(turbine: Turbine, duration: float, rate: float, before: float) -> None:
    """Refuse a simulation that does not fit into the memory of this machine, with `before` [s] in addition."""
    columns = 4 * len(turbine.model.states) + 3 * (3 + len(turbine.loads) + len(turbine.sensors))
    needed, there = 8e-9 * columns * rate * (before + duration), memory()
    if needed > MAX_MEMORY_SHARE * there:
        raise ConfigurationError(
            f"{duration:g} s at {rate:g} Hz need about {needed:.3g} GB of memory, and this machine has {there:.3g} GB: "
            f"simulate {MAX_MEMORY_SHARE * there / needed * duration:.2g} s at most, or at a lower rate"
        )


def memory() -> float:
    """Memory of this machine [GB]; 16 where it does not tell."""
    try:
        return 1e-9 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return 16.0
