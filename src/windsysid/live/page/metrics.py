"""What Prometheus scrapes: the overview as text."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import get_args

from windsysid.live.page.models import Overview, Verdict

__all__ = ["MEDIA_TYPE", "metrics_text"]

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Sample = tuple[Mapping[str, str], float | None]


def metrics_text(overview: Overview, sizes: Mapping[str, int], streams: int) -> str:
    """Metrics in the text format of Prometheus; what is not known is left out."""
    turbines = overview.turbines
    service = overview.service
    lines: list[str] = []

    def add(name: str, kind: str, text: str, samples: Iterable[Sample]) -> None:
        known = [(labels, value) for labels, value in samples if value is not None]
        if known:
            lines.extend((f"# HELP windsysid_{name} {text}", f"# TYPE windsysid_{name} {kind}"))
            lines.extend(f"windsysid_{name}{_labels(labels)} {value:.10g}" for labels, value in known)

    add("info", "gauge", "The version that runs.", [({"version": overview.version}, 1.0)])
    counts = Counter(turbine.verdict for turbine in turbines)
    add(
        "turbines", "gauge", "Turbines by verdict.",
        [({"verdict": verdict}, float(counts[verdict])) for verdict in get_args(Verdict)],
    )  # fmt: skip
    add(
        "turbine_verdict", "gauge", "1 for the verdict that holds of a turbine.",
        [({"turbine": one.name, "verdict": one.verdict}, 1.0) for one in turbines],
    )  # fmt: skip
    add(
        "turbine_trusted", "gauge", "Whether the newest estimate is to be trusted.",
        [({"turbine": one.name}, None if one.trusted is None else float(one.trusted)) for one in turbines],
    )  # fmt: skip
    for name, text, field in (
        ("sample_timestamp_seconds", "When the newest sample was taken.", "stream"),
        ("block_timestamp_seconds", "When the newest block came.", "received"),
        ("window_timestamp_seconds", "End of the newest window that has a result.", "until"),
    ):
        moments = [(one.name, getattr(one, field)) for one in turbines]
        add(name, "gauge", text, [({"turbine": one}, None if at is None else at / 1e3) for one, at in moments])
    add(
        "behind_seconds", "gauge", "By how much the results are behind the samples.",
        [({"turbine": one.name}, one.behind) for one in turbines],
    )  # fmt: skip
    add(
        "windows_waiting", "gauge", "Windows that ended and have no result yet.",
        [({"turbine": one.name}, one.windows_waiting) for one in turbines],
    )  # fmt: skip
    add("open_alarms", "gauge", "Alarms that are open.", _open_alarms(overview))
    add(
        "sensor_faults", "gauge", "Channels that are not good.",
        [({"turbine": one.name}, float(len(one.faults))) for one in turbines],
    )  # fmt: skip
    sources = overview.sources
    states = [({"source": one.name, "state": one.state}, 1.0) for one in sources]
    add("source_state", "gauge", "1 for the state that a source is in.", states)
    for name, text, field in (
        ("source_blocks_total", "Blocks that a source brought.", "blocks"),
        ("source_refused_total", "Blocks, messages and files of a source that were refused.", "refused"),
    ):
        add(name, "counter", text, [({"source": one.name}, float(getattr(one, field))) for one in sources])
    if service is not None:
        add("blocks_per_second", "gauge", "Blocks that are committed.", [({}, service.blocks_per_second)])
        cost = service.cost_per_sample
        add(
            "cost_per_sample_seconds", "gauge", "Processor time a sample.", [({}, None if cost is None else cost / 1e6)]
        )
    add("store_takes_blocks", "gauge", "0 while the store accepts no blocks.", [({}, float(not overview.store))])
    rows = [({"table": table}, float(count)) for table, count in sizes.items() if table != "bytes"]
    add("store_rows", "gauge", "Rows of the store.", rows)
    add("store_bytes", "gauge", "Size of the store.", [({}, sizes.get("bytes"))])
    add("event_streams", "gauge", "Pages that listen.", [({}, float(streams))])
    return "\n".join(lines) + "\n"


def _open_alarms(overview: Overview) -> list[Sample]:
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
