"""``identification.nc``: an identification as a file, and all of it back."""

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid._version import __version__
from windsysid.checks.verdict import Diagnosis
from windsysid.checks.whiteness import Whiteness
from windsysid.configuration import parse_json
from windsysid.records.formats.netcdf import sealed
from windsysid.results.budget import Budget
from windsysid.results.estimate import Estimate, FittedSpectrum, IntervalEstimate, Loads
from windsysid.results.finding import Finding, Severity, read_finding
from windsysid.results.mode import Mode
from windsysid.results.posterior import (
    PRIORS,
    ROLES,
    SIGMAS,
    opened,
    read_conditions,
    read_parameters,
    read_statistics,
    read_tolerances,
)
from windsysid.results.provenance import Provenance
from windsysid.results.sentences import UNKNOWN
from windsysid.results.serialization import as_plain, finite, from_plain
from windsysid.results.values import IdentificationValues
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.tables import as_tables, parse_turbine

if TYPE_CHECKING:
    import h5netcdf

__all__ = ["as_netcdf", "attributes_of", "read_fields", "variables_of"]

Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, str]]
"""Dimensions, values and attributes."""

REST: dict[str, Any] = {
    "sensors": tuple[str, ...],
    "rate": float,
    "samples": int,
    "elapsed": float,
    "estimates": tuple[Estimate, ...],
    "modes": tuple[Mode, ...],
    "log_likelihood": float,
    "budget": Budget,
    "diagnosis": Diagnosis,
    "spectra": tuple[FittedSpectrum, ...],
}
"""Content and kind of the attribute ``result``."""

WHITENESS = {
    "lags": "lag",
    "autocorrelation": "autocorrelation",
    "frequency": "whitened_frequency",
    "spectrum": "whitened_spectrum",
}
"""The arrays of `windsysid.checks.whiteness.Whiteness`, and the variables that hold them."""


def variables_of(found: IdentificationValues) -> dict[str, Variable]:
    """Content of ``identification.nc``."""
    axis = "time" if len(found.innovation) == len(found.time) else "innovation_time"
    variables = _parameter_variables(found) | _whiteness_variables(found.diagnosis.whiteness)
    variables["innovation"] = (axis, "reading"), found.innovation, {}
    variables["whitened"] = (axis, "reading"), found.whitened, {}
    variables["reading"] = ("reading",), np.array(found.readings, dtype=object), {}
    if found.loads is not None:
        variables["load"] = (axis, "load_name"), found.loads.mean, {}
        variables["load_std"] = (axis, "load_name"), found.loads.std, {}
        variables["load_name"] = ("load_name",), np.array(found.loads.names, dtype=object), {}
    variables |= _state_variables(found, axis)
    if axis != "time":
        variables[axis] = (axis,), found.innovation_time, {"units": "s"}
    return variables


def _parameter_variables(found: IdentificationValues) -> dict[str, Variable]:
    """Histories, estimates, priors and covariances of the parameters."""
    names = [parameter.name for parameter in found.parameters]
    histories = np.reshape([found.history(name) for name in names], (len(names), 3, len(found.time)))
    variables: dict[str, Variable] = {"time": (("time",), found.time, {"units": "s"})}
    variables["parameter"] = ("parameter",), np.array(names, dtype=object), {}
    for row, label in enumerate(("estimate", "low", "high")):
        variables[label] = ("time", "parameter"), histories[:, row].T, {}
    variables["unit"] = ("parameter",), np.array([found[name].unit for name in names], dtype=object), {}
    for what in ("estimate", "low", "high", "std", "prior", "informed_by_data"):
        finals = np.array([getattr(found[name], what) for name in names], dtype=np.float64)
        variables[f"final_{what}"] = ("parameter",), finals, {}
    note = "in filter coordinates: ln(k / prior_centre) for stiffness, c / coordinate_scale for damping"
    variables["cov"] = ("parameter", "parameter_2"), found.cov, {"note": note}
    for kinds, kind in ((PRIORS, np.float64), (ROLES, object)):
        for key, what in kinds.items():
            variables[key] = ("parameter",), np.array([getattr(q, what) for q in found.parameters], dtype=kind), {}
    if found.joint_cov is not None:
        note = "of parameters, statistics' coordinates (windsysid.loads.statistics), tolerances [prior σ]"
        variables["joint_cov"] = ("unknown", "unknown_2"), found.joint_cov, {"note": note}
    return variables


