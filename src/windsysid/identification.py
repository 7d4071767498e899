"""Identify: record + turbine + sensors → `Identification`, the front door of the house."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from windsysid.coercion import RecordLike, TurbineLike, as_record, as_turbine
from windsysid.diagnostics import diagnose
from windsysid.errors import ConfigurationError, RecordError
from windsysid.filters import EKF, Info
from windsysid.forcebalance import identify_by_force_balance, measured_channels
from windsysid.formulation import TURNING, Loads, Outcome, Prior
from windsysid.inspect.health import Finding
from windsysid.inspect.screening import noted, screen
from windsysid.joint import identify_jointly
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.sensors import Sensor
from windsysid.mechanics.tower import TowerModel
from windsysid.modal import modes_with_bands
from windsysid.provenance import Provenance, record_hash, trace
from windsysid.record import Record
from windsysid.result import SIGMAS, Conditions, Estimate, Identification, coefficient_errors
from windsysid.signals import resample
from windsysid.turbine import Turbine
from windsysid.units import parameter_unit

__all__ = ["Formulation", "Prior", "add_noise", "conclude", "identify", "screened", "usable_sensors", "with_noise"]

Array = NDArray[np.float64]

TOWER_SAMPLES = 12.0
"""Samples per period of a tower: room for its blade-passing line, not for the blades' own modes and the tower's second."""

FEWEST_PER_PERIOD, FEWEST = 2.5, 20
"""Samples per period of the slowest mode below which nothing of it is left in a resampled record, and fewest samples of such a record."""

STEP = 0.6
"""Longest step of the equations, times the highest natural frequency [rad]."""

Formulation = Literal["joint", "force-balance"]


def identify(
    record: RecordLike,
    turbine: TurbineLike,
    *,
    sensors: Sequence[Sensor] | None = None,
    formulation: Formulation = "joint",
    section: tuple[float, float] | None = None,
    prior: Prior | None = None,
    parameters: Sequence[str] | None = None,
    rate: float | None = None,
    loads: str = "auto",
) -> Identification:
    """Identify stiffness and damping of `turbine` from `record`.

    Parameters
    ----------
    record
        Channels in SI, with ``rotor_azimuth`` [rad]; ``rotor_speed`` [rad/s] and known loads ``load_x`` … [N, N·m]
        where measured. A `Record`, a path, a pandas DataFrame or an xarray Dataset with units (`windsysid.coercion`).
    turbine
        Masses, geometry, and the references that priors are centred on. A `Turbine`, a packaged name or a TOML file.
    sensors
        Instruments on the record's channels; the turbine's usual ones, as far as they are recorded, by default. The
        force balance reads displacement, velocity and acceleration of every degree of freedom by name and integrates
        what is missing.
    formulation
        ``"joint"`` or ``"force-balance"``.
    section
        Start and end of the part to use [s]; the whole record by default.
    prior
        Where priors are centred and how wide they are; on the turbine's references, as wide as its file says, by
        default.
    parameters
        Names of what to identify, masses and geometry included (joint formulation); the stiffness and damping
        coefficients of every free degree of freedom by default.
    rate
        Readings per second [Hz] to resample to, without aliasing (joint formulation): as many as hold what the model has and leave out what it has not. The record's own by
        default, and for a tower under a rigid rotor twelve per period. The equations take shorter steps where they need them.
    loads
        What the loads are taken for (joint formulation): ``"broadband"``, ``"second-order"`` or ``"rotor-wind"``
        (`windsysid.loadmodels`); the record chooses by default.

    Raises
    ------
    RecordError, ConfigurationError
        If the record does not hold what is needed, or an option is out of range.
    """
    record, turbine = as_record(record), as_turbine(turbine)
    options = {
        "formulation": formulation,
        "section": None if section is None else list(section),
        "prior": None if prior is None else asdict(prior),
        "parameters": None if parameters is None else list(parameters),
        "rate": rate,
        "loads": loads,
    }
    recorded = part = record.section(*section) if section else record
    part = part.on_own_times() if formulation == "joint" else part.on_uniform_grid()
    if formulation == "joint":
        found = usable_sensors(part, turbine, sensors)
        faults = noted(screened(recorded, turbine, found))
        part, steps, resampled = _slowed(part, turbine, rate, sensors)
        _check_length(part, turbine)
        outcome = identify_jointly(part, turbine, found, prior or Prior(), parameters, loads=loads)
        outcome = _every(outcome, steps)._replace(notes=(*resampled, *outcome.notes, *faults))
        read = replace(part, time=part.time[::steps], values=part.values[::steps])
        return conclude(
            outcome, read, formulation, provenance=trace(record, record_hash(record), turbine, found, options)
        )
    if formulation == "force-balance":
        _check_length(part, turbine)
        if sensors is not None:
            raise ConfigurationError(
                "the force balance takes no sensor list: it reads tower_x_acceleration, blade_1_lag_displacement … by name"
            )
        if parameters is not None:
            raise ConfigurationError("the force balance identifies all coefficients at once: leave `parameters` out")
        if rate is not None:
            raise ConfigurationError("the force balance filters the record as it is: leave the rate out")
        if loads != "auto":
            raise ConfigurationError("the force balance has no model of the loads: leave `loads` out")
        whole = record.on_uniform_grid()
        measured = measured_channels(part, turbine)
        faults = noted(screen(recorded, turbine, measured, others=(*TURNING, *turbine.model.loads)))
        outcome = identify_by_force_balance(whole, part, turbine, prior or Prior(spread=1.0))
        outcome = outcome._replace(notes=(*outcome.notes, *faults))
        return conclude(outcome, part, formulation, provenance=trace(record, record_hash(record), turbine, (), options))
    raise ConfigurationError(f"formulation: expected joint or force-balance, got '{formulation}'")


def add_noise(record: Record, channels: Sequence[str], percent: float, seed: int) -> tuple[Record, dict[str, float]]:
    """White noise of `percent` of each channel's standard deviation added to it; returns the noise rms per channel too.

    Raises
    ------
    ConfigurationError
        If `percent` is negative or not finite.
    """
    if not (math.isfinite(percent) and 0.0 <= percent <= 1000.0):
        raise ConfigurationError(f"added noise: expected a percentage between 0 and 1000, got {percent:g}")
    rng = np.random.default_rng(seed)
    added: dict[str, float] = {}
    changed: dict[str, tuple[Array, str]] = {}
    for channel in channels:
        values = record[channel]
        added[channel] = percent / 100.0 * float(np.nanstd(values))
        noisy = values + added[channel] * rng.standard_normal(len(values))
        changed[channel] = (noisy, record.units[record.channels.index(channel)])
    return record.with_channels(changed), added


def with_noise(sensors: Sequence[Sensor], added: Mapping[str, float]) -> tuple[Sensor, ...]:
    """The same sensors, as noisy as they and the added noise are together."""
    return tuple(
        sensor.model_copy(update={"noise": math.hypot(sensor.noise, added.get(sensor.channel, 0.0))})
        for sensor in sensors
    )


def usable_sensors(record: Record, turbine: Turbine, sensors: Sequence[Sensor] | None) -> tuple[Sensor, ...]:
    """The sensors given, all of which the record must hold, or those of the turbine's usual ones that it does hold."""
    if sensors is None:
        found = tuple(sensor for sensor in turbine.sensors if sensor.channel in record)
        if not found:
            wanted = ", ".join(sensor.channel for sensor in turbine.sensors)
            raise RecordError(
                f"{record.name}: expected at least one of the channels {wanted}; got {', '.join(record.channels)}; "
                "list the record's own channels with --sensors FILE"
            )
    else:
        found = tuple(sensors)
        if not found:
            raise ConfigurationError(
                "the sensor list is empty: expected at least one sensor; leave it out for the usual ones"
            )
    for sensor in found:
        values = record[sensor.channel]
        unit = record.units[record.channels.index(sensor.channel)]
        if sensor.quantity != "strain" and unit != sensor.unit:
            raise RecordError(
                f"channel '{sensor.channel}': expected {sensor.unit} for {sensor.quantity}, got {unit}: correct the unit or the sensor"
            )
        if not np.isfinite(values).any():
            raise RecordError(
                f"channel '{sensor.channel}' holds no numbers in this section: leave it out of the sensor list, "
                "or choose another section"
            )
    for name in turbine.model.loads:
        expected = "N*m" if "beta" in name else "N"
        if name in record and record.unit(name) != expected:
            raise RecordError(f"channel '{name}': expected {expected}, got {record.unit(name)}: correct its unit")
    return found


