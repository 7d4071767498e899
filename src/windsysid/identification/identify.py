"""Identify: record + turbine + sensors → `Identification`, the front door of the house."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, Literal

import numpy as np

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.identification.asked import Asked, Found
from windsysid.identification.conclude import Formulation, conclude, doubts_of_innovations
from windsysid.identification.drifting_clocks import Drift, left_over, persists, together, without_drift
from windsysid.identification.force_balance import identify_by_force_balance, measured_channels
from windsysid.identification.held_priors import note_wide_priors, with_wide_priors
from windsysid.identification.joint import forces_of, identify_jointly, identify_jointly_from, innovations_of
from windsysid.identification.line_dependence import doubt_line, doubt_sine, is_harmless
from windsysid.identification.narrow_band_beside import heard_on_time, narrow_band_beside, told_before
from windsysid.identification.narrow_bands import doubts_of_narrow_band, note_narrow_band
from windsysid.identification.offsets import with_offsets
from windsysid.identification.outcome import Outcome, compare
from windsysid.identification.prepare import (
    MAX_READING_OF_SPECTRA,
    check_length,
    resample_for_model,
    screened,
    thin_to_readings,
    usable_sensors,
    without_stuck,
)
from windsysid.identification.prior import Prior
from windsysid.identification.sine_forces import told, with_forces
from windsysid.identification.spectral import identify_by_spectrum
from windsysid.identification.steady_lines import Sine, find_sine, find_turning, one_turn, turned, without_sines
from windsysid.inspection.screening import screen
from windsysid.kernels.threads import one_thread
from windsysid.loads.family import Broadband
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.rotor_wind import RotorWind
from windsysid.mechanics.sensors import Sensor
from windsysid.output.progress import Progress, hear, unheard
from windsysid.records.coercion import RecordLike, as_record
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash, trace
from windsysid.signals.inputs import TURNING
from windsysid.spectral.band_pose import is_lightly_damped
from windsysid.turbine.coercion import TurbineLike, as_turbine

__all__ = ["identify"]

DISAGREEMENT = 3.0
"""Standard deviations between what filters and spectra say of a coefficient, beyond which neither is trusted."""

MOST_SEARCHES = 3
"""How often a record is asked again, without the steady lines that were found before."""

MOST_DRIFTS = 4
"""How often spectra are asked again, with readings of a clock that drifts put back by what was left."""

BEGINNING = 60.0
"""Periods of the slowest mode at a record's beginning in which filters look for loads that they cannot explain: where
there are, a search of all of it takes minutes."""

MOVED = "readings of a clock that drifts were put back, between samples: filters feel that; use --formulation spectral"


@one_thread()
def identify(
    record: RecordLike,
    turbine: TurbineLike,
    *,
    sensors: Sequence[Sensor] | None = None,
    formulation: Formulation | Literal["auto"] = "auto",
    section: tuple[float, float] | None = None,
    prior: Prior | None = None,
    parameters: Sequence[str] | None = None,
    rate: float | None = None,
    loads: str = "auto",
    progress: Progress = unheard,
) -> Identification:
    """Identify stiffness and damping of `turbine` from `record`.

    Parameters
    ----------
    record
        Channels in SI, with ``rotor_azimuth`` [rad]; ``rotor_speed`` [rad/s] and known loads ``load_x`` … [N, N·m]
        where measured, or ``part_of_load_x`` … where others act beside. A `Record`, a path, a pandas DataFrame or an
        xarray Dataset with units (`windsysid.records.coercion`).
    turbine
        Masses, geometry, and the references that priors are centred on. A `Turbine`, a packaged name or a TOML file.
    sensors
        Instruments on the record's channels; the turbine's usual ones, as far as they are recorded, by default. The
        force balance reads displacement, velocity and acceleration of every degree of freedom by name and integrates
        what is missing.
    formulation
        ``"joint"``, ``"spectral"`` (stationary records; docs/spectral.md), ``"force-balance"``, or ``"auto"``: spectra
        where nothing speaks against them and wind drives a turning rotor or nothing that moves turns, else joint; each
        held against the other where the record is stationary, but under wind.
    section
        Start and end of the part to use [s]; the whole record by default.
    prior
        Where priors are centred and how wide they are; on the turbine's references, as wide as its file says, by
        default.
    parameters
        Names of what to identify, masses and geometry included (joint formulation); the stiffness and damping
        coefficients of every free degree of freedom by default.
    rate
        Readings per second [Hz] to resample to, without aliasing (joint formulation): as many as hold what the model
        has and leave out what it has not. The record's own by default, and for a tower under a rigid rotor twelve per
        period. The equations take shorter steps where they need them.
    loads
        What the loads are taken for (joint formulation): ``"broadband"``, ``"second-order"`` or ``"rotor-wind"``
        (`windsysid.loads.family`); the record chooses by default.
    progress
        Told what is being done and its share that is done, 0 to 1; None where nobody knows.

    Returns
    -------
    Identification
        Coefficients, modes and loads with their ±2σ bands, and whether to trust them.

    Raises
    ------
    RecordError, ConfigurationError
        If the record does not hold what is needed, or an option is out of range.
    WindsysidError
        If no load model fits the record, or the likelihood cannot be computed at the start.
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
    if formulation not in _WAYS:
        raise ConfigurationError(f"formulation: expected {', '.join(_WAYS)}; got '{formulation}'")
    part = record.section(*section) if section else record
    asked = Asked(record, part, turbine, sensors, prior, parameters, rate, loads)
    doing = f"{formulation} formulation, {part.samples} samples"
    progress(doing, None)
    with hear(progress, doing):
        if formulation == "auto":
            asked = _heard_by_spectra(asked, options)
        found, result = _answer(asked, formulation, options)
        for _ in range(MOST_SEARCHES):
            sines = _sines(asked, found, result)
            if not sines:
                break
            asked = asked.with_sines(sines, found.outcome)
            found, result = _answer(asked, formulation, options)
    return result


