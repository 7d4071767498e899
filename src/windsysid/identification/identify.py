"""Identify: record + turbine + sensors → `Identification`, the front door of the house."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Literal

import numpy as np

from windsysid.errors import ConfigurationError, WindsysidError, as_numerical_error
from windsysid.identification.automatic_choice import by_spectra_alone, by_what_fits
from windsysid.identification.effects.prior_conflict import note_wide_priors
from windsysid.identification.effects.sinusoid import Sine, find_sine, find_turning, one_turn
from windsysid.identification.estimate.time_domain import innovations_of
from windsysid.identification.formulations import by_filters, by_force_balance, by_spectra
from windsysid.identification.job import Asked, Found
from windsysid.identification.model.prior import Prior
from windsysid.identification.verdict.conclude import Formulation, conclude
from windsysid.identification.verdict.influence import doubt_line, doubt_sine, is_harmless
from windsysid.kernels.threads import one_thread
from windsysid.loads.family import Broadband
from windsysid.mechanics.sensors import Sensor
from windsysid.output.progress import Progress, hear, unheard
from windsysid.records.coercion import RecordLike, as_record
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash, trace
from windsysid.turbine.coercion import TurbineLike, as_turbine

__all__ = ["identify"]


MOST_SEARCHES = 3
"""How often a record is asked again, without the steady lines that were found before."""


@one_thread()
@as_numerical_error("the identification")
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
        found = by_spectra(asked)
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


def _sines(asked: Asked, found: Found, result: Identification) -> list[Sine]:
    """Steady sines that a result feels, and has not taken into account."""
    part, sines = asked.quiet.on_own_times(), list(found.felt)
    if found.formulation == "force-balance" or not part.is_uniform:
        return []
    for line in (result.diagnosis.line, found.dependence and (found.dependence.channel, found.dependence.frequency)):
        sine = find_sine(part, asked.turbine, found.sensors, *line) if line else None
        sines += [sine] if sine is not None else []
    if any(one.group == "masses" and one.off for one in found.outcome.tolerances):
        turn = one_turn(found.read, asked.turbine, found.sensors)
        sines += [turn] if turn is not None else []  # an imbalance looks like blades of other masses
    return sines


_WAYS = {"auto": by_what_fits, "joint": by_filters, "spectral": by_spectra_alone, "force-balance": by_force_balance}
