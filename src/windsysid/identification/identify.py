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
from windsysid.records.coercion import MappingLike, RecordLike, as_record
from windsysid.results.identification import Identification
from windsysid.results.provenance import mapping_tables, record_hash, trace
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
    mapping: "MappingLike | None" = None,
    progress: Progress = unheard,
) -> Identification:
    """Identify stiffness and damping of `turbine` from the vibration in `record`.

    The estimate is the posterior mode of the coefficients. The statistics of loads and noise are learned from the same
    record. Intervals are ±2σ (about 95 %) and include the tolerances of instruments and masses.

    Parameters
    ----------
    record : Record, str, Path, pandas.DataFrame or xarray.Dataset
        Channels (T,) in SI units, uniformly sampled; NaN is a missing sample. A turning rotor needs ``rotor_azimuth``
        [rad]; ``rotor_speed`` [rad/s] is used if present, and so are known loads ``load_x`` … [N, N·m], or
        ``part_of_load_x`` … if further, unmeasured loads act. The columns of a table have their unit in the name,
        ``"tower_x_acceleration [m/s^2]"``, or in their attributes.
    turbine : Turbine, str or Path
        Masses, geometry, and the reference values on which priors are centred: a turbine, the name of a packaged one
        (`packaged_turbines`), or the path of a TOML file.
    sensors : sequence of Sensor, optional
        Instruments on the record's channels. By default those of the turbine that are recorded. The force balance reads
        displacement, velocity and acceleration of every degree of freedom by name, and integrates those that are
        missing.
    formulation : {"auto", "joint", "spectral", "force-balance"}, default "auto"
        ``"joint"``: Kalman filter of motion, loads and parameters. ``"spectral"``: Whittle likelihood, for stationary
        records. ``"force-balance"``: extended Kalman filter of the parameters, with the measured motion as known.
        ``"auto"``: spectral for a stationary record of a rotor that turns in wind, or of a structure without rotating
        degrees of freedom, else joint; where both apply, each result is checked against the other.
    section : (float, float), optional
        Start and end of the part to use [s]; the whole record by default.
    prior : Prior, optional
        Centre and width of the priors; by default the reference values, with the widths of the turbine file.
    parameters : sequence of str, optional
        Names of the parameters to identify, masses and geometry included (joint formulation); by default stiffness and
        damping of every free degree of freedom.
    rate : float, optional
        Sampling rate [Hz] to which the record is resampled, without aliasing (joint formulation). By default the
        record's own; for a tower under a rigid rotor twelve samples per period. Integration steps are shorter if the
        equations require it.
    loads : {"auto", "broadband", "second-order", "narrow-band", "rotor-wind"}, default "auto"
        Load model (joint formulation); by default that with the largest evidence.
    site : {"onshore", "offshore"}, optional
        Selects the prior odds of unmodelled effects (docs/effects.md); as the turbine file has it by default.
    state : str, default "auto"
        State of the turbine, which selects the prior of damping in its file: ``"operating"`` or ``"parked"``. By
        default it follows from rotor speed and pitch, where the file has states and the record these channels.
    mapping : str, Path or Mapping, optional
        Mapping file with the names, units and signs of channels, where `record` is a path (`read_record`).
    progress : callable, optional
        Called as ``progress(step, share)`` with the present step, a str, and the share that is done, 0 to 1, or None
        if that is unknown.

    Returns
    -------
    Identification
        ``estimates``: coefficients [N/m, N·s/m; N·m/rad, N·m·s/rad for rotations]; ``modes``: frequencies [Hz] and
        damping ratios [1]; ``statistics`` of loads and noise; each with its 95 % interval, the first two with grades.
        ``diagnosis`` says whether to trust the result, and why not; ``save`` writes it to a folder.

    Raises
    ------
    RecordError
        If the record cannot be read, lacks a channel, or is too short.
    ConfigurationError
        If the turbine, a sensor or an option is wrong.
    WindsysidError
        If no load model fits the record, or the likelihood cannot be computed at the start.

    See Also
    --------
    oma : Modes without a model of the turbine.
    inspect : Faults of a record, and the sections worth using.
    identify_pieces : Records that do not fit into memory.
    plan : The length of record that an accuracy needs.
    windsysid.models.fit : Equations of one's own.

    Notes
    -----
    Grade A: the interval of the model; B: a wider one; C: not to be used (docs/grades.md). Damping is the sum of
    structural and aerodynamic damping (`damping` separates them). In a record of length T, the relative standard
    deviation of a frequency f is about √(ζ / (2π f T)) at best, and that of its damping ratio ζ 1 / √(2π ζ f T), so
    that damping needs long records (Au); `plan` predicts both for a turbine and its sensors.

    References
    ----------
    - Särkkä & Svensson, Bayesian Filtering and Smoothing, 2nd ed., Cambridge 2023, ch. 16 (joint formulation).
    - Whittle, J. R. Statist. Soc. B 15, 1953, doi:10.1111/j.2517-6161.1953.tb00131.x (spectral formulation).
    - Au, Operational Modal Analysis, Springer 2017, ch. 15 and 16 (uncertainty laws).

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> result = ws.identify(record, "tower", formulation="spectral")
    >>> for one in result.estimates:
    ...     print(one)
    k_side_side: 1.764 MN/m (95 % interval 1.693 … 1.837, grade A)
    c_side_side: 7.783 kN·s/m (95 % interval 1.375 … 14.19, grade B)
    k_fore_aft: 1.88 MN/m (95 % interval 1.557 … 2.27, grade B)
    c_fore_aft: 116.7 kN·s/m (95 % interval 58.48 … 174.9, grade B)
    >>> result.diagnosis.trusted
    True
    """
    record, turbine = as_record(record, mapping), as_turbine(turbine)
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
    if mapping is not None:
        from windsysid.records.formats import as_mapping

        options["mapping"] = mapping_tables(as_mapping(mapping))
    if formulation not in _BY_FORMULATION:
        raise ConfigurationError(f"formulation: expected {', '.join(_BY_FORMULATION)}; got '{formulation}'")
    part = record.section(*section) if section else record
    machine, notes = in_state(placed, part, state)
    job = Job(record, part, machine, sensors, prior, parameters, rate, loads)
    doing = f"{formulation} formulation, {part.samples} samples"
    progress(doing, None)
    with hear(progress, doing):
        fit = _BY_FORMULATION[formulation](job)
    outcome = fit.outcome._replace(doubts=(*fit.outcome.doubts, *fit.unmodelled), notes=(*fit.outcome.notes, *notes))
    return conclude(
        note_wide_priors(outcome), fit.read, fit.formulation, faults=fit.faults, line=fit.line,
        provenance=trace(record, record_hash(record), turbine, fit.sensors, options),
    )  # fmt: skip


_BY_FORMULATION: dict[str, Callable[[Job], FittedJob]] = {
    "auto": choose,
    "joint": lambda job: run(job.by("joint"))[1],
    "spectral": spectral_alone,
    "force-balance": lambda job: estimate(job.by("force-balance")),
}
"""Identification by each formulation that `identify` takes."""
