"""Traversal of an HDF5 file that refuses datasets whose values are not in the file.

Groups form a graph, in which 30 groups can have 2^30 paths, and the values of datasets may be in other files (external
storage, virtual datasets) or missing (declared, but never written). Each group is visited once, links to other files
are not followed, and such datasets are refused.
"""

from collections.abc import Iterator
from typing import Any

from windsysid.errors import RecordError
from windsysid.records.formats.access.probed import MAX_UNWRITTEN_VALUES, unwritten

__all__ = ["check_tree", "datasets"]

MAX_DEPTH = 100
"""Largest number of levels of groups; instruments write three or four."""


def datasets(file: Any) -> Iterator[tuple[str, Any]]:
    """Iterate over all datasets below a group with their paths, in the order of their names.

    Raises
    ------
    RecordError
        If values are in another file, or too many values were declared and never written.
    """
    missing = 0
    for path, item in _below(file, "", {_place(file)}, links=False):
        if item.is_virtual or item.external:
            raise RecordError(
                f"'{path}' has its values in another file, which is not read; copy them into this file (h5repack)"
            )
        missing += unwritten(item)
        if missing > MAX_UNWRITTEN_VALUES:
            raise RecordError(
                f"'{path}' declares {item.size} values, most of which were never written; copy or export the file again"
            )
        yield path, item


def check_tree(file: Any) -> None:
    """Refuse a file that has links to other files, or datasets that `datasets` refuses."""
    for path, _ in _below(file, "", {_place(file)}, links=True):
        raise RecordError(f"'{path}' is a link to another file, which is not followed; copy its content into this file")
    for _ in datasets(file):
        pass


def _below(group: Any, path: str, seen: set[Any], *, links: bool) -> Iterator[tuple[str, Any]]:
    """Iterate over paths and datasets below a group, or over paths and links to other files if `links`."""
    import h5py  # type: ignore[import-untyped,unused-ignore]

    if path.count("/") > MAX_DEPTH:
        raise RecordError(f"has groups in groups, more than {MAX_DEPTH} levels deep; export it again")
    for name in group:
        if name.startswith("#"):  # what MATLAB keeps for itself
            continue
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            if links and not isinstance(link, h5py.SoftLink):
                yield path + name, link
            continue
        item = group[name]
        if isinstance(item, h5py.Group):
            if _place(item) not in seen:
                seen.add(_place(item))
                yield from _below(item, f"{path}{name}/", seen, links=links)
        elif isinstance(item, h5py.Dataset) and not links:
            yield path + name, item


def _place(item: Any) -> Any:
    """Address of an object, which identifies it within open files."""
    import h5py  # type: ignore[import-untyped,unused-ignore]

    found = h5py.h5o.get_info(item.id)
    return found.fileno, found.addr
