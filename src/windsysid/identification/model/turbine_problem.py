"""The state-only problem of a record: a model for every value of the unknowns, with the prior of the unknowns.

The unknowns (`windsysid.statespace.unknowns`) are θ, η and τ: the identified parameters, the statistics of loads and
noise (`windsysid.loads.statistics`), and the errors of instruments and masses within their tolerances
(`windsysid.identification.model.tolerances`). A search begins without τ, as if all were exact. What the likelihood of a
record is a function of, and what a planned record informs about, is said here once.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters import EKF
from windsysid.identification.model.fit import known_inputs, known_loads
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.identification.model.problem import FIRST_LOG_STD
from windsysid.identification.model.tolerances import seconds_late, tolerances_of, with_tolerances
from windsysid.loads.family import hypothesis
from windsysid.loads.hypothesis import SupposedLoads
from windsysid.loads.statistics import Statistic, moved_sensors, noise_groups, values_of
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.mechanics.model import MechanicalModel
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.tolerance import Tolerance, unknowns_of
from windsysid.statespace.compose import LoadBlocks, StateSpace, compose, discretise_loads, parameters_given
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import Unknowns
from windsysid.turbine.turbine import Turbine

__all__ = ["TurbineProblem", "pose", "seen_by"]


MAX_PASSES = 4
"""Numerical: passes of the joint filter towards a start."""

START_TOLERANCE_SIGMAS = 0.05
"""Numerical: the passes stop when one moves no parameter by more than so many standard deviations."""

MAX_CACHED_LOADS = 64
"""Setting: values of η whose loads and noise are kept."""


class TurbineProblem(NamedTuple):
    """Unknowns of a record.

    Attributes
    ----------
    turbine, sensors
        The turbine with the degrees of freedom that the sensors see, and these.
    model
        The joint model: θ in the state, the initial state as uncertain as the record is loud.
    loads, made
        What the loads that are states may be like; loads and noise at the last values of η that were requested.
    statistics, tolerances
        Statistics in η, and tolerances in τ, the clocks last.
    inputs, readings
        As filters take them (T, n_u + n_w), (T, m).
    notes
        What was locked.
    """

    turbine: Turbine
    model: StateSpace
    sensors: tuple[Sensor, ...]
    loads: SupposedLoads
    statistics: tuple[Statistic, ...]
    tolerances: tuple[Tolerance, ...]
    inputs: Array
    readings: Array
    notes: tuple[Finding, ...]
    made: dict[bytes, tuple[LoadBlocks, list[float]]]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of θ."""
        return self.model.parameters

    @property
    def unknowns(self) -> Unknowns:
        """Names of all unknowns."""
        return unknowns_of(self.parameters, self.statistics, self.tolerances)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean (n,) and covariance (n, n) of θ and η."""
        block, known = self.model.parameter_block, self.unknowns.only("parameters", "statistics")
        cov = np.diag(known.vector(statistics=np.square([s.spread for s in self.statistics])))
        theta = known.of("parameters")
        cov[theta, theta] = self.model.cov[block, block]
        return known.vector(parameters=self.model.mean[block]), cov

    @property
    def wide_prior(self) -> tuple[Array, Array]:
        """Values of θ, η and those of τ that are numbers of the model: all but the clocks."""
        mean, cov = self.prior
        known = self.unknowns.only("parameters", "statistics", "tolerances")
        at, wide = known.of("parameters", "statistics"), np.eye(known.size)
        wide[at, at] = cov
        return np.concatenate([mean, np.zeros(known.size - len(mean))]), wide

    @property
    def clocks(self) -> list[Array]:
        """For each clock, by how much readings (m,) are late [s] at one standard deviation of its tolerance."""
        own = np.diag([1.0 if one.group == "clock" else 0.0 for one in self.tolerances])
        return [seconds_late(self.tolerances, tau, self.sensors) for tau in own if tau.any()]

    def build(self, unknowns: Array) -> StateSpace:
        """The state-only model at the unknowns (n,), with τ or without."""
        known = self.unknowns
        statistics, off = unknowns[known.of("statistics")], unknowns[known.of("tolerances")]
        eta = statistics.tobytes()
        if eta not in self.made:  # of the neighbours of a value, most differ in θ alone
            if len(self.made) >= MAX_CACHED_LOADS:
                self.made.clear()
            self.made[eta] = self._levels(values_of(self.statistics, statistics))
        found = parameters_given(
            self.model, _compiled(self.turbine.model, self.sensors), unknowns[known.of("parameters")], *self.made[eta]
        )  # fmt: skip
        if not off.any():
            return found
        tau = np.zeros(len(self.tolerances))
        tau[: len(off)] = off
        p = with_tolerances(
            found.blocks.p, found.compiled.parameters, self.tolerances, tau, self.turbine, self.sensors,
            [q.name for q in self.parameters],
        )  # fmt: skip
        return replace(found, blocks=found.blocks._replace(p=p))

    def _levels(self, values: Mapping[str, float]) -> tuple[LoadBlocks, list[float]]:
        """The loads and the standard deviation of each reading's noise at the statistics."""
        compiled = _compiled(self.turbine.model, self.sensors)
        loads = discretise_loads(self.loads.blocks(values), compiled, self.model.blocks.step, continuous=True)
        sensors = moved_sensors([s for s in self.statistics if s.kind == "noise"], values, self.sensors)
        return loads, [sensor.noise for sensor in sensors]

    def start(self, inputs: Array, readings: Array) -> tuple[Array, Array]:
        """Start values of the unknowns and their uncertainty (n,), (n, n): from the joint filter on T samples.

        What the filter learns while linearised at a wrong θ it never forgets, so it runs again from where it ended,
        with the original prior covariance and the pull of the prior added afterwards, exactly so for a linear model: θ
        ← θ₁ + P₁ P₀⁻¹ (θ₀ − θ_start).
        """
        block, known = self.model.parameter_block, self.unknowns.only("parameters", "statistics")
        prior_mean, prior_cov = self.model.mean[block], self.model.cov[block, block]
        theta, cov = prior_mean, prior_cov
        for _ in range(MAX_PASSES):
            mean = self.model.mean.copy()
            mean[block] = theta
            belief, _ = EKF.run(self.model, EKF.init(self.model)._replace(mean=mean), inputs, readings)
            if not (np.isfinite(belief.mean).all() and np.isfinite(belief.cov).all()):
                break
            before, cov = theta, belief.cov[block, block]
            theta = belief.mean[block] + cov @ np.linalg.solve(prior_cov, prior_mean - before)
            if np.all(np.abs(theta - before) < START_TOLERANCE_SIGMAS * np.sqrt(np.diag(cov))):
                break
        at, start_cov = known.of("parameters"), np.diag(np.full(known.size, FIRST_LOG_STD**2))
        start_cov[at, at] = cov
        return known.vector(parameters=theta), start_cov

    def frequencies(self, unknowns: Array) -> list[float]:
        """Natural frequencies [Hz] at the unknowns (n,)."""
        at = zip(self.parameters, unknowns[self.unknowns.of("parameters")], strict=True)
        found = {q.name: float(q.physical(theta)) for q, theta in at}
        turbine = self.turbine.with_values(found)
        return [turbine.natural_frequency(name) / (2.0 * math.pi) for name in turbine.model.coordinates]


