"""A record as one row of an archive: the result, or the reason why there is none.

A row is a plain mapping with the keys of `COLUMNS`. What a record has several of (coefficients, modes, channels) is a
list of mappings, so that all turbines have the same columns. A row holds nothing that differs when the same record is
taken again: no date of today, no time that it took.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.fleet.scada import SCADA_COLUMNS
from windsysid.identification.identify import identify
from windsysid.identification.job import Formulation
from windsysid.inspection.channels import kinds
from windsysid.inspection.rotor import rotor_of
from windsysid.inspection.screening import faults_of, read_besides
from windsysid.mechanics.sensors import Sensor
from windsysid.monitoring.own_information import without_prior
from windsysid.records.moments import shift_moment
from windsysid.records.record import Record
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.operation import operation_of
from windsysid.turbine.turbine import Turbine

__all__ = ["COLUMNS", "Row", "empty_row", "failed_row", "row_of", "stored_grade", "stored_grades"]

Row = dict[str, Any]

NUMBER, COUNT, TEXT, TEXTS, FLAG, NUMBERS, MOMENT = "number", "count", "text", "texts", "flag", "numbers", "moment"

COLUMNS: dict[str, str | dict[str, str]] = {
    "source": TEXT, "source_bytes": COUNT, "status": TEXT, "why": TEXT, "tries": COUNT,
    "record": TEXT, "start": TEXT, "time": MOMENT, "duration": NUMBER, "rate": NUMBER, "samples": COUNT,
    "state": TEXT, "speed_bin": NUMBER, "rotor_speed": NUMBER, "rotor_speed_min": NUMBER, "rotor_speed_max": NUMBER,
    **{f"scada_{name}": NUMBER for name in SCADA_COLUMNS},
    "trusted": FLAG, "reasons": TEXTS, "remarks": TEXTS, "notes": TEXTS,
    "parameters": {
        "name": TEXT, "unit": TEXT, "kind": TEXT, "estimate": NUMBER, "low": NUMBER, "high": NUMBER, "std": NUMBER,
        "informed_by_data": NUMBER, "reference": NUMBER, "prior_centre": NUMBER, "prior_spread": NUMBER,
        "logarithmic": FLAG, "coordinate_scale": NUMBER, "own": NUMBER, "own_std": NUMBER, "grade": TEXT,
        "reason": TEXT,
    },
    "modes": {
        "name": TEXT, "frequency": NUMBER, "frequency_low": NUMBER, "frequency_high": NUMBER, "damping_ratio": NUMBER,
        "damping_ratio_low": NUMBER, "damping_ratio_high": NUMBER, "frequency_grade": TEXT, "damping_ratio_grade": TEXT,
    },
    "statistics": {
        "name": TEXT, "unit": TEXT, "given": NUMBER, "estimate": NUMBER, "low": NUMBER, "high": NUMBER,
        "spread": NUMBER, "like": TEXT,
    },
    "covariance": NUMBERS,
    "channels": {
        "name": TEXT, "unit": TEXT, "mean": NUMBER, "std": NUMBER, "min": NUMBER, "max": NUMBER, "missing": NUMBER,
    },
    "health": {"channel": TEXT, "kind": TEXT, "severity": TEXT, "text": TEXT, "count": COUNT},
    "formulation": TEXT, "method": TEXT, "section_start": NUMBER, "section_end": NUMBER, "log_likelihood": NUMBER,
    "windsysid": TEXT, "record_hash": TEXT, "settings": TEXT, "turbine_file": TEXT,
}  # fmt: skip
"""The columns of an archive, with their content; those with columns of their own are lists.

status
    ``ok``; ``refused``, where the record is not fit, `why` says for what; ``failed``, where something else went wrong.
source, source_bytes
    The file and its size: what tells that it was taken already.
start, time
    The moment of the first sample as the record says it, and the same as a date: UTC where its zone is known.
rotor_speed_min, rotor_speed_max
    Of the record's own rotor speed: none where `rotor_speed` is the mean that SCADA says.
speed_bin
    Lower edge of the bin of the rotor speed, as a share of the turbine's usual one.
covariance
    Lower triangle, row by row, of the parameters in filter coordinates, of the coordinates of the statistics, and of
    the tolerances in standard deviations of their priors.
own, own_std
    Information of the record itself on a parameter, without its prior, in filter coordinates: what is monitored.
grade, frequency_grade, damping_ratio_grade
    Of the quantity (docs/grades.md): none in archives of an older version (`stored_grade`).
reason
    Of grade C: the code of a finding (docs/findings.md).
settings
    SHA-256 of turbine, sensors, mapping and formulation.
turbine_file
    The turbine as TOML, as it was identified.
