r"""Universal files, data sets 58 (text) and 58b (binary): functions over time, as test software exports them.

A file is a row of data sets between lines ``    -1``. Here only functions over time are channels; spectra, geometry and
the rest are left out. The header of a set says how many values follow: a set that holds another number is refused. The
step of the time is written with six digits; of the steps that these can mean, the one with the shortest rate is taken
(1.95312E-02 s is 51.2 Hz).

Source: SDRC universal file format, data sets 58, 58b and 164 (sdrl.uc.edu/sdrl/referenceinfo/universalfileformats).
"""

import itertools
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, TimeGrid, cell_of, source_of_series, tidy_step
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.formats.text.text import decoded
from windsysid.records.record import Array
from windsysid.units import si_unit, to_si

__all__ = ["FORMAT"]

_MARK = b"    -1"
_HEADER = 11  # lines of a set 58 below its number
_MAX_HEADER_LINES = 1000
_TIME, _UNKNOWN = (17,), (0, 1)  # what the abscissa is
_SI = {8: "m", 9: "N", 11: "m/s", 12: "m/s^2", 13: "N"}  # what the ordinate is, in a file whose set 164 says SI
_AXES = {0: "", 1: "_x", 2: "_y", 3: "_z", 4: "_rx", 5: "_ry", 6: "_rz"}
_NOTHING = ("", "NONE")


@dataclass(frozen=True)
class _Set:
    """One data set 58, its numbers still in the file.

    Attributes
    ----------
    path, at, size
        The file, the first byte of the numbers and their bytes.
    kind : str
        Of binary numbers, as NumPy spells it; empty for text.
    header : tuple of str
        The eleven lines.
    """

    path: Path
    at: int
    size: int
    kind: str
    header: tuple[str, ...]

    def field(self, line: int, low: int, high: int) -> str:
        return self.header[line][low:high].strip()

    def number(self, line: int, low: int, high: int) -> float:
        text = self.field(line, low, high)
        try:
            value = float(text or 0)
            if not math.isfinite(value):
                raise ValueError
            return value
        except ValueError:
            raise RecordError(
                f"is damaged: '{text[:20]}' in a header of a set 58 is no number; export it again"
            ) from None

    @property
    def samples(self) -> int:
        return int(self.number(6, 10, 20))

    @property
    def wide(self) -> bool:
        return self.number(6, 0, 10) in (4, 6)

    @property
    def is_even(self) -> bool:
        return self.number(6, 20, 30) == 1

    @property
    def stride(self) -> int:
        """Numbers in the file for each sample."""
        return (1 if self.is_even else 2) + (self.number(6, 0, 10) in (5, 6))

    @property
    def is_over_time(self) -> bool:
        real = self.number(6, 0, 10) in (2, 4)
        return real and (self.number(7, 0, 10) in _TIME or (self.is_response and self.number(7, 0, 10) in _UNKNOWN))

    @property
    def is_response(self) -> bool:
        return self.number(5, 0, 5) in (0, 1)

    @cached_property
    def text(self) -> Array:
        """All numbers of a set in text, (samples,) or (2 samples,)."""
        widths = [13 if not self.wide else 20] if self.is_even or not self.wide else [13, 20]
        values = []
        with self.path.open("rb") as file:
            file.seek(self.at)
            lines = file.read(self.size).decode("latin-1").splitlines()
        for line in lines:
            column, end = 0, len(line.rstrip())
            for width in itertools.cycle(widths):
                if column >= end:
                    break
                values.append(_float(line[column : column + width]))
                column += width
        return np.array(values)

    def values(self, low: int, high: int, part: int = 1) -> Array:
        """Ordinates (part 1) or abscissas (part 0, only where uneven) low … high − 1."""
        stride = self.stride
        first, last = low * stride, high * stride
        if self.kind:
            size = np.dtype(self.kind).itemsize
            with self.path.open("rb") as file:
                file.seek(self.at + first * size)
                found = doubles(np.fromfile(file, self.kind, last - first))
        else:
            found = self.text[first:last]
        return found if stride == 1 else np.ascontiguousarray(found[part::2])


