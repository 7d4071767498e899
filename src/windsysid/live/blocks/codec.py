"""A block as bytes: Arrow for loggers that send much, JSON for those that have nothing else.

An Arrow block is one IPC stream with a column of float32 or float64 for each channel. The schema's metadata say
``sequence``, ``start`` [ns since 1970, UTC], ``rate`` [Hz] and, where a turbine has several loggers, ``stream``; each
field's metadata say its ``unit``. Null is a missing sample, as NaN is.

A JSON block is one object, with null for a missing sample:

    {"sequence": 17, "start": "2026-01-05T12:00:00Z", "rate": 100.0, "stream": "blades",
     "channels": {"tower_x_acceleration": {"unit": "m/s^2", "values": [0.01, null, 0.02]}}}

Where ``sequence`` is missing, the block's start is its number. ``start`` is text with a zone, or nanoseconds. Units
other than SI are converted. A sender is not trusted: sizes are bounded before anything is read
(`windsysid.live.blocks.limits`).
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from numbers import Integral
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError, RecordError, StoreError, WindsysidError
from windsysid.live.blocks.arrow import NotArrowError, read_columns
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.limits import MAX_TIME_NS, BlockLimits, one_line
from windsysid.records.checks import check_channels
from windsysid.records.moments import has_zone, nanoseconds
from windsysid.records.record import AS_WRITTEN
from windsysid.units import si_unit, to_si

__all__ = ["BlockLimits", "BlockRefused", "check", "decode", "encode_arrow", "encode_json", "refusing"]

ARROW = b"\xff\xff\xff\xff"
"""First bytes of an Arrow IPC stream; a JSON object begins with a brace."""

STREAM = re.compile(r"[\w.-]{0,40}")


class BlockRefused(WindsysidError, ValueError):  # noqa: N818  (it is the sender's error, not ours)
    """A block that cannot be accepted; the message is one printable line with the expected and the received value."""

    def __init__(self, why: str) -> None:
        super().__init__(one_line(why))


class refusing:  # noqa: N801  (a context; as a generator it would cost a tenth of a block)
    """Turn every error inside the context, except of the store, into a `BlockRefused`.

    An unexpected error in one block must not stop the blocks that follow.
    """

    __slots__ = ("_what",)

    def __init__(self, what: str) -> None:
        self._what = what

    def __enter__(self) -> None: ...

    def __exit__(self, _: object, error: BaseException | None, _traceback: TracebackType | None) -> None:
        if isinstance(error, Exception) and not isinstance(error, BlockRefused | StoreError):
            raise BlockRefused(f"block cannot be {self._what} ({type(error).__name__}: {error})"[:2000]) from error


def decode(payload: bytes, *, turbine: str, limits: BlockLimits = BlockLimits()) -> Block:
    """The block that a sender means, as it says it: `check`, which `Engine.push` calls, says whether it can be taken.

    Parameters
    ----------
    payload
        Arrow or JSON: its first byte tells.
    turbine
        Whose it is: the topic or the address says it, not the payload.

    Raises
    ------
    BlockRefused
        If it is none, or larger than `limits`.
    """
    with refusing("decoded"):
        return _decoded(payload, turbine, limits)


def _decoded(payload: bytes, turbine: str, limits: BlockLimits) -> Block:
    if len(payload) > limits.payload:
        raise BlockRefused(f"block of {len(payload)} bytes: expected {limits.payload} at most; send shorter blocks")
    if payload.startswith(ARROW):
        return _of_arrow(payload, turbine, limits)
    if payload.lstrip()[:1] == b"{":
        return _of_json(payload, turbine)
    raise BlockRefused(f"block begins with {payload[:8]!r}: expected an Arrow IPC stream or a JSON object")


def encode_arrow(block: Block) -> bytes:
    """The block as an Arrow IPC stream; `decode` gives it back, bit for bit."""
    import pyarrow as pa

    fields = [
        pa.field(name, pa.from_numpy_dtype(block.values.dtype), metadata={"unit": unit})
        for name, unit in zip(block.channels, block.units, strict=True)
    ]
    marks = {"sequence": str(block.sequence), "start": str(block.start), "rate": repr(block.rate)}
    schema = pa.schema(fields, metadata=marks | ({"stream": block.stream} if block.stream else {}))
    columns = [pa.array(np.ascontiguousarray(block.values[:, i])) for i in range(len(fields))]
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema) as writer:
        writer.write_batch(pa.record_batch(columns, schema=schema))
    return bytes(sink.getvalue())


def encode_json(block: Block) -> bytes:
    """The block as a JSON object; `decode` gives its values back as float64."""
    channels = {
        name: {"unit": unit, "values": [None if math.isnan(x) else x for x in block.values[:, i].tolist()]}
        for i, (name, unit) in enumerate(zip(block.channels, block.units, strict=True))
    }
    told = {"sequence": block.sequence, "start": block.start, "rate": block.rate, "channels": channels}
    return json.dumps(told | ({"stream": block.stream} if block.stream else {}), allow_nan=False).encode()


def check(block: Block, limits: BlockLimits = BlockLimits()) -> Block:
    """Return the block in SI, its rate to twelve digits, with values that are infinite or too large set to missing.

    Raises
    ------
    BlockRefused
        If names, units, shape, rate, start or sequence are not what a `Block` holds, or it is outside of `limits`.
    """
    with refusing("checked"):
        return _checked(block, limits)


def _checked(block: Block, limits: BlockLimits) -> Block:
    _check_shape(block, limits)
    _check_numbers(block, limits)
    if not STREAM.fullmatch(block.stream):
        raise BlockRefused(f"stream: expected up to 40 letters, digits, points and dashes, got {block.stream[:40]!r}")
    units, values = _in_si(block.channels, block.units, block.values, limits)
    flat = values.reshape(-1)
    with np.errstate(over="ignore", invalid="ignore"):
        if not np.dot(flat, flat) < 0.25 * limits.magnitude**2 and (absurd := np.abs(values) > limits.magnitude).any():
            values = np.where(absurd, values.dtype.type(np.nan), values)
    rate = float(f"{block.rate:.12g}")
    if values is block.values and units == block.units and rate == block.rate:
        return block
    return replace(block, units=units, values=values, rate=rate)


def _check_shape(block: Block, limits: BlockLimits) -> None:
    values = block.values
    if values.ndim != 2 or values.dtype not in (np.float32, np.float64):
        raise BlockRefused(f"values: expected float32 or float64 (n, m), got {values.dtype} {values.shape}")
    samples, channels = values.shape
    if channels != len(block.channels) or channels != len(block.units):
        raise BlockRefused(
            f"block has {channels} columns, {len(block.channels)} channels and {len(block.units)} units: expected as"
            " many of each"
        )
    if not (1 <= samples <= limits.samples and 1 <= channels <= limits.channels):
        raise BlockRefused(
            f"block of {samples} samples of {channels} channels: expected 1 to {limits.samples} samples of 1 to"
            f" {limits.channels} channels"
        )


def _check_numbers(block: Block, limits: BlockLimits) -> None:
    if not limits.lowest_rate <= block.rate <= limits.rate:
        raise BlockRefused(f"rate: expected {limits.lowest_rate:g} to {limits.rate:g} Hz, got {block.rate:g}")
    for name, number in (("start", block.start), ("sequence", block.sequence)):
        if not (isinstance(number, Integral) and 0 <= number < MAX_TIME_NS):
            raise BlockRefused(
                f"{name}: expected a whole number from 0 to {MAX_TIME_NS}{' (ns since 1970)' * (name == 'start')}, got"
                f" {number!r:.24}"
            )
    if block.start + len(block.values) * 1e9 / block.rate >= MAX_TIME_NS:
        raise BlockRefused(f"start: the block ends after the year 2115: it begins at {block.start} ns since 1970")


def _in_si(
    channels: tuple[str, ...], units: tuple[str, ...], values: NDArray[np.floating], limits: BlockLimits
) -> tuple[tuple[str, ...], NDArray[np.floating]]:
    """Units and values in SI; names and units are those of a record or refused."""
    key = channels, units, limits.name
    known = _known.get(key)
    if known is None:
        _check_texts(channels, units, limits)
        try:
            check_channels(channels)
            own = tuple(unit if unit.startswith(AS_WRITTEN) else si_unit(unit) for unit in units)
            factors = tuple(1.0 if unit.startswith(AS_WRITTEN) else to_si(1.0, unit) for unit in units)
        except (RecordError, ConfigurationError) as error:
            raise BlockRefused(" ".join(str(error).split())) from None
        if len(_known) >= _MAX_CACHED_UNITS:
            _known.clear()
        known = _known[key] = own, (None if set(factors) == {1.0} else np.array(factors))
    own, scale = known
    if scale is None:
        return own, values
    with np.errstate(over="ignore"):
        return own, values.astype(np.float64) * scale


def _check_texts(channels: tuple[str, ...], units: tuple[str, ...], limits: BlockLimits) -> None:
    """Refuse names and units that a database or a page cannot show: unpaired surrogates, control characters."""
    for text in (*channels, *units):
        if not (isinstance(text, str) and len(text) <= limits.name and text.isprintable()):
            raise BlockRefused(f"name or unit {text!r:.60}: expected up to {limits.name} printable characters")


_MAX_CACHED_UNITS = 512
_known: dict[tuple[tuple[str, ...], tuple[str, ...], int], tuple[tuple[str, ...], NDArray[np.float64] | None]] = {}
"""Names and units that were looked at before: the same loggers send the same ones all day."""


def _of_arrow(payload: bytes, turbine: str, limits: BlockLimits) -> Block:
    try:
        told = read_columns(payload, most_rows=limits.samples, most_columns=limits.channels)
    except NotArrowError as error:
        raise BlockRefused(f"no block in an Arrow IPC stream: {' '.join(str(error).split())[:120]}") from None
    units = []
    for name, unit in zip(told.names, told.units, strict=True):
        if unit is None:
            raise BlockRefused(f"channel '{name[:40]}' has no unit: write it into the field's metadata as 'unit'")
        units.append(unit)
    return _built(turbine, told.marks, told.names, tuple(units), told.values)


def _of_json(payload: bytes, turbine: str) -> Block:
    try:
        told = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise BlockRefused(f"no JSON: {' '.join(str(error).split())[:100]}") from None
    _check_keys(told)
    listed: dict[str, Any] = told["channels"]
    units = [_unit(name, channel) for name, channel in listed.items()]
    columns = [_numbers(name, channel["values"]) for name, channel in listed.items()]
    lengths = {len(column) for column in columns}
    if len(lengths) > 1:
        raise BlockRefused(f"channels have {min(lengths)} to {max(lengths)} values: expected as many in each")
    values = np.column_stack(columns) if columns else np.empty((0, 0))
    return _built(turbine, told, tuple(listed), tuple(units), values)


def _check_keys(told: dict[str, Any]) -> None:
    known = ("sequence", "start", "rate", "stream", "channels")
    unknown = [key for key in told if key not in known]
    if unknown or not isinstance(told.get("channels"), dict):
        what = f"unknown key {unknown[0][:40]!r}" if unknown else "no object 'channels'"
        raise BlockRefused(f"block has {what}: expected {', '.join(known)}")


def _unit(name: str, channel: Any) -> str:
    if not isinstance(channel, dict) or set(channel) != {"unit", "values"} or not isinstance(channel["unit"], str):
        raise BlockRefused(f'channel {name[:40]!r}: expected {{"unit": "m/s^2", "values": [...]}}')
    return str(channel["unit"])


def _numbers(name: str, values: Any) -> NDArray[np.float64]:
    if isinstance(values, list) and all(x is None or type(x) in (int, float) for x in values):
        try:
            return np.array([math.nan if x is None else x for x in values], dtype=np.float64)
        except OverflowError:
            pass
    raise BlockRefused(f"channel {name[:40]!r}: expected a list of numbers, null where one is missing")


def _built(
    turbine: str, marks: Mapping[str, Any], channels: tuple[str, ...], units: tuple[str, ...], values: NDArray[Any]
) -> Block:
    """Block from the fields that a sender gives, as text or as numbers."""
    start = _start(marks.get("start"))
    sequence = marks.get("sequence", start)
    rate, stream = marks.get("rate"), marks.get("stream", "")
    try:
        if isinstance(sequence, bool | float) or isinstance(rate, bool) or rate is None or not isinstance(stream, str):
            raise ValueError
        return Block(turbine, int(sequence), start, float(rate), channels, units, values, stream)
    except (TypeError, ValueError, OverflowError):
        got = f"sequence {sequence!r:.20}, rate {rate!r:.20}, stream {stream!r:.20}"
        raise BlockRefused(f"expected sequence as a whole number, rate in Hz, stream as text; got {got}") from None


def _start(given: Any) -> int:
    """A start [ns since 1970], given as such or as text with a zone."""
    if isinstance(given, int) and not isinstance(given, bool):
        return given
    if isinstance(given, str):
        if re.fullmatch(r"\d{1,20}", given, re.ASCII):
            return int(given)
        try:
            if has_zone(given):
                return nanoseconds(given)
        except ValueError:
            pass
    raise BlockRefused(f"start: expected ns since 1970 or a moment with its zone (…T12:00:00Z), got {given!r:.40}")
