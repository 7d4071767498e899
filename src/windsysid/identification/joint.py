"""The joint formulation: states, loads and coefficients together, from accelerometers.

The unknowns are the coefficients and the statistics of loads and noise (`windsysid.identification.problem`). The record is first taken in as it would be on
line (`windsysid.identification.recursive`); that history is kept. From where it ends the mode of the posterior of the whole record is found
(`windsysid.identification.posterior_mode`): the result and its bands are those.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.filters import EKF
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.load_choice import choose
from windsysid.identification.outcome import Outcome, check_finite, known_loads
from windsysid.identification.posterior_mode import Posterior, posterior_mode
from windsysid.identification.prior import Prior
from windsysid.identification.problem import Problem, pose
from windsysid.identification.recursive import History, Online, advance, finish
from windsysid.loads.family import candidates
from windsysid.loads.statistics import learned_statistics
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.load_history import Loads
from windsysid.statespace.compose import StateSpace
from windsysid.turbine.turbine import Turbine

__all__ = ["identify_jointly"]


PERIODS = 10.0
"""Periods of the slowest degree of freedom before the first estimate on line."""

GATE = 5.0
"""Standard deviations beyond which an innovation is an outlier: one in two million of normal ones."""

FELT = 0.02
"""What they must add to a channel's mean squared innovation to be left out: a few that are hardly beyond the gate do no harm."""

MOST = 0.05
"""Share of a channel beyond which they are not outliers: then the model is wrong, and all are kept."""

GATED_PASSES = 4
"""Most searches for the mode until the set of outliers stays."""

HELD = "under simulated turbulent wind ±2σ of this load model held the truth in nine cases of ten (docs/calibration.md)"
"""What a result under `rotor-wind` says of itself; ``python -m validation.mismatch`` prints how often."""

CHUNK = 1024
"""Samples whose covariances are held at once."""


def identify_jointly(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None = None, *,
    loads: str = "auto",
) -> Outcome:  # fmt: skip
    """Identify the chosen parameters, or every coefficient that the sensors see, from a record.

    `loads` names a load model (`windsysid.loads.family`), or leaves the choice to the record.
    """
    warming = 0.0

    def posed(name: str) -> Problem:
        nonlocal warming
        begun = time.perf_counter()
        problem = pose(record, turbine, sensors, prior, chosen, name)
        _warm(problem)
        warming += time.perf_counter() - begun
        return problem

    started = time.perf_counter()
    names = candidates(turbine, known_loads(record, turbine)[1]) if loads == "auto" else (loads,)
    best, why = choose(posed, names, first_estimate(turbine, record.rate), record.rate)
    problem = best.problem
    inputs, readings = problem.inputs, problem.readings
    online, history = advance(
        problem.build, best.online, inputs[best.online.reached :], readings[best.online.reached :], problem.start
    )
    online, last = finish(problem.build, online, problem.start)
    check_finite(online.theta, online.precision)
    mode, left_out = _without_outliers(problem, online)
    elapsed = time.perf_counter() - started - warming

    n = len(problem.parameters)
    mean, std = _after_each_sample(problem, (best.history, history, last), len(readings))
    acted = acting_loads(problem.build(mode.mean), inputs, left_out.readings)
    return Outcome(
        turbine=problem.turbine,
        model=problem.model,
        history_mean=mean,
        history_std=std,
        final=mode.info._replace(gated=left_out.outliers),
        theta=mode.mean[:n],
        cov=mode.cov[:n, :n],
        rotor=inputs[:, : len(problem.model.compiled.inputs)],
        channels=tuple(sensor.channel for sensor in sensors),
        elapsed=elapsed,
        notes=(*problem.notes, *_told(problem, why), *left_out.notes),
        statistics=learned_statistics(problem.statistics, mode.mean[n:], mode.cov[n:, n:]),
        doubts=_doubts(mode, turbine, problem.turbine),
        loads=acted,
        joint_cov=mode.cov,
    )


def _warm(problem: Problem) -> None:
    """Compile or load every kernel."""
    nothing = problem.inputs[:0], problem.readings[:0]
    for model in (problem.model, problem.build(problem.prior[0])):
        EKF.run(model, EKF.init(model), *nothing)
    run_bank(bank_of([model]), *nothing)


class _LeftOut(NamedTuple):
    """Outliers among the readings (T, m), the readings without them, and what to say about them."""

    outliers: NDArray[np.bool_]
    readings: Array
    notes: tuple[str, ...]


