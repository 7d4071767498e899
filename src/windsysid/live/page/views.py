"""Conversion of the store's contents into the models of the API."""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid._version import __version__
from windsysid.checks.conditioning import hold
from windsysid.configuration import parse_toml
from windsysid.errors import StoreError
from windsysid.fleet.rows import stored_grade, stored_grades
from windsysid.fleet.scada import SCADA_COLUMNS
from windsysid.live.engine_state import PageEngine, TurbineState
from windsysid.live.page import models
from windsysid.live.page.newest import Newest
from windsysid.live.sources.source import BlockSource
from windsysid.live.store.contents import Alarm, Result, SensorHealth, SeriesLevel, Status
from windsysid.live.store.store import Store
from windsysid.live.watch.series_words import series_title
from windsysid.mechanics.sensors import noise_source
from windsysid.units import unit_text

__all__ = [
    "NS_PER_MS", "alarm_seen", "detail_of", "levels_of", "overview_of", "results_of", "sources_of", "trouble_of",
    "turbine_of",
]  # fmt: skip

NS_PER_MS = 1_000_000

VERDICTS: tuple[models.Verdict, ...] = ("moved", "sensor", "silent", "unsure", "learning", "waiting", "steady")

SEVERITIES = ("alarm", "warning", "notice")

MOST_OPEN = 10_000
"""Setting: largest number of open alarms in an overview."""

MULTIPLES = 4
"""Setting: multiples of the blade-passing frequency, in addition to 1P."""

TWO_PI = 2.0 * math.pi


def sources_of(sources: Iterable[BlockSource]) -> list[models.SourceStatus]:
    """States of the sources."""
    return [
        models.SourceStatus(name=source.describe(), **source.state._asdict())  # a state is of one moment
        for source in sources
    ]


def trouble_of(store: Store) -> str:
    """Reason why the store accepts no blocks at this moment, in one line; empty if it does."""
    if store.trouble:
        return store.trouble
    try:
        store.last_event()
    except StoreError as error:
        return str(error)
    return ""


def overview_of(store: Store, engine: PageEngine | None, newest: Newest, role: str, login: bool) -> models.PageOverview:
    """All turbines, worst first."""
    event = store.last_event()
    state = None if engine is None else engine.state()
    turbines = state.turbines if state is not None else {}
    statuses = {status.turbine: status for status in store.statuses()}
    healths = _by_turbine(store.healths())
    alarms = _by_turbine(store.alarms(open_only=True, most=MOST_OPEN))
    names = sorted({*store.turbines(), *turbines})
    results = newest.of(names)
    summaries = [
        _summary(name, statuses.get(name), healths.get(name, ()), alarms.get(name, ()), results[name], turbines)
        for name in names
    ]
    summaries.sort(key=_how_bad)
    service = None
    if state is not None:
        cost = 1e6 * sum(state.seconds.values()) / state.samples if state.samples else None
        service = models.Service(
            blocks_per_second=_number(state.rate), cost_per_sample=_number(cost), compiling=state.compiling
        )
    return models.PageOverview(
        at=_now(), event=event, role="operator" if role == "operator" else "reader", login=login,
        version=__version__, turbines=summaries, service=service,
    )  # fmt: skip


def turbine_of(store: Store, engine: PageEngine | None, newest: Newest, name: str) -> models.TurbinePage:
    """Current state of a turbine; KeyError if the name is unknown."""
    event = store.last_event()
    state = {} if engine is None else engine.state().turbines
    if name not in state and name not in store.turbines():
        raise KeyError(name)
    status = {one.turbine: one for one in store.statuses()}.get(name)
    healths = store.healths(name)
    alarms = store.alarms(turbine=name, open_only=True)
    result = newest.of([name])[name]
    configurations = store.configurations(name)
    window = configurations[0]["tables"].get("window") if configurations else None
    return models.TurbinePage(
        at=_now(), event=event,
        summary=_summary(name, status, healths, alarms, result, state),
        counts=dict(status.counts) if status is not None else {},
        channels=[_channel(health) for health in healths],
        newest=None if result is None else detail_of(result),
        window_length=_number(window),
        configurations=[
            models.Configuration(at=_ms(one["at"]), settings=str(one["settings"])) for one in configurations
        ],
    )  # fmt: skip


