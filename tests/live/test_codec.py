"""A block survives the way in bytes, and what is no block ends in one line."""

import contextlib
import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.live.streaming import NOON, blocks_of, record
from windsysid.live.blocks import arrow
from windsysid.live.blocks.arrow import NotArrowError, read_columns
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockLimits, BlockRefused, check, decode, encode_arrow, encode_json
from windsysid.live.windows.timeline import SECOND
from windsysid.records.record import AS_WRITTEN

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
        ({"rate": 0.0}, "rate: expected 0.0001 to 20000 Hz"),
        ({"rate": 1e-300}, "rate: expected 0.0001 to 20000 Hz"),
        ({"rate": 9e-5}, "rate: expected 0.0001 to 20000 Hz"),
        ({"rate": float("nan")}, "rate: expected 0.0001 to 20000 Hz"),
        ({"rate": "fast"}, "block cannot be checked"),
        ({"start": -1}, "start: expected a whole number from 0"),
        ({"start": float(NOON)}, "start: expected a whole number from 0"),
        ({"start": 2**62 - SECOND}, "ends after the year 2115"),
        ({"sequence": 2**70}, "sequence: expected a whole number from 0"),
        ({"sequence": 1.5}, "sequence: expected a whole number from 0"),
        ({"channels": ("a", "\ud800")}, "printable"),
        ({"channels": ("a", "\x00")}, "printable"),
        ({"channels": ("a", "b" * 201)}, "expected up to 200 printable characters"),
        ({"channels": ("a", 7)}, "printable"),
        ({"units": ("m/s^2", "\ud800")}, "printable"),
        ({"units": ("m/s^2", AS_WRITTEN + "x" * 300)}, "expected up to 200 printable characters"),
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
    assert str(refused.value).isprintable()


@pytest.mark.filterwarnings("error")
def test_values_that_no_sensor_gives_are_missing():
    values = np.array([[1e30, 1.1e30], [-1e31, 1e308]])
    block = check(a_block(values=values))
    assert np.array_equal(block.values, [[1e30, np.nan], [np.nan, np.nan]], equal_nan=True)


@pytest.mark.parametrize("sequence", ["17.0", "1.5", "1e3", "true", '"x"', "[1]"])
def test_a_sequence_that_is_no_whole_number_is_refused(sequence):
    told = json.loads(encode_json(a_block()))
    payload = json.dumps(told | {"sequence": "@"}).replace('"@"', sequence).encode()
    with pytest.raises(BlockRefused, match="expected sequence as a whole number"):
        decode(payload, turbine="T01")


def test_an_error_that_nobody_foresaw_is_a_refusal(monkeypatch):
    def broken(*_: object) -> None:
        raise MemoryError("no\nroom \ud800")

    monkeypatch.setattr("windsysid.live.blocks.codec.json.loads", broken)
    with pytest.raises(BlockRefused, match=r"^block cannot be decoded \(MemoryError: no room \?\)$"):
        decode(b"{}", turbine="T01")


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
    with pytest.raises(BlockRefused, match="a column is truncated"):
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
        (BlockLimits(payload=100), "expected 100 at most"),
        (BlockLimits(samples=49), "more than 49 samples"),
        (BlockLimits(channels=1), "channels"),
        (BlockLimits(rate=10.0), "rate: expected 0.0001 to 10 Hz"),
        (BlockLimits(lowest_rate=30.0), "rate: expected 30 to 20000 Hz"),
        (BlockLimits(name=10), "expected up to 10 printable characters"),
    ):
        with pytest.raises(BlockRefused, match=said):
            check(decode(encode_arrow(block), turbine="T01", limits=limits), limits)


def sent(fields: list[object], columns: list[object], batches: int = 1, **marks: str) -> bytes:
    """An Arrow stream of these columns, so many times."""
    told = {"sequence": "0", "start": str(NOON), "rate": "20.0"} | marks
    schema, sink = pa.schema(fields, metadata=told), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema) as writer:
        for _ in range(batches):
            writer.write_batch(pa.record_batch(columns, schema=schema))
    return bytes(sink.getvalue())


A_COLUMN = pa.array([1.0])


