"""From the result of a formulation to an `Identification` in physical units."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.estimates import rival_priors
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.checks.lines import Line
from windsysid.checks.nonlinearity import Bent, find_bent
from windsysid.checks.stationarity import Late, how_late
from windsysid.checks.verdict import Diagnosis, FittedParameters, RecordTests, TurningRotor, diagnose
from windsysid.checks.whiteness import Whiteness, examine
from windsysid.errors import RecordError
from windsysid.filters import EKF
from windsysid.identification.estimate.clock_lag import PASS_EDGE_FACTOR
from windsysid.identification.estimate.fitted.modal_residuals import channels_of, doubts_beside_modes
from windsysid.identification.estimate.fitted.modes import FittedModes, modes_of
from windsysid.identification.job import Formulation
from windsysid.identification.model.fit import Outcome
from windsysid.identification.verdict.grading import (
    Widening,
    grade_coefficients,
    grade_modes,
    judged,
    scaled,
    widenings_of,
    with_tolerance_shifts,
)
from windsysid.inspection.fault import Fault
from windsysid.inspection.limits import MAX_RATE_MISMATCH
from windsysid.inspection.screening import doubted, noted
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.model import Coefficient
from windsysid.records.record import Record
from windsysid.results.budget import Budget, budget_of
from windsysid.results.finding import Finding
from windsysid.results.identification import Estimate, Identification, coefficient_errors
from windsysid.results.posterior import SIGMAS, Conditions
from windsysid.results.provenance import Provenance
from windsysid.results.tolerance import SHARED
from windsysid.results.transient import explain_by_transient, find_burst, find_transient
from windsysid.signals.rotor import MAX_STANDING_SPEED, rotor_inputs
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["WholeRecord", "conclude", "doubts_of_innovations"]


class WholeRecord(NamedTuple):
    """A record of which only the end is kept.

    Attributes
    ----------
    section, samples
        Start and end [s] of all of it, and how many samples it had.
    history_time
        Times of the history's estimates [s].
    wind_speed
        Mean wind speed [m/s]; None where it was not recorded.
    """

    section: tuple[float, float]
    samples: int
    history_time: Array
    wind_speed: float | None


def conclude(
    outcome: Outcome, record: Record, formulation: Formulation, *, whole: WholeRecord | None = None,
    provenance: Provenance | None = None, faults: Sequence[Fault] = (), line: Line | None = None,
) -> Identification:  # fmt: skip
    """Put what a formulation found on `record`, the end of the `whole` or all of it, into physical units, with
    intervals, modes and errors, and judge it, with the faults of its channels and the line of its readings that stands
    out most.
    """
    at = modes_of(outcome, compile_model(outcome.turbine.model) if formulation == "force-balance" else None)
    balanced = formulation == "force-balance"
    diagnosis = _judge(outcome, record, formulation, at, line, faults, tested_for_bursts=whole is None)
    if whole is None:
        readings = np.column_stack([record[name] for name in outcome.channels])
        transient = find_transient(readings, outcome.channels)
        diagnosis = diagnosis if transient is None else explain_by_transient(diagnosis, transient, outcome.channels)
    diagnosis = with_tolerance_shifts(diagnosis, outcome)
    coefficients, of_modes = widenings_of(_on_clock(outcome, record, whole), at, diagnosis.findings)
    wide, effective, factors = scaled(outcome, coefficients)
    diagnosis = judged(diagnosis, outcome.scores, effective, [*chain.from_iterable(of_modes)])
    readers = None if balanced else channels_of(outcome)
    grades = grade_coefficients(diagnosis, outcome.model.parameters, effective, outcome.channels, readers)
    conditions, final, log_likelihood = _conditions(record, at.speed), outcome.final, outcome.log_likelihood
    if whole is None:
        history_time, section = record.time[-len(outcome.history_mean) :], (record.time[0], record.time[-1])
        whole = WholeRecord((float(section[0]), float(section[1])), record.samples, history_time, conditions.wind_speed)
    return Identification(
        method=_METHODS[formulation], formulation=formulation, record=record.name, turbine=outcome.turbine.name,
        sensors=outcome.channels, section=whole.section, rate=record.rate, samples=whole.samples,
        elapsed=outcome.elapsed, estimates=_estimates(wide, grades, factors),
        modes=grade_modes(at.modes, outcome, grades, of_modes), parameters=outcome.model.parameters,
        time=whole.history_time, mean=outcome.history_mean, std=outcome.history_std, cov=wide.cov,
        readings=outcome.model.readings, innovation=final.innovation, whitened=final.whitened,
        log_likelihood=float(final.log_likelihood.sum()) if log_likelihood is None else log_likelihood,
        statistics=outcome.statistics, diagnosis=diagnosis,
        machine=replace(outcome.turbine, rotor_speed=max(at.speed, 0.0)), loads=outcome.loads,
        conditions=conditions._replace(wind_speed=whole.wind_speed), provenance=provenance, joint_cov=wide.joint_cov,
        tolerances=outcome.tolerances, budget=_budget(outcome, at, effective, [*chain.from_iterable(of_modes)]),
        spectra=outcome.spectra,
    )  # fmt: skip


def _on_clock(outcome: Outcome, record: Record, whole: WholeRecord | None) -> Outcome:
    """Scores over time on the record's clock."""
    start = float(record.time[0]) if whole is None else whole.section[0]
    places = (one._replace(places=one.places + start) if one.over == "time" else one for one in outcome.scores)
    return outcome._replace(scores=tuple(places))


