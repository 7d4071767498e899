"""Posterior of a turbine's coefficients, and its restoration from a result's folder."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.conditioning import hold
from windsysid.checks.widening import SIGMAS
from windsysid.configuration import parse_json
from windsysid.errors import ConfigurationError, RecordError
from windsysid.loads.statistics import Statistic, coordinates_of, learned_statistics
from windsysid.mechanics.sensors import noise_source
from windsysid.output.folders import result_file, without
from windsysid.records.formats.netcdf import check_seal, open_hdf5
from windsysid.results.finding import Finding, read_finding
from windsysid.results.tolerance import Group, Tolerance, unknowns_of
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.tables import parse_turbine
from windsysid.turbine.turbine import Turbine

if TYPE_CHECKING:
    import h5netcdf

__all__ = [
    "SIGMAS", "Conditions", "Posterior", "load_posterior", "opened", "read_parameters", "read_statistics",
    "read_tolerances", "section_name", "unusable_among",
]  # fmt: skip


class Conditions(NamedTuple):
    """Operating conditions: means over the section, None where a quantity was not recorded.

    Attributes
    ----------
    rotor_speed
        [rad/s].
    wind_speed
        [m/s], of the channel ``wind_speed``.
    """

    rotor_speed: float | None = None
    wind_speed: float | None = None


NOT_RECORDED = Conditions()

PRIORS = {"prior_centre": "centre", "prior_spread": "spread", "logarithmic": "logarithmic", "coordinate_scale": "scale"}
"""Names of a `Parameter`'s fields in ``identification.nc``."""

ROLES = {"parameter_kind": "kind", "parameter_part": "part"}
"""Names of its text fields, which files of older versions lack."""


class Posterior(NamedTuple):
    """Posterior of a turbine's coefficients, as comparisons and diagrams need it.

    Attributes
    ----------
    turbine
        With the estimates as its values, the degrees of freedom that were used and the record's mean rotor speed.
    parameters, theta, cov
        The identified parameters, their estimates (n_θ,) and covariance (n_θ, n_θ) in filter coordinates.
    record
        Name of the record.
    trusted
        True if no finding makes the result untrustworthy.
    conditions
        Operating conditions of the turbine.
    start
        Date of the record's time 0, as `windsysid.records.record.Record.start`; None where it is not known.
    record_hash
        `windsysid.results.provenance.record_hash` of the whole record; None where it is not known.
    section
        Start and end of the part that was used [s], on the record's clock; None where it is not known.
    statistics
        Learned statistics of loads and noise.
    joint_cov
        Covariance of θ, of the coordinates η of `statistics`, and of `tolerances` in standard deviations of their
        priors, together (n, n), n = n_θ + n_η + n_τ; None where it was not kept.
    tolerances
        Quantities known within tolerances only. Masses are not among them in a posterior that was read or made of a
        result: vibration determines ratios to masses, and those of the turbine are taken as exact.
    unusable
        Coefficients of grade C, each with the code of its reason (`unusable_among`).
    widening
        Factors `Estimate.widening` of the coefficients, which `cov` and `joint_cov` include.
    """

    turbine: Turbine
    parameters: tuple[Parameter, ...]
    theta: Array
    cov: Array
    record: str
    trusted: bool
    conditions: Conditions = NOT_RECORDED
    start: str | None = None
    record_hash: str | None = None
    section: tuple[float, float] | None = None
    statistics: tuple[Statistic, ...] = ()
    joint_cov: Array | None = None
    tolerances: tuple[Tolerance, ...] = ()
    unusable: Mapping[str, str] = {}
    widening: Mapping[str, float] = {}

    def given(self, *groups: Group) -> "Posterior":
        """Posterior conditioned on the stated values of instruments or masses of these groups, of all by default.

        Two results of one machine share them: changes between the two are reported without them.
        """
        if self.joint_cov is None or not self.tolerances:
            return self
        known = unknowns_of(self.parameters, self.statistics, self.tolerances)
        theta, eta = known.of("parameters"), known.of("statistics")
        levels = coordinates_of(self.statistics, {s.name: s.estimate for s in self.statistics})
        at = known.vector(parameters=self.theta, statistics=levels)
        at[known.of("tolerances", "clocks")] = [one.estimate / one.spread for one in self.tolerances]
        chosen = [not groups or one.group in groups for one in self.tolerances]
        held = known.places("tolerances", "clocks")[chosen]
        mean, cov = hold(at, self.joint_cov, held.tolist())
        values = {q.name: float(q.physical(t)) for q, t in zip(self.parameters, mean[theta], strict=True)}
        keep = np.setdiff1d(np.arange(len(cov)), held)
        return self._replace(
            turbine=self.turbine.with_values(values),
            theta=mean[theta],
            cov=cov[theta, theta],
            statistics=learned_statistics(self.statistics, mean[eta], cov[eta, eta]),
            joint_cov=cov[np.ix_(keep, keep)],
            tolerances=tuple(one for one, known in zip(self.tolerances, chosen, strict=True) if not known),
        )

    def __repr__(self) -> str:
        return (
            f"<Posterior of {self.turbine.name} from {self.record}: {len(self.parameters)} parameters,"
            f" {'' if self.trusted else 'not '}trusted>"
        )


