"""Samples for filters, block by block, repeatedly: from memory, or from a file on disk.

A search for the mode looks at all samples several times. A record that fits into memory is one block. A record that
does not is written, as it comes, to a file that has no name and ends with the process, and is read back in blocks of
one length: what is computed does not depend on how the record was cut.
"""

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np

from windsysid._types import Array
from windsysid.output.files import explain_errors

__all__ = ["Block", "Samples", "SamplesOnDisk", "split_evenly"]

Block = tuple[Array, Array]
"""Inputs (T, n_u + n_w) and readings (T, m) of consecutive samples."""

Samples = Iterable[Block]
"""Blocks in order, the same each time: a list of blocks, or `SamplesOnDisk`."""

MAX_BLOCK_SAMPLES = 100_000
"""Setting: samples read back at once, which bound memory, and innovations that are judged together."""


def split_evenly(count: int, every: int = 1) -> list[slice]:
    """As few parts of at most `MAX_BLOCK_SAMPLES` samples as there can be, all but equally long, that begin at
    multiples of `every`."""
    parts = max(-(-count // MAX_BLOCK_SAMPLES), 1)
    edges = [round(i * count / parts) // every * every for i in range(parts)] + [count]
    return [slice(first, last) for first, last in pairwise(edges)]


class SamplesOnDisk:
    """Samples that are held on disk.

    Parameters
    ----------
    columns
        Numbers of inputs and of readings.
    folder
        Where there is room: 8 bytes for every number. The system's folder for temporary files by default.
    every
        Blocks begin at multiples of it.
    """

    def __init__(self, columns: tuple[int, int], folder: Path | None = None, *, every: int = 1) -> None:
        self.columns, self.count, self.every = columns, 0, every
        self._folder = folder
        with self._explain_errors():
            self._file: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 (closed with this object)

    def append(self, inputs: Array, readings: Array) -> None:
        """Write the next samples: inputs (T, n_u + n_w) and readings (T, m); OutputError where the disk is full."""
        with self._explain_errors():
            self._file.seek(0, 2)
            self._file.write(np.ascontiguousarray(np.hstack([inputs, readings]), dtype=np.float64).tobytes())
            self._file.flush()
        self.count += len(inputs)

    def rows(self, first: int, last: int) -> Block:
        """Inputs and readings of the samples from `first` to before `last`."""
        width, split = sum(self.columns), self.columns[0]
        self._file.seek(8 * width * first)
        last = min(last, self.count)
        raw = self._file.read(8 * width * (last - first))
        table = np.frombuffer(raw, dtype=np.float64).reshape(last - first, width)
        return table[:, :split].copy(), table[:, split:].copy()

    def __iter__(self) -> Iterator[Block]:
        for part in split_evenly(self.count, self.every):
            yield self.rows(part.start, part.stop)

    def close(self) -> None:
        """Give the space on disk back."""
        self._file.close()

    def _explain_errors(self) -> AbstractContextManager[None]:
        where = self._folder or Path(tempfile.gettempdir())
        return explain_errors(f"samples in {where}", "choose an output on a disk with more space, or set TMPDIR")