def screened(record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, refuse: bool = True) -> list[Finding]:
    """What is wrong with the channels that the joint formulation reads (`windsysid.inspect.screening`); RecordError where it makes estimates wrong."""
    return screen(
        record, turbine, [sensor.channel for sensor in sensors],
        others=(*TURNING, "wind_speed", *turbine.model.loads), offsets={sensor.channel: sensor.bias for sensor in sensors},
        refuse=refuse,
    )  # fmt: skip


def _slowed(
    record: Record, turbine: Turbine, rate: float | None, sensors: Sequence[Sensor] | None
) -> tuple[Record, int, tuple[str, ...]]:
    """The record at a lower rate, where one is asked for or the turbine's model has nothing to say of what is faster; samples per reading, and a note.

    Where the equations need shorter steps than a reading takes, sensors are missing between their readings and all else is as the fine grid has it.
    """
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    if rate is None and isinstance(turbine.model, TowerModel):
        rate = min(TOWER_SAMPLES * fastest / (2.0 * math.pi), record.rate)
    elif rate is not None and not 0.0 < rate <= 1.001 * record.rate:
        raise ConfigurationError(
            f"rate: expected more than 0 and at most the record's {record.rate:.4g} Hz, got {rate:g}"
        )
    if rate is None or rate > 0.95 * record.rate:
        return record, 1, ()
    _check_rate(record, turbine, rate)
    slow, steps = resample(record, rate), math.ceil(fastest / STEP / rate * (1.0 - 1e-9))
    note = f"resampled from {record.rate:.4g} to {rate:.3g} Hz"
    if steps <= 1:
        return slow, 1, (note,)
    if fastest > 0.8 * math.pi * rate:
        note += f", which takes the mode near {fastest / (2.0 * math.pi):.3g} Hz out of the record and not out of the model: do not rely on what is said of it"
    read = {sensor.channel for sensor in sensors or turbine.sensors}
    others = [name for name in record.channels if name not in read]
    length = steps * (slow.samples - 1) + 1
    values = np.full((length, len(record.channels)), np.nan)
    values[::steps] = slow.values
    if others:
        fine = resample(record.select(others), steps * rate)
        values[:, [record.channels.index(name) for name in others]] = fine.values[:length]
    time = slow.time[0] + np.arange(length) / (steps * rate)
    return replace(slow, time=time, values=values), steps, (f"{note}, {steps} steps of the equations for each reading",)


