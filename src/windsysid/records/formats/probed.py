"""Read a file with a library in C under limits of time and memory: what `windsysid.records.formats.probing` runs.

It is free of windsysid, so that a fresh interpreter starts with little: ``probed.py LIBRARY PATH SECONDS BYTES``.
"""

import contextlib
import importlib
import itertools
import math
import sys
from collections.abc import Callable, Iterator
from typing import Any

__all__ = ["MAX_UNWRITTEN", "NEEDS_MEMORY", "main", "read", "unwritten"]

NEEDS_MEMORY = 3
"""Exit code of a process that asked for more memory than it may have."""

MAX_VALUES = 1 << 20
"""Values that are read at once."""

MAX_UNWRITTEN = 1 << 22
"""Values of an HDF5 file that were declared and never written; more of them cost memory for nothing."""

MAX_ROWS = 1000
"""Rows of each group of an MDF file whose values are converted; of the others only the time is read."""


def main() -> None:
    """Read the file of the command line."""
    library, path, seconds, size = sys.argv[1:]
    sys.exit(read(library, path, int(seconds), int(size)))


def read(library: str, path: str, seconds: int, size: int) -> int:
    """Read a file within so many seconds of processor time and, where `size` is not 0, bytes of memory.

    Returns
    -------
    int
        0, or 1 where the library raised an error, or `NEEDS_MEMORY`.
    """
    with contextlib.suppress(ImportError):
        importlib.import_module(library)
    _limit(seconds, size)
    try:
        _READERS[library](path)
    except MemoryError:
        return NEEDS_MEMORY
    except Exception:  # what Python says is said by whoever reads the file after this
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
            with _told():
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
    if dataset.is_virtual or dataset.external or unwritten(dataset) > MAX_UNWRITTEN:  # whoever reads the file says so
        return
    if not dataset.shape:
        dataset[()]
    else:
        for part in _blocks(dataset.shape, dataset.chunks):
            dataset[part]


def unwritten(dataset: Any) -> int:
    """Count the values of an HDF5 dataset that were declared and never written, where these are more than half."""
    declared = int(dataset.size or 0)
    if not declared or (dataset.chunks is None and dataset.id.get_storage_size()):
        return 0
    written = 0 if dataset.chunks is None else dataset.id.get_num_chunks() * math.prod(dataset.chunks)
    return declared - written if declared > 2 * written else 0


def _blocks(shape: tuple[int, ...], chunks: tuple[int, ...] | None) -> Iterator[tuple[slice, ...]]:
    """Parts of at most `MAX_VALUES` values, made of whole chunks, that fill a shape."""
    sizes = list(chunks or [1] * len(shape))
    for axis in reversed(range(len(shape))):
        sizes[axis] = min(shape[axis], sizes[axis] * max(1, MAX_VALUES // max(1, math.prod(sizes))))
    ranges = [range(0, length, max(1, size)) for length, size in zip(shape, sizes, strict=True)]
    for low in itertools.product(*ranges):
        yield tuple(slice(at, at + size) for at, size in zip(low, sizes, strict=True))


def _attributes(one: Any) -> None:
    for name in one.attrs:
        with _told():
            one.attrs[name]


def _mdf(path: str) -> None:
    """Follow all chains of an MDF file, and read the time and the first rows of each of its groups."""
    import logging
    import tempfile

    import asammdf  # type: ignore[import-untyped,unused-ignore]

    logging.disable(logging.CRITICAL)
    asammdf.blocks.mdf_v4.NamedTemporaryFile = tempfile.TemporaryFile  # has no name that could outlive this process
    with open(path, "rb") as stream:
        file = asammdf.MDF(stream)
        for number, group in enumerate(file.groups):
            with _told():
                file.get_master(number)
            with _told():
                wanted = [(None, number, index) for index in range(len(group.channels))]
                file.select(wanted, record_offset=0, record_count=MAX_ROWS, copy_master=False)


def _matlab(path: str) -> None:
    """Read the variables of a MATLAB file up to version 7 that windsysid would read, one after the other."""
    from scipy.io import loadmat, whosmat

    for name, _, kind in whosmat(path):
        if kind != "cell":
            with _told():
                loadmat(path, variable_names=[name], squeeze_me=True, struct_as_record=False)


@contextlib.contextmanager
def _told() -> Iterator[None]:
    """Go on after an error that whoever reads the file after this says, but not where memory is short."""
    try:
        yield
    except MemoryError:
        raise
    except Exception:
        pass


_READERS: dict[str, Callable[[str], None]] = {"h5py": _hdf5, "asammdf": _mdf, "scipy.io": _matlab}

if __name__ == "__main__":
    main()
