"""Metrics in Prometheus' text format, from the overview."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import get_args

from windsysid.live.page.models import PageOverview, TurbineSummary, Verdict

__all__ = ["MEDIA_TYPE", "metrics_text"]

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Sample = tuple[Mapping[str, str], float | None]
Metric = tuple[str, str, str, Iterable[Sample]]
"""Name, kind, text and samples."""


def metrics_text(overview: PageOverview, sizes: Mapping[str, int], streams: int) -> str:
    """Metrics in the text format of Prometheus; what is not known is left out."""
    metrics = [
        *_of_turbines(overview), *_of_sources(overview), *_of_service(overview),
        ("store_takes_blocks", "gauge", "0 while the store accepts no blocks.", [({}, float(not overview.store))]),
        ("store_rows", "gauge", "Rows of the store.",
         [({"table": table}, float(count)) for table, count in sizes.items() if table != "bytes"]),
        ("store_bytes", "gauge", "Size of the store.", [({}, sizes.get("bytes"))]),
        ("event_streams", "gauge", "Pages that listen.", [({}, float(streams))]),
    ]  # fmt: skip
    return "\n".join(line for metric in metrics for line in _lines(*metric)) + "\n"


def _lines(name: str, kind: str, text: str, samples: Iterable[Sample]) -> list[str]:
    known = [f"windsysid_{name}{_labels(labels)} {value:.10g}" for labels, value in samples if value is not None]
    return [f"# HELP windsysid_{name} {text}", f"# TYPE windsysid_{name} {kind}", *known] if known else []


def _of_turbines(overview: PageOverview) -> list[Metric]:
    turbines = overview.turbines
    counts = Counter(turbine.verdict for turbine in turbines)
    values: tuple[tuple[str, str, Callable[[TurbineSummary], float | None]], ...] = (
        ("turbine_trusted", "Whether the newest estimate is to be trusted.", lambda one: one.trusted),
        ("turbine_unusable", "Newest numbers of grade C.", lambda one: list(one.grades.values()).count("C")),
        ("sample_timestamp_seconds", "When the newest sample was taken.", lambda one: _seconds(one.stream)),
        ("block_timestamp_seconds", "When the newest block came.", lambda one: _seconds(one.received)),
        ("window_timestamp_seconds", "End of the newest window that has a result.", lambda one: _seconds(one.until)),
        ("behind_seconds", "By how much the results are behind the samples.", lambda one: one.behind),
        ("windows_waiting", "Windows that ended and have no result yet.", lambda one: one.windows_waiting),
        ("sensor_faults", "Channels that are not good.", lambda one: len(one.faults)),
    )
    return [
        ("info", "gauge", "The version that runs.", [({"version": overview.version}, 1.0)]),
        ("turbines", "gauge", "Turbines by verdict.",
         [({"verdict": verdict}, float(counts[verdict])) for verdict in get_args(Verdict)]),
        ("turbine_verdict", "gauge", "1 for the verdict that holds of a turbine.",
         [({"turbine": one.name, "verdict": one.verdict}, 1.0) for one in turbines]),
        ("open_alarms", "gauge", "Alarms that are open.", _open_alarms(overview)),
        *(
            (name, "gauge", text, [({"turbine": one.name}, value(one)) for one in turbines])
            for name, text, value in values
        ),
    ]  # fmt: skip


def _of_sources(overview: PageOverview) -> list[Metric]:
    sources = overview.sources
    return [
        ("source_state", "gauge", "1 for the state that a source is in.",
         [({"source": one.name, "state": one.state}, 1.0) for one in sources]),
        ("source_blocks_total", "counter", "Blocks that a source brought.",
         [({"source": one.name}, one.blocks) for one in sources]),
        ("source_refused_total", "counter", "Blocks, messages and files of a source that were refused.",
         [({"source": one.name}, one.refused) for one in sources]),
    ]  # fmt: skip


def _of_service(overview: PageOverview) -> list[Metric]:
    service = overview.service
    if service is None:
        return []
    cost = None if service.cost_per_sample is None else service.cost_per_sample / 1e6
    return [
        ("blocks_per_second", "gauge", "Blocks that are committed.", [({}, service.blocks_per_second)]),
        ("cost_per_sample_seconds", "gauge", "Processor time a sample.", [({}, cost)]),
    ]


def _seconds(ms: float | None) -> float | None:
    return None if ms is None else ms / 1e3


def _open_alarms(overview: PageOverview) -> list[Sample]:
    """Of every turbine, by kind, severity, and whether somebody acknowledged."""
    counts = Counter(
        (one.name, alarm.kind, alarm.severity, alarm.acknowledged is not None)
        for one in overview.turbines
        for alarm in one.alarms
    )
    return [
        ({"turbine": name, "kind": kind, "severity": severity, "acknowledged": str(seen).lower()}, float(count))
        for (name, kind, severity, seen), count in sorted(counts.items())
    ]


def _labels(labels: Mapping[str, str]) -> str:
    escaped = ",".join(f'{name}="{value.translate(_ESCAPES)}"' for name, value in labels.items())
    return f"{{{escaped}}}" if labels else ""


_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": "\\n"})