def levels_of(found: Sequence[tuple[int, SeriesLevel]]) -> models.Levels:
    """Levels as columns; null for windows without a level."""
    windows = sorted({window for window, _ in found})
    at = {window: i for i, window in enumerate(windows)}
    fields = (
        "estimate", "low", "high", "level", "level_low", "level_high", "statistic", "limit",
    )  # fmt: skip
    columns: dict[str, dict[str, list[Any]]] = {}
    shown: dict[str, SeriesLevel] = {}
    for window, level in found:
        if level.name not in columns:
            columns[level.name] = {field: [None] * len(windows) for field in fields} | {"grade": [""] * len(windows)}
        columns[level.name]["grade"][at[window]] = level.grade
        for field in fields:
            columns[level.name][field][at[window]] = _number(getattr(level, field))
        shown[level.name] = level
    return models.Levels(
        windows=[_ms(window) for window in windows],
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
        windows=[_ms(result.window) for result in results],
        until=[_ms(result.until) for result in results],
        status=[_text(row, "status") for row in rows],
        trusted=[row.get("trusted") for row in rows],
        state=[_text(row, "state", "unknown") for row in rows],
        why=["; ".join(_reasons(row)) for row in rows],
        rotor_speed=[_number(row.get("rotor_speed")) for row in rows],
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
        window=_ms(result.window), until=_ms(result.until),
        status=_text(row, "status"), why=_text(row, "why"), trusted=row.get("trusted"),
        reasons=_texts(row, "reasons"), remarks=_texts(row, "remarks"), notes=_texts(row, "notes"),
        state=_text(row, "state", "unknown"), rotor_speed=_number(row.get("rotor_speed")),
        rate=_number(row.get("rate")), samples=row.get("samples"), formulation=_text(row, "formulation"),
        modes=[_mode(row, mode, excitations) for mode in _rows(row, "modes")],
        excitations=excitations,
        budget=_budget(row),
        health=[
            models.WindowHealth(**{key: _text(one, key) for key in ("channel", "kind", "severity", "text")})
            for one in _rows(row, "health")
        ],
        channels=[
            models.ChannelStatistics(
                channel=str(one["name"]), unit=unit_text(_text(one, "unit")),
                **{key: _number(one.get(key)) for key in ("mean", "std", "missing")},
            )
            for one in _rows(row, "channels")
        ],
    )  # fmt: skip


def alarm_seen(alarm: Alarm) -> models.AlarmSeen:
    """An alarm as a model of the API."""
    return models.AlarmSeen(
        key=alarm.key, turbine=alarm.turbine, kind=alarm.kind, severity=alarm.severity, about=alarm.about,
        title=series_title(alarm.about), opened=_ms(alarm.opened), earliest=_ms(alarm.earliest),
        latest=_ms(alarm.latest), ended=_ms_or_none(alarm.ended), text=alarm.text,
        acknowledged=_ms_or_none(alarm.acknowledged), by=alarm.by, remark=alarm.remark,
    )  # fmt: skip


def _summary(
    name: str,
    status: Status | None,
    healths: Iterable[SensorHealth],
    alarms: Iterable[Alarm],
    result: Result | None,
    engine: Mapping[str, TurbineState],
) -> models.TurbineSummary:
    row: Mapping[str, Any] = {} if result is None else result.row
    seen = sorted((alarm_seen(alarm) for alarm in alarms), key=_alarm_order)
    faults = [_channel(health) for health in healths if health.state != "good"]
    known = status or Status(name, {}, 0, 0, "waiting", None, {})
    state = engine.get(name)
    waiting, behind = (None, None) if state is None else (state.windows, _number(state.behind))
    window, until = (None, None) if result is None else (_ms(result.window), _ms(result.until))
    verdict, answer = _verdict_of_alarms(seen, faults, status) or _verdict_of_result(status, waiting, result)
    return models.TurbineSummary(
        name=name, verdict=verdict, answer=answer, state=known.state, rotor_speed=_number(known.rotor_speed),
        stream=_ms_or_none(known.stream), received=_ms_or_none(known.received), window=window, until=until,
        trusted=_trusted(result), grades=stored_grades(row), reasons=_reasons(row), windows_waiting=waiting,
        behind=behind, alarms=seen, faults=faults,
    )  # fmt: skip