def _without_outliers(problem: Problem, online: Online) -> tuple[Posterior, _LeftOut]:
    """The mode of the posterior of the whole record, without the readings that are outliers there.

    Maximum likelihood needs a fixed set of readings. So the mode is found with all of them, the outliers there are left out, and the mode is found
    anew; the set is judged again from all readings, until it stays.
    """
    inputs, readings = problem.inputs, problem.readings
    start, start_cov = online.theta, online.cov
    outliers = np.zeros(readings.shape, dtype=np.bool_)
    for _ in range(GATED_PASSES):
        kept = np.where(outliers, np.nan, readings)
        mode = posterior_mode(
            problem.build, inputs, kept,
            prior_mean=problem.prior[0], prior_cov=problem.prior[1], start=start, start_cov=start_cov,
        )  # fmt: skip
        found = _outliers(problem.build(mode.mean), inputs, readings)
        if np.array_equal(found, outliers):
            break
        outliers, start, start_cov = found, mode.mean, mode.cov
    notes = [
        f"{count} of {len(readings)} samples of {name} were left out as outliers (beyond {GATE:g}σ)"
        for name, count in zip(problem.model.readings, outliers.sum(axis=0), strict=True)
        if count
    ]
    return mode, _LeftOut(outliers, kept, tuple(notes))


def _outliers(model: StateSpace, inputs: Array, readings: Array) -> NDArray[np.bool_]:
    """Readings (T, m) beyond `GATE` of a filter that takes none of them in, in channels that feel them, and not where they are the rule."""
    gated = replace(model, blocks=model.blocks._replace(gate=np.array([GATE])))
    info = EKF.run(gated, EKF.init(gated), inputs, readings)[1]
    size = np.square(np.where(info.gated, info.innovation / info.innovation_std, 0.0))
    felt = np.nansum(size, axis=0) > FELT * np.isfinite(readings).sum(axis=0)
    return np.asarray(info.gated & felt & (info.gated.mean(axis=0) <= MOST))


def acting_loads(model: StateSpace, inputs: Array, readings: Array) -> Loads:
    """The loads that are states as the filter knew them after each sample, w = H(ψ) z."""
    compiled, blocks = model.compiled, model.blocks
    nx, nz = blocks.sizes[:2]
    driven = np.any(blocks.load_output != 0.0, axis=(0, 2))
    names = tuple(name for name, is_driven in zip(compiled.loads, driven, strict=True) if is_driven)
    mean, std = np.empty((len(inputs), len(names))), np.empty((len(inputs), len(names)))
    belief = EKF.init(model)
    for first in range(0, len(inputs), CHUNK):
        part = slice(first, first + CHUNK)
        belief, info, covs = EKF.run_with_covariances(model, belief, inputs[part], readings[part])
        z, P = info.mean[:, nx : nx + nz], covs[:, nx : nx + nz, nx : nx + nz]
        psi = inputs[part, blocks.azimuth[0]] if blocks.azimuth[0] >= 0 else np.zeros(len(z))
        k = np.arange(1, (len(blocks.load_output) + 1) // 2)
        turn = np.ones((len(z), len(blocks.load_output)))
        turn[:, 1::2], turn[:, 2::2] = np.cos(np.outer(psi, k)), np.sin(np.outer(psi, k))
        H = np.einsum("tk,kwz->twz", turn, blocks.load_output[:, driven])
        mean[part] = np.einsum("twz,tz->tw", H, z)
        std[part] = np.sqrt(np.maximum(np.einsum("twz,tzy,twy->tw", H, P, H), 0.0))
    return Loads(names, mean, std)


def first_estimate(turbine: Turbine, rate: float) -> int:
    """Samples before the first estimate on line."""
    slowest = min(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    return math.ceil(PERIODS * 2.0 * math.pi / slowest * rate)


def _after_each_sample(problem: Problem, histories: Sequence[History], samples: int) -> tuple[Array, Array]:
    """Mean and standard deviation of θ as they were known after each sample (T, n_θ): the prior before the first estimate."""
    n = len(problem.parameters)
    prior_mean, prior_cov = problem.prior
    since = np.concatenate([[0], *(history.samples for history in histories)])
    mean = np.concatenate([prior_mean[None], *(history.mean for history in histories)])
    variance = np.array([np.diag(cov) for cov in (prior_cov, *(cov for history in histories for cov in history.cov))])
    known = np.searchsorted(since, np.arange(1, samples + 1), side="right") - 1
    return mean[known, :n], np.sqrt(variance[known, :n])


def _told(problem: Problem, why: str) -> tuple[str, ...]:
    """What was taken for the loads, and why."""
    total = "damping is total: structure and aerodynamics"
    if not problem.loads.statistics:
        return (f"all loads are known, the noise learned from the record; {total}",)
    taken = f"loads are states ({problem.loads.text}), their statistics and the noise learned from the record; {total}"
    return (taken, why, HELD) if problem.loads.name == "rotor-wind" else (taken, why)


def _doubts(mode: Posterior, given: Turbine, used: Turbine) -> tuple[str, ...]:
    """What speaks against the bands and does not show in the innovations."""
    doubts = []
    if not mode.settled:
        doubts.append(
            f"the likelihood still rose after {mode.iterations} steps: choose a longer or steadier section, or priors nearer to the structure"
        )
    if getattr(given.model, "lag", "") == "free" and getattr(used.model, "lag", "") == "locked":
        doubts.append(
            "no channel sees the blades, so they are locked; where they move, the load takes the blame and the support's stiffness is off by more "
            "than its band: add a sensor on a blade, or use a turbine file whose blades are locked (docs/tower.md)"
        )
    return tuple(doubts)
