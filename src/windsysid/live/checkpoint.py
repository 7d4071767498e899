"""Plain values and arrays as bytes, with a mark, a version and a checksum."""

import json
import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError

__all__ = ["pack", "unpack"]

MARK = b"windsysid watch 2\n"
"""The number is the version: it grows when what is kept, or what follows from it, is another."""

READ = (b"windsysid watch 1\n", MARK)
"""Versions that are read: the first has no references of slow drifts."""


def pack(header: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> bytes:
    """The bytes."""
    parts = [np.ascontiguousarray(array) for array in arrays]
    described = header | {"arrays": [[part.dtype.str, list(part.shape)] for part in parts]}
    text = json.dumps(described).encode()
    body = struct.pack("<I", len(text)) + text + b"".join(part.tobytes() for part in parts)
    return MARK + struct.pack("<I", zlib.crc32(body)) + body


def unpack(content: bytes, what: str) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """The values and arrays.

    Raises
    ------
    ConfigurationError
        If the bytes are damaged, of another version, or of another kind: one line that names `what`.
    """
    if not content.startswith(READ):
        raise ConfigurationError(f"{what}: it is of another version or damaged: start without it, or restore it")
    at = len(MARK) + 4
    body = content[at:]
    if len(body) < 4 or zlib.crc32(body) != struct.unpack("<I", content[at - 4 : at])[0]:
        raise ConfigurationError(f"{what}: it is damaged: start without it, or restore it")
    size = struct.unpack("<I", body[:4])[0]
    header = json.loads(body[4 : 4 + size])
    at, arrays = 4 + size, []
    for dtype, shape in header.pop("arrays"):
        count = int(np.prod(shape))
        arrays.append(np.frombuffer(body, dtype, count, at).reshape(shape).copy())
        at += arrays[-1].nbytes
    return header, arrays