def _answer(
    asked: Asked, formulation: Formulation | Literal["auto"], options: dict[str, Any]
) -> tuple[Found, Identification]:
    """What a formulation finds, and that judged."""
    found = _WAYS[formulation](asked)
    if found.formulation != "force-balance":
        of = found.outcome, found.read, asked.turbine, found.sensors, found.prior, asked.parameters
        spectral = found.formulation == "spectral"
        dependence = doubt_line(*of, by_spectra=spectral)
        if dependence is not None:
            found = found.doubted(dependence.doubt)._replace(dependence=dependence)
        for sine in asked.sines:
            if not (sine.order or found.outcome.doubts):
                found = found.doubted(*doubt_sine(sine.frequency, *of, by_spectra=spectral))
    if found.formulation == "joint":
        felt = find_turning(found.outcome.final.whitened, found.read, asked.turbine, found.sensors, asked.sines)
        found = found.doubted(*(one.doubt for one in felt))._replace(felt=tuple(felt))
    return found, _judged(asked, found, options)


def _judged(asked: Asked, found: Found, options: dict[str, Any]) -> Identification:
    of = found.outcome, found.read, asked.turbine, found.sensors, found.prior, asked.parameters
    return conclude(
        note_wide_priors(found.outcome), found.read, found.formulation, faults=found.faults,
        provenance=trace(asked.record, record_hash(asked.record), asked.turbine, found.sensors, options),
        harmless=lambda line: is_harmless(line, *of, by_spectra=found.formulation == "spectral"),
    )  # fmt: skip


def _heard_by_spectra(asked: Asked, options: dict[str, Any]) -> Asked:
    """The same with what spectra say, and with the steady lines that show then, in the readings and in the innovations
    of one filter: filters take long over lines that they do not know of. What turns at 1P may be masses, and waits."""
    try:
        found = _by_spectra(asked)
        if found.outcome.turns and found.outcome.hypothesis == Broadband.name:
            of = found.read, asked.turbine, found.sensors
            left = innovations_of(found.outcome, *of, found.prior, asked.parameters)
            found = found._replace(felt=tuple(one for one in find_turning(left, *of) if one.order > 1))
        sines = _sines(asked, found, _judged(asked, found, options))
    except (WindsysidError, np.linalg.LinAlgError):
        return asked
    if not sines:
        return asked._replace(spectra=found)
    return asked.with_sines(sines, found.outcome)._replace(near=None)  # filters have not looked there yet


