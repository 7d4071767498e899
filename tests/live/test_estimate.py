"""A window always gets its row: from a worker that lives, from the next one, or one that says why there is none."""

import json
from base64 import b64decode
from typing import Any

import numpy as np
import pytest

from tests.live.streaming import NOON, blocks_of, record
from windsysid.fleet.members import Member
from windsysid.fleet.work.guard import DeadWorkerError, HangingWorkerError
from windsysid.live.windows.estimate import Here, InWorker
from windsysid.live.windows.timeline import SECOND, Gathered, gather

MEMBER = Member("T01", "tower")


def window() -> Gathered:
    return gather(blocks_of(record(400), 20.0, 20), NOON, NOON + 60 * SECOND, "T01")


def taken(estimator: InWorker | Here, gathered: Gathered) -> dict[str, Any]:
    return dict(estimator.take(gathered, "T01 now", MEMBER, "spectral", "sha256:0").row)


def test_a_window_without_samples_says_so():
    for estimator in (Here(), InWorker()):
        row = taken(estimator, Gathered(None))
        assert row["status"] == "refused"
        assert "fewer than 2 samples" in row["why"]


def test_a_window_too_short_is_refused_with_its_reason_and_its_channels():
    row = taken(Here(), window())
    assert row["status"] == "refused"
    assert [channel["name"] for channel in row["channels"]] == ["tower_x_acceleration", "tower_z_acceleration"]
    json.dumps(row, allow_nan=False)


def test_a_worker_that_dies_is_asked_again(monkeypatch: pytest.MonkeyPatch):
    estimator, deaths = InWorker(), [1, 2]

    def ask(request: dict[str, Any]) -> dict[str, Any]:
        if deaths.pop() if deaths else 0:
            raise DeadWorkerError("ended its process by signal 9")
        json.dumps(request)  # a worker is told everything as text
        return {"row": {"status": "ok"}, "seconds": 0.1, "spectra": []}

    monkeypatch.setattr(estimator._worker, "ask", ask)
    assert taken(estimator, window()) == {"status": "ok"}


@pytest.mark.parametrize(("error", "said"), [(DeadWorkerError, "died, 3 times"), (HangingWorkerError, "hung")])
def test_a_window_that_workers_die_or_hang_at_is_a_failed_row(monkeypatch, error, said):
    estimator, asked = InWorker(), []

    def ask(request: dict[str, Any]) -> dict[str, Any]:
        asked.append(request["source"])
        raise error(said.removesuffix(", 3 times"))

    monkeypatch.setattr(estimator._worker, "ask", ask)
    row = taken(estimator, window())
    assert (row["status"], row["why"]) == ("failed", said)
    assert len(asked) == (3 if error is DeadWorkerError else 1)


@pytest.mark.slow
def test_a_worker_that_is_killed_is_started_again():
    estimator = InWorker()
    first = taken(estimator, window())
    process = estimator._worker._process
    assert process is not None
    process.kill()
    assert taken(estimator, window()) == first == taken(Here(), window())
    estimator.close()


def test_bits_of_a_window_reach_the_worker(monkeypatch: pytest.MonkeyPatch):
    sent: list[dict[str, Any]] = []
    estimator = InWorker()

    def ask(request: dict[str, Any]) -> dict[str, Any]:
        sent.append(request)
        return {"row": {"status": "ok"}, "seconds": 0.0, "spectra": []}

    monkeypatch.setattr(estimator._worker, "ask", ask)
    gathered = window()
    taken(estimator, gathered)
    assert gathered.record is not None
    values = np.frombuffer(b64decode(sent[0]["values"])).reshape(gathered.record.values.shape)
    assert values.tobytes() == gathered.record.values.tobytes()
    assert sent[0]["start"] == "2026-01-01T12:00:00Z"
