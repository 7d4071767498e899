"""Processing of a closed window: blocks to a record, record to a row, row to a result with levels and alarms."""

import json
import time
from collections.abc import Iterable
from typing import NamedTuple

from windsysid.fleet.rows import failed_row
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.limits import one_line
from windsysid.live.follower import Conclusion, Follower, WindowTask
from windsysid.live.store.contents import Result
from windsysid.live.windows.estimate import Estimated, Estimator, Here
from windsysid.live.windows.streams import Drift, drifts
from windsysid.live.windows.timeline import gather
from windsysid.records.moments import moment_text

__all__ = ["Read", "conclude", "estimate", "unpack"]


class Read(NamedTuple):
    """A window's estimate, counts of faults of its samples, and processor time of joining them [s]."""

    found: Estimated
    counts: dict[str, int]
    joining: float


def estimate(follower: Follower, task: WindowTask, blocks: Iterable[Block], estimator: Estimator) -> Read:
    """The estimate of a window's blocks."""
    begun = time.thread_time()
    source = f"{task.turbine} {moment_text(task.window, 0)}"
    followed = follower.followed
    try:
        gathered = gather(blocks, task.window, task.until, source)
    except Exception as error:  # a retry would fail as well, and would delay the windows that follow
        why = one_line(f"the window's blocks cannot be joined ({type(error).__name__}: {error})")
        failed = failed_row(source, 0, follower.settings, why)
        return Read(Estimated(failed, 0.0), {}, time.thread_time() - begun)
    joined = time.thread_time()
    found = estimator.take(gathered, source, followed.member, followed.formulation, follower.settings)
    sent = 0.0 if isinstance(estimator, Here) else time.thread_time() - joined
    counts = {
        "missing samples": gathered.missing, "repeated samples": gathered.repeated,
        "samples cut by a clock jump": gathered.cut,
    }  # fmt: skip
    return Read(found, counts, joined - begun + sent)


def conclude(follower: Follower, task: WindowTask, found: Estimated, now: int) -> Conclusion:
    """Let the turbine's watch take in the row of its next window."""
    row = found.row
    taken = follower.watching.take(row, task.window)
    means, verdicts = drifts(follower.means, row, task.window, task.until)
    checkpoint = _pack(means, taken.checkpoint)
    result = Result(task.turbine, task.window, task.until, now, row, taken.levels, checkpoint, found.spectra)
    return Conclusion(result, taken.alarms, means, verdicts)


def _pack(means: Drift, watch: bytes) -> bytes:
    """Checkpoint: the known means of the channels, and that of the watch."""
    head = json.dumps(means, sort_keys=True, allow_nan=False).encode()
    return len(head).to_bytes(4, "big") + head + watch


def unpack(checkpoint: bytes) -> tuple[Drift, bytes]:
    """The two parts of a result's checkpoint."""
    size = int.from_bytes(checkpoint[:4], "big")
    return json.loads(checkpoint[4 : 4 + size]), checkpoint[4 + size :]