def _disagreement(name: str, off: float) -> str:
    return f"filters and spectra disagree on {name} by {off:.1f} standard deviations: loads are not as modelled"


def _sines(asked: Asked, found: Found, result: Identification) -> list[Sine]:
    """Steady sines that a result feels, and has not taken into account."""
    if found.formulation == "force-balance" or not asked.part.is_uniform:
        return []
    part, sines = asked.quiet, list(found.felt)
    for line in (result.diagnosis.line, found.dependence and (found.dependence.channel, found.dependence.frequency)):
        sine = find_sine(part, asked.turbine, found.sensors, *line) if line else None
        sines += [sine] if sine is not None else []
    if any(one.group == "masses" and one.off for one in found.outcome.tolerances):
        turn = one_turn(found.read, asked.turbine, found.sensors)
        sines += [turn] if turn is not None else []  # an imbalance looks like blades of other masses
    return sines


def _jointly(asked: Asked, near: Outcome | None = None) -> Found:
    """By filters, from where spectra ended if that is said."""
    part, turbine, sensors = asked.part.on_own_times(), asked.turbine, asked.sensors
    found = usable_sensors(part, turbine, sensors)
    part, faults = without_stuck(part, screened(asked.part, turbine, found))
    found, offsets = with_offsets(part, turbine, found)
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

    near, said = asked.near or near, list[str]()
    if asked.sines:
        left = without_sines(part, turbine, found, asked.sines)
        psi = turned(part, turbine, found)
        if psi is None:
            part, said = left, [str(sine) for sine in asked.sines]
        else:
            near = near or search(left, None)
            forces = forces_of(asked.sines, near, part, turbine, found, prior, asked.parameters)
            left = without_sines(part, turbine, found, [force.sine for force in forces])
            part, said = with_forces(part, forces, psi), told(forces)
    outcome = thin_to_readings(search(part, near), steps)
    outcome = outcome._replace(notes=(*map(str, drifts), *offsets, *resampled, *said, *outcome.notes))
    read = replace(left, time=left.time[::steps], values=left.values[::steps])
    joint = Found("joint", outcome, read, found, faults, prior, drifts)
    return joint.doubted(MOVED) if drifts else joint


def _by_filters(asked: Asked) -> Found:
    """By filters, with a narrow-band load on the support where spectra need one."""
    found = _jointly(asked)
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
    again = _jointly(asked, near)
    if again.outcome.hypothesis != NarrowBand.name:
        return again.beside(*alone)
    name, off = compare(again.outcome, near)
    against = [_disagreement(name, off)] if off > DISAGREEMENT else []
    return again.saying(note_narrow_band(beside), *doubts_of_narrow_band(beside, asked=asked.loads), *against)


def _by_spectra(asked: Asked) -> Found:
    part, turbine = asked.quiet.on_uniform_grid(), asked.turbine
    check_length(part.name, part.duration, part.rate, turbine, MAX_READING_OF_SPECTRA)
    if asked.rate is not None:
        raise ConfigurationError("the spectral formulation reads the bands that it needs: leave the rate out")
    found = usable_sensors(part, turbine, asked.sensors)
    part, faults = without_stuck(part, screened(asked.part, turbine, found))
    found, _ = with_offsets(part, turbine, found)

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
    beside, narrow = narrow_band_beside(outcome, part, turbine, found), tuple[str, ...]()
    if beside is not None and beside.is_needed and asked.loads == "auto":
        again, prior = ask(heard_on_time(part, outcome, turbine, found), NarrowBand.name)
        outcome = told_before(again, outcome)
    else:
        narrow = doubts_of_narrow_band(beside, asked=asked.loads)
    outcome = outcome._replace(notes=(*map(str, drifts), *map(str, asked.sines), *outcome.notes))
    return Found("spectral", outcome, part, found, faults, prior, drifts).beside(*narrow)