"""


def empty_row(source: str, size: int, settings: str) -> Row:
    """A row of which nothing is known but the file."""
    from windsysid._version import __version__

    row: Row = {
        name: [] if isinstance(kind, dict) or kind in (TEXTS, NUMBERS) else None for name, kind in COLUMNS.items()
    }
    row |= {"source": source, "source_bytes": size, "settings": settings, "windsysid": __version__, "tries": 0}
    return row


def failed_row(source: str, size: int, settings: str, why: str) -> Row:
    """A row of a record that could not be taken for a reason that is not its own."""
    row = empty_row(source, size, settings)
    return row | {"status": "failed", "why": why, "tries": 1}


def stored_grade(row: Mapping[str, Any], quantity: Mapping[str, Any], key: str = "grade") -> str:
    """The grade of a quantity of a row. Without one, it is A or C, as the row is trusted or not."""
    known = quantity.get(key)
    return str(known) if known is not None else "A" if row.get("trusted") else "C"


def stored_grades(row: Mapping[str, Any]) -> dict[str, str]:
    """Grades of the coefficients of a row, and of frequencies and damping ratios of its modes."""
    found = {str(one["name"]): stored_grade(row, one) for one in row.get("parameters") or ()}
    for mode in row.get("modes") or ():
        for what in ("frequency", "damping_ratio"):
            found[f"{mode['name']} {what.replace('_', ' ')}"] = stored_grade(row, mode, f"{what}_grade")
    return found


def row_of(
    row: Row, record: Record, turbine: Turbine, sensors: Sequence[Sensor] | None, formulation: Formulation | str,
    on_result: Callable[[Identification], object] = lambda found: None,
) -> Row:  # fmt: skip
    """Fill a row from a record: identified, or the reason why that is refused; `on_result` is given the result."""
    row = row | {"record": record.name, "samples": record.samples, "duration": record.duration, "rate": record.rate}
    row["record_hash"] = record_hash(record)
    if record.start is not None:
        row["start"] = shift_moment(record.start, float(record.time[0]))
    row["channels"] = _channels(record)
    try:
        row |= _operation(record, turbine)
        row["health"] = _health(record, turbine, sensors)
        found = identify(record, turbine, sensors=sensors, formulation=formulation)  # type: ignore[arg-type]
    except (RecordError, ConfigurationError) as error:
        return row | {"status": "refused", "why": " ".join(str(error).split())}
    on_result(found)
    return row | {"status": "ok"} | _found(found)


def _operation(record: Record, turbine: Turbine) -> Row:
    rotor = rotor_of(record, set(kinds(record)))
    state, at, mean, low, high = operation_of(None if rotor is None else rotor.speed, turbine.rotor_speed)
    return {"state": state, "speed_bin": at, "rotor_speed": mean, "rotor_speed_min": low, "rotor_speed_max": high}


def _channels(record: Record) -> list[Row]:
    rows = []
    for i, (name, unit) in enumerate(zip(record.channels, record.units, strict=True)):
        values = record.values[:, i]
        known = values[np.isfinite(values)]
        some = known.size > 0
        rows.append({
            "name": name, "unit": unit, "mean": float(known.mean()) if some else None,
            "std": float(known.std()) if some else None, "min": float(known.min()) if some else None,
            "max": float(known.max()) if some else None, "missing": 1.0 - known.size / values.size,
        })  # fmt: skip
    return rows


def _health(record: Record, turbine: Turbine, sensors: Sequence[Sensor] | None) -> list[Row]:
    """Warnings and worse of the channels that an identification reads."""
    listed = turbine.sensors if sensors is None else sensors
    measured = [sensor.channel for sensor in listed if sensor.channel in record]
    read = [*measured, *read_besides(record, turbine)]
    if not read:
        return []
    return [
        {key: getattr(finding, key) for key in ("channel", "kind", "severity", "text", "count")}
        for finding in faults_of(record, read, turbine)
        if finding.severity != "note"
    ]


def _found(found: Identification) -> Row:
    """Row of an identification's result."""
    import tomli_w

    from windsysid.turbine.tables import as_tables

    posterior = found.posterior
    own, own_cov = without_prior(posterior, found.parameters)
    cov = found.cov if found.joint_cov is None else found.joint_cov
    return {
        "trusted": found.diagnosis.trusted,
        "reasons": list(found.diagnosis.reasons), "remarks": list(found.diagnosis.remarks), "notes": list(found.notes),
        "parameters": [
            _parameter(found, q, float(own[i]), float(own_cov[i, i]) ** 0.5)
            | {"reason": posterior.unusable.get(q.name)}
            for i, q in enumerate(found.parameters)
        ],
        "modes": [
            {"name": m.name, **_columns("frequency", m.frequency), **_columns("damping_ratio", m.damping_ratio)}
            for m in found.modes
        ],
        "statistics": [asdict(statistic) for statistic in found.statistics],
        "covariance": cov[np.tril_indices(len(cov))].tolist(),
        "formulation": found.formulation, "method": found.method,
        "section_start": found.section[0], "section_end": found.section[1], "log_likelihood": found.log_likelihood,
        "turbine_file": "" if found.machine is None else tomli_w.dumps(as_tables(found.machine)),
    }  # fmt: skip


def _columns(name: str, one: IntervalEstimate) -> Row:
    return {name: one.estimate, f"{name}_low": one.low, f"{name}_high": one.high, f"{name}_grade": one.grade}


def _parameter(found: Identification, q: Parameter, own: float, own_std: float) -> Row:
    e = found[q.name]
    shared = ("unit", "kind", "estimate", "low", "high", "std", "informed_by_data", "reference", "grade")
    return {
        "name": q.name, **{key: getattr(e, key) for key in shared},
        "prior_centre": q.centre, "prior_spread": q.spread, "logarithmic": q.logarithmic, "coordinate_scale": q.scale,
        "own": own, "own_std": own_std,
    }  # fmt: skip