def _check_rate(record: Record, turbine: Turbine, rate: float) -> None:
    """Refuse a rate whose low-pass, flat to 0.4 of it, takes every mode out of the record, or that leaves next to no readings."""
    slowest = min(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)
    least = max(FEWEST_PER_PERIOD * slowest, FEWEST / record.duration)
    if rate < least:
        left, periods = math.floor(record.duration * rate) + 1, record.duration * slowest
        raise ConfigurationError(
            f"rate: {rate:g} Hz would leave {left} samples of {periods:.3g} periods of the slowest mode ({slowest:.3g} Hz): expected at least {1.001 * least:.3g} Hz"
        )


def _every(outcome: Outcome, steps: int) -> Outcome:
    """What a formulation found at every reading, on a record that has `steps` samples for each."""
    loads = outcome.loads
    return outcome._replace(
        history_mean=outcome.history_mean[::steps],
        history_std=outcome.history_std[::steps],
        final=Info._make(array[::steps] for array in outcome.final),
        rotor=outcome.rotor[::steps],
        loads=None if loads is None else Loads(loads.names, loads.mean[::steps], loads.std[::steps]),
    )


def _check_length(record: Record, turbine: Turbine) -> None:
    for name in turbine.model.coordinates:
        if turbine.natural_frequency(name) == 0.0:
            raise ConfigurationError(
                f"turbine '{turbine.name}': expected a positive k_{name}, got 0: correct the turbine file, or lock {name}"
            )
    least, why = turbine.least_duration
    if record.duration < least:
        raise RecordError(
            f"{record.name}: expected at least {why}, got {record.duration:.3g} s: choose a longer record or section"
        )
    period = 2.0 * math.pi / turbine.slowest_frequency
    if record.duration < period:
        raise RecordError(
            f"{record.name}: expected at least one period of the turbine's slowest mode ({period:.3g} s), got {record.duration:.3g} s: "
            "choose a longer record, or correct the stiffness in the turbine file"
        )
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    if fastest / record.rate > STEP:
        raise RecordError(
            f"{record.name}: expected at least {fastest / STEP:.3g} samples per second for a mode at "
            f"{fastest / (2.0 * math.pi):.3g} Hz, got {record.rate:.3g}"
        )