def _by_force_balance(asked: Asked) -> Found:
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


def _by_what_fits(asked: Asked) -> Found:
    """By spectra under wind and where nothing turns, jointly otherwise; the other way is asked, too, but under wind.

    Springs that harden, friction, play and loads of another kind show in innovations; in the size of a spectrum they
    hardly do.
    """
    try:
        spectral = asked.spectra or _by_spectra(asked)
    except (WindsysidError, np.linalg.LinAlgError) as error:
        return _by_filters(asked).saying(f"joint formulation, as spectra do not apply ({error})")
    doubts = (*spectral.outcome.doubts, *_undamped(spectral.outcome))
    if not doubts and spectral.outcome.hypothesis == RotorWind.name:
        broad = _by_broad_loads(asked) if spectral.outcome.in_bands else None
        if broad is not None:
            return broad.saying("joint formulation: broad loads explain the record, and spectra in bands suppose wind")
        return spectral.saying("spectral formulation: wind drives a turning rotor, and the record is stationary")
    if not doubts and spectral.drifts:
        return spectral.saying("spectral formulation: a clock drifts, and filters feel what is read between samples")
    again = asked._replace(prior=spectral.prior, drifts=spectral.drifts)
    if spectral.drifts and asked.loads == "auto":
        again = again._replace(loads=Broadband.name)  # others would explain what filters feel of that
    joint = _by_filters(again) if doubts else _jointly(again, spectral.outcome)
    joint = joint._replace(outcome=joint.outcome._replace(given_priors=spectral.outcome.given_priors))
    if doubts:
        explained = joint.narrow or joint.outcome.hypothesis == NarrowBand.name
        if not explained and compare(joint.outcome, spectral.outcome)[1] < DISAGREEMENT:
            joint = joint.beside(*spectral.narrow)  # filters have ended where spectra did
        return joint.saying(f"joint formulation, as spectra are in doubt ({doubts[0]})")
    name, off = compare(joint.outcome, spectral.outcome)
    against = [_disagreement(name, off)]
    if spectral.outcome.turns:
        if off > DISAGREEMENT:
            return joint.saying("joint formulation; spectra were asked, too", *against)
        return joint.saying(f"joint formulation; spectra agree within {off:.1f} standard deviations")
    why = "spectral formulation: the record is stationary, and nothing that moves turns"
    if off > DISAGREEMENT:
        return spectral.saying(f"{why}; filters were asked, too", *against)
    innovations = doubts_of_innovations(joint.outcome, joint.read.rate)
    return spectral.saying(f"{why}; filters agree within {off:.1f} standard deviations", *innovations)


def _by_broad_loads(asked: Asked) -> Found | None:
    """By filters under broad loads, where these explain the record of a rotor whose modes are well damped, which bands
    take for one in wind; None where they do not, or other loads are asked for. A real machine's modes are lightly
    damped, and it has more than its model: it stays with bands."""
    if asked.loads not in ("auto", Broadband.name) or is_lightly_damped(asked.turbine):
        return None
    part, joint = asked.part, None
    begun = float(part.time[0])
    beginning = begun + BEGINNING * 2.0 * math.pi / asked.turbine.slowest_frequency
    for end in sorted({min(beginning, float(part.time[-1])), float(part.time[-1])}):
        try:
            joint = _jointly(asked._replace(part=part.section(begun, end), loads=Broadband.name))
        except (WindsysidError, np.linalg.LinAlgError):
            return None
        if joint.outcome.doubts or doubts_of_innovations(joint.outcome, joint.read.rate):
            return None
    return joint


def _undamped(found: Outcome) -> list[str]:
    """Which damping is not positive: a spectrum says its size only, and a search may end at the mirror image."""
    damping = {f"c_{name}" for name in found.turbine.model.coordinates}
    at = zip(found.model.parameters, found.theta.tolist(), strict=True)
    return [f"{q.name} is not positive" for q, theta in at if q.name in damping and q.physical(theta) <= 0.0]


_WAYS = {"auto": _by_what_fits, "joint": _by_filters, "spectral": _by_spectra, "force-balance": _by_force_balance}
