"""MDF 4 of the ASAM, as automotive loggers write it, read by asammdf.

A file holds groups of channels, each with its own time; a record holds the channels of one group. Where a file has
several groups, the mapping lists channels of one. Values come with their conversions; samples that the logger marked as
invalid are missing. Times are seconds after the start in the header.
"""

import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import damaged, quiet, read_start, reading
from windsysid.records.formats.access.probing import probe
from windsysid.records.formats.contents.format import Format, package
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, cell_of, short_names, source_of_series, utc
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.moments import tidy
from windsysid.records.record import Array

__all__ = ["FORMAT"]

_MASTERS, _TIME = (2, 3), 1  # kinds of channels that are an axis, and the kind of axis that is the time
_STORED = (0, 2, 4)  # kinds of channels whose values stand in the rows
_SOME_INVALID = 2  # a flag: each row has a bit that says whether the value is valid
_FIRST_BLOCK = 64  # byte
_CHAINED = {
    b"HD": (0, 1, 2, 3, 4), b"DG": (0, 1, 2), b"CG": (0, 1), b"CN": (0, 1), b"CA": (0,), b"CH": (0, 1), b"FH": (0,),
    b"AT": (0,), b"EV": (0,), b"HL": (0,), b"DL": (0,), b"LD": (0,),
}  # fmt: skip
"""Links that form chains and trees, by kind of block: no block is part of two of them (ASAM MDF 4.2, chapter 5)."""
_MAX_COMPRESSION_RATIO = 1100  # zlib packs 1032 bytes into one at most


def open_mdf(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; its channels are read as far as they are needed."""
    start = read_start(path, 16)
    if start.startswith(b"UnFinMF"):
        raise RecordError("was not closed by its logger; finalise it with the logger's own software")
    if not start.startswith(b"MDF "):
        raise RecordError("is not MDF; give the file the ending of what it is, or export it again")
    if start[8:9] != b"4":
        raise RecordError(f"is MDF {start[8:16].decode('latin-1').strip()}, expected version 4; convert it")
    _follow(path)
    probe(path, "asammdf")
    file = _opened(path)
    with reading():
        paths, found = _channels(file, path.stat().st_size)
        names = short_names(paths)
        began = _start(file)
        series = [_series(file, group, index, *name, began) for (group, index), name in zip(found, names, strict=True)]
    if not series:
        raise RecordError("holds no channel with samples; expected at least one; record it again")

    def together(indices: Sequence[int], low: int, high: int) -> list[Array]:
        return _read(file, [found[i] for i in indices], low, high)

    how = "let the logger write its unit"
    return source_of_series(path.name, series, mapping, {"source": "MDF"}, how=how, together=together)


def _follow(path: Path) -> None:
    """Refuse a file with a cyclic chain of blocks, which asammdf would follow for ever."""
    seen: set[int] = set()
    left, size = [_FIRST_BLOCK], path.stat().st_size
    with path.open("rb") as file:
        while left:
            at = left.pop()
            file.seek(at)
            head = file.read(24)
            chained = _CHAINED.get(head[2:4], ()) if head.startswith(b"##") and len(head) == 24 else ()
            if not chained:
                continue
            if at in seen:
                raise RecordError(f"is damaged: a chain of blocks comes back to byte {at}; copy or export it again")
            seen.add(at)
            count = min(int.from_bytes(head[16:24], "little"), 1 + max(chained))
            links = file.read(8 * count)
            found = (int.from_bytes(links[8 * k : 8 * k + 8], "little") for k in chained)
            left += [link for link in found if 0 < link < size]


def _opened(path: Path) -> Any:
    asammdf = package("asammdf", "MDF files", "formats")
    stream = path.open("rb")  # of a name it makes a copy where the file is not finalised
    try:
        with quiet("asammdf"):
            file = asammdf.MDF(stream)
        weakref.finalize(file, stream.close)
        return file
    except Exception as error:
        stream.close()
        _silence(error)
        raise damaged(error) from error


def _silence(error: BaseException) -> None:
    """Keep a reader that failed half-way from failing again, with a traceback, where it is thrown away."""
    trace = error.__traceback__
    while trace is not None:
        half = trace.tb_frame.f_locals.get("self")
        if half is not None and hasattr(half, "_closed") and hasattr(half, "_tempfile"):
            half._closed = True
            half._tempfile.close()
        trace = trace.tb_next


def _channels(file: Any, size: int) -> tuple[list[tuple[str, str]], list[tuple[int, int]]]:
    """Group and name, and number of group and channel, of every channel that is no axis."""
    paths, found = [], []
    for number, group in enumerate(file.groups):
        about = group.channel_group
        needed = about.cycles_nr * max(1, about.samples_byte_nr)
        if needed > _MAX_COMPRESSION_RATIO * size:
            raise RecordError(f"is damaged: group {number} says {about.cycles_nr} samples, more than the file can hold")
        name = about.acq_name or f"group_{number}"
        for index, channel in enumerate(group.channels):
            _check_place(channel, about)
            if channel.channel_type not in _MASTERS and about.cycles_nr:
                paths.append((name, channel.name))
                found.append((number, index))
    return paths, found


def _check_place(channel: Any, group: Any) -> None:
    """Refuse a channel beyond its row: asammdf reads there whatever stands in memory, or dies."""
    if channel.channel_type not in _STORED:
        return
    bits = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
    marked = channel.flags & _SOME_INVALID
    if bits > 8 * group.samples_byte_nr or (marked and channel.pos_invalidation_bit >= 8 * group.invalidation_bytes_nr):
        raise RecordError(f"is damaged: channel '{channel.name}' lies outside its rows; copy or export it again")


def _start(file: Any) -> str | None:
    began = file.header.start_time
    if began.timestamp() == 0.0:
        return None
    if began.tzinfo is None:
        return tidy(began.isoformat())  # the logger's local time
    return utc(1000 * round(1e6 * began.timestamp()))


def _series(file: Any, group: int, index: int, written: str, name: str, start: str | None) -> FileSeries:
    channel = file.groups[group].channels[index]
    unit = channel.unit or (channel.conversion.unit if channel.conversion is not None else "")
    samples = int(file.groups[group].channel_group.cycles_nr)

    def times() -> Array:
        with reading(), quiet("asammdf"):
            return doubles(file.get_master(group))

    master = file.masters_db.get(group)
    timed = master is not None and file.groups[group].channels[master].sync_type == _TIME
    return FileSeries(
        cell_of(written, name, unit),
        samples,
        lambda low, high: _read(file, [(group, index)], low, high)[0],
        times=times if timed else None,
        clock=f"group {group}",
        start=start,
    )


def _read(file: Any, channels: list[tuple[int, int]], low: int, high: int) -> list[Array]:
    wanted = [(None, group, index) for group, index in channels]
    with reading(), quiet("asammdf"):
        signals = file.select(wanted, record_offset=low, record_count=high - low, copy_master=False)
    return [_numbers(signal) for signal in signals]


def _numbers(signal: Any) -> Array:
    if signal.samples.dtype.kind not in "fiub" or signal.samples.ndim != 1:
        raise RecordError(f"channel '{signal.name}' holds text or arrays, expected numbers; leave it out")
    values = doubles(signal.samples)
    invalid = signal.invalidation_bits
    return values if invalid is None else np.where(np.asarray(invalid, dtype=bool), np.nan, values)


FORMAT = Format("MDF", (".mf4", ".mdf"), open_mdf, begins=(b"MDF     ", b"UnFinMF "))