def conclude(
    outcome: Outcome,
    record: Record,
    formulation: Formulation,
    *,
    section: tuple[float, float] | None = None,
    samples: int | None = None,
    history_time: Array | None = None,
    provenance: Provenance | None = None,
) -> Identification:
    """Put what a formulation found on `record` into physical units, with bands, modes and errors.

    Where `record` is the last piece of a longer one, `section` [s] and `samples` are the whole's, and `history_time` [s] says when the
    estimates of the history were made.
    """
    turbine, model, theta, cov = outcome.turbine, outcome.model, outcome.theta, outcome.cov
    history_mean, history_std = outcome.history_mean, outcome.history_std
    std = np.sqrt(np.diag(cov))
    estimates = []
    for i, q in enumerate(model.parameters):
        reference = turbine.values[q.name] or None  # nobody knows what the file sets to zero
        low, value, high = (float(q.physical(theta[i] + k * std[i])) for k in (-SIGMAS, 0.0, SIGMAS))
        spread = std[i] * (value if q.logarithmic else q.scale)
        errors = coefficient_errors(q.physical(history_mean[:, i]), reference) if reference else None
        estimates.append(
            Estimate(
                name=q.name,
                unit=parameter_unit(q.name),
                kind=_KINDS.get(q.name[:2], "parameter"),
                estimate=value,
                low=low,
                high=high,
                std=float(spread),
                informed_by_data=float(np.clip(1.0 - (std[i] / q.prior[1]) ** 2, 0.0, 1.0)),
                prior=q.centre,
                reference=reference,
                average_error_percent=None if errors is None else float(np.mean(errors)),
                tip=_at_the_tip(q.name, turbine, value, low, high, float(spread), reference or 0.0),
            )
        )
    final = turbine.with_values({e.name: e.estimate for e in estimates})
    compiled = model.compiled if formulation == "joint" else compile_model(turbine.model)
    p, at_reference = (np.array([source.values[name] for name in compiled.parameters]) for source in (final, turbine))
    speed = float(outcome.rotor[:, 1].mean())
    modes = modes_with_bands(turbine.model, compiled, p, speed, model.parameters, theta, cov, at_reference)
    diagnosis = diagnose(
        outcome.final,
        readings=model.readings,
        rate=record.rate,
        frequencies=[final.natural_frequency(name) / (2.0 * math.pi) for name in turbine.model.coordinates],
        parameters=model.parameters,
        theta=theta,
        cov=cov,
        rotor_speed=speed,
        blades=turbine.model.blades,
        white=formulation == "joint",
        doubts=outcome.doubts,
        damping=[(mode.name, mode.damping_ratio) for mode in modes],
    )
    return Identification(
        method=EKF.name if formulation == "force-balance" else f"posterior mode, {EKF.name}",
        formulation=formulation,
        record=record.name,
        turbine=turbine.name,
        sensors=outcome.channels,
        section=section or (float(record.time[0]), float(record.time[-1])),
        rate=record.rate,
        samples=samples or record.samples,
        elapsed=outcome.elapsed,
        estimates=tuple(estimates),
        modes=modes,
        parameters=model.parameters,
        time=record.time if history_time is None else history_time,
        mean=history_mean,
        std=history_std,
        cov=cov,
        readings=model.readings,
        innovation=outcome.final.innovation,
        whitened=outcome.final.whitened,
        log_likelihood=float(outcome.final.log_likelihood.sum()),
        notes=outcome.notes,
        statistics=outcome.statistics,
        diagnosis=diagnosis,
        machine=replace(turbine, rotor_speed=max(speed, 0.0)),
        loads=outcome.loads,
        conditions=_conditions(record, speed),
        provenance=provenance,
        joint_cov=outcome.joint_cov,
    )


def _conditions(record: Record, rotor_speed: float) -> Conditions:
    """How the turbine ran, as far as it was recorded."""
    turning = "rotor_speed" in record or "rotor_azimuth" in record
    wind = record["wind_speed"] if "wind_speed" in record else np.empty(0)
    known = wind[np.isfinite(wind)]
    return Conditions(rotor_speed if turning else None, float(known.mean()) if known.size else None)


_KINDS = {"k_": "stiffness", "c_": "damping"}


def _at_the_tip(
    name: str, turbine: Turbine, value: float, low: float, high: float, std: float, reference: float
) -> dict[str, float] | None:
    """A blade's coefficient per tip deflection, k_β/ℓ² or c_β/ℓ²."""
    if not name.startswith(("k_beta", "c_beta")) or turbine.tip_lever == 0.0:
        return None
    square = turbine.tip_lever**2
    labels = ("estimate", "low", "high", "std", "reference")
    return dict(zip(labels, (x / square for x in (value, low, high, std, reference)), strict=True))
