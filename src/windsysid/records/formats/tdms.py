"""NI TDMS, as LabVIEW and FlexLogger write it, read by nptdms.

A file is a chain of segments; each says how long it is. nptdms reads what is left of a file that was cut, with channels
of unequal length, and only warns. So the chain is followed here first: it must end where the file does, and hold as
many bytes of numbers as the channels need. An index file next to the data (``.tdms_index``) is not used: it may be
older than the data.

The clock is the waveform's: ``wf_increment``, ``wf_start_offset`` and ``wf_start_time`` (UTC). Without them a channel
of timestamps, or one called ``time``, is the time.
"""

import struct
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import damaged, quiet, reading
from windsysid.records.formats.contents.columns import Cell
from windsysid.records.formats.contents.format import Format, package
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, TimeGrid, cell_of, short_names, source_of_series, utc
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.formats.time.clock import Moments
from windsysid.records.record import RATE_DOUBT, Array

__all__ = ["FORMAT"]

_LEAD = 28  # bytes
_BIG_ENDIAN, _DAQMX = 1 << 6, 1 << 7  # flags of a segment
_VERSIONS, _FLAGS = (4712, 4713), 0b1111_1110
_OPEN_END = 0xFFFFFFFFFFFFFFFF  # the length of a segment that LabVIEW had not finished

_DEFAULT_RATE = (
    "the file gives 1 Hz, LabVIEW's default where no rate was set: check it; if it is wrong, every frequency is; set"
    " wf_increment [s] in the file"
)


def open_tdms(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; its channels are read as far as they are needed."""
    numbers, plain = _follow(path)
    nptdms = package("nptdms", "NI TDMS files", "formats")
    stream = path.open("rb")  # a file without a name has no index file
    try:
        with quiet("nptdms"):
            file = nptdms.TdmsFile.open(stream)
        channels = [channel for group in file.groups() for channel in group.channels() if len(channel)]
        attributes = {str(key): str(value) for key, value in file.properties.items()}
        if mapping.time.column is None and {channel.properties.get("wf_increment") for channel in channels} == {1.0}:
            attributes[RATE_DOUBT] = _DEFAULT_RATE
        _check_sizes(channels, numbers, plain)
        names = short_names([(channel.group_name, channel.name) for channel in channels])
        series = [_series(channel, *name) for channel, name in zip(channels, names, strict=True)]
        if not series:
            raise RecordError("holds no channel with samples; expected at least one; record it again")
        how = "set the channel's property unit_string"
        source = source_of_series(path.name, series, mapping, attributes, how=how)
    except Exception as error:
        stream.close()
        raise damaged(error) from error
    weakref.finalize(source, stream.close)
    return source


def _check_sizes(channels: list[Any], numbers: int, plain: bool) -> None:
    """Refuse channels that need another number of bytes than the segments have, or more of them."""
    needed = sum(len(channel) * (channel.data_type.size or 0) for channel in channels)
    if plain and all(channel.data_type.size for channel in channels) and needed != numbers:
        raise RecordError(
            f"is damaged: its channels need {needed} bytes of numbers, its segments have {numbers}; copy it again"
        )
    for channel in channels:
        if len(channel) > numbers:  # in all kinds of data a value takes at least a byte
            raise RecordError(
                f"is damaged: channel '{channel.name}' declares {len(channel)} values in {numbers} bytes; copy it again"
            )


def _follow(path: Path) -> tuple[int, bool]:
    """Bytes of numbers in all segments, and whether none of them is of DAQmx's own kind.

    Raises
    ------
    RecordError
        If the chain of segments does not end with the file.
    """
    size, at, numbers, plain = path.stat().st_size, 0, 0, True
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            lead = file.read(_LEAD)
            if not lead.startswith(b"TDSm"):
                raise RecordError(
                    f"is damaged: no segment begins at byte {at}; copy it again"
                    if at
                    else "is not NI TDMS; give the file the ending of what it is, or export it again"
                )
            if len(lead) < _LEAD:
                raise RecordError(f"is cut off: the segment at byte {at} has no length; copy it again")
            (flags,) = struct.unpack_from("<I", lead, 4)
            version, length, before = struct.unpack_from(">IQQ" if flags & _BIG_ENDIAN else "<IQQ", lead, 8)
            if length == _OPEN_END or at + _LEAD + length > size:
                raise RecordError(
                    f"is cut off: the last segment, at byte {at}, is not whole, its channels end at different times;"
                    " copy it again, or let LabVIEW defragment it"
                )
            if before > length or version not in _VERSIONS or flags & ~_FLAGS:
                raise RecordError(f"is damaged: the segment at byte {at} has a wrong header; copy it again")
            numbers, plain = numbers + length - before, plain and not flags & _DAQMX
            at += _LEAD + length
    return numbers, plain


def _series(channel: Any, written: str, name: str) -> FileSeries:
    properties = channel.properties
    unit = properties.get("unit_string") or properties.get("NI_UnitDescription")
    cell = cell_of(written, name, None if unit is None else str(unit))
    if channel.dtype.kind == "M":
        return FileSeries(Cell(written, name), len(channel), _no_numbers(name), moments=lambda: _moments(channel))

    def numbers(low: int, high: int) -> Array:
        with reading():
            values = channel[low:high]
        if values.dtype.kind not in "fiub":
            raise RecordError(f"channel '{name}' holds text, expected numbers; leave it out of the mapping file")
        return doubles(values)

    return FileSeries(cell, len(channel), numbers, _grid(properties))


def _no_numbers(name: str) -> Any:
    def numbers(low: int, high: int) -> Array:
        raise RecordError(
            f"channel '{name}' holds moments; name it as the time in the mapping file ([time] column), or leave it out"
        )

    return numbers


def _moments(channel: Any) -> Moments:
    with reading():
        return np.asarray(channel[:], dtype="datetime64[ns]").astype(np.int64)


def _grid(properties: Any) -> TimeGrid | None:
    step = float(properties.get("wf_increment", 0.0))
    if not 0.0 < step < np.inf:
        return None
    began = properties.get("wf_start_time")
    start = None
    if began is not None and np.datetime64(began) > np.datetime64("1904-01-02"):  # LabVIEW's zero means not known
        start = utc(1000 * round(int(np.datetime64(began, "ns").astype(np.int64)) / 1000))  # fractions of 2^-64 s
    return TimeGrid(float(properties.get("wf_start_offset", 0.0)), step, start)


FORMAT = Format("NI TDMS", (".tdms",), open_tdms, begins=(b"TDSm",))
