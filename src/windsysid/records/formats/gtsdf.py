"""DTU's general time series data format (GTSDF), an HDF5 layout that HAWC2 and measurement systems write.

The attribute ``type`` of the file names the format. Groups ``block0000`` … hold ``data`` (T, m) and, for integers,
``gains`` and ``offsets`` (m): value = gain × integer + offset, where the largest integer means a missing value. Times
are ``time_start + time_step`` × ``time``, or × the number of the row if there is no ``time``; a file without step and
times needs a mapping with its rate. Datasets ``attribute_names``, ``attribute_units`` and
``attribute_descriptions`` are those of the channels. Names, axes and signs are the program's own.

Source: ``gtsdf`` of DTU's wind energy toolbox (wetb), which reads and writes the format.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import reading
from windsysid.records.formats.contents.columns import Cell
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, source_of_series
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.formats.hawc2 import distinct_names, known_unit
from windsysid.records.record import Array

__all__ = ["TYPE", "source_of_blocks"]

TYPE = "General time series data format"
"""Beginning of the attribute ``type`` of such a file, in upper or lower case."""


class _Block(NamedTuple):
    """Consecutive rows: their data, unpacking and times."""

    data: Any
    gains: Array | None
    offsets: Array | None
    time: Array | None

    def rows(self, low: int, high: int) -> Array:
        """Unpacked values of the rows low … high − 1."""
        packed = self.data[low:high]
        values = doubles(packed)
        if packed.dtype.kind in "iu":
            values = np.where(packed == np.iinfo(packed.dtype).max, np.nan, values)
        with np.errstate(all="ignore"):  # the check of the rows reports infinity
            values = values if self.gains is None else values * self.gains
            return values if self.offsets is None else values + self.offsets


def source_of_blocks(
    name: str, about: dict[str, Any], found: dict[str, Any], groups: dict[str, dict[str, Any]], mapping: Mapping
) -> FileSource:
    """Make the source of a GTSDF file.

    Parameters
    ----------
    name : str
        Name of the record.
    about : dict
        Attributes of the file.
    found : dict
        Datasets of the file by path.
    groups : dict
        Attributes of its groups by name.
    mapping : Mapping

    Raises
    ------
    RecordError
        If blocks are missing or do not fit each other.
    """
    with reading():
        blocks = _blocks(about, found, groups)
        cells = _cells(found, blocks[0].data.shape[1])
    listed = [block.time for block in blocks if block.time is not None]
    times = partial(np.concatenate, listed) if len(listed) == len(blocks) else None
    ends = np.cumsum([len(block.data) for block in blocks])

    def rows(low: int, high: int) -> Array:
        parts = []
        for end, block in zip(ends.tolist(), blocks, strict=True):
            begin = end - len(block.data)
            if begin < high and end > low:
                parts.append(block.rows(max(low - begin, 0), min(high, end) - begin))
        return np.concatenate(parts)

    def together(indices: Sequence[int], low: int, high: int) -> list[Array]:
        table = rows(low, high)
        return [np.ascontiguousarray(table[:, columns[index]]) for index in indices]

    def column(k: int, low: int, high: int) -> Array:
        return np.ascontiguousarray(rows(low, high)[:, k])

    columns = [k for k, cell in enumerate(cells) if cell.name.lower() != "time"]
    series = [FileSeries(cells[k], int(ends[-1]), partial(column, k), times=times) for k in columns]
    if not series:
        raise RecordError("holds no channel but the time; expected at least one")
    texts = {key: str(about[key]) for key in ("name", "description") if about.get(key)}
    how = "write its unit into attribute_units"
    return source_of_series(name, series, mapping, {"source": "GTSDF", **texts}, how=how, together=together)


def _blocks(about: dict[str, Any], found: dict[str, Any], groups: dict[str, dict[str, Any]]) -> list[_Block]:
    numbers = range(min(int(about["no_blocks"]), 1 + len(groups)))
    blocks = [_block(found, name, groups.get(name, {})) for name in (f"block{number:04d}" for number in numbers)]
    if len({block.data.shape[1] for block in blocks}) != 1:
        raise RecordError("has blocks of different width, or none; it is damaged; copy or export it again")
    return blocks


def _block(found: dict[str, Any], name: str, about: dict[str, Any]) -> _Block:
    data = found.get(f"{name}/data")
    if data is None or len(data.shape) != 2 or data.dtype.kind not in "fiu":
        raise RecordError(f"has no table {name}/data, which its attribute no_blocks requires; copy or export it again")
    samples, width = data.shape
    gains, offsets = (_numbers(found.get(f"{name}/{key}"), width) for key in ("gains", "offsets"))
    counted = _numbers(found.get(f"{name}/time"), samples)
    if counted is None and "time_step" not in about:
        return _Block(data, gains, offsets, None)
    step, start = (float(np.squeeze(about.get(key, usual))) for key, usual in (("time_step", 1.0), ("time_start", 0.0)))
    time = np.arange(samples, dtype=np.float64) if counted is None else counted
    return _Block(data, gains, offsets, time * step + start)


def _numbers(dataset: Any, size: int) -> Array | None:
    """Read a vector of `size` numbers; None if there is no such dataset."""
    if dataset is None:
        return None
    values = doubles(dataset[()]).ravel()
    if values.size != size:
        raise RecordError(f"has {values.size} numbers in {dataset.name}, expected {size}; it is damaged; copy it again")
    return values


def _cells(found: dict[str, Any], width: int) -> list[Cell]:
    names, units, about = (_texts(found.get(f"attribute_{key}"), width) for key in ("names", "units", "descriptions"))
    full = [name or f"column_{k}" for k, name in enumerate(names, 1)]
    return [Cell(name, name, known_unit(unit)) for name, unit in zip(distinct_names(full, about), units, strict=True)]


def _texts(dataset: Any, width: int) -> list[str]:
    """Read one text per channel, empty if the file has none."""
    found = [] if dataset is None else np.ravel(dataset[()]).tolist()
    texts = [one.decode("utf-8", errors="replace") if isinstance(one, bytes) else str(one) for one in found]
    return [" ".join(text.split()) for text in (texts + [""] * width)[:width]]