def _whiteness_variables(w: Whiteness | None) -> dict[str, Variable]:
    """Autocorrelations and spectra of the innovations."""
    if w is None:
        return {}
    return {
        "lag": (("lag",), w.lags, {"units": "s"}),
        "autocorrelation": (("lag", "channel"), w.autocorrelation, {}),
        "whitened_frequency": (("whitened_frequency",), w.frequency, {"units": "Hz"}),
        "whitened_spectrum": (("whitened_frequency", "channel"), w.spectrum, {"note": "1: white noise"}),
    }


def _state_variables(found: IdentificationValues, axis: str) -> dict[str, Variable]:
    """The states of a `Fit` along its own times, or those of the innovations."""
    states, variables = getattr(found, "states", ()), dict[str, Variable]()
    for what in ("state_mean", "state_std") if states else ():
        values = getattr(found, what)
        variables[what] = ("time" if len(values) == len(found.time) else axis, "state"), values, {}
        variables["state"] = ("state",), np.array(states, dtype=object), {}
    return variables


def attributes_of(found: IdentificationValues) -> dict[str, Any]:
    """Attributes of ``identification.nc``."""
    import tomli_w

    known = found.provenance
    traced: dict[str, Any] = {}
    if known is not None:
        traced = {"record_hash": known.record_hash, "provenance": json.dumps(finite(known.summary()))}
        if known.start is not None:
            traced["record_start"] = known.start
    return {
        "windsysid_version": __version__,
        **traced,
        "result": json.dumps(as_plain(_rest(found))),
        "statistics": json.dumps(finite([asdict(s) for s in found.statistics])),
        "tolerances": json.dumps(finite([asdict(one) for one in found.tolerances])),
        **{"method": found.method, "formulation": found.formulation, "record": found.record},
        **{"turbine": found.turbine, "sensors": ", ".join(found.sensors), "notes": "\n".join(found.notes)},
        **{"trusted": int(found.diagnosis.trusted), "reasons": "\n".join(found.diagnosis.reasons)},
        **{"section_start_s": found.section[0], "section_end_s": found.section[1]},
        **{f"mean_{what}": mean for what, mean in found.conditions._asdict().items() if mean is not None},
        **({} if found.machine is None else {"turbine_file": tomli_w.dumps(as_tables(found.machine))}),
    }


def _rest(found: IdentificationValues) -> dict[str, Any]:
    """Content of ``identification.nc`` in addition to its variables: the rest that `windsysid.load_result` needs."""
    judged, w = found.diagnosis, found.diagnosis.whiteness
    if w is not None:  # its arrays are variables
        nothing: dict[str, Any] = dict.fromkeys(WHITENESS, np.empty(0))
        judged = replace(judged, whiteness=w._replace(**nothing))
    listed = {"findings": [finding.summary() for finding in judged.findings]}
    return {name: getattr(found, name) for name in REST} | {"diagnosis": replace(judged, findings=()), **listed}


def as_netcdf(found: IdentificationValues) -> bytes:
    """``identification.nc``."""
    import h5netcdf
    import h5py  # type: ignore[import-untyped,unused-ignore]

    # xarray would write the same; to import it takes longer than to read, write and print.
    written = io.BytesIO()  # a disk that is full makes HDF5 end the interpreter: it gets none
    with h5netcdf.File(written, "w") as file:
        for name, (axes, values, attributes) in variables_of(found).items():
            file.dimensions.update(
                {axis: n for axis, n in zip(axes, values.shape, strict=True) if axis not in file.dimensions}
            )
            text = values.dtype == object
            variable = file.create_variable(
                name, axes, h5py.string_dtype() if text else np.float64, values, fillvalue=None if text else np.nan
            )
            variable.attrs.update(attributes)
        file.attrs.update(attributes_of(found))
    return sealed(written.getvalue())


