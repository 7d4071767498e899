"""Records in an object store, called by their addresses: ``s3://bucket/folder/file.parquet``.

Readers need files, so that each object is copied to a folder of its own when its turn comes, and the copy goes with it.
pyarrow opens the store (s3, gs, abfs, hdfs), by the environment of its own tools: ``AWS_ACCESS_KEY_ID``,
``AWS_DEFAULT_REGION``, ``AWS_ENDPOINT_URL`` … .
"""

import fnmatch
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

from windsysid.errors import ConfigurationError
from windsysid.records.formats import FORMATS
from windsysid.records.formats.contents.format import package

__all__ = ["fetched", "is_remote", "list_remote", "size_of"]


def is_remote(source: str | Path) -> bool:
    """Test whether a source is an address, and no path."""
    return isinstance(source, str) and re.match(r"[a-z][a-z0-9+]+://", source) is not None


def list_remote(source: str) -> list[str]:
    """Addresses of the objects of a source: itself, all below it, or those that match its pattern of * or ?.

    ``*`` takes slashes too. Hidden ones and endings of no format are left out.

    Raises
    ------
    ConfigurationError
        If the store cannot be reached.
    """
    scheme, path = source.split("://", 1)
    fixed = re.split(r"[*?\[]", path)[0]
    folder, pattern = (path.rstrip("/"), "*") if fixed == path else (fixed.rpartition("/")[0], path)
    try:
        store = _store(scheme, path.split("/")[0])
        fs = package("pyarrow.fs", "object stores", "fleet")
        if fixed == path and store.get_file_info(folder).type == fs.FileType.File:
            return [source]
        listed = store.get_file_info(fs.FileSelector(folder, recursive=True, allow_not_found=True))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"source {source}: cannot be reached ({_short(error)})") from None
    found = [one.path for one in listed if one.is_file and _is_record(PurePosixPath(one.path), folder)]
    return sorted(f"{scheme}://{name}" for name in found if fnmatch.fnmatchcase(name, pattern))


def _is_record(path: PurePosixPath, folder: str) -> bool:
    """Test whether an object below a folder is not hidden and has the ending of a format."""
    hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    return not hidden and any(one.is_named(Path(path)) for one in FORMATS)


def size_of(source: str) -> int:
    """Bytes of a record's file, or of its object.

    Raises
    ------
    OSError
        If it is not there.
    """
    if not is_remote(source):
        return Path(source).stat().st_size
    scheme, path = source.split("://", 1)
    size = _store(scheme, path.split("/")[0]).get_file_info(path).size
    if size is None:
        raise FileNotFoundError(f"{source}: no such object")
    return int(size)


@contextmanager
def fetched(source: str) -> Iterator[Path]:
    """The file of a record: itself, or a copy of the object for as long as it is needed.

    Raises
    ------
    OSError
        If it cannot be copied.
    """
    if not is_remote(source):
        yield Path(source)
        return
    scheme, path = source.split("://", 1)
    store = _store(scheme, path.split("/")[0])
    with tempfile.TemporaryDirectory(prefix="windsysid-") as folder:
        copy = Path(folder) / PurePosixPath(path).name
        with store.open_input_stream(path) as stream, copy.open("wb") as file:
            while block := stream.read(1 << 22):
                file.write(block)
        yield copy


@cache
def _store(scheme: str, bucket: str) -> Any:
    fs = package("pyarrow.fs", "object stores", "fleet")
    return fs.FileSystem.from_uri(f"{scheme}://{bucket or '/'}")[0]


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:100]
