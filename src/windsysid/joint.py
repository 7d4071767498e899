"""The joint formulation: states, loads and coefficients together, from accelerometers.

First the joint filter runs over the record as it would on line; that history is kept. What it learned while linearised at a wrong
coefficient it never forgets, so it runs again from where it ended, with the original prior covariance and the pull of the prior
added afterwards, exactly so for a linear model:

    θ ← θ₁ + P₁ P₀⁻¹ (θ₀ − θ_start).

From there the mode of the posterior is found on the likelihood of the state-only filter (`windsysid.likelihood`), together with
the statistics of loads and noise (`windsysid.statistics`): the result and its bands are those.
"""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windsysid.filters import EKF, Belief
from windsysid.formulation import Outcome, Prior, check_finite, identifiable, known_loads
from windsysid.likelihood import Posterior, posterior_mode
from windsysid.loads import GaussMarkov
from windsysid.mechanics.sensors import Sensor
from windsysid.record import Record
from windsysid.signals import rotor_inputs
from windsysid.statespace import Parameter, StateSpace, compose
from windsysid.statistics import Statistic, given_statistics, learned_statistics, spreads, with_statistics
from windsysid.turbine import Turbine

__all__ = ["identify_jointly"]

Array = NDArray[np.float64]

PASSES = 4
"""Most passes of the joint filter; they stop when one moves no coefficient by more than `SETTLED` standard deviations."""

SETTLED = 0.05

FIRST_WIDTH = 0.05
"""Standard deviation of the logarithm of a statistic that scales its first differences."""

COARSE = 10_000
"""Samples at the beginning of a long record on which the way to the mode is found cheaply, before all of it is used."""

CORRELATED = 0.1
"""Correlation of a whitened innovation with the one before it, above which the model does not explain the record."""


def identify_jointly(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None = None
) -> Outcome:
    """Identify the chosen parameters, or every coefficient that the sensors see, from a uniformly sampled record."""
    notes: list[str] = []
    turbine = _seen(turbine, sensors, notes)
    rotor = rotor_inputs(record, turbine.rotor_speed)
    known, loads = known_loads(record, turbine)
    parameters = prior.parameters(turbine, identifiable(turbine, chosen), linear=False)
    model = _compose(record, turbine, sensors, parameters, loads, rotor)
    inputs = np.hstack([rotor, known])
    readings = np.column_stack([record[sensor.channel] for sensor in sensors])

    EKF.run(model, EKF.init(model), inputs[:0], readings[:0])  # compiles or loads the kernel outside the clock
    started = time.perf_counter()
    first, online = EKF.run(model, EKF.init(model), inputs, readings)
    check_finite(first.mean, first.cov)
    theta, cov = _settle(model, first, inputs, readings)
    statistics = given_statistics(loads, sensors)
    mode = _refine(model, turbine, sensors, loads, statistics, theta, cov, inputs, readings)
    elapsed = time.perf_counter() - started

    n = len(parameters)
    learned = learned_statistics(statistics, mode.mean[n:], mode.cov[n:, n:])
    notes += _judgement(mode, sensors, loads_are_states=bool(loads))
    channels = tuple(sensor.channel for sensor in sensors)
    return Outcome(
        turbine,
        model,
        online,
        mode.info,
        mode.mean[:n],
        mode.cov[:n, :n],
        rotor,
        channels,
        elapsed,
        tuple(notes),
        learned,
    )


def _settle(model: StateSpace, first: Belief, inputs: Array, readings: Array) -> tuple[Array, Array]:
    """Further passes of the joint filter until θ stays; θ and its covariance."""
    block = model.parameter_block
    prior_mean, prior_cov = model.mean[block], model.cov[block, block]
    theta, cov = first.mean[block], first.cov[block, block]
    for _ in range(PASSES - 1):
        belief, _ = EKF.run(model, _restarted(model, theta), inputs, readings)
        if not (np.isfinite(belief.mean).all() and np.isfinite(belief.cov).all()):
            break
        start, cov = theta, belief.cov[block, block]
        theta = belief.mean[block] + cov @ np.linalg.solve(prior_cov, prior_mean - start)
        if np.all(np.abs(theta - start) < SETTLED * np.sqrt(np.diag(cov))):
            break
    return theta, cov