def read_fields(folder: str | Path) -> dict[str, Any]:
    """The fields of the `Identification` that was saved in a folder; those of a `Fit` where equations of one's own were
    identified.

    Raises
    ------
    ConfigurationError
        If there is none, it was changed after windsysid wrote it, or it was written by version 0.1.0.
    """
    with opened(folder) as file:
        said = {"spectra": [], **parse_json(file.attrs["result"])}  # results of version 0.2 have none
        said["modes"] = [_as_now(mode) for mode in said["modes"]]
        findings = _read_findings(said)
        fields = {name: from_plain(kind, said[name]) for name, kind in REST.items()}
        fields["diagnosis"] = _read_diagnosis(file, replace(fields["diagnosis"], findings=findings))
        fields |= {name: str(file.attrs[name]) for name in ("method", "formulation", "record", "turbine")}
        parameters = read_parameters(file)
        histories = [file[name][...] for name in ("estimate", "low", "high")]
        middle, _, high = (_coordinates(parameters, values) for values in histories)
        traced = file.attrs.get("provenance")
        fields |= {
            "section": (float(file.attrs["section_start_s"]), float(file.attrs["section_end_s"])),
            "parameters": parameters,
            "time": file["time"][...],
            "mean": middle,
            "std": (high - middle) / SIGMAS,
            "cov": file["cov"][...],
            "readings": tuple(file["reading"][...].tolist()),
            "innovation": file["innovation"][...],
            "whitened": file["whitened"][...],
            "statistics": read_statistics(file),
            "loads": Loads(tuple(file["load_name"][...].tolist()), file["load"][...], file["load_std"][...])
            if "load_name" in file
            else None,
            "machine": None,
            "conditions": read_conditions(file),
            "provenance": None if traced is None else _read_provenance(parse_json(traced)),
            "joint_cov": file["joint_cov"][...] if "joint_cov" in file else None,
            "tolerances": read_tolerances(file),
        }
        if "turbine_file" in file.attrs:
            return fields | {"machine": parse_turbine(file.attrs["turbine_file"], f"of the result {folder}")}
        return fields | _read_states(file, len(fields["time"]))


def _read_diagnosis(file: "h5netcdf.File", judged: Diagnosis) -> Diagnosis:
    """A diagnosis with the arrays of its whiteness, which are variables."""
    if judged.whiteness is None:
        return judged
    arrays = {name: file[variable][...] for name, variable in WHITENESS.items()}
    return replace(judged, whiteness=judged.whiteness._replace(**arrays))


def _read_states(file: "h5netcdf.File", samples: int) -> dict[str, Any]:
    """The states of a `Fit`; none where none were written."""
    if "state" not in file:
        nothing = np.empty((samples, 0))
        return {"states": (), "state_mean": nothing, "state_std": nothing}
    arrays = {name: file[name][...] for name in ("state_mean", "state_std")}
    return {"states": tuple(file["state"][...].tolist()), **arrays}


def _coordinates(parameters: Sequence[Parameter], values: Array) -> Array:
    """Filter coordinates (T, n_θ) of values in SI (T, n_θ)."""
    relative = values / np.array([q.reference for q in parameters])
    logarithmic = np.array([q.logarithmic for q in parameters], dtype=bool)
    return np.asarray(np.where(logarithmic, np.log(relative, where=logarithmic, out=np.zeros_like(relative)), relative))


def _as_now(mode: dict[str, Any]) -> dict[str, Any]:
    """Fields of a mode; those of version 0.2 are (value, low, high), with both references and grades apart."""
    if "frequency" in mode:
        return mode
    grades, references = mode.get("grades", ("", "")), mode["reference"] or (None, None)
    names = (("frequency", "frequency_hz", "Hz"), ("damping_ratio", "damping_ratio", "1"))
    fields: dict[str, Any] = {"name": mode["name"]}
    for (name, key, unit), grade, reference in zip(names, grades, references, strict=True):
        value, low, high = map(float, mode[key])
        std = (high - low) / (2.0 * SIGMAS)
        fields[name] = as_plain(IntervalEstimate(value, low, high, std, unit, grade, reference))
    return fields


def _read_findings(said: dict[str, Any]) -> tuple[Finding, ...]:
    """The findings of a result; of one of an older version, which has sentences only, those of the code ``unknown``."""
    if "findings" in said:
        return tuple(map(read_finding, said["findings"]))
    judged = said["diagnosis"]
    texts: dict[Severity, list[str]] = {
        "reason": judged.pop("reasons"), "remark": judged.pop("remarks"), "note": said["notes"]
    }  # fmt: skip
    judged["findings"] = []
    return tuple(Finding(UNKNOWN, severity, {"text": text}) for severity, of in texts.items() for text in of)


def _read_provenance(said: dict[str, Any]) -> Provenance:
    return Provenance(**{**said, "sensors": tuple(said["sensors"])})
