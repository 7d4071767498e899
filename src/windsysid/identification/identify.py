"""Identify: record + turbine + sensors → `Identification`, the front door of the house."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Literal

from windsysid.errors import ConfigurationError, as_numerical_error
from windsysid.identification.automatic_choice import choose, spectral_alone
from windsysid.identification.condition.operating_state import in_state
from windsysid.identification.estimate.prior_conflict import note_wide_priors
from windsysid.identification.formulations import estimate
from windsysid.identification.job import FittedJob, Formulation, Job
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.prior_odds import check_odds
from windsysid.identification.pipeline import run
from windsysid.identification.verdict.conclude import conclude
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.output.progress import Progress, hear, unheard
from windsysid.records.coercion import RecordLike, as_record
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash, trace
from windsysid.turbine.coercion import TurbineLike, as_turbine

__all__ = ["identify"]


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
    site: str | None = None,
    state: str = "auto",
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
    site
        ``"onshore"`` or ``"offshore"``: which prior odds effects have (docs/effects.md); as the turbine file says by
        default.
    state
        State of the turbine, whose damping prior its file has: ``"operating"`` or ``"parked"``; by default it follows
        from rotor speed and pitch, where the file has states and the record these channels.
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

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> result = ws.identify(record, "tower", formulation="spectral")
    >>> for one in result.estimates:
    ...     print(f"{one.name}: {one.estimate:.2e} ({one.low:.2e} … {one.high:.2e}) {one.unit}, {one.grade}")
    k_side_side: 1.76e+06 (1.69e+06 … 1.84e+06) N/m, A
    c_side_side: 7.78e+03 (2.13e+03 … 1.34e+04) N*s/m, A
    k_fore_aft: 1.88e+06 (1.77e+06 … 2.00e+06) N/m, A
    c_fore_aft: 1.17e+05 (8.09e+04 … 1.52e+05) N*s/m, A
    >>> result.diagnosis.trusted
    True
    """
    record, turbine = as_record(record), as_turbine(turbine)
    placed = turbine.at(site)
    check_odds(placed)
    options = {
        "formulation": formulation,
        "section": None if section is None else list(section),
        "prior": None if prior is None else asdict(prior),
        "parameters": None if parameters is None else list(parameters),
        "rate": rate,
        "loads": loads,
        "site": placed.site,
        "state": state,
    }
    if formulation not in _WAYS:
        raise ConfigurationError(f"formulation: expected {', '.join(_WAYS)}; got '{formulation}'")
    part = record.section(*section) if section else record
    machine, notes = in_state(placed, part, state)
    job = Job(record, part, machine, sensors, prior, parameters, rate, loads)
    doing = f"{formulation} formulation, {part.samples} samples"
    progress(doing, None)
    with hear(progress, doing):
        fit = _WAYS[formulation](job)
    outcome = fit.outcome._replace(doubts=(*fit.outcome.doubts, *fit.unmodelled), notes=(*fit.outcome.notes, *notes))
    return conclude(
        note_wide_priors(outcome), fit.read, fit.formulation, faults=fit.faults, line=fit.line,
        provenance=trace(record, record_hash(record), turbine, fit.sensors, options),
    )  # fmt: skip


_WAYS: dict[str, Callable[[Job], FittedJob]] = {
    "auto": choose,
    "joint": lambda job: run(job.by("joint"))[1],
    "spectral": spectral_alone,
    "force-balance": lambda job: estimate(job.by("force-balance")),
}
"""Identification by each formulation that `identify` takes."""