def _estimates(outcome: Outcome, grades: Sequence[str], factors: Array) -> tuple[Estimate, ...]:
    """The coefficients in physical units, with their grades and the factors that widened them."""
    columns = outcome.model.parameters, outcome.theta, np.sqrt(np.diag(outcome.cov)), outcome.history_mean.T
    return tuple(
        replace(_estimate(q, outcome.turbine, float(x), float(std), past), grade=grade, widening=wider)
        for q, x, std, past, grade, wider in zip(*columns, grades, factors.tolist(), strict=True)
    )


def _estimate(q: Parameter, turbine: Turbine, theta: float, std: float, history: Array) -> Estimate:
    """A coefficient in physical units, of its filter coordinate, that one's standard deviation and history (T,)."""
    known = turbine.model.coefficient(q.name)
    reference = turbine.values[q.name] or None  # it is not known what the file sets to zero
    low, value, high = (float(q.physical(theta + k * std)) for k in (-SIGMAS, 0.0, SIGMAS))
    spread = float(std * (value if q.logarithmic else q.scale))
    return Estimate(
        name=q.name,
        unit=known.unit,
        kind=known.kind if known.kind in ("stiffness", "damping") else "parameter",
        estimate=value,
        low=low,
        high=high,
        std=spread,
        informed_by_data=float(np.clip(1.0 - (std / q.prior[1]) ** 2, 0.0, 1.0)),
        prior=q.centre,
        reference=reference,
        average_error_percent=float(np.mean(coefficient_errors(q.physical(history), reference))) if reference else None,
        tip=_at_the_tip(known, turbine, (value, low, high, spread, reference or 0.0)),
    )


def _judge(
    outcome: Outcome, record: Record, formulation: Formulation, at: FittedModes, line: Line | None,
    faults: Sequence[Fault], *, tested_for_bursts: bool,
) -> Diagnosis:  # fmt: skip
    """Judge a fit at its modes."""
    model, filtered = outcome.turbine.model, formulation == "joint"
    frequencies = [at.turbine.natural_frequency(name) / (2.0 * math.pi) for name in model.coordinates]
    balanced = formulation == "force-balance"  # whose readings are filtered to a band
    findings = (
        *doubted(faults),
        *outcome.doubts,
        *rival_priors(outcome.model.parameters, *outcome.given(*SHARED)),
        *_off_clock(record, at.speed),
        *(_burst(outcome, record) if filtered and tested_for_bursts else ()),
        *(() if balanced else doubts_beside_modes(outcome, record, at.modes, at.speed, filtered=filtered)),
        *outcome.notes,
        *noted(faults),
    )
    tests = RecordTests(line, smoothed_loads=outcome.smoothed_loads)
    if filtered:
        tests = tests._replace(late=_late(outcome, record), bent=_bent(outcome))
    return diagnose(
        _whiteness(outcome, record.rate, frequencies) if filtered else outcome.whiteness,
        FittedParameters(
            outcome.model.parameters,
            outcome.theta,
            outcome.cov,
            [(m.name, (m.damping_ratio.estimate, m.damping_ratio.low, m.damping_ratio.high)) for m in at.modes],
            {q.name: model.coefficient(q.name).unit for q in outcome.model.parameters},
        ),
        frequencies=frequencies,
        rotor=TurningRotor(at.speed, model.blades, any(freedom.blade for freedom in model.freedoms)),
        tests=tests,
        findings=findings,
    )


def _whiteness(outcome: Outcome, rate: float, frequencies: Sequence[float]) -> Whiteness:
    """The innovations of a filter against white noise."""
    final = outcome.final
    return outcome.whiteness or examine(
        final.whitened, names=outcome.model.readings, rate=rate, frequencies=frequencies, gated=final.gated
    )


def doubts_of_innovations(outcome: Outcome, rate: float) -> tuple[Finding, ...]:
    """Findings on the innovations of a filter, at so many a second."""
    found = diagnose(
        _whiteness(outcome, rate, ()), FittedParameters((), np.empty(0), np.empty((0, 0))), frequencies=(),
        tests=RecordTests(bent=_bent(outcome), smoothed_loads=outcome.smoothed_loads),
    )  # fmt: skip
    return tuple(one for one in found.findings if one.severity == "reason")


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
    if not mean > MAX_STANDING_SPEED or abs(turned / mean - 1.0) < MAX_RATE_MISMATCH:
        return ()
    return (Finding("azimuth_contradicts_speed", "reason", {"ratio": turned / mean}),)