def _trusted(result: Result | None) -> bool | None:
    return None if result is None else result.row.get("status") == "ok" and bool(result.row.get("trusted"))


def _verdict_of_alarms(
    alarms: Sequence[models.AlarmSeen], faults: Sequence[models.ChannelHealth], status: Status | None
) -> tuple[models.Verdict, str] | None:
    """Worst verdict from alarms and sensors, with a sentence; None if there is no alarm and no fault."""
    first = {alarm.kind: alarm.text for alarm in reversed(alarms)}
    if "structure" in first:
        return "moved", first["structure"]
    if "sensor" in first:
        return "sensor", first["sensor"]
    if faults:
        return "sensor", faults[0].text or f"{faults[0].channel}: {faults[0].state}"
    if "data" in first:
        return "silent", first["data"]
    if status is not None and status.state == "silent":
        return "silent", "No samples are received: check the logger and the connection."
    return None


def _verdict_of_result(status: Status | None, waiting: int | None, result: Result | None) -> tuple[models.Verdict, str]:
    """Verdict from the newest result of a turbine without alarms, or the reason for a missing result."""
    if result is None:
        if status is None:
            return "waiting", "No data received yet: the first estimate follows the end of the first window."
        if waiting:
            return "waiting", f"The first estimates are being computed: {waiting} waiting."
        return "waiting", "Samples are received: the first estimate follows the end of the first window."
    why = "; ".join(_reasons(result.row)) or "reason not known"
    if result.row.get("status") != "ok":
        return "unsure", f"The newest window has no estimate: {why}."
    bad, known = _unusable(result.row), len(_rows(result.row, "parameters"))
    if 0 < len(bad) == known:
        return "unsure", f"All coefficients of the newest estimate have grade C: {why}."
    but = f" Grade C in the newest estimate, not used for the level: {', '.join(bad)}." if bad else ""
    if not any(level.statistic > 0.0 for level in result.levels):
        return "learning", f"Learning: changes are detected after the learning phase.{but}"
    return "steady", f"Unchanged: no change beyond the usual variation.{but}"


def _unusable(row: Mapping[str, Any]) -> list[str]:
    """Coefficients of grade C."""
    return [str(one["name"]) for one in _rows(row, "parameters") if stored_grade(row, one) == "C"]


def _how_bad(summary: models.TurbineSummary) -> tuple[int, bool, int, str]:
    """Sort key: worst verdict, then alarms that are not acknowledged, then severity."""
    worst = min((SEVERITIES.index(alarm.severity) for alarm in summary.alarms), default=len(SEVERITIES))
    seen = all(alarm.acknowledged is not None for alarm in summary.alarms)
    return VERDICTS.index(summary.verdict), seen, worst, summary.name


def _alarm_order(alarm: models.AlarmSeen) -> tuple[bool, int, float]:
    return alarm.acknowledged is not None, SEVERITIES.index(alarm.severity), -alarm.opened


def _channel(health: SensorHealth) -> models.ChannelHealth:
    return models.ChannelHealth(channel=health.channel, state=health.state, since=_ms(health.since), text=health.text)


def _reasons(row: Mapping[str, Any]) -> list[str]:
    """Reasons why a row has no estimate or is not trusted."""
    why = [str(row["why"])] if row.get("why") else []
    return why + ([] if row.get("trusted") else _texts(row, "reasons"))


def _mode(
    row: Mapping[str, Any], mode: Mapping[str, Any], excitations: Sequence[models.Excitation]
) -> models.FoundMode:
    values = {key: _number(mode.get(key)) for key in _MODE_NUMBERS}
    grades = {key: stored_grade(row, mode, key) for key in _MODE_GRADES}
    frequency = values["frequency"]
    nearest, distance = None, None
    if frequency and excitations:
        at = min(excitations, key=lambda one: abs(one.frequency - frequency))
        nearest, distance = at.name, (frequency - at.frequency) / frequency
    return models.FoundMode(name=_text(mode, "name"), **values, **grades, nearest=nearest, distance=distance)


_MODE_NUMBERS = (
    "frequency", "frequency_low", "frequency_high", "damping_ratio", "damping_ratio_low", "damping_ratio_high",
)  # fmt: skip

_MODE_GRADES = ("frequency_grade", "damping_ratio_grade")


