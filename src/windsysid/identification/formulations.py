"""How each formulation is asked: by filters, by spectra, or by the force balance of one instant."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.identification.condition.readings import (
    MAX_READING_OF_SPECTRA,
    check_length,
    resample_for_model,
    screened,
    thin_to_readings,
    usable_sensors,
    without_faulty,
)
from windsysid.identification.effects.bias import with_offsets
from windsysid.identification.effects.clock_drift import Drift, left_over, persists, together, without_drift
from windsysid.identification.effects.narrow_band_alternative import heard_on_time, narrow_band_beside, told_before
from windsysid.identification.effects.narrow_band_load import doubts_of_narrow_band, note_narrow_band
from windsysid.identification.effects.prior_conflict import with_wide_priors
from windsysid.identification.effects.random_walk_bias import with_drifting_offsets
from windsysid.identification.effects.sinusoid import turned, without_sines
from windsysid.identification.effects.sinusoidal_force import told, with_forces
from windsysid.identification.estimate.force_balance import identify_by_force_balance, measured_channels
from windsysid.identification.estimate.frequency_domain import identify_by_spectrum
from windsysid.identification.estimate.time_domain import forces_of, identify_jointly, identify_jointly_from
from windsysid.identification.job import Asked, Found
from windsysid.identification.model.fit import Outcome, compare
from windsysid.identification.model.prior import Prior
from windsysid.inspection.screening import screen
from windsysid.loads.family import Broadband
from windsysid.loads.narrow_band import NarrowBand
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.signals.inputs import TURNING
from windsysid.turbine.turbine import Turbine

__all__ = ["DISAGREEMENT", "by_filters", "by_force_balance", "by_spectra", "disagreement", "jointly"]

DISAGREEMENT = 3.0
"""Standard deviations between what filters and spectra say of a coefficient, beyond which neither is trusted."""

MOST_DRIFTS = 4
"""How often spectra are asked again, with readings of a clock that drifts put back by what was left."""

MOVED = Finding("drift_moved_readings", "reason")


def jointly(asked: Asked, near: Outcome | None = None) -> Found:
    """By filters, from where spectra ended if that is said."""
    part, turbine, sensors = asked.part.on_own_times(), asked.turbine, asked.sensors
    found = usable_sensors(part, turbine, sensors)
    part, faults = without_faulty(part, screened(asked.part, turbine, found))
    found, offsets = with_offsets(part, turbine, found)
    part, found, wandering = with_drifting_offsets(part, turbine, found, leaning=asked.leaning)
    part, drifts = without_drift(part, turbine, found, asked.drifts)
    part, steps, resampled = resample_for_model(part, turbine, asked.rate, sensors or turbine.sensors)
    check_length(part.name, part.duration, part.rate, turbine)
    prior, uniform, left = asked.prior or Prior(), part.is_uniform, part

    def search(part: Record, near: Outcome | None) -> Outcome:
        outcome = None
        if near is not None and uniform:
            outcome = identify_jointly_from(
                near, part, turbine, found, prior, asked.parameters, explained=near is not asked.near
            )
        return outcome or identify_jointly(part, turbine, found, prior, asked.parameters, loads=asked.loads)

    near, said = asked.near or near, list[Finding]()
    if asked.sines:
        left = without_sines(part, turbine, found, asked.sines)
        psi = turned(part, turbine, found)
        if psi is None:
            part, said = left, [sine.note for sine in asked.sines]
        else:
            near = near or search(left, None)
            forces = forces_of(asked.sines, near, part, turbine, found, prior, asked.parameters)
            left = without_sines(part, turbine, found, [force.sine for force in forces])
            part, said = with_forces(part, forces, psi), told(forces)
    outcome = thin_to_readings(search(part, near), steps)
    outcome = outcome._replace(
        notes=(*(one.note for one in drifts), *offsets, *wandering, *resampled, *said, *outcome.notes)
    )
    read = replace(left, time=left.time[::steps], values=left.values[::steps])
    joint = Found("joint", outcome, read, found, faults, prior, drifts)
    return joint.doubted(MOVED) if drifts else joint


def by_filters(asked: Asked) -> Found:
    """By filters, with a narrow-band load on the support where spectra need one."""
    found = jointly(asked)
    of = found.read, asked.turbine, found.sensors
    beside = narrow_band_beside(found.outcome, *of)
    if beside is None or not beside.is_needed or asked.loads != "auto":
        return found.beside(*doubts_of_narrow_band(beside, asked=asked.loads))
    alone = doubts_of_narrow_band(beside, asked=Broadband.name)
    on_time = heard_on_time(found.read, found.outcome, asked.turbine, found.sensors)
    try:
        near, _ = with_wide_priors(
            lambda prior: identify_by_spectrum(on_time, *of[1:], prior, asked.parameters, loads=NarrowBand.name),
            found.prior,
        )
    except (WindsysidError, np.linalg.LinAlgError):
        return found.beside(*alone)
    near = told_before(near, found.outcome)
    again = jointly(asked, near)
    if again.outcome.hypothesis != NarrowBand.name:
        return again.beside(*alone)
    name, off = compare(again.outcome, near)
    against = [disagreement(name, off, again, asked.turbine)] if off > DISAGREEMENT else []
    return again.saying(note_narrow_band(beside), *doubts_of_narrow_band(beside, asked=asked.loads), *against)


def by_spectra(asked: Asked) -> Found:
    """By spectra, with clocks that drift put back, and with a narrow-band load where the readings need one."""
    part, turbine = asked.quiet.on_uniform_grid(), asked.turbine
    check_length(part.name, part.duration, part.rate, turbine, MAX_READING_OF_SPECTRA)
    if asked.rate is not None:
        raise ConfigurationError("the spectral formulation reads the bands that it needs: leave the rate out")
    found = usable_sensors(part, turbine, asked.sensors)
    part, faults = without_faulty(part, screened(asked.part, turbine, found))
    found, _ = with_offsets(part, turbine, found)
    part, _, _ = with_drifting_offsets(part, turbine, found)  # trends leak; drifts stay below the bands

    def ask(heard: Record, loads: str) -> tuple[Outcome, Prior]:
        return with_wide_priors(
            lambda prior: identify_by_spectrum(heard, turbine, found, prior, asked.parameters, loads=loads),
            asked.prior or Prior(),
        )

    def on_time(drifts: Sequence[Drift]) -> tuple[Record, tuple[Drift, ...], Outcome, Prior]:
        moved, drifts = without_drift(part, turbine, found, drifts)
        return moved, drifts, *ask(moved, asked.loads)

    _, drifts, outcome, _ = best = on_time(asked.drifts)
    left = left_over(outcome.drifts, drifts, turbine, part.duration)
    for _ in range(MOST_DRIFTS):
        if not left:
            break
        further, before = on_time(together(drifts, left)), left
        _, drifts, outcome, _ = further
        left = left_over(outcome.drifts, drifts, turbine, part.duration)
        if persists(left, before):
            break
        best = further
    part, drifts, outcome, prior = best
    beside, narrow = narrow_band_beside(outcome, part, turbine, found), tuple[Finding, ...]()
    if beside is not None and beside.is_needed and asked.loads == "auto":
        again, prior = ask(heard_on_time(part, outcome, turbine, found), NarrowBand.name)
        outcome = told_before(again, outcome)
    else:
        narrow = doubts_of_narrow_band(beside, asked=asked.loads)
    outcome = outcome._replace(
        notes=(*(one.note for one in drifts), *(one.note for one in asked.sines), *outcome.notes)
    )
    return Found("spectral", outcome, part, found, faults, prior, drifts).beside(*narrow)


def by_force_balance(asked: Asked) -> Found:
    """By the force balance of one instant."""
    part, turbine = asked.part.on_uniform_grid(), asked.turbine
    check_length(part.name, part.duration, part.rate, turbine)
    if asked.sensors is not None:
        raise ConfigurationError(
            "the force balance takes no sensor list: it reads tower_x_acceleration, blade_1_lag_displacement … by name"
        )
    if asked.parameters is not None:
        raise ConfigurationError("the force balance identifies all coefficients at once: leave `parameters` out")
    if asked.rate is not None:
        raise ConfigurationError("the force balance filters the record as it is: leave the rate out")
    if asked.loads != "auto":
        raise ConfigurationError("the force balance has no model of the loads: leave `loads` out")
    whole = asked.record.on_uniform_grid()
    measured = measured_channels(part, turbine)
    faults = screen(asked.part, turbine, measured, others=(*TURNING, *turbine.model.loads))
    outcome = identify_by_force_balance(whole, part, turbine, asked.prior or Prior(spread=1.0))
    return Found("force-balance", outcome, part, (), faults)


def disagreement(name: str, off: float, found: Found, turbine: Turbine) -> Finding:
    """That filters and spectra are so many standard deviations apart on a coefficient, and the likeliest cause."""
    locked = _blades_move(turbine) and not _blades_move(found.outcome.turbine)
    return Finding("formulations_disagree", "reason", {"sigmas": off, "unseen_blades": locked}, (name,))


def _blades_move(turbine: Turbine) -> bool:
    return any(freedom.blade for freedom in turbine.model.freedoms)
