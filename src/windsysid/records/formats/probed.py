"""Read all of an HDF5 file and say nothing: what `windsysid.records.formats.probing` runs, free of windsysid."""

import contextlib
import sys
from typing import Any

__all__ = ["main"]

ROWS = 1 << 16


def main() -> None:
    """Read the file that the command line names, in so many seconds of processor time."""
    import h5py

    with contextlib.suppress(ImportError, ValueError, OSError):  # Windows has no such limit
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[2]), int(sys.argv[2]) + 1))
    with h5py.File(sys.argv[1], "r") as file:
        _walk(file, h5py, set())


def _walk(group: Any, h5py: Any, seen: set[Any]) -> None:
    with contextlib.suppress(Exception):
        _attributes(group)
    for name in group:
        with contextlib.suppress(Exception):
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            one = group[name]
            place = h5py.h5o.get_info(one.id).addr
            if place in seen:
                continue
            seen.add(place)
            if isinstance(one, h5py.Group):
                _walk(one, h5py, seen)
                continue
            _attributes(one)
            if isinstance(one, h5py.Dataset):
                if not one.shape:
                    one[()]
                else:
                    for low in range(0, one.shape[0], ROWS):
                        one[low : low + ROWS]


def _attributes(one: Any) -> None:
    for name in one.attrs:
        with contextlib.suppress(Exception):
            one.attrs[name]


if __name__ == "__main__":
    main()
