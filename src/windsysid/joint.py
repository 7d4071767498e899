"""The joint formulation: states, loads and coefficients in one filter, from accelerometers.

The filter runs over the record several times. A first pass linearises where it happens to be, and information taken in at a wrong
coefficient is never forgotten; each further pass starts from the last estimate and takes the pull of the original prior into account
afterwards, exactly so for a linear model:

    θ ← θ₁ + P₁ P₀⁻¹ (θ₀ − θ_start).

Its fixed point is the mode of the posterior that the filter's likelihood defines (Gauss–Newton on the innovations).
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windsysid.filters import EKF, Belief, Info
from windsysid.formulation import Outcome, Prior, check_finite, identifiable, known_loads
from windsysid.mechanics.sensors import Sensor
from windsysid.record import Record
from windsysid.signals import rotor_inputs
from windsysid.statespace import GaussMarkov, Parameter, StateSpace, compose
from windsysid.turbine import Turbine

__all__ = ["identify_jointly"]

Array = NDArray[np.float64]

PASSES = 8
"""Most passes over the record; they stop when one moves no coefficient by more than `SETTLED` standard deviations."""

SETTLED = 0.05


def identify_jointly(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None = None
) -> Outcome:
    """Identify the chosen parameters, or every coefficient that the sensors see, from a uniformly sampled record."""
    notes: list[str] = []
    turbine = _seen(turbine, sensors, notes)
    rotor = rotor_inputs(record, turbine.rotor_speed)
    known, loads = known_loads(record, turbine)
    model = _compose(
        record, turbine, sensors, prior.parameters(turbine, identifiable(turbine, chosen), linear=False), loads, rotor
    )
    inputs = np.hstack([rotor, known])
    readings = np.column_stack([record[sensor.channel] for sensor in sensors])

    EKF.run(model, EKF.init(model), inputs[:0], readings[:0])  # compiles or loads the kernel outside the clock
    started = time.perf_counter()
    first, info = EKF.run(model, EKF.init(model), inputs, readings)
    theta, cov, last, passes = _settle(model, first.mean, first.cov, info, inputs, readings)
    elapsed = time.perf_counter() - started

    whitened_ms = np.nanmean(last.whitened**2, axis=0)
    worst = int(np.argmax(whitened_ms))
    notes.append(
        f"{passes} passes over the record; loads are states with the turbine file's statistics "
        f"(first-order Gauss–Markov, {loads[0].time_constant:g} s); damping is total: structure and aerodynamics"
        if loads
        else f"{passes} passes over the record; all loads known"
    )
    if whitened_ms[worst] > 2.0:
        notes.append(
            f"WARNING: do not trust these bands: {sensors[worst].channel} deviates {math.sqrt(whitened_ms[worst]):.1f} times "
            "further from its prediction than the model expects; the loads or the noise are larger than the files say"
        )
    channels = tuple(sensor.channel for sensor in sensors)
    return Outcome(turbine, model, info, last, theta, cov, rotor, channels, elapsed, tuple(notes))


def _settle(
    model: StateSpace, mean: Array, cov: Array, info: Info, inputs: Array, readings: Array
) -> tuple[Array, Array, Info, int]:
    """Further passes of the joint filter until θ stays; returns θ, its covariance, the last pass and the number of passes."""
    block = model.parameter_block
    prior_mean, prior_cov = model.mean[block], model.cov[block, block]
    start = prior_mean
    check_finite(mean, cov)
    theta, theta_cov = mean[block], cov[block, block]
    for count in range(2, PASSES + 1):
        belief, info = EKF.run(model, _restarted(model, theta), inputs, readings)
        check_finite(belief.mean, belief.cov)
        start = theta
        theta_cov = belief.cov[block, block]
        theta = belief.mean[block] + theta_cov @ np.linalg.solve(prior_cov, prior_mean - start)
        if np.all(np.abs(theta - start) < SETTLED * np.sqrt(np.diag(theta_cov))):
            return theta, theta_cov, info, count
    return theta, theta_cov, info, PASSES


def _restarted(model: StateSpace, theta: Array) -> Belief:
    """The prior belief, moved to θ."""
    prior = EKF.init(model)
    mean = prior.mean.copy()
    mean[model.parameter_block] = theta
    return prior._replace(mean=mean)


def _seen(turbine: Turbine, sensors: Sequence[Sensor], notes: list[str]) -> Turbine:
    """The turbine with those degrees of freedom locked that no sensor sees."""
    changes: dict[str, str] = {}
    if turbine.model.lag == "free" and not any(sensor.blade for sensor in sensors):
        changes["lag"] = "locked"
        notes.append("no blade channels: the blades are locked, and only the support's coefficients are identified")
    on_tower = [sensor for sensor in sensors if not sensor.blade]
    for axis in ("x", "y"):
        free = getattr(turbine.model, axis) == "free"
        seen = any(sensor.axis == axis for sensor in on_tower) or any(s.blade and s.axis != "lag" for s in sensors)
        if free and not seen:
            changes[axis] = "locked"
            notes.append(f"no channel sees {axis}: it is locked")
    if not changes:
        return turbine
    if changes.get("x") == "locked" and turbine.model.roll == "tied":
        changes["roll"] = "locked"
    model = replace(turbine.model, **changes)  # type: ignore[arg-type]
    return replace(turbine, model=model, loads=tuple(load for load in turbine.loads if load.load in model.loads))


def _compose(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], parameters: Sequence[Parameter],
    loads: Sequence[GaussMarkov], rotor: Array,
) -> StateSpace:  # fmt: skip
    model = compose(
        turbine.model, rate=record.rate, values=turbine.values, parameters=parameters, loads=loads, sensors=sensors
    )
    n = len(turbine.model.coordinates)
    amplitude = _amplitudes(record, turbine, sensors, model, rotor[0])
    frequency = np.array([turbine.natural_frequency(name) for name in turbine.model.coordinates])
    cov = model.cov.copy()
    cov[range(2 * n), range(2 * n)] = np.square(np.concatenate([amplitude, amplitude * frequency]))
    return replace(model, cov=cov)


def _amplitudes(record: Record, turbine: Turbine, sensors: Sequence[Sensor], model: StateSpace, rotor: Array) -> Array:
    """How far each degree of freedom may be from rest at the first sample: three times what the loudest second would
    need.

    A channel that reads C q + D q̇ + E q̈ has the gain |C + iωD − ω²E| to a motion at the natural frequency ω.
    """
    compiled = model.compiled
    n, m = len(turbine.model.coordinates), len(sensors)
    rest = np.zeros(2 * n)
    no_load = np.zeros(len(compiled.loads))
    size = (len(compiled.identified), len(compiled.loads))
    A, B, G = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, size[0])), np.zeros((2 * n, size[1]))
    compiled.rates_jacobian(rest, rotor, model.blocks.p, no_load, np.empty(2 * n), A, B, G)
    C, D, E = np.zeros((m, 2 * n)), np.zeros((m, size[0])), np.zeros((m, size[1]))
    compiled.reading_jacobian(rest, rotor, model.blocks.p, no_load, np.empty(m), C, D, E)
    to_acceleration = E @ np.linalg.inv(G[n:])  # ∂y/∂q̈, as ∂q̈/∂w = M⁻¹ on the degrees of freedom
    direct = C - to_acceleration @ A[n:]
    loudest = np.array([_loudest(record[sensor.channel], record.rate) for sensor in sensors])
    amplitudes = np.empty(n)
    for j, name in enumerate(turbine.model.coordinates):
        w = turbine.natural_frequency(name)
        gain = np.abs(direct[:, j] + 1j * w * direct[:, n + j] - w**2 * to_acceleration[:, j])
        clear = gain > 0.3 * gain.max() if gain.max() > 0.0 else np.zeros(m, dtype=bool)
        amplitudes[j] = 3.0 * np.min(loudest[clear] / gain[clear]) if clear.any() else 1.0
    return np.maximum(amplitudes, 1e-12)


def _loudest(values: Array, rate: float) -> float:
    """Greatest rms about the channel's mean over any second."""
    deviation = np.nan_to_num(values - np.nanmean(values))
    window = max(1, round(rate))
    power = np.convolve(deviation**2, np.full(window, 1.0 / window), mode="valid" if len(values) >= window else "full")
    return float(np.sqrt(max(power.max(), 0.0)))
