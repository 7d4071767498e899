"""Simulation: the reference response of a model and what its sensors read, by RK4 between samples.

The simulator calls the kernels that the filters call (`windsysid.mechanics.compile`). Inputs run linearly between
samples; random loads move the machine as they do in continuous time (`windsysid.statespace.within_step`).
"""

import os

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.loads.family import hypothesis
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.mechanics.compile import compile_model
from windsysid.records.record import Record
from windsysid.signals.inputs import TURNING, steady_inputs
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads, draw_within_steps
from windsysid.turbine.coercion import TurbineLike, as_turbine

__all__ = ["simulate_record"]

WIND = ("wind", "wind-feedback")
"""Loads that are simulated from turbulence and not drawn from a hypothesis."""

SHARE = 0.7
"""Of the memory of a machine: what a simulation may take."""

LEAD_IN = 60.0
"""Seconds simulated, at least, before a record starts."""

RELAXATIONS, MOST_LEAD_IN = 6.0, 1800.0
"""Memories 1/ζω of the slowest mode until a machine that began at rest under its weight vibrates stationarily, and the
longest time [s] that is simulated for that."""


def simulate_record(
    turbine: TurbineLike, *, duration: float, rate: float, seed: int = 0, loads: str = "random"
) -> Record:
    """What the turbine's sensors record at its usual rotor speed; SI, reproducible for a seed.

    Parameters
    ----------
    duration
        [s].
    rate
        Samples per second [Hz].
    loads
        What drives the turbine. ``"random"``: the Gauss–Markov loads of its file. The name of a hypothesis
        (`windsysid.loads.family`): what that supposes, with the file's statistics. ``"wind"``: turbulent wind on the
        packaged blades (docs/wind.md), as if tower and blades stood still. ``"wind-feedback"``: with their motion,
        aerodynamic damping included.

    Returns
    -------
    Record
        The sensors' channels in SI, with ``rotor_azimuth`` [rad] and ``rotor_speed`` [rad/s] of a rotor that turns.

    Raises
    ------
    ConfigurationError
        If duration or rate are out of range, there are no such loads or none for this turbine, or the motion grows
        without bound.
    """
    turbine = as_turbine(turbine)
    if loads not in (playable := ("random", *WIND, *HYPOTHESES)):
        raise ConfigurationError(f"loads: expected one of {', '.join(playable)}; got '{loads}'")
    played = next(iter(HYPOTHESES)) if loads == "random" else loads
    supposed = hypothesis(played, turbine, turbine.loads) if played not in WIND else None
    turbine = turbine if supposed is None else supposed.turbine
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * np.pi)
    if not (np.isfinite(rate) and 4.0 * fastest <= rate <= 1e5):
        raise ConfigurationError(
            f"rate: expected {4.0 * fastest:.3g} to 100000 Hz (four samples per period of the fastest spring), got "
            f"{rate:g}"
        )
    if not (np.isfinite(duration) and duration > 0.0):
        raise ConfigurationError(f"duration: expected a positive time in seconds, got {duration:g}")
    columns = 4 * len(turbine.model.states) + 3 * (3 + len(turbine.loads) + len(turbine.sensors))
    before = LEAD_IN  # the air damps, and what it does before is costly
    if supposed is not None:
        before = max(LEAD_IN, min(RELAXATIONS / turbine.slowest_decay, MOST_LEAD_IN))
    needed, there = 8e-9 * columns * rate * (before + duration), memory()
    if needed > SHARE * there:
        raise ConfigurationError(
            f"{duration:g} s at {rate:g} Hz need about {needed:.3g} GB of memory, and this machine has {there:.3g} GB: "
            f"simulate {SHARE * there / needed * duration:.2g} s at most, or at a lower rate"
        )
    rng = np.random.default_rng(seed)
    model = compile_model(turbine.model, turbine.sensors)
    lead = round(before * rate)
    rotor = constant_speed_inputs(turbine.rotor_speed, before + duration, rate)
    inputs = steady_inputs(model.inputs, turbine.rotor_speed, before + duration, rate)
    p = np.array([turbine.values[name] for name in model.parameters])
    start, substeps = np.zeros(len(model.states)), max(1, int(np.ceil(20.0 * fastest / rate)))
    if supposed is not None:
        asked, (apart,) = (supposed.given(), model.loads, len(rotor), rate), rng.spawn(1)
        drawn = draw_loads(*asked, rng, rotor[:, 0])
        within = draw_within_steps(*asked, apart, rotor[:, 0])
        response = integrate(
            model, p, np.hstack([inputs, drawn]), rate=rate, start=start, substeps=substeps, within=within
        )
    else:
        from windsysid.simulation.wind import packaged_wind, wind_loads
        from windsysid.simulation.wind.feedback import integrate_with_feedback

        wind = wind_loads(turbine, *packaged_wind(turbine.name), rotor, rate=rate, seed=seed)
        damping = wind.damping if loads == "wind-feedback" else np.zeros_like(wind.damping)
        response, _ = integrate_with_feedback(
            model, p, np.hstack([inputs, wind.loads]), damping, rate=rate, start=start, substeps=substeps
        )
    noise = rng.standard_normal(response.readings.shape) * [sensor.noise for sensor in turbine.sensors]
    bias = rng.standard_normal(len(turbine.sensors)) * [sensor.bias for sensor in turbine.sensors]
    known = [(name, "rad/s" if name == "rotor_speed" else "rad") for name in TURNING if name in model.inputs]
    scada = {name: inputs[lead:, model.inputs.index(name)] for name, _ in known}
    scada |= {name: np.mod(psi, 2.0 * np.pi) for name, psi in scada.items() if name == "rotor_azimuth"}
    values = np.column_stack([*scada.values(), (response.readings + noise + bias)[lead:]])
    return Record(
        time=np.arange(len(values)) / rate,
        values=values,
        channels=(*(name for name, _ in known), *(sensor.channel for sensor in turbine.sensors)),
        units=(*(unit for _, unit in known), *(sensor.unit for sensor in turbine.sensors)),
        name=f"simulated record, seed {seed}",
        attributes={"source": f"windsysid simulate, turbine {turbine.name}, loads {loads}, seed {seed}"},
    )


def memory() -> float:
    """Memory of this machine [GB]; 16 where it does not tell."""
    try:
        return 1e-9 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return 16.0
