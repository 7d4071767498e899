"""Conversion of the store's current state into the models of the API: overview, turbines, verdicts and alarms."""

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

from windsysid._version import __version__
from windsysid.errors import StoreError
from windsysid.fleet.rows import stored_grade, stored_grades
from windsysid.live.engine_state import PageEngine, TurbineState
from windsysid.live.page import models
from windsysid.live.page.newest import Newest
from windsysid.live.page.results import detail_of, list_of, ms_of, number_of, reasons_of
from windsysid.live.sources.source import BlockSource
from windsysid.live.store.contents import Alarm, Result, SensorHealth, Status
from windsysid.live.store.store import Store
from windsysid.live.watch.series_words import series_title

__all__ = ["alarm_seen", "overview_of", "sources_of", "trouble_of", "turbine_of"]

VERDICTS = get_args(models.Verdict)

SEVERITIES = ("alarm", "warning", "notice")

MAX_OPEN_ALARMS = 10_000
"""Setting: largest number of open alarms in an overview."""


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
    alarms = _by_turbine(store.alarms(open_only=True, most=MAX_OPEN_ALARMS))
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
            blocks_per_second=number_of(state.rate), cost_per_sample=number_of(cost), compiling=state.compiling
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
        window_length=number_of(window),
        configurations=[
            models.Configuration(at=ms_of(one["at"]), settings=str(one["settings"])) for one in configurations
        ],
    )  # fmt: skip


def alarm_seen(alarm: Alarm) -> models.AlarmSeen:
    """An alarm as a model of the API."""
    return models.AlarmSeen(
        key=alarm.key, turbine=alarm.turbine, kind=alarm.kind, severity=alarm.severity, about=alarm.about,
        title=series_title(alarm.about), opened=ms_of(alarm.opened), earliest=ms_of(alarm.earliest),
        latest=ms_of(alarm.latest), ended=_ms_or_none(alarm.ended), text=alarm.text,
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
    trusted = None if result is None else row.get("status") == "ok" and bool(row.get("trusted"))
    seen = sorted((alarm_seen(alarm) for alarm in alarms), key=_alarm_order)
    faults = [_channel(health) for health in healths if health.state != "good"]
    known = status or Status(name, {}, 0, 0, "waiting", None, {})
    state = engine.get(name)
    waiting, behind = (None, None) if state is None else (state.windows, number_of(state.behind))
    window, until = (None, None) if result is None else (ms_of(result.window), ms_of(result.until))
    verdict, answer = _verdict_of_alarms(seen, faults, status) or _verdict_of_result(status, waiting, result)
    return models.TurbineSummary(
        name=name, verdict=verdict, answer=answer, state=known.state, rotor_speed=number_of(known.rotor_speed),
        stream=_ms_or_none(known.stream), received=_ms_or_none(known.received), window=window, until=until,
        trusted=trusted, grades=stored_grades(row), reasons=reasons_of(row), windows_waiting=waiting,
        behind=behind, alarms=seen, faults=faults,
    )  # fmt: skip


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
    why = "; ".join(reasons_of(result.row)) or "reason not known"
    if result.row.get("status") != "ok":
        return "unsure", f"The newest window has no estimate: {why}."
    bad, known = _unusable(result.row), len(list_of(result.row, "parameters"))
    if 0 < len(bad) == known:
        return "unsure", f"All coefficients of the newest estimate have grade C: {why}."
    but = f" Grade C in the newest estimate, not used for the level: {', '.join(bad)}." if bad else ""
    if not any(level.statistic > 0.0 for level in result.levels):
        return "learning", f"Learning: changes are detected after the learning phase.{but}"
    return "steady", f"Unchanged: no change beyond the usual variation.{but}"


def _unusable(row: Mapping[str, Any]) -> list[str]:
    """Coefficients of grade C."""
    return [str(one["name"]) for one in list_of(row, "parameters") if stored_grade(row, one) == "C"]


def _how_bad(summary: models.TurbineSummary) -> tuple[int, bool, int, str]:
    """Sort key: worst verdict, then alarms that are not acknowledged, then severity."""
    worst = min((SEVERITIES.index(alarm.severity) for alarm in summary.alarms), default=len(SEVERITIES))
    seen = all(alarm.acknowledged is not None for alarm in summary.alarms)
    return VERDICTS.index(summary.verdict), seen, worst, summary.name


def _alarm_order(alarm: models.AlarmSeen) -> tuple[bool, int, float]:
    return alarm.acknowledged is not None, SEVERITIES.index(alarm.severity), -alarm.opened


def _channel(health: SensorHealth) -> models.ChannelHealth:
    return models.ChannelHealth(channel=health.channel, state=health.state, since=ms_of(health.since), text=health.text)


def _by_turbine(found: Iterable[Any]) -> dict[str, list[Any]]:
    grouped: dict[str, list[Any]] = {}
    for one in found:
        grouped.setdefault(one.turbine, []).append(one)
    return grouped


def _ms_or_none(ns: int | None) -> float | None:
    """None where there was none yet, which is 0 in the store."""
    return ms_of(ns) if ns else None


def _now() -> float:
    return ms_of(time.time_ns())
