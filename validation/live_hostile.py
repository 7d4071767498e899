"""Hostile messages through decoding, checking, placing, storing and joining, without a broker.

``python -m validation.live_hostile --messages 5000 --seed 1``: JSON and Arrow blocks that are wrong in one or several
ways (shape, type, size, name, unit, moment, rate, offsets), between good blocks of another turbine. Every message must
be accepted or refused in one printable line, within seconds and a bounded address space; every good block must be on
disk once; every window must be joined. The exit code is 1 where that does not hold.
"""

import argparse
import json
import random
import resource
import struct
import time
import traceback
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from windsysid.fleet.members import Member
from windsysid.fleet.rows import empty_row
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused, decode, encode_arrow, encode_json
from windsysid.live.blocks.limits import ALWAYS_ALLOWED_CELLS, BlockLimits
from windsysid.live.engine import Engine, Followed
from windsysid.live.sources.broker import MAX_PAYLOAD_BYTES
from windsysid.live.store.opening import open_store
from windsysid.live.store.store import Store
from windsysid.live.windows.estimate import Estimated
from windsysid.live.windows.timeline import SECOND, Gathered

__all__ = ["Outcome", "hostile", "main", "message"]

NOON = 1_767_268_800 * SECOND
MESSAGE_SECONDS = 3.0
"""Longest time that a message may take [s]."""

MEMORY = 1_500_000_000
"""Address space beyond that of the process at the begin [bytes]."""

ODD: list[Any] = [
    None, "", " ", [], {}, -1, 0, 1e-300, 1e-5, 5e-324, 1e308, 1e400, True, 2**62, 2**63, 2**64, 2**80, -(2**63), 1.5,
    float("nan"), float("inf"), "\x00\n\x1b[31m", "\ud800", "\ufeffa", "x" * 50, "x" * 5000, "7", " 1_7 ", "1e5", "nan",
    "2026-01-01T12:00:00Z", "0001-01-01T00:00:00+23:59", "9999-12-31T23:59:59.999999999Z", "\u202e", "time", "../x",
    {"a": {}}, [[1]], [None] * 3, 20_000.0, 1e-4, "a" * 39 + "/", "١٢٣",
]  # fmt: skip
"""Values that stand where others are expected."""

UNITS = ["m/s^2", "g", "MN", "furlong", "", "1", "as written: x", "as written x" * 40, "\ud800", "m" * 300]


class Outcome(NamedTuple):
    """Outcome of the messages.

    Attributes
    ----------
    accepted, refused
        Numbers of messages; the second by the first words of the reason.
    faults
        One text for each thing that must not happen.
    slowest
        [s].
    """

    accepted: int
    refused: Counter[str]
    faults: list[str]
    slowest: float


class _Joining:
    """Takes a window without estimating it."""

    compiling = False

    def take(self, gathered: Gathered, source: str, member: Member, formulation: str, settings: str) -> Estimated:
        """A row that says how large the window's table was."""
        size = 0 if gathered.record is None else gathered.record.values.size
        return Estimated(empty_row(source, size, settings) | {"status": "refused", "why": f"{size} cells"}, 0.0)

    def close(self) -> None:
        """There is nothing to end."""


def good_block(rng: random.Random, turbine: str, number: int) -> Block:
    """One second of two channels."""
    values = np.random.default_rng(rng.randrange(2**31)).standard_normal((20, 2))
    names, units = ("tower_x_acceleration", "tower_z_acceleration"), ("m/s^2", "m/s^2")
    return Block(turbine, number, NOON + number * SECOND, 20.0, names, units, values)


def message(rng: random.Random, number: int) -> bytes:
    """A message that is wrong in one or several ways, or that is right and strange."""
    return rng.choice((_text, _text, _strange, _strange, _bytes, _broken_arrow, _crafted_arrow, _raw))(rng, number)


