"""Metrics in Prometheus' text format, from the overview."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import get_args

from windsysid.fleet.rows import stored_grade
from windsysid.live.page.models import PageOverview, TurbineSummary, Verdict
from windsysid.live.store.contents import Result

__all__ = ["MEDIA_TYPE", "metrics_text"]

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Sample = tuple[Mapping[str, str], float | None]
Metric = tuple[str, str, str, Iterable[Sample]]
"""Name, kind, text and samples."""


def metrics_text(
    overview: PageOverview, results: Mapping[str, Result | None], sizes: Mapping[str, int], streams: int
) -> str:
    """Metrics of an overview, and of each turbine's newest result, in Prometheus' text format; unknown values and
    values of grade C are left out."""
    metrics = [
        *_of_turbines(overview), *_of_levels(results), *_of_modes(results),
        *_of_sources(overview), *_of_service(overview),
        ("store_takes_blocks", "gauge", "0 while the store accepts no blocks.", [({}, float(not overview.store))]),
        ("store_rows", "gauge", "Rows of the store.",
         [({"table": table}, float(count)) for table, count in sizes.items() if table != "bytes"]),
        ("store_bytes", "gauge", "Size of the store.", [({}, sizes.get("bytes"))]),
        ("event_streams", "gauge", "Open event streams.", [({}, float(streams))]),
    ]  # fmt: skip
    return "\n".join(line for metric in metrics for line in _lines(*metric)) + "\n"


def _lines(name: str, kind: str, text: str, samples: Iterable[Sample]) -> list[str]:
    known = [f"windsysid_{name}{_labels(labels)} {value:.10g}" for labels, value in samples if value is not None]
    return [f"# HELP windsysid_{name} {text}", f"# TYPE windsysid_{name} {kind}", *known] if known else []


def _of_turbines(overview: PageOverview) -> list[Metric]:
    turbines = overview.turbines
    counts = Counter(turbine.verdict for turbine in turbines)
    values: tuple[tuple[str, str, Callable[[TurbineSummary], float | None]], ...] = (
        ("turbine_trusted", "1 if the newest estimate is trusted.", lambda one: one.trusted),
        ("turbine_unusable", "Newest values of grade C.", lambda one: list(one.grades.values()).count("C")),
        ("sample_timestamp_seconds", "Time of the newest sample.", lambda one: _seconds(one.stream)),
        ("block_timestamp_seconds", "Arrival of the newest block.", lambda one: _seconds(one.received)),
        ("window_timestamp_seconds", "End of the newest window that has a result.", lambda one: _seconds(one.until)),
        ("behind_seconds", "Delay of the results behind the samples.", lambda one: one.behind),
        ("windows_waiting", "Windows that have ended without a result so far.", lambda one: one.windows_waiting),
        ("sensor_faults", "Channels with a fault.", lambda one: len(one.faults)),
    )
    return [
        ("info", "gauge", "Version of the service.", [({"version": overview.version}, 1.0)]),
        ("turbines", "gauge", "Turbines by verdict.",
         [({"verdict": verdict}, float(counts[verdict])) for verdict in get_args(Verdict)]),
        ("turbine_verdict", "gauge", "1 for the verdict of a turbine.",
         [({"turbine": one.name, "verdict": one.verdict}, 1.0) for one in turbines]),
        ("open_alarms", "gauge", "Open alarms.", _open_alarms(overview)),
        *(
            (name, "gauge", text, [({"turbine": one.name}, value(one)) for one in turbines])
            for name, text, value in values
        ),
    ]  # fmt: skip


ENDS = (("", ""), ("_low", ", lower end of the 95 % interval"), ("_high", ", upper end of the 95 % interval"))


def _of_levels(results: Mapping[str, Result | None]) -> list[Metric]:
    """Levels of stiffness and damping."""
    levels = [(name, one) for name, result in results.items() if result for one in result.levels if one.kind != "noise"]
    return [
        (f"level{end}", "gauge", f"Level of a coefficient in SI units{text}.",
         [({"turbine": of, "series": one.name, "unit": one.unit}, getattr(one, f"level{end}")) for of, one in levels])
        for end, text in ENDS
    ]  # fmt: skip


def _of_modes(results: Mapping[str, Result | None]) -> list[Metric]:
    """Frequencies and damping ratios of the newest windows."""
    modes = [
        (name, result.row, mode) for name, result in results.items() if result for mode in result.row.get("modes") or ()
    ]
    return [
        (f"mode_{metric}{end}", "gauge", f"{title} of a mode in the newest window{text}.",
         [({"turbine": name, "mode": str(mode["name"])}, mode.get(f"{key}{end}"))
          for name, row, mode in modes if stored_grade(row, mode, f"{key}_grade") != "C"])
        for key, metric, title in (
            ("frequency", "frequency_hertz", "Frequency"), ("damping_ratio", "damping_ratio", "Damping ratio"),
        )
        for end, text in ENDS
    ]  # fmt: skip


def _of_sources(overview: PageOverview) -> list[Metric]:
    sources = overview.sources
    return [
        ("source_state", "gauge", "1 for the state of a source.",
         [({"source": one.name, "state": one.state}, 1.0) for one in sources]),
        ("source_blocks_total", "counter", "Blocks received from a source.",
         [({"source": one.name}, one.blocks) for one in sources]),
        ("source_refused_total", "counter", "Refused blocks, messages and files of a source.",
         [({"source": one.name}, one.refused) for one in sources]),
    ]  # fmt: skip


def _of_service(overview: PageOverview) -> list[Metric]:
    service = overview.service
    if service is None:
        return []
    cost = None if service.cost_per_sample is None else service.cost_per_sample / 1e6
    return [
        ("blocks_per_second", "gauge", "Blocks committed per second.", [({}, service.blocks_per_second)]),
        ("cost_per_sample_seconds", "gauge", "Processor time per sample.", [({}, cost)]),
    ]


def _seconds(ms: float | None) -> float | None:
    return None if ms is None else ms / 1e3


def _open_alarms(overview: PageOverview) -> list[Sample]:
    """Open alarms by turbine, kind, severity and acknowledgement."""
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
