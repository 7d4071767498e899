"""Bladed results: a header ``NAME.%nn`` in text, and its numbers in ``NAME.$nn``, text or binary.

The header says how many variables, stations and times there are (``DIMENS``), in this order, the variable running
fastest; and names and units in powers of force, length, time, angle … (``FL`` is N·m), which are SI. A variable at
several stations is one channel for each, ``Blade 1 Mx at 12.5``. Names are quoted or bare, and a list may continue
in the next lines. There must be as many numbers as the header declares. Names, axes and signs are Bladed's own; a
mapping turns them into windsysid's.

Source: Bladed user manual (DNV), appendix on output files.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import read_start
from windsysid.records.formats.contents.columns import Cell
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, TimeGrid, source_of_series, tidy_step
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.formats.text.text import decoded, plain_numbers
from windsysid.records.record import AS_WRITTEN, Array

__all__ = ["FORMAT"]

_UNITS = {
    "N": "-", "T": "s", "L": "m", "A": "rad", "F": "N", "M": "kg", "P": "W", "FL": "N*m", "V": "V", "I": "A",
    "L/T": "m/s", "L/TT": "m/s^2", "A/T": "rad/s", "A/TT": "rad/s^2", "F/L": "N/m", "F/LL": "Pa", "ML": "kg*m",
    "MLL": "kg*m^2", "1/T": "Hz", "A/L": "rad/m",
}  # fmt: skip
_KINDS = {"R*4": "<f4", "R*8": "<f8", "I*4": "<i4", "I*2": "<i2"}
_KEYWORDS = {
    "FILE", "ACCESS", "FORM", "RECL", "FORMAT", "CONTENT", "CONFIG", "NDIMENS", "DIMENS", "GENLAB", "VARIAB", "VARUNIT",
    "AXISLAB", "AXIUNIT", "AXIMETH", "AXIVAL", "AXITICK", "MIN", "STEP", "NVARS", "ULOADS",
}  # fmt: skip
"""Words that begin a line of a header; a line with another first word continues the list above."""
_SINGLE = 1.2e-7  # of the step: it was written from single precision
_MAX_HEADER_BYTES = 1 << 22  # bytes


@dataclass(frozen=True)
class _ResultHeader:
    """Header of a result: its lines (keyword, rest, whole line) in order, and the file with the numbers."""

    lines: tuple[tuple[str, str, str], ...]
    data: Path

    def all(self, key: str) -> list[str]:
        return [text for found, text, _ in self.lines if found == key]

    def listed(self, key: str, count: int) -> list[str]:
        """Words after a keyword, which are expected to be `count` and may continue in the lines below."""
        text = self.one(key)
        at = [found for found, *_ in self.lines].index(key)
        parts, number, is_open = [text], len(_words(text, count)), text.count("'") % 2 == 1
        for keyword, _, whole in self.lines[at + 1 :]:
            if not is_open and (keyword in _KEYWORDS or number >= count):
                break
            parts.append(whole)
            number += len(_words(whole, count))
            is_open ^= whole.count("'") % 2 == 1
        return _words(" ".join(parts), count)

    def one(self, key: str) -> str:
        found = self.all(key)
        if not found:
            raise RecordError(f"has no line {key} in its header; run the simulation or copy it again")
        return found[0]

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Numbers of variables, stations, where there are any, and times."""
        sizes = tuple(int(text) for text in self.one("DIMENS").split() if re.fullmatch(r"[0-9]{1,15}", text))
        if len(sizes) not in (2, 3) or str(len(sizes)) != self.one("NDIMENS").strip() or 0 in sizes:
            raise RecordError(f"has DIMENS '{self.one('DIMENS')[:40]}', expected variables, stations and times")
        return sizes

    @property
    def width(self) -> int:
        """Numbers at one time."""
        return math.prod(self.shape[:-1])

    @property
    def kind(self) -> str | None:
        """Of binary numbers, as NumPy spells it; None for text."""
        access, form = self.one("ACCESS").strip().upper(), self.one("FORMAT").strip().upper()
        if access == "S":
            return None
        if access != "D" or form not in _KINDS:
            raise RecordError(f"has ACCESS {access} and FORMAT {form}, expected S, or D with {', '.join(_KINDS)}")
        return _KINDS[form]