def _text(rng: random.Random, number: int) -> bytes:
    """JSON with odd values in the place of others."""
    told = json.loads(encode_json(good_block(rng, "T02", number)))
    for _ in range(rng.randrange(1, 4)):
        where = rng.randrange(7)
        if where < 4:
            told[rng.choice(["sequence", "start", "rate", "stream"])] = rng.choice(ODD)
        elif where == 4:
            told["channels"] = rng.choice([rng.choice(ODD), {"a": rng.choice(ODD)}, {str(rng.choice(ODD)): {}}])
        elif where == 5 and isinstance(told["channels"], dict):
            channel = {"unit": rng.choice(UNITS + ODD), "values": rng.choice([[rng.choice(ODD)] * 20, rng.choice(ODD)])}
            told["channels"][str(rng.choice(ODD))] = channel
        else:
            told[str(rng.choice(ODD))] = rng.choice(ODD)
    return json.dumps(told).encode()


def _strange(rng: random.Random, number: int) -> bytes:
    """A block that may be right: far away, wide, fast, slow, empty or overlapping."""
    samples, channels = rng.choice([1, 1, 2, 20, 3000]), rng.choice([1, 2, 200, 201])
    rate = rng.choice([1e-4, 1e-3, 0.5, 20.0, 19.999, 1000.0, 20_000.0])
    start = NOON + rng.choice([number, 0, 599, rng.randrange(1200), -86_400 * 365 * rng.randrange(57)]) * SECOND
    span = rng.choice([3, 300, 5000])
    names = tuple(f"c{rng.randrange(span)}_{i if rng.random() < 0.98 else 0}" for i in range(channels))
    samples = min(samples, 100_000 // channels)
    values = np.random.default_rng(number).standard_normal((samples, channels)) * rng.choice([1.0, 1e29, 1e300])
    values[rng.randrange(samples)] = rng.choice([np.nan, np.inf, -np.inf, 0.0, 5e-324])
    if rng.random() < 0.5:
        with np.errstate(over="ignore"):
            values = values.astype(np.float32)
    sequence = rng.choice([number, number, rng.randrange(50), start, 2**62 - 1])
    unit = rng.choice(UNITS[:5] + ["m/s^2"] * 5)
    stream = rng.choice(["", "", "a", f"s{rng.randrange(40)}"])
    block = Block("T02", sequence, start, rate, names, (unit,) * channels, values, stream)
    try:
        return encode_arrow(block)
    except UnicodeEncodeError:
        return b"{"


def _bytes(rng: random.Random, number: int) -> bytes:
    """Random bytes, deep nesting, long digits."""
    return rng.choice(
        [
            rng.randbytes(rng.randrange(2000)),
            b"\xff\xff\xff\xff" + rng.randbytes(rng.randrange(2000)),
            b"{" + b'"a":[' * rng.randrange(1, 50_000),
            b'{"start": ' + b"9" * rng.randrange(1, 6000) + b"}",
            '{"channels": {"ä": 1}}'.encode("utf-16"),
            b" " * rng.randrange(3_000_000),
        ]
    )


def _broken_arrow(rng: random.Random, number: int) -> bytes:
    """A stream with bytes changed, cut or doubled."""
    arrow = bytearray(encode_arrow(good_block(rng, "T02", number)))
    for _ in range(rng.randrange(1, 12)):
        arrow[rng.randrange(4, len(arrow))] = rng.choice([0, 1, 127, 128, 255, rng.randrange(256)])
    low, high = sorted((rng.randrange(4, len(arrow)), rng.randrange(4, len(arrow))))
    cut = rng.random()
    return bytes(arrow[:high] if cut < 0.2 else arrow[:low] + arrow[high:] if cut < 0.4 else arrow)


def _crafted_arrow(rng: random.Random, number: int) -> bytes:
    """A stream whose numbers of 4 or 8 bytes were replaced by small, large or negative ones."""
    arrow = bytearray(encode_arrow(good_block(rng, "T02", number)))
    for _ in range(rng.randrange(1, 5)):
        wide = rng.random() < 0.5
        at = rng.randrange(1, len(arrow) // 8 - 40) * 8
        value = rng.choice([0, 1, 2, 8, 40, 1000, 500_000, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1])
        piece = struct.pack("<Q", value) if wide else struct.pack("<I", value % 2**32)
        arrow[at : at + len(piece)] = piece
    return bytes(arrow)


def _raw(rng: random.Random, number: int) -> bytes:
    """JSON written by hand: doubled keys, escapes, constants, other types at the top."""
    value = rng.choice(["1e999", "-0", "NaN", "Infinity", "1" * 400, "0.1e-400", '"x"', "null", "[[]]", "1" * 4301])
    name = rng.choice(["a", "\\ud800", "\\u0000", "\\ud83d\\ude00", "a\\nb", " a", "time", "", "\\u202e", "a" * 300])
    start = rng.choice(["0", str(NOON), str(2**62 - 1), "1e18", '"now"', '"2026-01-01"', "-5"])
    rate = rng.choice(["20", "1e-4", "1e-300", "20000", '"20"', "0", "true"])
    channel = f'{{"unit": "m", "values": [1, {value}]}}'
    return f'{{"start": {start}, "rate": {rate}, "channels": {{"{name}": {channel}}}}}'.encode()


def hostile(messages: int, seed: int, *, tell: Callable[[str], object] = print) -> Outcome:
    """Push so many hostile messages, each behind a good block of another turbine."""
    rng = random.Random(seed)
    store = open_store(":memory:")
    engine = _engine(store, NOON + (messages + 86_400) * SECOND)
    accepted, refused, faults, slowest = 0, Counter[str](), list[str](), 0.0
    for number in range(messages):
        payload = message(rng, number)
        begun = time.monotonic()
        reason, fault = _pushed(engine, payload)
        seconds = time.monotonic() - begun
        slowest = max(slowest, seconds)
        accepted += not reason and not fault
        refused.update([reason[:28]] if reason else [])
        fault = f"took {seconds:.1f} s" if seconds > MESSAGE_SECONDS else fault
        faults += [f"message {number} {payload[:200]!r}: {fault}"] if fault else []
        engine.push(good_block(rng, "T01", number)).result(60.0)
        if number % 1000 == 999:
            tell(f"{number + 1} messages, {accepted} accepted")
    faults += [] if engine.finish(300.0) else ["windows were not joined within 300 s"]
    engine.drain(5.0)
    rows = [result.row for name in ("T01", "T02") for result in store.results(name)]
    faults += [f"a window failed: {row['why']}" for row in rows if row["status"] == "failed"]
    largest = max(int(str(row["why"]).split()[0]) for row in rows if row["status"] != "failed")
    tell(f"largest table of a window: {largest} cells (allowed: {ALWAYS_ALLOWED_CELLS}, and 8 for each value received)")
    taken = next(one for one in store.statuses() if one.turbine == "T01").counts
    if taken["blocks"] != messages or taken.get("refused") or taken.get("too late") or store.trouble:
        faults.append(f"good blocks: {messages} sent, {dict(taken)}; store: {store.trouble!r}")
    store.close()
    return Outcome(accepted, refused, faults, slowest)


def _engine(store: Store, now: int) -> Engine:
    turbines = [Followed(Member(name, "tower")) for name in ("T01", "T02")]
    with mock.patch("windsysid.live.engine.estimators", return_value=[_Joining()]):
        return Engine(turbines, store, workers=0, now=lambda: now)


def _pushed(engine: Engine, payload: bytes) -> tuple[str, str]:
    """Why a message was refused, and what is wrong with how; both empty where it was accepted."""
    try:
        block = decode(payload, turbine="T02", limits=BlockLimits(payload=MAX_PAYLOAD_BYTES))
        engine.push(block).result(60.0)
    except BlockRefused as error:
        short = str(error).isprintable() and len(str(error)) <= 300
        return str(error), "" if short else f"a reason that is no short line: {str(error)!r:.200}"
    except Exception:
        return "", traceback.format_exc()
    return "", ""


def _limit_memory() -> None:
    with open("/proc/self/statm") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=None, help="a fresh one by default")
    given = parser.parse_args()
    seed = random.SystemRandom().randrange(2**31) if given.seed is None else given.seed
    _limit_memory()
    begun = time.monotonic()
    outcome = hostile(given.messages, seed)
    for reason, count in outcome.refused.most_common(25):
        print(f"{count:7d} refused: {reason}…")
    print("\n".join(outcome.faults[:20]))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(
        f"seed {seed}: {given.messages} messages in {time.monotonic() - begun:.0f} s, {outcome.accepted} accepted,"
        f" {outcome.refused.total()} refused in one line, {len(outcome.faults)} faults;"
        f" slowest {outcome.slowest:.2f} s, peak {peak:.0f} MB"
    )
    return 1 if outcome.faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
