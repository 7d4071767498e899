"""Blocks, rows and levels as the store's columns hold them. Every number comes back with the bits that it had."""

import json
import math
import zlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, cast

import numpy as np

from windsysid.live.blocks.block import Block
from windsysid.live.store.contents import SeriesLevel

__all__ = [
    "block_of", "columns_of", "levels_of", "pack_levels", "pack_row", "pack_spectra", "pack_text", "row_of",
    "spectra_of",
]  # fmt: skip

NUMBERS = ("estimate", "low", "high", "level", "level_low", "level_high", "statistic", "limit")
TEXTS = ("name", "unit", "kind", "grade")
"""Windows of an older version have no grade."""


def columns_of(block: Block) -> tuple[Any, ...]:
    """Turbine, stream, sequence, start, rate, channels, units, type and content of a block.

    They are not compressed: they wait for minutes, and the lower bits of samples are noise.
    """
    little = np.ascontiguousarray(block.values, dtype=block.values.dtype.newbyteorder("<"))
    return (
        block.turbine, block.stream, int(block.sequence), int(block.start), float(block.rate),
        _packed_names(block.channels), _packed_names(block.units), little.dtype.str, little.tobytes(),
    )  # fmt: skip


def block_of(columns: Sequence[Any]) -> Block:
    """The block of `columns_of`."""
    turbine, stream, sequence, start, rate, channels, units, dtype, content = columns
    names = _names(channels)
    values = np.frombuffer(content, dtype=dtype)
    values = values.astype(values.dtype.newbyteorder("="), copy=False).reshape(-1, max(len(names), 1))
    return Block(turbine, sequence, start, rate, names, _names(units), values, stream)


@lru_cache(4096)  # loggers send the same names all day
def _packed_names(names: tuple[str, ...]) -> str:
    return pack_text(names)


@lru_cache(4096)
def _names(packed: str) -> tuple[str, ...]:
    return tuple(json.loads(packed))


def pack_text(value: Any) -> str:
    """As JSON; NumPy's scalars as the numbers that they are."""
    return _JSON.encode(value)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"a store holds numbers, text, lists and mappings of them, got {type(value).__name__}")


_JSON = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), default=_plain)


def pack_row(row: Mapping[str, Any]) -> bytes:
    """A row of `windsysid.fleet.rows`: compressed as quickly as can be, it takes less than half."""
    return zlib.compress(pack_text(row).encode(), 1)


def row_of(content: bytes) -> dict[str, Any]:
    """The row of `pack_row`."""
    return cast(dict[str, Any], json.loads(zlib.decompress(content)))


def pack_levels(levels: Sequence[SeriesLevel]) -> bytes:
    """All series of one window: names, units, kinds and grades, then their numbers; NaN stands for None."""
    head = pack_text([[getattr(level, key) for key in TEXTS] for level in levels]).encode()
    numbers = np.array([[_number(getattr(level, key)) for key in NUMBERS] for level in levels], dtype="<f8")
    return zlib.compress(len(head).to_bytes(4, "little") + head + numbers.tobytes(), 1)


def levels_of(content: bytes) -> list[SeriesLevel]:
    """The levels of `pack_levels`."""
    whole = zlib.decompress(content)
    end = 4 + int.from_bytes(whole[:4], "little")
    numbers = np.frombuffer(whole, "<f8", offset=end).reshape(-1, len(NUMBERS)).tolist()
    return [
        SeriesLevel(*texts[:3], *(None if math.isnan(one) else one for one in values[:-2]), *values[-2:], *texts[3:])
        for texts, values in zip(json.loads(whole[4:end]), numbers, strict=True)
    ]


def pack_spectra(spectra: Sequence[str]) -> bytes:
    """Plots of one window as a compressed JSON array; empty where there are none."""
    return zlib.compress(f"[{','.join(spectra)}]".encode()) if spectra else b""


def spectra_of(content: bytes) -> list[dict[str, Any]]:
    """The plots of `pack_spectra`."""
    return cast(list[dict[str, Any]], json.loads(zlib.decompress(content)))


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
