"""From what a formulation found to an `Identification` in physical units."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array
from windsysid.checks.constancy import doubt_constancy
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.checks.lines import Line
from windsysid.checks.nonlinearity import Bent, find_bent
from windsysid.checks.stationarity import Late, how_late
from windsysid.checks.verdict import diagnose
from windsysid.errors import RecordError
from windsysid.filters import EKF
from windsysid.identification.estimate.clock_lag import PASSED
from windsysid.identification.estimate.fitted.modal_residuals import doubts_beside_modes
from windsysid.identification.estimate.fitted.modes import modes_of
from windsysid.identification.job import Formulation
from windsysid.identification.limits import MAX_RATE_MISMATCH
from windsysid.identification.model.fit import Outcome
from windsysid.inspection.fault import Fault
from windsysid.inspection.screening import doubted, noted
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.model import Coefficient
from windsysid.records.record import Record
from windsysid.results.budget import Budget, budget_of
from windsysid.results.finding import Finding
from windsysid.results.identification import Estimate, Identification, coefficient_errors
from windsysid.results.mode import Mode
from windsysid.results.posterior import SIGMAS, Conditions
from windsysid.results.provenance import Provenance
from windsysid.results.transient import Transient, explain_by_transient, find_burst, find_transient
from windsysid.signals.rotor import STANDING_MAX_SPEED, rotor_inputs
from windsysid.turbine.turbine import Turbine

__all__ = ["conclude", "doubts_of_innovations"]


def conclude(
    outcome: Outcome,
    record: Record,
    formulation: Formulation,
    *,
    section: tuple[float, float] | None = None,
    samples: int | None = None,
    history_time: Array | None = None,
    wind_speed: float | None = None,
    provenance: Provenance | None = None,
    faults: Sequence[Fault] = (),
    line: Line | None = None,
) -> Identification:
    """Put what a formulation found on `record` into physical units, with bands, modes and errors, and judge it, with
    the faults of its channels and the line of its readings that stands out most.

    Where `record` is the end of a longer one, `section` [s], `samples` and the mean `wind_speed` [m/s] are the whole's,
    and `history_time` [s] says when the estimates of the history were made.
    """
    turbine, model, theta, cov = outcome.turbine, outcome.model, outcome.theta, outcome.cov
    history_mean, history_std = outcome.history_mean, outcome.history_std
    std = np.sqrt(np.diag(cov))
    estimates = []
    for i, q in enumerate(model.parameters):
        known = turbine.model.coefficient(q.name)
        reference = turbine.values[q.name] or None  # nobody knows what the file sets to zero
        low, value, high = (float(q.physical(theta[i] + k * std[i])) for k in (-SIGMAS, 0.0, SIGMAS))
        spread = std[i] * (value if q.logarithmic else q.scale)
        errors = coefficient_errors(q.physical(history_mean[:, i]), reference) if reference else None
        estimates.append(
            Estimate(
                name=q.name,
                unit=known.unit,
                kind=known.kind if known.kind in ("stiffness", "damping") else "parameter",
                estimate=value,
                low=low,
                high=high,
                std=float(spread),
                informed_by_data=float(np.clip(1.0 - (std[i] / q.prior[1]) ** 2, 0.0, 1.0)),
                prior=q.centre,
                reference=reference,
                average_error_percent=None if errors is None else float(np.mean(errors)),
                tip=_at_the_tip(known, turbine, value, low, high, float(spread), reference or 0.0),
            )
        )
    at = modes_of(outcome, compile_model(turbine.model) if formulation == "force-balance" else None)
    final, speed, modes = at.turbine, at.speed, at.modes
    beside: tuple[Finding, ...] = ()
    if formulation != "force-balance":
        beside = doubts_beside_modes(outcome, record, modes, speed, filtered=formulation == "joint")
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
        findings=(
            *doubted(faults),
            *outcome.doubts,
            *_off_clock(record, speed),
            *(_burst(outcome, record) if formulation == "joint" and section is None else ()),
            *beside,
            *outcome.notes,
            *noted(faults),
        ),
        whiteness=outcome.whiteness,
        damping=[(mode.name, mode.damping_ratio) for mode in modes],
        line=line,
        late=_late(outcome, record) if formulation == "joint" else None,
        bent=_bent(outcome) if formulation == "joint" else None,
        smoothed_loads=outcome.smoothed_loads,
        constancy=outcome.constancy,
        blades_move=any(freedom.blade for freedom in turbine.model.freedoms),
    )
    transient = _transient(outcome, record) if section is None else None
    if transient is not None:
        diagnosis = explain_by_transient(diagnosis, transient, outcome.channels)
    return Identification(
        method=_METHODS[formulation],
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
        time=record.time[-len(history_mean) :] if history_time is None else history_time,
        mean=history_mean,
        std=history_std,
        cov=cov,
        readings=model.readings,
        innovation=outcome.final.innovation,
        whitened=outcome.final.whitened,
        log_likelihood=float(outcome.final.log_likelihood.sum())
        if outcome.log_likelihood is None
        else outcome.log_likelihood,
        statistics=outcome.statistics,
        diagnosis=diagnosis,
        machine=replace(turbine, rotor_speed=max(speed, 0.0)),
        loads=outcome.loads,
        conditions=_conditions(record, speed)
        if history_time is None
        else _conditions(record, speed)._replace(wind_speed=wind_speed),
        provenance=provenance,
        joint_cov=outcome.joint_cov,
        tolerances=outcome.tolerances,
        budget=_budget(outcome, modes, at.slopes, at.given_masses),
    )


def doubts_of_innovations(outcome: Outcome, rate: float) -> tuple[Finding, ...]:
    """What the innovations of a filter, so many a second, say against its result."""
    nothing, names = np.empty(0), [q.name for q in outcome.model.parameters]
    found = diagnose(
        outcome.final, readings=outcome.model.readings, rate=rate, frequencies=(), parameters=(), theta=nothing,
        cov=np.diag(nothing), whiteness=outcome.whiteness, bent=_bent(outcome), smoothed_loads=outcome.smoothed_loads,
    )  # fmt: skip
    reasons = (one for one in found.findings if one.severity == "reason")
    return (*reasons, *doubt_constancy(names, outcome.constancy))


def _off_clock(record: Record, speed: float) -> tuple[Finding, ...]:
    """That azimuth and speed contradict each other, as a doubt: time may be counted wrongly, and stiffness goes with
    its square."""
    if not ("rotor_azimuth" in record and "rotor_speed" in record and record.is_uniform):
        return ()
    try:
        psi, recorded, _ = rotor_inputs(record, abs(speed)).T
    except RecordError:  # an azimuth that was not needed
        return ()
    mean = float(recorded.mean())
    turned = float(psi[-1] - psi[0]) / float(record.time[-1] - record.time[0])
    if not mean > STANDING_MAX_SPEED or abs(turned / mean - 1.0) < MAX_RATE_MISMATCH:
        return ()
    return (Finding("azimuth_contradicts_speed", "reason", {"ratio": turned / mean}),)


def _transient(outcome: Outcome, record: Record) -> Transient | None:
    """Find the channels of the readings whose vibration decreases over the whole record."""
    return find_transient(np.column_stack([record[name] for name in outcome.channels]), outcome.channels)


def _burst(outcome: Outcome, record: Record) -> tuple[Finding, ...]:
    """A burst after the beginning of a record, as a doubt: a filter learns the state at the beginning, however large,
    but its loads are stationary."""
    burst = find_burst(np.column_stack([record[name] for name in outcome.channels]), outcome.channels, record.rate)
    return (Finding("late_burst", "reason", burst.data),) if burst is not None and burst.segment else ()


def _late(outcome: Outcome, record: Record) -> Late | None:
    """How late the blades' readings are behind the tower's along x and y; None where there are not both.

    Where a clock is an unknown, readings have been moved in its band only, and what is faster is late still.
    """
    z, sensors = outcome.final.whitened, outcome.sensors
    along = {axis: [i for i, s in enumerate(sensors) if not s.blade and s.directions == {axis}] for axis in ("x", "y")}
    turbine = outcome.turbine.model
    blades = {
        i: 2.0 * math.pi * (sensor.blade - 1) / turbine.blades
        for i, sensor in enumerate(sensors)
        if sensor.blade and sensor.directions == {"lag"}
    }
    if not (along["x"] and along["y"] and blades and "rotor_azimuth" in record and len(z) == record.samples):
        return None
    below = 0.5
    if any(one.group == "clock" for one in outcome.tolerances):
        prior = {q.name: float(q.physical(q.prior[0])) for q in outcome.model.parameters}
        before = outcome.turbine.with_values(prior)
        highest = max(before.natural_frequency(name) for name in turbine.coordinates) / (2.0 * math.pi)
        below = min(below, PASSED * highest / record.rate)
    azimuth = np.nan_to_num(record["rotor_azimuth"])
    return how_late(z, azimuth, (along["x"][0], along["y"][0]), blades, below=below)


def _bent(outcome: Outcome) -> Bent | None:
    """Which degree of freedom shows most that its spring or damper is no straight line."""
    coordinates = outcome.turbine.model.coordinates
    n, mean = len(coordinates), outcome.final.mean
    return find_bent(
        outcome.final.whitened, mean[:, :n], mean[:, n : 2 * n],
        channels=outcome.model.readings, coordinates=coordinates, chance=FALSE_ALARM_PROBABILITY,
    )  # fmt: skip


def _budget(outcome: Outcome, modes: Sequence[Mode], slopes: Array, given_masses: Array) -> Budget:
    """What widens the bands of coefficients and of modes, these with the masses of the file."""
    if outcome.joint_cov is None:
        return Budget()
    unit = np.eye(len(outcome.theta), len(outcome.joint_cov))
    rows = [
        (q.name, unit[i] * (1.0 if q.logarithmic else q.scale), q.logarithmic)
        for i, q in enumerate(outcome.model.parameters)
    ]
    statistics = outcome.unknowns.of("statistics")
    coefficients = budget_of(rows, outcome.joint_cov, statistics, outcome.tolerances)
    rows = [
        (f"{mode.name}: {what}", slope @ unit, False)
        for what, of in zip(("frequency [Hz]", "damping ratio"), slopes, strict=True)
        for mode, slope in zip(modes, of, strict=True)
    ]
    of_modes = budget_of(rows, given_masses, statistics, outcome.tolerances)
    return coefficients._replace(rows=coefficients.rows + of_modes.rows)


def _conditions(record: Record, rotor_speed: float) -> Conditions:
    """How the turbine ran, as far as it was recorded."""
    turning = "rotor_speed" in record or "rotor_azimuth" in record
    wind = record["wind_speed"] if "wind_speed" in record else np.empty(0)
    known = wind[np.isfinite(wind)]
    return Conditions(rotor_speed if turning else None, float(known.mean()) if known.size else None)


_METHODS: dict[Formulation, str] = {
    "joint": f"posterior mode, {EKF.name}",
    "force-balance": EKF.name,
    "spectral": "posterior mode, spectral likelihood",
}


def _at_the_tip(
    known: Coefficient, turbine: Turbine, value: float, low: float, high: float, std: float, reference: float
) -> dict[str, float] | None:
    """A blade's coefficient per tip deflection, k_β/ℓ² or c_β/ℓ²."""
    blades = [freedom.name for freedom in turbine.model.freedoms if freedom.blade]
    if known.part not in blades or turbine.tip_lever == 0.0:
        return None
    square = turbine.tip_lever**2
    labels = ("estimate", "low", "high", "std", "reference")
    return dict(zip(labels, (x / square for x in (value, low, high, std, reference)), strict=True))
