"""Program that reads a file with a C library under limits of time and memory, for
`windsysid.records.formats.access.probing`.

It imports nothing from windsysid, so that a new interpreter starts fast: ``probed.py LIBRARY PATH SECONDS BYTES``.
"""

import contextlib
import importlib
import itertools
import math
import sys
from collections.abc import Callable, Iterator
from typing import Any

__all__ = ["MAX_UNWRITTEN_VALUES", "OUT_OF_MEMORY", "main", "read", "unwritten"]

OUT_OF_MEMORY = 3
"""Exit code of a process that exceeded its memory limit."""

MAX_VALUES = 1 << 20
"""Largest number of values that are read at a time."""

MAX_UNWRITTEN_VALUES = 1 << 22
"""Largest number of values of an HDF5 file that were declared and never written: each one takes memory when read."""

MAX_MDF_ROWS = 1000
"""Number of rows of each group of an MDF file whose values are converted; for the other rows only the time is read."""


def main() -> None:
    """Read the file of the command line."""
    library, path, seconds, size = sys.argv[1:]
    sys.exit(read(library, path, int(seconds), int(size)))


def read(library: str, path: str, seconds: int, size: int) -> int:
    """Read a file within limits of processor time [s] and, unless `size` is 0, of memory [bytes].

    Returns
    -------
    int
        Exit code: 0, 1 if the library raised an error, or `OUT_OF_MEMORY`.
    """
    with contextlib.suppress(ImportError):
        importlib.import_module(library)
    _limit(seconds, size)
    try:
        _READERS[library](path)
    except MemoryError:
        return OUT_OF_MEMORY
    except Exception:  # the process that reads the file next reports the error
        return 1
    return 0


def _limit(seconds: int, size: int) -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):  # Windows has no such limits
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        if size and sys.platform == "linux":
            with open("/proc/self/statm", encoding="ascii") as file:
                now = int(file.read().split()[0]) * resource.getpagesize()
            most = resource.getrlimit(resource.RLIMIT_AS)[1]
            wanted = now + size
            resource.setrlimit(resource.RLIMIT_AS, (wanted if most < 0 else min(wanted, most), most))


def _hdf5(path: str) -> None:
    """Read every attribute and dataset of an HDF5 file once."""
    import h5py  # type: ignore[import-untyped,unused-ignore]

    with h5py.File(path, "r") as file:
        _attributes(file)
        _walk(file, h5py, set())


def _walk(file: Any, h5py: Any, seen: set[Any]) -> None:
    groups = [file]
    while groups:
        group = groups.pop()
        for name in group:
            with _ignoring_errors():
                if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                    continue
                one = group[name]
                place = h5py.h5o.get_info(one.id).addr
                if place in seen:
                    continue
                seen.add(place)
                if isinstance(one, h5py.Group):
                    groups.append(one)
                _attributes(one)
                if isinstance(one, h5py.Dataset):
                    _values(one)


def _values(dataset: Any) -> None:
    if (
        dataset.is_virtual or dataset.external or unwritten(dataset) > MAX_UNWRITTEN_VALUES
    ):  # the reader of the file refuses it
        return
    if not dataset.shape:
        dataset[()]
    else:
        for part in _blocks(dataset.shape, dataset.chunks):
            dataset[part]


def unwritten(dataset: Any) -> int:
    """Number of values of an HDF5 dataset that were declared and never written; 0 if they are less than half."""
    declared = int(dataset.size or 0)
    if not declared or (dataset.chunks is None and dataset.id.get_storage_size()):
        return 0
    written = 0 if dataset.chunks is None else dataset.id.get_num_chunks() * math.prod(dataset.chunks)
    return declared - written if declared > 2 * written else 0


def _blocks(shape: tuple[int, ...], chunks: tuple[int, ...] | None) -> Iterator[tuple[slice, ...]]:
    """Partition a shape into blocks of whole chunks with at most `MAX_VALUES` values."""
    sizes = list(chunks or [1] * len(shape))
    for axis in reversed(range(len(shape))):
        sizes[axis] = min(shape[axis], sizes[axis] * max(1, MAX_VALUES // max(1, math.prod(sizes))))
    ranges = [range(0, length, max(1, size)) for length, size in zip(shape, sizes, strict=True)]
    for low in itertools.product(*ranges):
        yield tuple(slice(at, at + size) for at, size in zip(low, sizes, strict=True))


def _attributes(one: Any) -> None:
    for name in one.attrs:
        with _ignoring_errors():
            one.attrs[name]


def _mdf(path: str) -> None:
    """Follow all chains of an MDF file, and read the time and the first rows of each of its groups."""
    import logging
    import tempfile

    import asammdf  # type: ignore[import-untyped,unused-ignore]

    logging.disable(logging.CRITICAL)
    asammdf.blocks.mdf_v4.NamedTemporaryFile = tempfile.TemporaryFile  # it is deleted when this process ends
    with open(path, "rb") as stream:
        file = asammdf.MDF(stream)
        for number, group in enumerate(file.groups):
            with _ignoring_errors():
                file.get_master(number)
            with _ignoring_errors():
                wanted = [(None, number, index) for index in range(len(group.channels))]
                file.select(wanted, record_offset=0, record_count=MAX_MDF_ROWS, copy_master=False)


def _matlab(path: str) -> None:
    """Read the variables of a MATLAB file up to version 7 that windsysid would read, one after the other."""
    from scipy.io import loadmat, whosmat

    for name, _, kind in whosmat(path):
        if kind != "cell":
            with _ignoring_errors():
                loadmat(path, variable_names=[name], squeeze_me=True, struct_as_record=False)


@contextlib.contextmanager
def _ignoring_errors() -> Iterator[None]:
    """Ignore errors other than `MemoryError`: the process that reads the file next reports them."""
    try:
        yield
    except MemoryError:
        raise
    except Exception:
        pass


_READERS: dict[str, Callable[[str], None]] = {"h5py": _hdf5, "asammdf": _mdf, "scipy.io": _matlab}

if __name__ == "__main__":
    main()
