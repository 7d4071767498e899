"""OpenFAST's packed binary output, ``.outb``, read where it is needed.

A header says how many channels and samples follow, then come int16 rows with one scale and offset per channel
(float64 rows in format 3; formats 1 has packed times before the rows). A row is as long as any other, so the rows of
a section are one piece of the file. Bytes after the counted rows come from a longer file that was overwritten: they
are left out, and the attribute ``left_over`` reports them. The numbers are those that openfast_io reads
(tests/records/formats).
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.contents.source import doubles
from windsysid.records.formats.text.text import decoded
from windsysid.records.record import Array

__all__ = ["PackedOutput", "open_packed"]


@dataclass(frozen=True)
class PackedOutput:
    """An ``.outb`` file whose header has been read.

    Attributes
    ----------
    path : Path
    names, units : tuple of str
        Of every channel, the time first; units without brackets.
    description : str
    samples : int
    start, step : float
        First time [s] and step [s]; NaN in format 1, which has `packed_times`.
    packed_times : (samples,) array or None
        Times [s] of format 1.
    scale, offset : (m,) array
        value = (packed − offset)/scale.
    at : int
        Position of the first row.
    wide : bool
        Whether rows are float64 and not packed.
    behind : int
        Number of bytes after the counted rows, which are not read.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    description: str
    samples: int
    start: float
    step: float
    packed_times: Array | None
    scale: Array
    offset: Array
    at: int
    wide: bool
    behind: int = 0

    def time(self, low: int, high: int) -> Array:
        """Times [s] of the rows low … high − 1, as the file has them."""
        if self.packed_times is not None:
            return self.packed_times[low:high]
        return np.asarray(self.start + self.step * np.arange(low, high))

    def rows(self, low: int, high: int) -> Array:
        """Values of the rows low … high − 1, (high − low, m)."""
        kind, channels = ("<f8" if self.wide else "<i2"), len(self.names) - 1
        with self.path.open("rb") as file:
            file.seek(self.at + low * channels * np.dtype(kind).itemsize)
            packed = np.fromfile(file, dtype=kind, count=(high - low) * channels)
        if packed.size != (high - low) * channels:
            raise RecordError("became shorter while it was read; read it when the simulation has ended")
        table = packed.reshape(high - low, channels).astype(np.float64)
        if self.wide:
            return table
        with np.errstate(all="ignore"):  # infinity is named by whoever checks the rows
            return np.asarray((table - self.offset) / self.scale)

    @property
    def notes(self) -> dict[str, str]:
        """Remarks on the file, as attributes of its record."""
        if not self.behind:
            return {}
        return {
            "left_over": f"{self.behind} bytes after the {self.samples} counted samples are not read; the file may"
            " have overwritten a longer one"
        }

    def place(self, row: int) -> str:
        """Name of a row in messages."""
        return f"sample {row}"


def open_packed(path: Path) -> PackedOutput:
    """Read the header and hold it against the size of the file.

    Raises
    ------
    RecordError
        If the header is invalid, or the file is shorter than it requires.
    """
    with path.open("rb") as file:
        head = _head(file)
        description, behind = _description_size(file, head, path.stat().st_size)
        file.seek(head.at)
        first, second = struct.unpack("<dd", file.read(16))
        scale, offset = _scales(file, head)
        file.seek(4, 1)
        text = decoded(file.read(description)).strip()
        names, units = (_texts(file.read(head.names_size), head.width) for _ in range(2))
        times, start, step = None, first, second
        if head.kind == 1:
            with np.errstate(all="ignore"):
                times = (np.fromfile(file, "<i4", head.samples) - second) / first
            start = step = np.nan
        return PackedOutput(
            path, names, tuple(unit[1:-1] for unit in units), text, head.samples, start, step, times,
            doubles(scale), doubles(offset), file.tell(), head.kind == 3, behind,
        )  # fmt: skip


class _PackedHead(NamedTuple):
    """Format, characters of a name, numbers of channels and samples, and position of the rest."""

    kind: int
    width: int
    channels: int
    samples: int
    at: int

    @property
    def names_size(self) -> int:
        """Bytes of all names, and of all units."""
        return self.width * (self.channels + 1)

    @property
    def row(self) -> int:
        """Bytes of a row, with its time in format 1."""
        return self.channels * (8 if self.kind == 3 else 2) + (4 if self.kind == 1 else 0)


def _head(file: BinaryIO) -> _PackedHead:
    data = file.read(12)
    (kind,) = struct.unpack_from("<h", data) if len(data) == 12 else (0,)
    if kind not in (1, 2, 3, 4):
        raise _rubbish()
    width, at = (struct.unpack_from("<h", data, 2)[0], 4) if kind == 4 else (10, 2)
    channels, samples = struct.unpack_from("<ii", data, at)
    if width <= 0 or channels <= 0 or samples < 0:
        raise _rubbish()
    return _PackedHead(kind, width, channels, samples, at + 8)


def _rubbish() -> RecordError:
    return RecordError("is not OpenFAST binary output; give the file the ending of what it is")


def _description_size(file: BinaryIO, head: _PackedHead, size: int) -> tuple[int, int]:
    """Numbers of bytes of the description, and after the counted rows; RecordError if the file is too short."""
    fixed = head.at + 16 + (0 if head.kind == 3 else 8 * head.channels)  # two numbers for the time, scales
    needed, description = fixed + 4 + 2 * head.names_size + head.samples * head.row, 0
    if size >= fixed + 4:
        file.seek(fixed)
        (description,) = struct.unpack("<i", file.read(4))
        if description < 0:
            raise _rubbish()
    if size < needed + description:
        raise RecordError(
            f"is cut off: {head.samples} samples of {head.channels} channels need {needed + description} bytes, got"
            f" {size}; run the simulation or copy the file again"
        )
    return description, size - needed - description


def _scales(file: BinaryIO, head: _PackedHead) -> tuple[Array, Array]:
    if head.kind == 3:
        return np.ones(head.channels), np.ones(head.channels)
    scale, offset = np.fromfile(file, "<f4", head.channels), np.fromfile(file, "<f4", head.channels)
    if not (np.isfinite(scale).all() and np.isfinite(offset).all()):
        raise RecordError("has a channel whose scale is not a number; run the simulation or copy the file again")
    return scale, offset


def _texts(cells: bytes, width: int) -> tuple[str, ...]:
    return tuple(decoded(cells[i : i + width]).strip() for i in range(0, len(cells), width))
