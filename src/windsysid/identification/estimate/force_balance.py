"""The paper's formulation: identify coefficients from the balance of forces, with displacement and velocity as inputs.

The equations of motion are linear in stiffness and damping. With measured q, q̇, q̈ put in, each degree of freedom
gives

    s_j(t) = Σ_i Φ_ji(t) θ_i,
    s = F(θ = 0) − M q̈  (what is left of the known forces),    Φ = −∂F/∂θ  (here: q and q̇),

and θ_{k+1} = θ_k (the paper's evolution model). Both sides go through the same zero-phase band-pass: an
accelerometer knows no mean, and integration leaves drift below the band. Residuals of a band of width B are correlated
over fs / 2B samples, and the variance of s is enlarged by that factor so that ±2σ means what it says.

The load that is not in the equations biases the answer: in stationary vibration E[f q̇] = c E[q̇²], so that damping
vanishes.
"""

import math
import time
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.filters import EKF
from windsysid.identification.model.fit import Outcome, check_finite, known_loads
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.force_balance import ForceBalance, ForceRegression, RegressionReading
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.signals import band_pass, rotor_inputs
from windsysid.signals import integrate as integrate_acceleration
from windsysid.simulation.integrate import integrate
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = [
    "Balance", "Kinematic", "MeasuredMotion", "analysis_band", "balance_forces", "balance_statespace", "filter_balance",
    "identify_by_force_balance", "measured_channels", "measured_motion",
]  # fmt: skip


EDGE_PERIODS = 2.0
"""Setting: periods of the band's lower edge at either end of a record that are left out: there the filters know one
side only."""

RELATIVE_STEP = 0.01
"""Numerical: the paper's "centesimal increment": relative step of its finite differences."""


class Kinematic(NamedTuple):
    """Measured motion of every degree of freedom, (T, n) each: displacement, velocity, acceleration."""

    displacement: Array
    velocity: Array
    acceleration: Array


class MeasuredMotion(NamedTuple):
    """Inputs of a force balance: the motion of every free degree of freedom, (T, n) each; ψ, Ω, dΩ/dt of the rotor
    (T, 3); known generalised loads (T, n), or None: withheld; samples per second [Hz]."""

    motion: Kinematic
    rotor: Array
    loads: Array | None
    rate: float


class Balance(NamedTuple):
    """Both sides of the force balance: s (T, n) [N or N·m] and Φ (T, n, n_θ) with s = Φ θ + noise."""

    force: Array
    regressors: Array


def identify_by_force_balance(whole: Record, part: Record, turbine: Turbine, prior: Prior) -> Outcome:
    """Identify from `part` of a uniformly sampled record.

    Integration and filtering run over the `whole` record, so that a section has no ends of its own.
    """
    band = analysis_band(turbine)
    channels = measured_channels(whole, turbine)
    motion = measured_motion(whole, turbine, cutoff=band[0] / 2.0)
    known, withheld = known_loads(whole, turbine)
    rotor = rotor_inputs(whole, turbine.rotor_speed)
    balance = balance_forces(turbine, MeasuredMotion(motion, rotor, known, whole.rate), identifiable(turbine), band)
    start = int(np.argmin(np.abs(whole.time - part.time[0])))
    window = slice(start, start + part.samples)
    notes = [Finding("balance_filtered", "note", {"low": band[0], "high": band[1]})]
    doubts: tuple[Finding, ...] = ()
    if withheld:
        notes.append(Finding("loads_withheld", "note", {"loads": [load.load for load in withheld]}))
        doubts = (Finding("loads_missing", "reason"),)
    cut = Balance(balance.force[window], balance.regressors[window])
    outcome = filter_balance(cut, turbine, rotor[window], prior, rate=whole.rate, band=band)
    return outcome._replace(channels=channels, notes=tuple(notes), doubts=doubts)


