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

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.source import doubles
from windsysid.records.formats.text import decoded
from windsysid.records.record import Array

__all__ = ["Packed", "open_packed"]


@dataclass(frozen=True)
class Packed:
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


def open_packed(path: Path) -> Packed:
    """Read the header and hold it against the size of the file.

    Raises
    ------
    RecordError
        If the header is invalid, or the file is shorter than it requires.
    """
    size = path.stat().st_size
    rubbish = RecordError("is not OpenFAST binary output; give the file the ending of what it is")
    with path.open("rb") as file:
        head = file.read(12)
        if len(head) < 12:
            raise rubbish
        (kind,) = struct.unpack_from("<h", head)
        if kind not in (1, 2, 3, 4):
            raise rubbish
        width, at = (struct.unpack_from("<h", head, 2)[0], 4) if kind == 4 else (10, 2)
        channels, samples = struct.unpack_from("<ii", head, at)
        if width <= 0 or channels <= 0 or samples < 0:
            raise rubbish
        fixed = at + 8 + 16 + (0 if kind == 3 else 8 * channels)  # two counts, two numbers for the time, scales
        row = channels * (8 if kind == 3 else 2) + (4 if kind == 1 else 0)
        names_size = width * (channels + 1)
        needed = fixed + 4 + 2 * names_size + samples * row
        if size >= fixed + 4:
            file.seek(fixed)
            (description_size,) = struct.unpack("<i", file.read(4))
            if description_size < 0:
                raise rubbish
            needed += description_size
        if size < needed:
            raise RecordError(
                f"is cut off: {samples} samples of {channels} channels need {needed} bytes, got {size}; run the"
                " simulation or copy the file again"
            )
        file.seek(at + 8)
        first, second = struct.unpack("<dd", file.read(16))
        scale = offset = np.ones(channels)
        if kind != 3:
            scale, offset = np.fromfile(file, "<f4", channels), np.fromfile(file, "<f4", channels)
            if not (np.isfinite(scale).all() and np.isfinite(offset).all()):
                raise RecordError(
                    "has a channel whose scale is not a number; run the simulation or copy the file again"
                )
        file.seek(fixed + 4)
        description = decoded(file.read(description_size)).strip()
        names, units = (_texts(file.read(names_size), width) for _ in range(2))
        times = None
        if kind == 1:
            with np.errstate(all="ignore"):
                times = (np.fromfile(file, "<i4", samples) - second) / first
        start, step = (np.nan, np.nan) if kind == 1 else (first, second)
        return Packed(
            path, names, tuple(unit[1:-1] for unit in units), description, samples, start, step, times,
            doubles(scale), doubles(offset), file.tell(), kind == 3, size - needed,
        )  # fmt: skip


def _texts(cells: bytes, width: int) -> tuple[str, ...]:
    return tuple(decoded(cells[i : i + width]).strip() for i in range(0, len(cells), width))
