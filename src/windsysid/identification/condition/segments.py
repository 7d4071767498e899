"""Segments of a record, each checked against those before it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from windsysid.errors import RecordError
from windsysid.inspection.fault import Fault
from windsysid.inspection.limits import MAX_RATE_MISMATCH
from windsysid.inspection.screening import screen
from windsysid.records.record import Record

__all__ = ["SegmentReader", "require_alike", "steps_after"]


class SegmentReader:
    """The segments of a record on uniform grids, one for a `whole` record; what is left out between them is missing
    where they are `continuous`. It knows the first segment and the last, how many samples were read, and faults."""

    first: Record
    last: Record

    def __init__(self, record: Record | Iterable[Record], channels: Sequence[str], *, continuous: bool) -> None:
        self.whole, self.samples, self.faults = isinstance(record, Record), 0, list[Fault]()
        self._segments = [record] if isinstance(record, Record) else record
        self._channels, self._continuous = channels, continuous

    def __iter__(self) -> Iterator[Record]:
        """Read segment by segment; RecordError where there is none, the first is refused (`screen`), or another does
        not fit to it."""
        for segment in self._segments:
            part, first = segment.on_uniform_grid(), not self.samples
            if first:
                self.first = part
            else:
                require_alike(part, self.first.rate, self._channels)
                part = _with_samples_missing_before(self.last, part) if self._continuous else part
            self.faults += screen(segment, None, self._channels, refuse=first)
            self.last, self.samples = part, self.samples + part.samples
            yield part
        if not self.samples:
            raise RecordError("no pieces: expected at least one, got an empty record")


def require_alike(segment: Record, rate: float, channels: Sequence[str] = ()) -> None:
    """Refuse a segment of another rate than that of the first [Hz], or without its channels."""
    if abs(segment.rate / rate - 1.0) > MAX_RATE_MISMATCH:
        raise RecordError(f"{segment.name}: expected pieces of {rate:.6g} Hz, got one of {segment.rate:.6g} Hz")
    missing = [channel for channel in channels if channel not in segment]
    if missing:
        raise RecordError(f"{segment.name}: expected the channels of the first piece, got none of {', '.join(missing)}")


def steps_after(before: Record, segment: Record, rate: float) -> int:
    """Steps from the last sample before a segment to its first one; RecordError where it does not follow."""
    steps = round((segment.time[0] - before.time[-1]) * rate)
    if steps < 1:
        raise RecordError(f"{segment.name}: expected a piece that begins after the one before, got an overlap")
    return int(steps)


def _with_samples_missing_before(before: Record, segment: Record) -> Record:
    steps = steps_after(before, segment, before.rate)
    between = segment.time[0] - np.arange(steps - 1, 0, -1) / before.rate
    nothing = np.full((steps - 1, len(segment.channels)), np.nan)
    time, values = np.concatenate([between, segment.time]), np.vstack([nothing, segment.values])
    return replace(segment, time=time, values=values)