def open_uff(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; the numbers of binary sets are read where they are needed."""
    sets, left, system = [], [], 0
    with path.open("rb") as file:
        for number, one in _sets(path, file):
            if isinstance(one, int):
                system = one
            elif one is not None and one.is_over_time:
                sets.append(one)
            else:
                left.append(number)
    if not sets:
        raise RecordError(
            f"holds no function over time ({len(left)} other data sets); expected data sets 58 of time responses"
        )
    for one in sets:
        _check_size(one)
    names = _names(sets)
    series = [_series(one, name, system) for one, name in zip(sets, names, strict=True)]
    notes = {f"id{k}": sets[0].field(k - 1, 0, 80) for k in range(2, 6)}
    attributes = {key: text for key, text in notes.items() if text not in _NOTHING}
    if left:
        attributes["left_out"] = "data sets " + ", ".join(left)
    return source_of_series(path.name, series, mapping, attributes, how="give it the units label of its data set")


def _sets(path: Path, file: BinaryIO) -> Iterator[tuple[str, _Set | int | None]]:
    """Number and content of each data set: a set 58, the units' code of a set 164, None for others."""
    found = 0
    while line := file.readline():
        if not line.strip():
            continue
        if line.rstrip() != _MARK:
            where = f"a data set ends before byte {file.tell() - len(line)}" if found else "it does not begin with '-1'"
            raise RecordError(f"is no universal file or is damaged: {where}; export it again")
        number = file.readline().decode("latin-1").rstrip()
        kind = number[:7].strip().lower()
        found += 1
        if kind == "58b":
            yield kind, _binary(path, file, number)
        elif kind == "58":
            header = _lines(file, _HEADER)
            at = file.tell()
            yield kind, _Set(path, at, _to_mark(file) - at, "", header)
        else:
            first = file.readline()
            if first.rstrip() != _MARK:
                _to_mark(file)
            yield (
                kind or "without a number",
                int(first[:10]) if kind == "164" and first[:10].strip().isdigit() else None,
            )


def _binary(path: Path, file: BinaryIO, number: str) -> _Set:
    fields = [number[low:high].strip() for low, high in ((7, 13), (13, 19), (19, 31), (31, 43))]
    try:
        order, form, lines, size = (int(field) for field in fields)
    except ValueError:
        raise RecordError(
            f"is damaged: the line '{number[:50]}' of a set 58b has no lengths; export it again"
        ) from None
    if not _HEADER <= lines <= _MAX_HEADER_LINES:
        raise RecordError(f"is damaged: a set 58b declares {lines:g} header lines, expected {_HEADER}; export it again")
    if form != 2 or order not in (1, 2):
        raise RecordError(f"has numbers of byte order {order} and format {form}, expected IEEE (2); export it as text")
    header = _lines(file, lines)
    one = _Set(path, file.tell(), size, "?", header)
    kind = ("<" if order == 1 else ">") + ("f8" if one.wide else "f4")
    expected = one.stride * one.samples * np.dtype(kind).itemsize
    most = path.stat().st_size - one.at
    for length in dict.fromkeys((size, expected)):  # some software counts the bytes of complex numbers wrongly
        file.seek(one.at + min(max(length, 0), most))
        if 0 <= length <= most and _is_mark_near(file):
            return _Set(path, one.at, length, kind, header)
    raise RecordError("is cut off or damaged: the numbers of a set 58b are not as long as it says; export it again")


def _is_mark_near(file: BinaryIO) -> bool:
    """Test whether the next line that is not blank ends a set; the file is then behind it."""
    line = file.readline(128)
    if not line.strip():
        line = file.readline(128)
    return line.rstrip() == _MARK


def _lines(file: BinaryIO, count: int) -> tuple[str, ...]:
    found = [decoded(file.readline()) for _ in range(count)]
    if not found[-1]:
        raise RecordError("is cut off in the header of a set 58; copy or export it again")
    return tuple(line.rstrip("\r\n") for line in found)


def _to_mark(file: BinaryIO) -> int:
    """Position of the line that ends a set; the file is behind it."""
    while line := file.readline():
        if line.rstrip() == _MARK:
            return file.tell() - len(line)
    raise RecordError("is cut off: its last data set has no end; copy or export it again")


def _check_size(one: _Set) -> None:
    """Refuse a set whose header says another number of values than there are."""
    expected = one.samples * one.stride
    got = one.size // np.dtype(one.kind).itemsize if one.kind else one.text.size
    if expected != got or expected < 1:
        raise RecordError(
            f"a set 58 declares {one.samples:g} samples, expected {expected:g} numbers, got {got}; it is cut off or"
            " damaged; export it again"
        )


def _names(sets: list[_Set]) -> list[str]:
    """Names by the first line of each set where those tell them apart, otherwise by entity, node and direction."""
    titles = [one.field(0, 0, 80) for one in sets]
    if len({*titles}) == len(titles) and not any(title in _NOTHING for title in titles):
        return titles
    return [_point(one) for one in sets]


def _point(one: _Set) -> str:
    entity, direction = one.field(5, 31, 41), int(one.number(5, 51, 55))
    axis = _AXES.get(abs(direction), f"_{abs(direction)}")
    name = "point" if entity in _NOTHING else entity
    return f"{name}_{one.field(5, 41, 51) or 0}{'_minus' if direction < 0 else ''}{axis}"


def _series(one: _Set, name: str, system: int) -> FileSeries:
    label = one.field(8, 47, 67)
    unit = label if label.upper() not in _NOTHING else _SI.get(int(one.number(8, 0, 10))) if system == 1 else None
    cell = cell_of(name, name, unit)
    scale = _seconds(one.field(7, 47, 67))
    if one.is_even:
        grid = TimeGrid(one.number(6, 30, 43) * scale, _shortest(one.number(6, 43, 56)) * scale)
        return FileSeries(cell, one.samples, one.values, grid)

    def times() -> Array:
        return one.values(0, one.samples, 0) * scale

    clock = f"times {zlib.crc32(times().tobytes()):08x}"
    return FileSeries(cell, one.samples, one.values, times=times, clock=clock)


def _seconds(unit: str) -> float:
    if unit.upper() in _NOTHING:
        return 1.0
    try:
        if si_unit(unit) == "s":
            return to_si(1.0, unit)
    except ConfigurationError:
        pass
    raise RecordError(f"the time is in '{unit}', not in a unit of time; export it in s")


def _shortest(step: float) -> float:
    """The step that six digits mean."""
    return tidy_step(step, 0.500001 * 10.0 ** (np.floor(np.log10(step)) - 5)) if 0.0 < step < np.inf else step


def _float(cell: str) -> float:
    try:
        if "_" in cell:
            raise ValueError
        return float(cell.replace("D", "E").replace("d", "e"))
    except ValueError:
        raise RecordError(f"a set 58 holds '{cell[:20]}', expected a number; export it again") from None


FORMAT = Format("a universal file (UFF)", (".uff", ".unv", ".uf", ".bunv", ".ufb"), open_uff, begins=(_MARK,))