def _excitations(row: Mapping[str, Any]) -> list[models.Excitation]:
    """1P and the multiples of the blades; none where the rotor does not turn or its blades are not known."""
    speed, blades = _number(row.get("rotor_speed")), _blades(row)
    if not speed or blades is None:
        return []
    orders = [1, *(blades * k for k in range(1, MULTIPLES + 1))]
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
        models.LoadTrack(name=name, title=name.replace("_", " "), unit=unit_text(_text(first, "unit")), **found)
        for name, (found, first) in columns.items()
        if not noise_source(name)
    ]


def _conditions_over_time(rows: Sequence[Mapping[str, Any]]) -> list[models.ConditionTrack]:
    """Means of the channels, and SCADA that was joined to the rows."""
    columns = _over_time(rows, "channels", ("mean",))
    found = {name: (one["mean"], _text(first, "unit")) for name, (one, first) in columns.items()}
    for name, (unit, _) in SCADA_COLUMNS.items():
        values = [_number(row.get(f"scada_{name}")) for row in rows] if unit else []
        if any(value is not None for value in values):
            found[f"scada_{name}"] = values, unit
    return [
        models.ConditionTrack(name=name, title=name.replace("_", " "), unit=unit_text(unit), mean=values)
        for name, (values, unit) in found.items()
    ]


def _over_time(
    rows: Sequence[Mapping[str, Any]], column: str, fields: Sequence[str], grades: Sequence[str] = ()
) -> dict[str, tuple[dict[str, list[Any]], Mapping[str, Any]]]:
    """A list column as lists by name and field, numbers or grades, with the first entry of each name."""
    found: dict[str, tuple[dict[str, list[Any]], Mapping[str, Any]]] = {}
    for i, row in enumerate(rows):
        for entry in _rows(row, column):
            name = _text(entry, "name")
            if name not in found:
                empty = {field: [None] * len(rows) for field in fields} | {key: [""] * len(rows) for key in grades}
                found[name] = empty, entry
            for field in fields:
                found[name][0][field][i] = _number(entry.get(field))
            for key in grades:
                found[name][0][key][i] = stored_grade(row, entry, key)
    return found


def _budget(row: Mapping[str, Any]) -> list[models.BudgetShare]:
    """Shares of the sources of uncertainty, from the row's covariance of all unknowns."""
    parameters, cov = _rows(row, "parameters"), _covariance(row)
    n, count = len(parameters), len(cov)
    if not 0 < n <= count:
        return []
    first = min(n + len(_rows(row, "statistics")), count)
    held = {
        "loads": hold(np.zeros(count), cov, list(range(n, first)))[1],
        "instruments": hold(np.zeros(count), cov, list(range(first, count)))[1],
    }
    rest = hold(np.zeros(count), cov, list(range(n, count)))[1]
    return [
        models.BudgetShare(
            name=str(one["name"]), title=series_title(str(one["name"])), unit=unit_text(_text(one, "unit")),
            **{key: _number(one.get(key)) for key in ("estimate", "low", "high")},
            grade=stored_grade(row, one), informed=_number(one.get("informed_by_data")),
            **{cause: _number(1.0 - known[i, i] / cov[i, i]) for cause, known in held.items()},
            rest=_number(rest[i, i] / cov[i, i]),
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


def _by_turbine(found: Iterable[Any]) -> dict[str, list[Any]]:
    grouped: dict[str, list[Any]] = {}
    for one in found:
        grouped.setdefault(one.turbine, []).append(one)
    return grouped


def _rows(row: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    return list(row.get(key) or ())


def _text(row: Mapping[str, Any], key: str, default: str = "") -> str:
    return str(row.get(key) or default)


def _texts(row: Mapping[str, Any], key: str) -> list[str]:
    return [str(text) for text in row.get(key) or ()]


def _number(value: Any) -> float | None:
    """A finite number, or None: JSON has neither NaN nor ∞."""
    if value is None:
        return None
    value = float(value)
    return value if math.isfinite(value) else None


def _ms(ns: int) -> float:
    return ns / NS_PER_MS


def _ms_or_none(ns: int | None) -> float | None:
    """None where there was none yet, which is 0 in the store."""
    return _ms(ns) if ns else None


def _now() -> float:
    return time.time_ns() / NS_PER_MS
