"""A block survives the way in bytes, and what is no block ends in one line."""

import contextlib
import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.live.streaming import NOON, blocks_of, record
from windsysid.live.arrow import read_columns
from windsysid.live.block import Block
from windsysid.live.codec import BlockRefused, Limits, check, decode, encode_arrow, encode_json

pa = pytest.importorskip("pyarrow")


def a_block(**changes: object) -> Block:
    return replace(blocks_of(record(50), 20.0, 50)[0], **changes)  # type: ignore[arg-type]


def same(a: Block, b: Block) -> bool:
    return (
        (a.turbine, a.sequence, a.start, a.rate, a.channels, a.units, a.stream)
        == (b.turbine, b.sequence, b.start, b.rate, b.channels, b.units, b.stream)
        and a.values.dtype == b.values.dtype
        and a.values.tobytes() == b.values.tobytes()
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("stream", ["", "blades"])
def test_an_arrow_block_comes_back_bit_for_bit(dtype, stream):
    values = a_block().values.astype(dtype)
    values[3, 1] = np.nan
    block = a_block(values=values, stream=stream, sequence=17, start=NOON + 1)
    assert same(decode(encode_arrow(block), turbine="T01"), block)


def test_a_json_block_comes_back_with_its_values():
    values = a_block().values.copy()
    values[3, 1] = np.nan
    block = a_block(values=values, stream="blades")
    assert same(decode(encode_json(block), turbine="T01"), block)


def test_a_start_may_be_a_moment_and_a_sequence_may_be_missing():
    told = json.loads(encode_json(a_block()))
    del told["sequence"]
    told["start"] = "2026-01-01T13:00:00.123456789+01:00"
    block = decode(json.dumps(told).encode(), turbine="T01")
    assert block.start == block.sequence == NOON + 123_456_789


@pytest.mark.parametrize(("fraction", "nanoseconds"), [("5", 500_000_000), ("25", 250_000_000), ("000001", 1000)])
def test_a_fraction_of_a_second_may_have_any_number_of_digits(fraction: str, nanoseconds: int):
    told = json.loads(encode_json(a_block())) | {"start": f"2026-01-01T12:00:00.{fraction}Z"}
    assert decode(json.dumps(told).encode(), turbine="T01").start == NOON + nanoseconds


def test_other_units_are_converted_and_infinite_values_are_missing():
    values = np.array([[1.0, np.inf], [2.0, 3.0]])
    block = check(Block("T01", 0, NOON, 20.0, ("tower_x_acceleration", "power"), ("g", "kW"), values))
    assert block.units == ("m/s^2", "W")
    assert np.array_equal(block.values, [[9.80665, np.nan], [2 * 9.80665, 3000.0]], equal_nan=True)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rate": 0.0}, "rate: expected above 0"),
        ({"rate": float("nan")}, "rate: expected above 0"),
        ({"start": -1}, "start and sequence: expected whole numbers"),
        ({"sequence": 2**70}, "start and sequence: expected whole numbers"),
        ({"values": np.zeros((0, 2))}, "block of 0 samples"),
        ({"values": np.zeros((3, 2), dtype=np.int64)}, "expected float32 or float64"),
        ({"values": np.zeros((3, 3))}, "3 columns, 2 channels"),
        ({"channels": ("a", "a")}, "occurs twice"),
        ({"channels": ("a", "time")}, "the record's own"),
        ({"units": ("m/s^2", "furlong")}, "furlong"),
        ({"stream": "a/b"}, "stream: expected up to 40 letters"),
    ],
)
def test_what_is_no_block_is_refused_in_one_line(changes, said):
    with pytest.raises(BlockRefused, match=said) as refused:
        check(a_block(**changes))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"hello", b"{", b"[]", b"{}", b'{"channels": []}', b'{"channels": {"a": 1}, "start": 0, "rate": 1}',
        b'{"start": 0, "rate": 1, "channels": {"a": {"unit": "m", "values": ["x"]}}}',
        b'{"start": 0, "rate": 1, "channels": {"a": {"unit": "m", "values": [1]}, "b": {"unit": "m", "values": []}}}',
        b'{"start": "yesterday", "rate": 1, "channels": {"a": {"unit": "m", "values": [1]}}}',
        b'{"start": 0, "rate": "x", "channels": {"a": {"unit": "m", "values": [1]}}}',
        b'{"start": 0, "rate": 1, "more": 1, "channels": {"a": {"unit": "m", "values": [1]}}}',
        b"[" * 100_000, b'{"a":' * 100_000, b"\xff\xff\xff\xff", b"\xff\xff\xff\xff\x00\x00\x00\x10abc", b"\x00" * 100,
        b'{"start": 0, "rate": 1, "channels": {"a": {"unit": "m", "values": [1' + b"0" * 400 + b"]}}}",
        b'{"start": 1' + b"0" * 5000 + b', "rate": 1, "channels": {"a": {"unit": "m", "values": [1]}}}',
    ],
)  # fmt: skip
def test_malformed_payloads_are_refused_in_one_line(payload):
    with pytest.raises(BlockRefused) as refused:
        check(decode(payload, turbine="T01"))
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 260