def _burst(outcome: Outcome, record: Record) -> tuple[Finding, ...]:
    """A burst after the beginning of a record, as a doubt: a filter learns the state at the beginning, however large,
    but its loads are stationary."""
    burst = find_burst(np.column_stack([record[name] for name in outcome.channels]), outcome.channels, record.rate)
    return (Finding("late_burst", "reason", burst.data),) if burst is not None and burst.segment else ()


def _late(outcome: Outcome, record: Record) -> Late | None:
    """Lag of the blades' readings behind the tower's along x and y; None if there are not both."""
    z = outcome.final.whitened
    along = [_first_along(outcome, axis) for axis in ("x", "y")]
    turned = 2.0 * math.pi / max(outcome.turbine.model.blades, 1)
    blades = {
        i: turned * (sensor.blade - 1)
        for i, sensor in enumerate(outcome.sensors)
        if sensor.blade and sensor.directions == {"lag"}
    }
    x, y = along
    if x is None or y is None or not blades or "rotor_azimuth" not in record or len(z) != record.samples:
        return None
    azimuth = np.nan_to_num(record["rotor_azimuth"])
    return how_late(z, azimuth, (x, y), blades, below=_highest_share(outcome, record.rate))


def _first_along(outcome: Outcome, axis: str) -> int | None:
    """Number of the first sensor that does not turn and reads along one axis only."""
    sensors = enumerate(outcome.sensors)
    return next((i for i, sensor in sensors if not sensor.blade and sensor.directions == {axis}), None)


def _highest_share(outcome: Outcome, rate: float) -> float:
    """Highest frequency at which lateness is judged, per sample. Where a clock is an unknown, readings have been moved
    in its band only, and what is faster is late still."""
    if not any(one.group == "clock" for one in outcome.tolerances):
        return 0.5
    turbine = outcome.turbine.with_values({q.name: float(q.physical(q.prior[0])) for q in outcome.model.parameters})
    highest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)
    return min(0.5, PASS_EDGE_FACTOR * highest / rate)


def _bent(outcome: Outcome) -> Bent | None:
    """Degree of freedom with the strongest nonlinearity of spring or damper."""
    coordinates = outcome.turbine.model.coordinates
    n, mean = len(coordinates), outcome.final.mean
    return find_bent(
        outcome.final.whitened, mean[:, :n], mean[:, n : 2 * n],
        channels=outcome.model.readings, coordinates=coordinates, chance=FALSE_ALARM_PROBABILITY,
    )  # fmt: skip


def _relative_slope(q: Parameter, x: float) -> float:
    """Slope of the logarithm of a coefficient to its filter coordinate."""
    return 1.0 if q.logarithmic else q.scale / (abs(float(q.physical(x))) or 1.0)


def _budget(
    outcome: Outcome, at: FittedModes, coefficients: Sequence[Widening], of_modes: Sequence[Widening]
) -> Budget:
    """Uncertainty budget of coefficients and of modes, the latter given the masses of the file."""
    if outcome.joint_cov is None:
        return Budget()
    unit = np.eye(len(outcome.theta), len(outcome.joint_cov))
    theta = enumerate(zip(outcome.model.parameters, outcome.theta, strict=True))
    rows = [(q.name, unit[i] * _relative_slope(q, float(x))) for i, (q, x) in theta]
    statistics = outcome.unknowns.of("statistics")
    added = {one.name: one.added().tolist() for one in coefficients}
    own = budget_of(rows, outcome.joint_cov, statistics, outcome.tolerances).widened(added)
    rows = [
        (f"{mode.name}: {what}", slope @ unit / (abs(one.estimate) or 1.0))
        for k in (0, 1)
        for mode, slope in zip(at.modes, at.slopes[k], strict=True)
        for what, one in [mode.quantities[k]]
    ]
    added = {name: one.added().tolist() for (name, *_), one in zip(rows, of_modes, strict=True)}
    modes = budget_of(rows, at.given_masses, statistics, outcome.tolerances).widened(added)
    return own._replace(rows=own.rows + modes.rows)


def _conditions(record: Record, rotor_speed: float) -> Conditions:
    """State of operation, as far as it was recorded."""
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
    known: Coefficient, turbine: Turbine, values: tuple[float, float, float, float, float]
) -> dict[str, float] | None:
    """A blade's coefficient per tip deflection, k_β/ℓ² or c_β/ℓ²: estimate, low, high, std and reference."""
    blades = [freedom.name for freedom in turbine.model.freedoms if freedom.blade]
    if known.part not in blades or turbine.tip_lever == 0.0:
        return None
    square = turbine.tip_lever**2
    labels = ("estimate", "low", "high", "std", "reference")
    return {label: value / square for label, value in zip(labels, values, strict=True)}
