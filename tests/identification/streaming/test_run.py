"""The streaming run with an accumulator that only counts: checkpoints, resuming, wind, and what is refused."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming import run as streaming
from windsysid.identification.streaming.run import SegmentsEstimate, StreamingJob, run_segments
from windsysid.records.record import Record
from windsysid.results.provenance import record_hash
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


class Counter:
    """Sums the time stamps, and remembers how it was called."""

    def __init__(self, first: Record, job: StreamingJob) -> None:
        self.sensors, self.total, self.last = tuple(job.sensors or ()), 0.0, first
        self.calls: list[str] = []

    def replay(self, segment: Record) -> None:
        self.calls.append("replay")

    def take(self, segment: Record) -> Record:
        self.calls.append("take")
        self.total, self.last = self.total + float(segment.time.sum()), segment
        return segment

    def stored(self) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"total": np.asarray(self.total)}, {}

    def restore(self, arrays: Mapping[str, Any], progress: Mapping[str, Any]) -> None:
        self.calls.append("restore")
        self.total = float(arrays["total"])

    def finish(self) -> None:
        self.calls.append("finish")

    def estimate(self) -> SegmentsEstimate:
        return SegmentsEstimate(Told(self), self.last, len(self.calls), self.last.time[-1:])  # type: ignore[arg-type]


class Told:
    """An outcome that holds the accumulator."""

    def __init__(self, of: Counter) -> None:
        self.of, self.elapsed, self.notes = of, 0.0, ()

    def _replace(self, **changes: object) -> "Told":
        return self


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return load_turbine("tower")


@pytest.fixture(scope="module")
def segments(tower: Turbine) -> list[Record]:
    record = simulate_record(tower, duration=60.0, rate=10.0, seed=1)
    wind = 8.0 + 0.01 * record.time
    record = record.with_channels({"wind_speed": (np.where(record.time < 20.0, np.nan, wind), "m/s")})
    return [
        replace(record, time=record.time[i:j], values=record.values[i:j]) for i, j in ((0, 200), (200, 400), (400, 600))
    ]


@pytest.fixture(autouse=True)
def concluded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Instead of a result: what it would be made of."""
    monkeypatch.setattr(streaming, "conclude", lambda outcome, read, formulation, **more: (outcome.of, more))


def job(tower: Turbine, checkpoint: Path | None = None, **changes: Any) -> StreamingJob:
    given = StreamingJob(tower, None, Prior(), None, "joint", None, "auto", None, checkpoint, False, {})
    return given._replace(**changes)


def run(of: Sequence[Record] | Iterator[Record], asked: StreamingJob) -> tuple[Counter, dict[str, Any]]:
    return run_segments(of, asked, Counter)  # type: ignore[return-value]


def interrupted(of: Sequence[Record], asked: StreamingJob) -> None:
    def stopping() -> Iterator[Record]:
        yield from of
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(stopping(), asked)


def test_one_pass_takes_every_segment_and_says_what_the_whole_was(tower: Turbine, segments: list[Record]):
    counter, result = run(segments, job(tower))
    assert counter.calls == ["take", "take", "take", "finish"]
    assert result["whole"].section == (0.0, 59.9)
    assert result["whole"].wind_speed == pytest.approx(np.mean(8.0 + 0.01 * np.arange(200, 600) / 10.0))
    whole = replace(
        segments[0], time=np.concatenate([s.time for s in segments]), values=np.vstack([s.values for s in segments])
    )
    assert result["provenance"].record_hash == record_hash(whole)
    assert result["provenance"].options["loads"] == "auto"


def test_a_call_that_resumes_replays_restores_and_ends_the_same(tower: Turbine, segments: list[Record], tmp_path: Path):
    asked = job(tower, tmp_path / "state.npz")
    interrupted(segments[:2], asked)
    assert asked.checkpoint is not None
    assert asked.checkpoint.exists()
    resumed, result = run(segments, asked)
    straight, expected = run(segments, job(tower))
    assert resumed.calls == ["replay", "replay", "restore", "take", "finish"]
    assert resumed.total == straight.total
    assert result["whole"].wind_speed == expected["whole"].wind_speed
    assert not asked.checkpoint.exists()


def test_a_checkpoint_is_kept_where_that_is_asked(tower: Turbine, segments: list[Record], tmp_path: Path):
    asked = job(tower, tmp_path / "state.npz", keep_checkpoint=True)
    run(segments, asked)
    assert (tmp_path / "state.npz").exists()
    assert run(segments, asked)[0].calls == ["replay", "replay", "replay", "restore", "finish"]


def test_another_record_or_another_call_does_not_resume(tower: Turbine, segments: list[Record], tmp_path: Path):
    asked = job(tower, tmp_path / "state.npz")
    interrupted(segments[:2], asked)
    changed = [segments[0], replace(segments[1], values=segments[1].values + 1e-9), segments[2]]
    longer = [
        segments[0],
        replace(segments[1], time=segments[1].time[:150], values=segments[1].values[:150]),
        segments[2],
    ]
    for other in (changed, longer, segments[:1]):
        with pytest.raises(ConfigurationError, match="another call, which differs in record"):
            run(other, asked)
    for other_job, differs in ((asked._replace(loads="broadband"), "loads"), (asked._replace(rate=5.0), "rate")):
        with pytest.raises(ConfigurationError, match=f"differs in {differs}"):
            run(segments, other_job)
    assert run(segments, asked._replace(options={"file": "moved.csv"}))[0].calls[2] == "restore"


def test_no_segment_is_refused(tower: Turbine):
    with pytest.raises(RecordError, match="no pieces: expected at least one"):
        run([], job(tower))