def load_posterior(folder: str | Path) -> Posterior:
    """Load the posterior from the folder of a saved identification.

    Parameters
    ----------
    folder : str or Path
        Folder that `Identification.save` or ``windsysid identify`` wrote.

    Returns
    -------
    Posterior
        Estimates (n_θ,) and covariance (n_θ, n_θ) in filter coordinates, with the turbine.

    Raises
    ------
    ConfigurationError
        If the folder holds none, it was changed after windsysid wrote it, or an older version wrote it without the
        turbine.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> result = ws.identify(ws.simulate("tower", duration=600.0, rate=5.0, seed=1), "tower", formulation="spectral")
    >>> folder = Path(tempfile.mkdtemp()) / "first"
    >>> _ = result.save(folder)
    >>> posterior = ws.results.load_posterior(folder)
    >>> [q.name for q in posterior.parameters], posterior.cov.shape
    (['k_side_side', 'c_side_side', 'k_fore_aft', 'c_fore_aft'], (4, 4))
    """

    with opened(folder) as file:
        text, trusted = file.attrs["turbine_file"], file.attrs["trusted"]
        begun, ended = (float(file.attrs[key]) for key in ("section_start_s", "section_end_s"))
        record = section_name(file.attrs["record"], begun, ended)
        start, found = (file.attrs.get(key) for key in ("record_start", "record_hash"))
        learned, tolerances = read_statistics(file), read_tolerances(file)
        conditions, parameters = read_conditions(file), read_parameters(file)
        estimate, cov = file["final_estimate"][...].tolist(), file["cov"][...]
        joint_cov = file["joint_cov"][...] if learned and "joint_cov" in file else None
        said = parse_json(file.attrs.get("result", "{}"))
    turbine = parse_turbine(text, str(Path(folder) / "identification.nc"))
    theta = np.array([q.coordinate(value) for q, value in zip(parameters, estimate, strict=True)])
    grades = {q.name: "" for q in parameters} | {one["name"]: one.get("grade", "") for one in said.get("estimates", [])}
    return Posterior(
        turbine.with_values({q.name: value for q, value in zip(parameters, estimate, strict=True)}), parameters, theta,
        cov, record, bool(trusted), conditions, start, found, (begun, ended), learned, joint_cov, tolerances,
        unusable=unusable_among(grades, list(map(read_finding, said.get("findings", []))), trusted=bool(trusted)),
        widening={one["name"]: one.get("widening", 1.0) for one in said.get("estimates", [])},
    ).given("masses")  # fmt: skip