def filter_balance(
    balance: Balance, turbine: Turbine, rotor: Array, prior: Prior, *, rate: float, band: tuple[float, float]
) -> Outcome:
    """Run the filter over a force balance; `rotor` is ψ, Ω, dΩ/dt (T, 3) of the same samples."""
    parameters = prior.parameters(turbine, identifiable(turbine), linear=True)
    model, inputs = balance_statespace(balance, turbine.model.coordinates, parameters, rate=rate, band=band)
    EKF.run(model, EKF.init(model), inputs[:0], balance.force[:0])  # compiles or loads the kernel outside the clock
    started = time.perf_counter()
    belief, info = EKF.run(model, EKF.init(model), inputs, balance.force)
    elapsed = time.perf_counter() - started
    check_finite(belief.mean, belief.cov)
    return Outcome(turbine, model, info.mean, info.std, info, belief.mean, belief.cov, rotor, (), elapsed, ())


def analysis_band(turbine: Turbine) -> tuple[float, float]:
    """The band of the force balance [Hz]: from half the lowest to one and a half times the highest natural
    frequency."""
    frequencies = [turbine.natural_frequency(name) / (2.0 * math.pi) for name in turbine.model.coordinates]
    return 0.5 * min(frequencies), 1.5 * max(frequencies)


def measured_channels(record: Record, turbine: Turbine) -> tuple[str, ...]:
    """Channels that a force balance of this record reads: an acceleration per degree of freedom, and the others
    present."""
    optional = [f"{stem}_{quantity}" for stem in turbine.rotor.stems for quantity in ("displacement", "velocity")]
    return (
        *(f"{stem}_acceleration" for stem in turbine.rotor.stems),
        *(channel for channel in optional if channel in record),
    )


def measured_motion(record: Record, turbine: Turbine, cutoff: float) -> Kinematic:
    """Displacement, velocity, acceleration of every degree of freedom, (T, n) each.

    What is not recorded is integrated from the acceleration, without drift below `cutoff` [Hz].

    Raises
    ------
    RecordError
        If an acceleration is missing, or a channel has another unit or no numbers.
    """
    columns: list[tuple[Array, Array, Array]] = []
    for stem in turbine.rotor.stems:
        _check_channels(record, stem)
        acceleration = record[f"{stem}_acceleration"]
        velocity, displacement = integrate_acceleration(acceleration, record.rate, cutoff=cutoff)
        if f"{stem}_displacement" in record:
            displacement = record[f"{stem}_displacement"]
        if f"{stem}_velocity" in record:
            velocity = record[f"{stem}_velocity"]
        columns.append((displacement, velocity, acceleration))
    return Kinematic(*(np.column_stack(quantity) for quantity in zip(*columns, strict=True)))


def _check_channels(record: Record, stem: str) -> None:
    """Refuse channels of one degree of freedom that hold no numbers or another unit than the balance needs."""
    for quantity, per in (("displacement", ""), ("velocity", "/s"), ("acceleration", "/s^2")):
        channel = f"{stem}_{quantity}"
        if channel not in record and quantity != "acceleration":
            continue
        unit = ("rad" if "lag" in stem or "roll" in stem else "m") + per
        if record.unit(channel) != unit:
            raise RecordError(f"channel '{channel}': expected {unit}, got {record.unit(channel)}: correct its unit")
        if not np.isfinite(record[channel]).any():
            raise RecordError(
                f"channel '{channel}' holds no numbers: leave it out if it is a displacement or velocity, "
                "or choose another record"
            )