def test_as_many_batches_as_stated_are_read_and_one_more_is_refused(monkeypatch):
    monkeypatch.setattr(arrow, "MAX_BATCHES", 3)
    field = pa.field("a", pa.float64(), metadata={"unit": "m"})
    assert decode(sent([field], [A_COLUMN], 3), turbine="T01").values.shape == (3, 1)
    with pytest.raises(BlockRefused, match="more than 3 batches"):
        decode(sent([field], [A_COLUMN], 4), turbine="T01")


def test_so_many_empty_batches_cost_no_time():
    payload = sent([pa.field("a", pa.float64(), metadata={"unit": "m"})], [pa.array([], type=pa.float64())], 10_001)
    with pytest.raises(BlockRefused, match="more than 10000 batches"):
        decode(payload, turbine="T01")


@pytest.mark.parametrize("where", ["name", "unit", "mark"])
def test_texts_are_read_up_to_a_thousand_bytes(where):
    def payload(size: int) -> bytes:
        text = "x" * size
        name, unit = (text if where == "name" else "a"), (text if where == "unit" else "m")
        stream = text if where == "mark" else ""
        return sent([pa.field(name, pa.float64(), metadata={"unit": unit})], [A_COLUMN], stream=stream)

    read = read_columns(payload(1000), most_rows=10, most_columns=10)
    assert 1000 in (len(read.names[0]), len(read.units[0] or ""), len(read.marks.get("stream", "")))
    with pytest.raises(NotArrowError, match="a text of 1001 bytes: expected 1000 at most"):
        read_columns(payload(1001), most_rows=10, most_columns=10)


def test_more_metadata_than_stated_are_refused():
    def payload(count: int) -> bytes:
        field = pa.field("a", pa.float64(), metadata={"unit": "m"} | {f"m{i}": "" for i in range(count - 1)})
        return sent([field], [A_COLUMN])

    assert read_columns(payload(100), most_rows=10, most_columns=10).units == ("m",)
    with pytest.raises(NotArrowError, match="101 metadata: expected 100 at most"):
        read_columns(payload(101), most_rows=10, most_columns=10)


def test_columns_that_share_their_bytes_are_refused():
    """Each would be a copy: 200 columns of one buffer make 400 MB of 2 MB."""
    fields = [pa.field(f"c{i}", pa.float64(), metadata={"unit": "m"}) for i in range(2)]
    payload = bytearray(sent(fields, [pa.array(np.zeros(1000))] * 2))
    lengths = struct.pack("<qq", 8000, 8000)  # offset and length of the second column's numbers
    at = payload.rindex(lengths)
    payload[at : at + 16] = struct.pack("<qq", 0, 8000)
    short = bytes(payload[: len(payload) - 8000 - 8])  # without the second column's bytes
    head = short.rindex(struct.pack("<q", 16000))  # length of the batch's body
    short = short[:head] + struct.pack("<q", 8000) + short[head + 8 :]
    with pytest.raises(BlockRefused, match="columns share their bytes"):
        decode(short, turbine="T01")


def test_schemas_that_are_remembered_are_bounded(monkeypatch):
    monkeypatch.setattr(arrow, "MAX_SCHEMA_CACHE_BYTES", 10_000)
    arrow._schemas.clear()
    for i in range(50):
        decode(sent([pa.field(f"c{'x' * i}", pa.float64(), metadata={"unit": "m"})], [A_COLUMN]), turbine="T01")
    assert 1 < sum(size * len(alike) for size, alike in arrow._schemas.items()) <= 10_000


def test_as_many_columns_as_allowed_are_read_and_one_more_is_refused():
    fields = [pa.field(f"of_{i}", pa.float64(), metadata={"unit": "m"}) for i in range(3)]
    assert read_columns(sent(fields, [A_COLUMN] * 3), most_rows=10, most_columns=3).values.shape == (1, 3)
    more = [*fields, pa.field("more", pa.float64(), metadata={"unit": "m"})]
    with pytest.raises(NotArrowError, match="4 channels: expected 3 at most"):
        read_columns(sent(more, [A_COLUMN] * 4), most_rows=10, most_columns=3)


def test_a_text_that_leads_out_of_the_payload_is_refused():
    schema = sent([pa.field("leads_out", pa.float64(), metadata={"unit": "m"})], [A_COLUMN], batches=0)[:-8]
    text = struct.pack("<I", 1) + b"m\0"
    assert schema.count(text) == 1
    with pytest.raises(NotArrowError, match="a text of 999 bytes"):
        read_columns(schema.replace(text, struct.pack("<I", 999) + b"m\0"), most_rows=10, most_columns=3)
