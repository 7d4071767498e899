"""Dewesoft recordings, read by dwdatareader through Dewesoft's own library.

Only Dewesoft's software writes such files, so this reader is tested against the interface of dwdatareader and
against files that are none, not against a recording. Times are those that the library gives for each sample, in seconds
after the start of storing; channels of one rate are sampled together.
"""

import locale
from pathlib import Path
from typing import Any, NoReturn

from windsysid.errors import RecordError
from windsysid.records.formats.contents.format import Format, package
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, cell_of, source_of_series, utc
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.record import Array

__all__ = ["FORMAT"]


def open_dewesoft(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; its channels are read as far as they are needed."""
    library = package("dwdatareader", "Dewesoft files", "formats")
    languages = locale.setlocale(locale.LC_ALL)
    try:
        file = library.DWFile(str(path))
        channels = [(name, channel) for name, channel in file.items() if channel.array_size == 1]
        start = utc(1000 * round(1e6 * file.info.start_store_time.timestamp()))
        series = [_series(file, name, channel, start) for name, channel in channels if channel.number_of_samples]
    except Exception as error:
        _refuse(error)
    finally:  # Dewesoft's library sets its own, and Python would read and write ASCII from then on
        locale.setlocale(locale.LC_ALL, languages)
    if not series:
        raise RecordError("holds no channel with samples; expected at least one; record it again")
    return source_of_series(path.name, series, mapping, {"source": "Dewesoft"}, how="let Dewesoft write its unit")


def _series(file: Any, name: str, channel: Any, start: str) -> FileSeries:
    samples, rate = int(channel.number_of_samples), float(channel.sample_rate)

    def read(part: int, low: int, high: int) -> Array:
        assert file is not None  # the file stays open as long as somebody may read
        try:
            begin = low / rate if rate > 0.0 else None
            found = channel.scaled(T1=None if begin is None else begin + 0.5 / rate, count=high - low)
        except Exception as error:
            _refuse(error)
        both = found if rate > 0.0 else tuple(values[low:high] for values in found)
        return doubles(both[part])

    return FileSeries(
        cell_of(name, name, channel.unit),
        samples,
        lambda low, high: read(1, low, high),
        times=lambda: read(0, 0, samples),
        clock=f"{rate:g} Hz" if rate > 0.0 else name,
        start=start,
    )


def _refuse(error: Exception) -> NoReturn:
    if isinstance(error, RecordError | MemoryError):
        raise error
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    raise RecordError(f"cannot be read by Dewesoft's library ({reason}); export it from Dewesoft as MATLAB or HDF5")


FORMAT = Format("a Dewesoft recording", (".dxd", ".d7d", ".d7z", ".dxz"), open_dewesoft)