def balance_forces(
    turbine: Turbine,
    measured: MeasuredMotion,
    parameters: Sequence[str],
    band: tuple[float, float],
    *,
    jacobian: Literal["exact", "differences"] = "exact",
) -> Balance:
    """Both sides of the force balance of a record, filtered to a band.

    Parameters
    ----------
    parameters
        Names of the coefficients to identify.
    band
        Lower and upper frequency of the zero-phase filter [Hz].
    jacobian
        ``"exact"``, or ``"differences"`` with the paper's centesimal increment; the same to rounding, the balance
        being linear.

    Raises
    ------
    RecordError
        If an array does not fit, or a channel holds no numbers.
    """
    (motion, rotor, loads, rate), n = measured, len(turbine.model.coordinates)
    samples = len(rotor)
    for name, array in zip(Kinematic._fields, motion, strict=True):
        if array.shape != (samples, n):
            raise RecordError(f"{name}: expected ({samples}, {n}), one column per degree of freedom, got {array.shape}")
    compiled = compile_model(ForceBalance(turbine.rotor))
    known = np.zeros((samples, n)) if loads is None else loads
    inputs = np.hstack([*motion, rotor, known])
    values = dict(turbine.values) | dict.fromkeys(parameters, 0.0)

    def residual(changed: dict[str, float]) -> Array:
        p = np.array([(values | changed)[name] for name in compiled.parameters])
        return integrate(compiled, p, inputs, rate=rate, start=np.empty(0)).readings

    def slope(name: str) -> Array:
        if jacobian == "exact":
            return force - residual({name: 1.0})
        at = turbine.values[name]
        return (residual({name: at}) - residual({name: at * (1.0 + RELATIVE_STEP)})) / (at * RELATIVE_STEP)

    force = residual({})
    regressors = np.empty((samples, n, len(parameters)))
    for i, name in enumerate(parameters):
        regressors[:, :, i] = slope(name)
    return _filtered(Balance(force, regressors), rate, band)


def _filtered(balance: Balance, rate: float, band: tuple[float, float]) -> Balance:
    """A force balance in a band [Hz]; its ends, which the filters distort, are missing."""
    force, regressors = balance
    missing = ~np.isfinite(force)
    ends = math.ceil(EDGE_PERIODS / band[0] * rate)
    missing[:ends] = missing[-ends:] = True
    filtered = Balance(np.empty_like(force), np.zeros_like(regressors))
    for j in range(force.shape[1]):
        filtered.force[:, j] = band_pass(force[:, j], rate, band)
        for i in range(regressors.shape[2]):
            if np.any(regressors[:, j, i] != 0.0):
                filtered.regressors[:, j, i] = band_pass(regressors[:, j, i], rate, band)
    filtered.force[missing] = np.nan
    return filtered


def balance_statespace(
    balance: Balance,
    coordinates: Sequence[str],
    parameters: Sequence[Parameter],
    *,
    rate: float,
    band: tuple[float, float],
) -> tuple[StateSpace, Array]:
    """The force balance as a state-space model, with its input array.

    Returns
    -------
    model, inputs
        State θ alone, readings s, inputs the entries of Φ (T, n · n_θ).
    """
    samples, n = balance.force.shape
    noise = _residual_rms(balance)
    correlated = np.sqrt(rate / (2.0 * (band[1] - band[0])))
    sensors = [
        RegressionReading(f"force_{name}", float(rms * correlated))
        for name, rms in zip(coordinates, noise, strict=True)
    ]
    model = compose(
        ForceRegression(n, tuple(parameter.name for parameter in parameters)),
        rate=rate,
        values={},
        parameters=parameters,
        sensors=sensors,
    )
    inputs = np.where(np.isfinite(balance.regressors), balance.regressors, 0.0).reshape(samples, -1)
    return model, inputs


def _residual_rms(balance: Balance) -> Array:
    """Rms residual of each row after least squares: the noise of the balance, from the data."""
    rms = np.empty(balance.force.shape[1])
    for j in range(len(rms)):
        known = np.isfinite(balance.force[:, j]) & np.isfinite(balance.regressors[:, j]).all(axis=1)
        if not known.any():
            raise RecordError(
                f"force balance: no sample is left: its filters need {EDGE_PERIODS:g} periods of the lower edge at"
                " either end; choose a longer record, or a section further inside"
            )
        rows, right = balance.regressors[known, j], balance.force[known, j]
        solution = np.linalg.lstsq(rows, right, rcond=None)[0]
        rms[j] = np.sqrt(np.mean((right - rows @ solution) ** 2))
        rms[j] = max(rms[j], 1e-9 * np.sqrt(np.mean(right**2)), 1e-300)
    return rms