@lru_cache(maxsize=16)
def _compiled(model: MechanicalModel, sensors: tuple[Sensor, ...]) -> CompiledModel:
    return compile_model(model, sensors, instruments=True)


def pose(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None = None,
    loads: str = "broadband",
) -> TurbineProblem:  # fmt: skip
    """The problem that a record poses, with the chosen parameters or every coefficient that the sensors see.

    `loads` names a load model of `windsysid.loads.family`.
    """
    notes: list[Finding] = []
    turbine = seen_by(turbine, sensors, notes)
    known = known_inputs(record, turbine, sensors)
    measured, of_the_file = known_loads(record, turbine)
    supposed = hypothesis(loads, turbine, of_the_file)
    turbine = supposed.turbine
    parameters = (*prior.parameters(turbine, identifiable(turbine, chosen), linear=False), *supposed.parameters)
    given = supposed.blocks({s.name: s.given for s in supposed.statistics})
    model = _joint_model(record, turbine, sensors, parameters, given, known)
    readings = np.column_stack([record[sensor.channel] for sensor in sensors])
    inputs = np.hstack([known, measured] if record.is_uniform else [known, measured, record.intervals()[1][:, None]])
    statistics = (*supposed.statistics, *noise_groups(sensors))
    tolerances = tolerances_of(turbine, sensors, [q.name for q in parameters])
    return TurbineProblem(
        turbine, model, tuple(sensors), supposed, statistics, tolerances, inputs, readings, tuple(notes), {}
    )  # fmt: skip


def seen_by(turbine: Turbine, sensors: Sequence[Sensor], notes: list[Finding]) -> Turbine:
    """The turbine with those degrees of freedom locked that no sensor sees, which `notes` then name."""
    model, locked = turbine.model.lock_unseen(sensors)
    if not locked:
        return turbine
    notes += [Finding("coordinate_locked", "note", {"coordinate": name}) for name in locked]
    return replace(turbine, model=model, loads=tuple(load for load in turbine.loads if load.load in model.loads))


def _joint_model(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], parameters: Sequence[Parameter],
    loads: Sequence[LoadModel], rotor: Array,
) -> StateSpace:  # fmt: skip
    model = compose(
        turbine.model,
        intervals=record.intervals()[0],
        values=turbine.values,
        parameters=parameters,
        loads=loads,
        continuous=True,
        sensors=sensors,
    )
    n = len(turbine.model.coordinates)
    amplitude = _amplitudes(record, turbine, sensors, model, rotor[0])
    frequency = np.array([turbine.natural_frequency(name) for name in turbine.model.coordinates])
    cov = model.cov.copy()
    cov[range(2 * n), range(2 * n)] = np.square(np.concatenate([amplitude, amplitude * frequency]))
    return replace(model, cov=cov)


def _amplitudes(record: Record, turbine: Turbine, sensors: Sequence[Sensor], model: StateSpace, rotor: Array) -> Array:
    """Bound of each degree of freedom's distance from rest at the first sample: three times what the strongest second
    would need.

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
    blades = np.array([freedom.blade > 0 for freedom in turbine.model.freedoms])
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