def _refine(
    model: StateSpace, turbine: Turbine, sensors: Sequence[Sensor], loads: Sequence[GaussMarkov],
    statistics: Sequence[Statistic], theta: Array, cov: Array, inputs: Array, readings: Array,
) -> Posterior:  # fmt: skip
    """The mode of the posterior of coefficients and statistics, from the state-only filter."""
    n, extra = len(theta), len(statistics)
    nx = len(model.compiled.states)
    block = model.parameter_block

    def build(values: Array) -> StateSpace:
        moved_loads, moved_sensors = with_statistics(statistics, values[n:], loads, sensors)
        physical = {q.name: float(q.physical(t)) for q, t in zip(model.parameters, values, strict=False)}
        return compose(
            turbine.model, intervals=model.blocks.step, values={**turbine.values, **physical}, loads=moved_loads, sensors=moved_sensors,
            cov=model.cov[:nx, :nx],
        )  # fmt: skip

    prior_cov = np.diag(np.concatenate([np.zeros(n), np.square(spreads(statistics))]))
    prior_cov[:n, :n] = model.cov[block, block]
    prior_mean = np.concatenate([model.mean[block], np.zeros(extra)])
    start, start_cov = np.concatenate([theta, np.zeros(extra)]), np.diag(np.full(n + extra, FIRST_WIDTH**2))
    start_cov[:n, :n] = cov
    for samples in (COARSE, len(readings)) if len(readings) >= 2 * COARSE else (len(readings),):
        mode = posterior_mode(
            build, inputs[:samples], readings[:samples],
            prior_mean=prior_mean, prior_cov=prior_cov, start=start, start_cov=start_cov,
        )  # fmt: skip
        start, start_cov = mode.mean, mode.cov
    return mode


def _judgement(mode: Posterior, sensors: Sequence[Sensor], *, loads_are_states: bool) -> list[str]:
    """What a reader must know before believing the bands."""
    loads = (
        "loads are states (first-order Gauss–Markov), their statistics and the noise learned from the record"
        if loads_are_states
        else "all loads are known, the noise learned from the record"
    )
    notes = [f"{loads}; damping is total: structure and aerodynamics"]
    if not mode.settled:
        notes.append(
            f"WARNING: do not trust these bands: the likelihood still rose after {mode.iterations} steps; "
            "choose a longer or steadier section, or priors nearer to the structure"
        )
    z = np.nan_to_num(mode.info.whitened)
    lag_one = np.sum(z[1:] * z[:-1], axis=0) / np.maximum(np.sum(z**2, axis=0), 1e-300)
    worst = int(np.argmax(np.abs(lag_one)))
    if abs(lag_one[worst]) > CORRELATED:
        notes.append(
            f"WARNING: do not trust these bands: the model does not explain {sensors[worst].channel} (its innovations are correlated "
            f"by {lag_one[worst]:+.2f} from sample to sample; 0 is expected): the loads are not of the modelled kind, or motion is "
            "missing from the model"
        )
    return notes


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
    axes = {sensor.axis for sensor in sensors if not sensor.blade}
    for axis in ("x", "y"):
        coupled = turbine.model.lag == "free" and "lag" not in changes  # blades shake the hub, which shakes them back
        if getattr(turbine.model, axis) == "free" and axis not in axes and not coupled:
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
    w = np.array([turbine.natural_frequency(name) for name in turbine.model.coordinates])
    gain = np.abs(direct[:, :n] + 1j * w * direct[:, n:] - w**2 * to_acceleration)
    gain[gain < 1e-9 * gain.max()] = 0.0  # rounding
    amplitudes: Array = np.full(n, np.nan)
    for j in range(n):
        clear = gain[:, j] > 0.3 * gain[:, j].max()
        if clear.any():
            amplitudes[j] = 3.0 * np.min(loudest[clear] / gain[clear, j])
    blades = np.array([name.startswith("beta_") for name in turbine.model.coordinates])
    for alike in (blades, ~blades):  # what no channel reads directly moves as far as its like
        seen = amplitudes[alike & np.isfinite(amplitudes)]
        amplitudes[alike & np.isnan(amplitudes)] = seen.max() if seen.size else 1.0
    return np.asarray(np.maximum(amplitudes, 1e-12))


def _loudest(values: Array, rate: float) -> float:
    """Greatest rms about the channel's mean over any second."""
    deviation = np.nan_to_num(values - np.nanmean(values))
    window = max(1, round(rate))
    power = np.convolve(deviation**2, np.full(window, 1.0 / window), mode="valid" if len(values) >= window else "full")
    return float(np.sqrt(max(power.max(), 0.0)))
