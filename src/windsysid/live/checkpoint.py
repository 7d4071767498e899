"""A watch as bytes, with a mark, a version and a checksum: all that it takes to go on, bit for bit."""

import json
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError
from windsysid.live.store.contents import Alarm
from windsysid.live.watch.alarms import AlarmCase
from windsysid.live.watch.slow_drifts import Past, past_of
from windsysid.live.watch.watch_state import KeptWindows, WatchState
from windsysid.live.watch.watched import Watched
from windsysid.live.windows.conditions import Standards
from windsysid.monitoring.levels.following import Kept
from windsysid.monitoring.levels.jumps import LevelBelief, Rates
from windsysid.monitoring.levels.locating import Jump

__all__ = ["KeptWatch", "pack", "pack_watch", "unpack", "unpack_watch"]

MARK = b"windsysid watch 3\n"
"""Version number: it grows when the stored data, or results from it, change."""

READ = (b"windsysid watch 1\n", b"windsysid watch 2\n", MARK)
"""Versions that are read: the first has no references of slow drifts, the first two have whether windows are trusted.
"""


class KeptWatch(NamedTuple):
    """Complete state of a watch: its windows, series, cases, and by series the reference of drifts."""

    state: WatchState
    windows: KeptWindows
    series: Mapping[Watched, Kept]
    cases: tuple[AlarmCase, ...]
    past: Mapping[str, Past]


def pack_watch(turbine: str, watch: KeptWatch) -> bytes:
    """The checkpoint of a turbine's watch."""
    state = watch.state
    header = {
        "turbine": turbine,
        "state": state._asdict() | {"standards": state.standards and list(state.standards)},
        "series": [
            {"watched": list(one), "let_go": kept.let_go, "rates": kept.rates and list(kept.rates),
             "scale": kept.scale, "jumps": [list(jump) for jump in kept.jumps], "learned": kept.before is not None,
             "past": watch.past.get(one.name)}
            for one, kept in watch.series.items()
        ],
        "cases": [[one.series, list(one.jump), one.returns, list(one.alarm), one.drift] for one in watch.cases],
    }  # fmt: skip
    arrays: list[NDArray[Any]] = [*watch.windows]
    for kept in watch.series.values():
        arrays += [kept.y, kept.std]
        arrays += [] if kept.before is None else [*kept.before]
    return pack(header, arrays)


def unpack_watch(checkpoint: bytes, turbine: str) -> KeptWatch:
    """The watch of a checkpoint; ConfigurationError if it is damaged, or of another turbine or version."""
    header, arrays = unpack(checkpoint, f"checkpoint of {turbine}")
    if header["turbine"] != turbine:
        raise ConfigurationError(f"checkpoint of {turbine}: it is one of '{header['turbine']}': start without it")
    del arrays[2 : 2 + (not checkpoint.startswith(MARK))]  # whether windows are trusted
    rest = iter(arrays)
    windows = KeptWindows._make(next(rest) for _ in KeptWindows._fields)
    series = {Watched(*one["watched"]): _kept(one, rest) for one in header["series"]}
    state = WatchState(**header["state"])
    if state.standards is not None:
        parts = (tuple(part) if isinstance(part, list) else part for part in state.standards)
        state = state._replace(standards=Standards._make(parts))
    cases = tuple(
        AlarmCase(name, Jump(*jump), returns, Alarm(*alarm), *drift)
        for name, jump, returns, alarm, *drift in header["cases"]
    )
    past = {Watched(*one["watched"]).name: past_of(one["past"]) for one in header["series"] if one.get("past")}
    return KeptWatch(state, windows, series, cases, past)


def _kept(one: Mapping[str, Any], rest: Iterator[NDArray[Any]]) -> Kept:
    """State of a series in a checkpoint: its part of the header, and the arrays that follow."""
    y, std = next(rest), next(rest)
    before = LevelBelief(next(rest), next(rest)) if one["learned"] else None
    rates = None if one["rates"] is None else Rates(*one["rates"])
    return Kept(y, std, one["let_go"], before, rates, one["scale"], tuple(Jump(*jump) for jump in one["jumps"]))


def pack(header: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> bytes:
    """Plain values and arrays as bytes."""
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