def test_an_arrow_payload_with_any_byte_changed_is_a_block_or_refused():
    good = encode_arrow(a_block())
    rng = np.random.default_rng(0)
    for _ in range(1500):
        bad = bytearray(good)
        for at in rng.integers(0, len(good), rng.integers(1, 6)):
            bad[at] = rng.integers(0, 256)
        payload = bytes(bad[: rng.integers(8, len(good) + 1)] if rng.random() < 0.3 else bad)
        with contextlib.suppress(BlockRefused):
            check(decode(payload, turbine="T01"))


def test_what_is_read_of_arrow_is_what_pyarrow_reads():
    """Writers differ: nulls, several batches, both precisions, no rows, no mark of the end."""
    rng = np.random.default_rng(1)
    for case in range(40):
        n, m = int(rng.integers(0, 40)), int(rng.integers(1, 5))
        kinds = [pa.float32() if rng.random() < 0.5 else pa.float64() for _ in range(m)]
        fields = [pa.field(f"c{i}", kinds[i], metadata={"unit": "m", "more": "x"}) for i in range(m)]
        marks = {"sequence": str(case), "start": str(NOON), "rate": "20.0", "stream": "ü" * (case % 9)}
        schema = pa.schema(fields, metadata=marks)
        sink = pa.BufferOutputStream()
        tables = []
        with pa.ipc.new_stream(sink, schema) as writer:
            for _ in range(case % 4):
                columns = [
                    pa.array([None if rng.random() < 0.2 else x for x in rng.normal(size=n)], type=kind)
                    for kind in kinds
                ]
                batch = pa.record_batch(columns, schema=schema).slice(case % 3)
                writer.write_batch(batch)
                tables.append(np.column_stack([c.to_numpy(zero_copy_only=False) for c in batch.columns]))
        payload = bytes(sink.getvalue())[: None if case % 2 else -8]
        for _ in range(2):  # a schema that is known, and one that is not
            read = read_columns(payload, most_rows=1000, most_columns=10)
            assert (read.marks, read.names, set(read.units)) == (marks, tuple(schema.names), {"m"})
            expected = np.concatenate([np.empty((0, m)), *tables])
            assert np.array_equal(read.values, expected, equal_nan=True)
            assert read.values.dtype == (np.float32 if set(kinds) == {pa.float32()} else np.float64)


def test_a_schema_that_is_known_does_not_hide_one_that_differs():
    block = a_block()
    for one in (block, replace(block, units=("g", "m")), replace(block, sequence=block.sequence + 1), block):
        assert same(decode(encode_arrow(one), turbine="T01"), one)


def test_columns_that_are_compressed_are_refused_before_they_are_unpacked():
    schema = pa.schema([pa.field("a", pa.float64(), metadata={"unit": "m"})], metadata={"start": "0", "rate": "1"})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        writer.write_batch(pa.record_batch([pa.array(np.zeros(400_000))], schema=schema))
    assert len(sink.getvalue()) < 2000  # it would be 3.2 MB
    with pytest.raises(BlockRefused, match="compressed"):
        decode(bytes(sink.getvalue()), turbine="T01")


def test_a_column_that_is_shorter_than_its_rows_is_refused():
    """Its numbers would go on in the column after it."""
    payload = encode_arrow(a_block(values=np.zeros((50, 2))))
    whole, cut = struct.pack("<qq", 0, 400), struct.pack("<qq", 0, 392)  # where the first column begins, and its bytes
    assert whole in payload
    with pytest.raises(BlockRefused, match="a column is cut"):
        decode(payload.replace(whole, cut, 1), turbine="T01")


def test_arrow_without_units_or_of_texts_is_refused():
    def sent(field: object, values: list[object]) -> bytes:
        schema = pa.schema([field], metadata={"sequence": "0", "start": str(NOON), "rate": "20.0"})
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, schema) as writer:
            writer.write_batch(pa.record_batch([pa.array(values)], schema=schema))
        return bytes(sink.getvalue())

    with pytest.raises(BlockRefused, match="has no unit"):
        decode(sent(pa.field("a", pa.float64()), [1.0]), turbine="T01")
    with pytest.raises(BlockRefused, match="expected float32 or float64"):
        decode(sent(pa.field("a", pa.string(), metadata={"unit": "m"}), ["x"]), turbine="T01")
    null = decode(sent(pa.field("a", pa.float64(), metadata={"unit": "m"}), [1.0, None]), turbine="T01")
    assert np.array_equal(null.values, [[1.0], [np.nan]], equal_nan=True)


def test_sizes_are_bounded():
    block = a_block()
    for limits, said in (
        (Limits(payload=100), "expected 100 at most"),
        (Limits(samples=49), "more than 49 samples"),
        (Limits(channels=1), "channels"),
        (Limits(rate=10.0), "rate: expected above 0 to 10 Hz"),
    ):
        with pytest.raises(BlockRefused, match=said):
            check(decode(encode_arrow(block), turbine="T01", limits=limits), limits)