def unusable_among(grades: Mapping[str, str], findings: Sequence[Finding], *, trusted: bool) -> dict[str, str]:
    """Return the coefficients of grade C, each with the code of a reason that names it, or else of one that names none.
    Without a grade, a coefficient is C where the result is not trusted."""
    reasons = [one for one in findings if one.severity == "reason"]
    named = {name: one.code for one in reversed(reasons) for name in one.quantities}
    other = next((one.code for one in sorted(reasons, key=lambda one: bool(one.quantities))), "not_trusted")
    return {name: named.get(name, other) for name, grade in grades.items() if grade == "C" or not (grade or trusted)}


@contextmanager
def opened(folder: str | Path) -> "Iterator[h5netcdf.File]":
    """The ``identification.nc`` of a result, open for reading; every fault in it is one ConfigurationError."""
    path = result_file(folder, "identification.nc")
    changed = ConfigurationError(
        f"result {folder}: identification.nc was damaged or changed after windsysid wrote it: copy it again, or"
        " identify the record again"
    )
    try:
        sealed = check_seal(path)  # first: HDF5 may hang in a damaged file
        with open_hdf5(path) as file:
            if not sealed and "windsysid_version" in file.attrs:  # version 0.1.0 wrote neither
                raise changed
            yield file
    except ConfigurationError:
        raise
    except RecordError:
        raise changed from None
    except (OSError, ValueError) as error:
        named = getattr(error, "strerror", None) or error.__class__.__name__
        if isinstance(error, FileNotFoundError | NotADirectoryError):
            raise ConfigurationError(without("a result of windsysid identify", folder)) from None
        raise ConfigurationError(f"{folder}: expected a result of identify, got an unreadable one ({named})") from None
    except KeyError:
        raise ConfigurationError(
            f"result {folder}: expected the whole result in identification.nc, got a file of an older version:"
            " identify the record again"
        ) from None


def read_parameters(file: "h5netcdf.File") -> tuple[Parameter, ...]:
    """The identified parameters with their priors."""
    names, *columns = (file[key][...].tolist() for key in ("parameter", *PRIORS))
    kinds, parts = (file[key][...].tolist() if key in file else [""] * len(names) for key in ROLES)
    return tuple(
        Parameter(name, centre, spread, bool(logarithmic), scale, kind, part)
        for name, centre, spread, logarithmic, scale, kind, part in zip(names, *columns, kinds, parts, strict=True)
    )


def read_conditions(file: "h5netcdf.File") -> Conditions:
    """Operating conditions of the turbine."""
    means = (file.attrs.get(f"mean_{what}") for what in Conditions._fields)
    return Conditions(*(None if mean is None else float(mean) for mean in means))


def read_tolerances(file: "h5netcdf.File") -> tuple[Tolerance, ...]:
    """Tolerances of instruments and masses."""
    return tuple(Tolerance(**row) for row in parse_json(file.attrs.get("tolerances", "[]")))


def read_statistics(file: "h5netcdf.File") -> tuple[Statistic, ...]:
    """Statistics of loads and noise; version 0.1.0 wrote none."""
    found = []
    for row in parse_json(file.attrs.get("statistics", "[]")):
        known: dict[str, Any] = {key: math.nan if value is None else value for key, value in row.items()}
        found.append(Statistic(**known if "kind" in known else {**known, **_described_by_name(known["name"])}))
    return tuple(found)


def _described_by_name(name: str) -> dict[str, str]:
    """Fields of a statistic that files of older versions left to its name."""
    if noise_source(name):
        return {"kind": "noise"}
    harmonic = f"_{name.rpartition('_')[2]}" if name.endswith("P") else ""
    return {"kind": "level", "time_constant": f"load_time_constant{harmonic}"} if name.startswith("load_rms") else {}


def section_name(record: str, start: float, end: float) -> str:
    """A record and the part of it that was used, in words."""
    return f"{record}, {start:.6g}–{end:.6g} s"
