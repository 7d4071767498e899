"""Files that are heaps of named arrays, MATLAB's and HDF5's: which of them are channels.

A vector is a channel, and so is each column of a matrix, called ``name_1``, ``name_2`` … Along which axis of a matrix
the time runs follows from the length of the time; a file without one must have matrices that are ten times longer than
wide. Arrays of other lengths than the time's, and what is no number, are no channels: they are left out, and the
attribute ``left_out`` names them. One that the mapping lists must fit.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.contents.columns import Cell, is_called_time, name_and_unit
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, cell_of, source_of_series
from windsysid.records.formats.contents.source import FileSource
from windsysid.records.record import Array

__all__ = ["Stored", "rate_hint", "source_of_arrays"]

_LONGER = 10  # times longer than wide is a matrix whose long axis must be the time
_MOST = 4096  # columns of a matrix that are channels
_RATES = ("fs", "f_s", "rate", "sampling_rate", "samplingrate", "sample_rate", "samplerate", "fsample", "freq")
_SEPARATOR = re.compile(r"/(?![^\[\](){}]*[\])])")
"""The ``/`` between a group and what is in it; one in brackets belongs to a unit, as in ``acc [m/s^2]``."""
_HOW = "end the name in its unit, such as _m_s2"


@dataclass(frozen=True)
class Stored:
    """One array of a file.

    Attributes
    ----------
    path : str
        Its name with those of the groups or structures above, ``tower/acc``.
    shape : tuple of int
        Without the axes of length one.
    read : callable
        ``read(index)`` gives a part of it as float64; `index` has an entry for each axis of `shape`.
    numeric : bool
    unit : str or None
    """

    path: str
    shape: tuple[int, ...]
    read: Callable[[tuple[Any, ...]], Array]
    numeric: bool = True
    unit: str | None = None

    @property
    def name(self) -> str:
        """The last part of its path."""
        return self.parts[-1]

    @property
    def parts(self) -> list[str]:
        """The groups above it and its own name."""
        return _SEPARATOR.split(self.path)


def source_of_arrays(
    name: str, arrays: Sequence[Stored], mapping: Mapping, attributes: dict[str, str], hint: str = ""
) -> FileSource:
    """The source of a file that holds these arrays.

    Raises
    ------
    RecordError
        If it is ambiguous which array is the time or along which axis it runs, or the arrays are no record.
    ConfigurationError
        If the mapping lists an array that is not there.
    """
    counts = Counter(array.name for array in arrays)
    length = _length(arrays, mapping)
    series, left = [], []
    for array in arrays:
        short = array.name if counts[array.name] == 1 else "_".join(array.parts)
        parts = _fitting(_series(array, short, length, mapping), length, mapping)
        series += parts
        if not parts and array.shape:
            left.append(array.path)
    if not series:
        raise _no_channel(arrays)
    if left and not mapping.only_listed:
        attributes = {**attributes, "left_out": ", ".join(left)}
    return source_of_series(name, series, mapping, attributes, how=_HOW, hint=hint)


def _fitting(parts: list[FileSeries], length: int | None, mapping: Mapping) -> list[FileSeries]:
    """The channels of an array; none if it is not as long as the time and the mapping does not list it."""
    listed = any({one.cell.written, one.cell.name} & {*mapping.channels} for one in parts)  # not by a pattern
    return [one for one in parts if listed or length in (None, one.samples)]


def _no_channel(arrays: Sequence[Stored]) -> RecordError:
    matrix = next((one for one in arrays if one.numeric and len(one.shape) == 2 and 0 not in one.shape), None)
    if matrix is None:
        return RecordError(
            "holds no array of numbers that could be a channel; expected vectors (T,) or matrices (T, m)"
        )
    size = " by ".join(map(str, matrix.shape))
    return RecordError(
        f"'{matrix.path}' is {size}, which does not show the axis of the time: expected one at least {_LONGER} times"
        " the other; save the time as a vector next to it"
    )


def rate_hint(arrays: Sequence[Stored]) -> str:
    """Hint on the rate from a scalar ``fs`` or the like, for the message that a rate is missing; empty if none."""
    scalars = [one for one in arrays if not one.shape and one.numeric and one.name.lower() in _RATES]
    return "".join(f"the file says {one.path} = {float(one.read(())):g}" for one in scalars[:1])


def _length(arrays: Sequence[Stored], mapping: Mapping) -> int | None:
    """The number of samples, where an array is known to be the time."""
    wanted = mapping.time.column
    if mapping.time.rate is not None or isinstance(wanted, tuple):
        return None
    vectors = [array for array in arrays if len(array.shape) == 1 and array.numeric]
    if wanted is not None:
        found = [array for array in vectors if wanted in (array.path, array.name)]
    else:
        found = [array for array in vectors if is_called_time(name_and_unit(array.name).name)]
    return found[0].shape[0] if len(found) == 1 else None


def _series(array: Stored, short: str, length: int | None, mapping: Mapping) -> list[FileSeries]:
    """The channels that an array could be."""
    if not array.numeric or not array.shape or 0 in array.shape:
        if {array.path, short} & {*mapping.channels}:
            raise ConfigurationError(
                f"{mapping.place}: '{array.path}' is no array of numbers, expected a vector (T,); remove it there"
            )
        return []
    if len(array.shape) == 1:
        numbers = lambda low, high: array.read((slice(low, high),))  # noqa: E731 - as in the loop below
        return [FileSeries(cell_of(array.path, short, array.unit), array.shape[0], numbers)]
    axis = _time_axis(array, length) if len(array.shape) == 2 else None
    if axis is None:
        return []

    def column(k: int) -> Callable[[int, int], Array]:
        return lambda low, high: array.read((slice(low, high), k) if axis == 0 else (k, slice(low, high)))

    whole = cell_of(array.path, short, array.unit)
    cells = [
        Cell(f"{array.path}_{k}", f"{whole.name}_{k}", whole.unit)
        for k in range(1, 1 + min(array.shape[1 - axis], _MOST))
    ]
    return [FileSeries(cell, array.shape[axis], column(k)) for k, cell in enumerate(cells)]


def _time_axis(array: Stored, length: int | None) -> int | None:
    rows, columns = array.shape
    if length is not None:
        if rows == columns == length:
            raise RecordError(
                f"'{array.path}' is {rows} by {columns}, as long as the time both ways: samples or channels? Store each"
                " channel separately"
            )
        return 0 if rows == length else 1 if columns == length else None
    if max(rows, columns) >= _LONGER * min(rows, columns):
        return int(np.argmax(array.shape))
    return None