def open_bladed(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a pair of files by either; binary numbers are read as far as they are needed."""
    header = _read_header(path)
    samples, width, kind = header.shape[-1], header.width, header.kind
    size, table = header.data.stat().st_size, None
    if kind is None:
        numbers = plain_numbers(header.data.read_bytes())
        got, needed = numbers.size, samples * width
    else:
        got, needed = size, samples * width * np.dtype(kind).itemsize
    if got != needed:
        what = "numbers" if kind is None else "bytes"
        raise RecordError(
            f"is cut off or damaged: {samples} times of {width} numbers are {needed} {what}, {header.data.name} has"
            f" {got}; run the simulation or copy it again"
        )
    if kind is None:
        table = numbers.reshape(samples, width)

    def rows(low: int, high: int) -> Array:
        if table is not None:
            return table[low:high]
        with header.data.open("rb") as file:
            file.seek(low * width * np.dtype(kind).itemsize)
            return doubles(np.fromfile(file, kind, (high - low) * width)).reshape(high - low, width)

    def together(indices: Sequence[int], low: int, high: int) -> list[Array]:
        found = rows(low, high)
        return [np.ascontiguousarray(found[:, i]) for i in indices]

    grid = _grid(header)
    series = [
        FileSeries(cell, samples, lambda low, high, k=k: together([k], low, high)[0], grid)  # type: ignore[misc]
        for k, cell in enumerate(_cells(header))
    ]
    attributes = {"source": "Bladed", "description": header.one("GENLAB").strip(" '")}
    how = "let Bladed write its unit"
    return source_of_series(header.data.name, series, mapping, attributes, how=how, together=together)


def _read_header(path: Path) -> _ResultHeader:
    listing, data = (path.with_name(f"{path.stem}.{mark}{path.suffix[2:]}") for mark in "%$")
    for other in (listing, data):
        if not other.is_file():
            raise RecordError(f"has no {other.name} next to it, the rest of the Bladed result; copy it there too")
    text = decoded(read_start(listing, _MAX_HEADER_BYTES))
    lines = [tuple(line.split(None, 1)) for line in text.splitlines() if line.strip()]
    found = tuple((whole[0].upper(), whole[1] if len(whole) > 1 else "", " ".join(whole)) for whole in lines)
    if not found or found[0][0] != "FILE":
        raise RecordError(f"{listing.name} is not the header of a Bladed result; run the simulation or copy it again")
    return _ResultHeader(found, data)


def _cells(header: _ResultHeader) -> list[Cell]:
    count = header.shape[0]
    names, units = header.listed("VARIAB", count), header.listed("VARUNIT", count)
    if len(names) != header.shape[0] or len(units) != header.shape[0]:
        raise RecordError(
            f"names {len(names)} variables with {len(units)} units, expected {header.shape[0]}; it is damaged"
        )
    stations = _stations(header)
    return [
        Cell(f"{name}{station}", f"{name}{station}", _UNITS.get(unit, AS_WRITTEN + unit))
        for station in stations
        for name, unit in zip(names, units, strict=True)
    ]


def _stations(header: _ResultHeader) -> list[str]:
    """Suffixes of the names of variables, for each station."""
    if len(header.shape) == 2:
        return [""]
    key = next((key for key in ("AXITICK", "AXIVAL") if header.all(key)), None)
    found = [] if key is None else header.listed(key, header.shape[1])
    if len(found) != header.shape[1]:
        raise RecordError(f"names {len(found)} stations, expected {header.shape[1]} after DIMENS; it is damaged")
    return [
        f" at {float(text):g}" if re.fullmatch(r"[-+]?\d+\.?\d*([eE][-+]?\d+)?", text) else f" at {text}"
        for text in found
    ]


def _words(text: str, count: int) -> list[str]:
    """Split a list into names, quoted or bare; bare names contain blanks if there were more than `count` otherwise."""
    words = [quoted.strip() if bare is None else bare for quoted, bare in _split(r"[^\s']+", text)]
    if len(words) <= count:
        return words
    return [quoted.strip() if bare is None else bare.strip() for quoted, bare in _split(r"[^\s'][^']*", text)]


def _split(bare: str, text: str) -> list[tuple[str, str | None]]:
    return [(found[1] or "", found[2]) for found in re.finditer(rf"'([^']*)'|({bare})", text)]


def _grid(header: _ResultHeader) -> TimeGrid:
    try:
        first, step = float(header.all("MIN")[-1]), float(header.all("STEP")[-1])
        if not (math.isfinite(first) and math.isfinite(step)):
            raise ValueError
    except (IndexError, ValueError):
        raise RecordError(
            "has no numbers MIN and STEP of the time in its header; it is damaged; copy it again"
        ) from None
    labels = header.all("AXISLAB")
    if not labels or labels[-1].strip(" '").lower() != "time":
        raise RecordError("holds no results over time; expected a last axis 'Time'; choose another result")
    tidy = tidy_step(step, _SINGLE * step)
    return TimeGrid(first if first == 0.0 or tidy <= 0.0 else _near(first, tidy), tidy)


def _near(first: float, step: float) -> float:
    """The first time, on a multiple of the step where single precision cannot tell it from one."""
    count = first / step
    whole = step * round(count) if math.isfinite(count) else first
    return whole if abs(whole - first) <= _SINGLE * abs(first) else first


FORMAT = Format("Bladed results", (".%#", ".$#"), open_bladed)
