"""Conversion of stored results and levels into the models of the API."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.checks.conditioning import hold
from windsysid.configuration import parse_toml
from windsysid.fleet.rows import stored_grade
from windsysid.fleet.scada import SCADA_COLUMNS
from windsysid.live.page import models
from windsysid.live.store.contents import Result, SeriesLevel
from windsysid.live.watch.series_words import series_title
from windsysid.mechanics.sensors import noise_source
from windsysid.output.table import titled
from windsysid.units import unit_text

__all__ = ["NS_PER_MS", "detail_of", "levels_of", "list_of", "ms_of", "number_of", "reasons_of", "results_of"]

NS_PER_MS = 1_000_000

MAX_BLADE_PASSING_MULTIPLE = 4
"""Setting: multiples of the blade-passing frequency, in addition to 1P."""

TWO_PI = 2.0 * math.pi


def levels_of(found: Sequence[tuple[int, SeriesLevel]]) -> models.Levels:
    """Levels as columns; null for windows without a level."""
    windows = sorted({window for window, _ in found})
    at = {window: i for i, window in enumerate(windows)}
    fields = ("estimate", "low", "high", "level", "level_low", "level_high", "statistic", "limit")
    columns: dict[str, dict[str, list[Any]]] = {}
    shown: dict[str, SeriesLevel] = {}
    for window, level in found:
        if level.name not in columns:
            columns[level.name] = {field: [None] * len(windows) for field in fields} | {"grade": [""] * len(windows)}
        columns[level.name]["grade"][at[window]] = level.grade
        for field in fields:
            columns[level.name][field][at[window]] = number_of(getattr(level, field))
        shown[level.name] = level
    return models.Levels(
        windows=[ms_of(window) for window in windows],
        series=[
            models.SeriesHistory(
                name=name, title=series_title(name, level.kind), unit=unit_text(level.unit), kind=level.kind,
                **columns[name],
            )
            for name, level in shown.items()
        ],
    )  # fmt: skip


def results_of(results: Sequence[Result]) -> models.Results:
    """Results as columns."""
    rows = [result.row for result in results]
    return models.Results(
        windows=[ms_of(result.window) for result in results],
        until=[ms_of(result.until) for result in results],
        status=[_text(row, "status") for row in rows],
        trusted=[row.get("trusted") for row in rows],
        state=[_text(row, "state", "unknown") for row in rows],
        why=["; ".join(reasons_of(row)) for row in rows],
        rotor_speed=[number_of(row.get("rotor_speed")) for row in rows],
        blades=_blades(rows[-1]) if rows else None,
        modes=_modes_over_time(rows),
        loads=_loads_over_time(rows),
        conditions=_conditions_over_time(rows),
    )


def detail_of(result: Result) -> models.Detail:
    """All results of one window."""
    row = result.row
    excitations = _excitations(row)
    return models.Detail(
        window=ms_of(result.window), until=ms_of(result.until),
        status=_text(row, "status"), why=_text(row, "why"), trusted=row.get("trusted"),
        reasons=_texts(row, "reasons"), remarks=_texts(row, "remarks"), notes=_texts(row, "notes"),
        state=_text(row, "state", "unknown"), rotor_speed=number_of(row.get("rotor_speed")),
        rate=number_of(row.get("rate")), samples=row.get("samples"), formulation=_text(row, "formulation"),
        modes=[_mode(row, mode, excitations) for mode in list_of(row, "modes")],
        excitations=excitations,
        budget=_budget(row),
        health=[
            models.WindowHealth(**{key: _text(one, key) for key in ("channel", "kind", "severity", "text")})
            for one in list_of(row, "health")
        ],
        channels=[
            models.ChannelStatistics(
                channel=str(one["name"]), unit=unit_text(_text(one, "unit")),
                **{key: number_of(one.get(key)) for key in ("mean", "std", "missing")},
            )
            for one in list_of(row, "channels")
        ],
    )  # fmt: skip


def reasons_of(row: Mapping[str, Any]) -> list[str]:
    """Reasons why a row has no estimate or is not trusted."""
    why = [str(row["why"])] if row.get("why") else []
    return why + ([] if row.get("trusted") else _texts(row, "reasons"))


def _mode(
    row: Mapping[str, Any], mode: Mapping[str, Any], excitations: Sequence[models.Excitation]
) -> models.FoundMode:
    values = {key: number_of(mode.get(key)) for key in _MODE_NUMBERS}
    grades = {key: stored_grade(row, mode, key) for key in _MODE_GRADES}
    frequency = values["frequency"]
    nearest, distance = None, None
    if frequency and excitations:
        at = min(excitations, key=lambda one: abs(one.frequency - frequency))
        nearest, distance = at.name, (frequency - at.frequency) / frequency
    return models.FoundMode(name=_text(mode, "name"), **values, **grades, nearest=nearest, distance=distance)


_MODE_NUMBERS = tuple(f"{name}{end}" for name in ("frequency", "damping_ratio") for end in ("", "_low", "_high"))


_MODE_GRADES = ("frequency_grade", "damping_ratio_grade")


def _excitations(row: Mapping[str, Any]) -> list[models.Excitation]:
    """1P and the multiples of the blades; none where the rotor does not turn or its blades are not known."""
    speed, blades = number_of(row.get("rotor_speed")), _blades(row)
    if not speed or blades is None:
        return []
    orders = [1, *(blades * k for k in range(1, MAX_BLADE_PASSING_MULTIPLE + 1))]
    return [models.Excitation(name=f"{order}P", frequency=order * speed / TWO_PI) for order in orders]


def _blades(row: Mapping[str, Any]) -> int | None:
    """The number of blades in the turbine file that a row keeps."""
    try:
        blades = parse_toml(_text(row, "turbine_file"))["model"]["blades"]
    except (KeyError, TypeError, ValueError):
        return None
    return blades if isinstance(blades, int) else None


def _modes_over_time(rows: Sequence[Mapping[str, Any]]) -> list[models.ModeTrack]:
    columns = _over_time(rows, "modes", _MODE_NUMBERS, _MODE_GRADES)
    return [models.ModeTrack(name=name, **found) for name, (found, _) in columns.items()]


def _loads_over_time(rows: Sequence[Mapping[str, Any]]) -> list[models.LoadTrack]:
    columns = _over_time(rows, "statistics", ("estimate", "low", "high"))
    return [
        models.LoadTrack(name=name, title=titled(name), unit=unit_text(_text(first, "unit")), **found)
        for name, (found, first) in columns.items()
        if not noise_source(name)
    ]


def _conditions_over_time(rows: Sequence[Mapping[str, Any]]) -> list[models.ConditionTrack]:
    """Means of the channels, and SCADA that was joined to the rows."""
    columns = _over_time(rows, "channels", ("mean",))
    found = {name: (one["mean"], _text(first, "unit")) for name, (one, first) in columns.items()}
    for name, (unit, _) in SCADA_COLUMNS.items():
        values = [number_of(row.get(f"scada_{name}")) for row in rows] if unit else []
        if any(value is not None for value in values):
            found[f"scada_{name}"] = values, unit
    return [
        models.ConditionTrack(name=name, title=titled(name), unit=unit_text(unit), mean=values)
        for name, (values, unit) in found.items()
    ]


def _over_time(
    rows: Sequence[Mapping[str, Any]], column: str, fields: Sequence[str], grades: Sequence[str] = ()
) -> dict[str, tuple[dict[str, list[Any]], Mapping[str, Any]]]:
    """A list column as lists by name and field, numbers or grades, with the first entry of each name."""
    found: dict[str, tuple[dict[str, list[Any]], Mapping[str, Any]]] = {}
    for i, row in enumerate(rows):
        for entry in list_of(row, column):
            name = _text(entry, "name")
            if name not in found:
                empty = {field: [None] * len(rows) for field in fields} | {key: [""] * len(rows) for key in grades}
                found[name] = empty, entry
            for field in fields:
                found[name][0][field][i] = number_of(entry.get(field))
            for key in grades:
                found[name][0][key][i] = stored_grade(row, entry, key)
    return found


def _budget(row: Mapping[str, Any]) -> list[models.BudgetShare]:
    """Shares of the sources of uncertainty, from the row's covariance of all unknowns."""
    parameters, cov = list_of(row, "parameters"), _covariance(row)
    n, count = len(parameters), len(cov)
    if not 0 < n <= count:
        return []
    first = min(n + len(list_of(row, "statistics")), count)
    held = {
        "loads": hold(np.zeros(count), cov, list(range(n, first)))[1],
        "instruments": hold(np.zeros(count), cov, list(range(first, count)))[1],
    }
    rest = hold(np.zeros(count), cov, list(range(n, count)))[1]
    return [
        models.BudgetShare(
            name=str(one["name"]), title=series_title(str(one["name"])), unit=unit_text(_text(one, "unit")),
            **{key: number_of(one.get(key)) for key in ("estimate", "low", "high")},
            grade=stored_grade(row, one), informed=number_of(one.get("informed_by_data")),
            **{cause: number_of(1.0 - known[i, i] / cov[i, i]) for cause, known in held.items()},
            rest=number_of(rest[i, i] / cov[i, i]),
        )
        for i, one in enumerate(parameters)
        if cov[i, i] > 0.0
    ]  # fmt: skip


def _covariance(row: Mapping[str, Any]) -> Array:
    """Covariance (n, n) of all unknowns from its lower triangle; (0, 0) where it is none."""
    triangle = row.get("covariance") or []
    count = round((math.sqrt(8 * len(triangle) + 1) - 1) / 2)
    if count * (count + 1) // 2 != len(triangle):
        return np.empty((0, 0))
    cov = np.zeros((count, count))
    cov[np.tril_indices(count)] = triangle
    cov += np.tril(cov, -1).T
    return cov if np.isfinite(cov).all() else np.empty((0, 0))


def list_of(row: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """Entries of a list column; none where it is missing."""
    return list(row.get(key) or ())


def _text(row: Mapping[str, Any], key: str, default: str = "") -> str:
    return str(row.get(key) or default)


def _texts(row: Mapping[str, Any], key: str) -> list[str]:
    return [str(text) for text in row.get(key) or ()]


def number_of(value: Any) -> float | None:
    """A finite number, or None: JSON has neither NaN nor ∞."""
    if value is None:
        return None
    value = float(value)
    return value if math.isfinite(value) else None


def ms_of(ns: int) -> float:
    """Milliseconds of a time in nanoseconds."""
    return ns / NS_PER_MS
