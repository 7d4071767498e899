"""Identify: record + turbine + sensors → `Identification`, the front door of the house."""

from collections.abc import Sequence
from dataclasses import asdict, replace

from windsysid.errors import ConfigurationError
from windsysid.identification.conclude import Formulation, conclude
from windsysid.identification.force_balance import identify_by_force_balance, measured_channels
from windsysid.identification.joint import identify_jointly
from windsysid.identification.prepare import (
    check_length,
    resample_for_model,
    screened,
    thin_to_readings,
    usable_sensors,
)
from windsysid.identification.prior import Prior
from windsysid.identification.spectral import identify_by_spectrum
from windsysid.inspection.screening import noted, screen
from windsysid.mechanics.sensors import Sensor
from windsysid.records.coercion import RecordLike, as_record
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash, trace
from windsysid.signals.inputs import TURNING
from windsysid.turbine.coercion import TurbineLike, as_turbine

__all__ = ["identify"]


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
        where measured. A `Record`, a path, a pandas DataFrame or an xarray Dataset with units
        (`windsysid.records.coercion`).
    turbine
        Masses, geometry, and the references that priors are centred on. A `Turbine`, a packaged name or a TOML file.
    sensors
        Instruments on the record's channels; the turbine's usual ones, as far as they are recorded, by default. The
        force balance reads displacement, velocity and acceleration of every degree of freedom by name and integrates
        what is missing.
    formulation
        ``"joint"``, ``"spectral"`` (stationary records; docs/spectral.md) or ``"force-balance"``.
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
        part, steps, resampled = resample_for_model(part, turbine, rate, sensors or turbine.sensors)
        check_length(part.name, part.duration, part.rate, turbine)
        outcome = identify_jointly(part, turbine, found, prior or Prior(), parameters, loads=loads)
        outcome = thin_to_readings(outcome, steps)._replace(notes=(*resampled, *outcome.notes, *faults))
        read = replace(part, time=part.time[::steps], values=part.values[::steps])
        return conclude(
            outcome, read, formulation, provenance=trace(record, record_hash(record), turbine, found, options)
        )
    if formulation == "spectral":
        check_length(part.name, part.duration, part.rate, turbine)
        if rate is not None:
            raise ConfigurationError("the spectral formulation reads the bands that it needs: leave the rate out")
        found = usable_sensors(part, turbine, sensors)
        faults = noted(screened(recorded, turbine, found))
        outcome = identify_by_spectrum(part, turbine, found, prior or Prior(), parameters, loads=loads)
        outcome = outcome._replace(notes=(*outcome.notes, *faults))
        return conclude(
            outcome, part, formulation, provenance=trace(record, record_hash(record), turbine, found, options)
        )
    if formulation == "force-balance":
        check_length(part.name, part.duration, part.rate, turbine)
        if sensors is not None:
            raise ConfigurationError(
                "the force balance takes no sensor list: it reads tower_x_acceleration, blade_1_lag_displacement … "
                "by name"
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
    raise ConfigurationError(f"formulation: expected joint, spectral or force-balance, got '{formulation}'")
