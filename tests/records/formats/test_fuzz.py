"""Damaged files become one clear line or a correct record: never another error, never columns that shifted."""

import signal
import struct
import warnings
from contextlib import contextmanager

import numpy as np
import pytest

from tests.records.formats import damage
from tests.records.formats.helpers import write
from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats import iterate_record, read_record, write_record
from windsysid.records.record import Record
from windsysid.units import UNITS

pytestmark = pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")

FACTORS = sorted({factor for _, factor in UNITS.values()}, key=lambda f: abs(np.log(f)))


def channels(rows=60, seed=0):
    """Values (T, 3) that tell their channel: 1xx.xxx, 2xx.xxx, 3xx.xxx."""
    rng = np.random.default_rng(seed)
    return np.arange(rows) * 0.05, np.round(rng.random((rows, 3)) * 99.0 + [100.0, 200.0, 300.0], 3)


def table(
    delimiter,
    decimal,
    end="\n",
    above="",
    header="time [s]|a [m]|b [rad]|c",
    below="",
    stamp=False,
    quote="",
    step=0.05,
):
    time, values = channels()
    lines = [above] if above else []
    lines += [header.replace("|", delimiter)] if header else []
    lines += [below.replace("|", delimiter)] if below else []
    for k, row in enumerate(values):
        moment = (
            f"{quote}2021-07-07 12:00:{time[k]:06.3f}{quote}"
            if stamp
            else f"{time[k] / 0.05 * step:.6g}".replace(".", decimal)
        )
        lines.append(delimiter.join([moment, *(f"{x:.3f}".replace(".", decimal) for x in row)]))
    return end.join(lines) + end


TOA5 = (
    '"TOA5","mast","CR1000X","1","s","p","9","fast"\r\n"TIMESTAMP","a","b","c"\r\n'
    '"TS","m","rad",""\r\n"","Smp","Smp","Smp"'
)
DIALECTS = {  # name: (content, delimiter, decimal, encoding, times are text)
    "comma": (table(",", "."), ",", ".", "utf-8", False),
    "comma, CRLF, mark": (table(",", ".", "\r\n"), ",", ".", "utf-8-sig", False),
    "semicolon": (table(";", ",", "\r\n"), ";", ",", "cp1252", False),
    "semicolon, units below": (table(";", ",", header="Zeit|a|b|c", below="s|m|°|1"), ";", ",", "latin-1", False),
    "tab": (table("\t", ".", "\r"), "\t", ".", "utf-8", False),
    "tab, decimal comma": (table("\t", ",", above="# site: hill\n# more"), "\t", ",", "utf-8", False),
    "blanks": (table(" ", ".", header="time|a|b|c"), " ", ".", "utf-8", False),
    "no header": (table("  ", ".", header=""), " ", ".", "utf-8", False),
    "UTF-16": (table("\t", ".", "\r\n"), "\t", ".", "utf-16", False),
    "moments": (table(",", ".", stamp=True), ",", ".", "utf-8", True),
    "TOA5": (table(",", ".", "\r\n", TOA5, "", stamp=True, quote='"'), ",", ".", "utf-8", True),
}  # fmt: skip


@contextmanager
def in_time(seconds=10):
    def too_long(*_):
        raise TimeoutError("reading hangs")

    old = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, old)


def outcome(path, mapping=None):
    """The record, or None if the file is refused in one line; anything else fails."""
    with in_time(), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return read_record(path, mapping=mapping)
        except (RecordError, ConfigurationError) as error:
            line = str(error)
    assert "\n" not in line
    assert line.startswith((str(path), "mapping: "))
    assert len(line) < 600
    return None


def same_column(read, truth, factors=FACTORS):
    """Whether a column is the file's, in some unit."""
    return any(np.array_equal(read, truth * factor, equal_nan=True) for factor in factors)


def check_rows_are_the_files(record, data, dialect):
    _, delimiter, decimal, encoding, stamps = dialect
    width = len(record.channels) + 1
    found = [damage.rows_of(data, delimiter, decimal, encoding, width, stamps)]
    if not len(found[0][0]):  # the damage may have made a table in another dialect
        marks = [(d, p) for d in ",;\t " for p in ".,"]
        found = [damage.rows_of(data, d, p, encoding, width, stamps) for d, p in marks]
        # A last column without name and values is a delimiter at the end of every line.
        wider = [damage.rows_of(data, d, p, encoding, width + 1, stamps) for d, p in marks]
        found += [(rows[:, :-1], strangers) for rows, strangers in wider if np.isnan(rows[:, -1]).all()]
    rows, strangers = max(found, key=lambda pair: len(pair[0]))
    if record.attributes.get("format") == "TOA5":
        rows[np.isinf(rows)] = np.nan  # an overflow of the logger
    assert strangers == 0, "a line between the rows was left out"
    assert record.samples in ({len(rows)} if "cut_off" not in record.attributes else {len(rows), len(rows) - 1})
    if not stamps:
        steps = rows[: record.samples, 0] - rows[0, 0]
        assert any(
            np.allclose(record.time - record.time[0], steps * factor, rtol=1e-9, atol=1e-9) for factor in FACTORS
        )
    for i in range(width - 1):
        truth = rows[: record.samples, i + 1]
        assert same_column(record.values[:, i], truth), f"column {i} is not the file's"


def fuzz_csv(folder, count, seed):
    rng = np.random.default_rng(seed)
    read = 0
    for k in range(count):
        name = list(DIALECTS)[k % len(DIALECTS)]
        content, _, _, encoding, _ = DIALECTS[name]
        whole = content.encode(encoding)
        changes = damage.BYTES + (damage.LINES if encoding != "utf-16" else [])
        change = changes[rng.integers(0, len(changes))]
        data = change(whole, rng)
        if rng.random() < 0.15 and data:
            second = changes[rng.integers(0, len(changes))]
            if (change, second) != (damage.many_columns, damage.many_columns):  # equal columns are kept once
                data = second(data, rng)
            change = second if second is not damage.truncate else damage.change_bytes
        path = write(folder, data or b"\n")
        try:
            record = outcome(path)
            if record is not None:
                read += 1
                check_rows_are_the_files(record, data, DIALECTS[name])
        except BaseException as error:
            error.add_note(f"{name}, {change.__name__}, file {k} of seed {seed}")
            (folder / "bad.csv").write_bytes(data)
            raise
    return read


def test_damaged_text_is_refused_or_read_as_it_stands(tmp_path):
    read = fuzz_csv(tmp_path, 66, 1)  # six of each dialect
    assert read > 11  # or nothing was tested


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10, 16))
def test_much_more_damaged_text(tmp_path, seed):
    fuzz_csv(tmp_path, 3000, seed)


@pytest.mark.parametrize("name", list(DIALECTS))
def test_text_that_is_cut_off_gives_the_rows_before_the_cut(tmp_path, name):
    content, _, _, encoding, _ = DIALECTS[name]
    data = content.encode(encoding)
    whole = read_record(write(tmp_path, data))
    assert whole.samples == 60
    rng = np.random.default_rng(4)
    for cut in rng.integers(len(data) // 2, len(data), 25):
        part = data[:cut]
        record = read_record(write(tmp_path, part))
        kept = part.decode(encoding, errors="ignore").replace("\r\n", "\n").replace("\r", "\n").count("\n")
        headers = content.replace("\r\n", "\n").replace("\r", "\n").count("\n") - 60
        assert record.samples in (kept - headers, kept - headers + 1)
        assert record.time.tobytes() == whole.time[: record.samples].tobytes()
        np.testing.assert_array_equal(record.values, whole.values[: record.samples])


@pytest.mark.parametrize("name", [name for name in DIALECTS if name != "UTF-16"])
def test_mixed_line_ends_change_nothing(tmp_path, name):
    content, _, _, encoding, _ = DIALECTS[name]
    whole = read_record(write(tmp_path, content.encode(encoding)))
    rng = np.random.default_rng(5)
    lines = content.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    for _ in range(5):
        ends = [["\n", "\r\n", "\r"][i] for i in rng.integers(0, 3, len(lines))]
        record = read_record(write(tmp_path, "".join(map(str.__add__, lines, ends)).encode(encoding)))
        assert record.time.tobytes() == whole.time.tobytes()
        assert record.values.tobytes() == whole.values.tobytes()


def fuzz_checked(folder, name, count, seed):
    """Files with checksums: what is read is what was written, up to a damaged name or unit."""
    time, values = channels()
    truth = Record(time, values, ("a", "b", "c"), ("m", "rad", "1"))
    write_record(truth, folder / f"good{name}")
    whole = (folder / f"good{name}").read_bytes()
    rng, read = np.random.default_rng(seed), 0
    for k in range(count):
        change = damage.BYTES[rng.integers(0, len(damage.BYTES))]
        data = change(whole, rng)
        path = write(folder, data or b"\n", f"x{name}")
        try:
            record = outcome(path)
            if record is not None:
                read += 1
                assert any(np.array_equal(record.time, time * factor) for factor in FACTORS)
                for i in range(len(record.channels)):
                    found = ~np.isnan(record.values[:, i])  # a block that is lost is missing
                    assert any(same_column(record.values[found, i], column[found]) for column in values.T)
        except BaseException as error:
            error.add_note(f"{change.__name__}, file {k} of seed {seed}")
            (folder / f"bad{name}").write_bytes(data)
            raise
    return read


def test_damaged_parquet_is_refused_or_what_was_written(tmp_path):
    pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    fuzz_checked(tmp_path, ".parquet", 100, 2)


def test_damaged_netcdf_is_refused_or_what_was_written(tmp_path):
    fuzz_checked(tmp_path, ".nc", 60, 3)


@pytest.mark.slow
@pytest.mark.parametrize("name", [".parquet", ".nc"])
@pytest.mark.parametrize("seed", range(3))
def test_many_more_damaged_binary_files(tmp_path, name, seed):
    if name == ".parquet":
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    fuzz_checked(tmp_path, name, 1000, 100 + seed)


@pytest.mark.parametrize("count", [75, pytest.param(600, marks=pytest.mark.slow)])
def test_damaged_packed_openfast_is_refused_or_decoded_as_it_stands(tmp_path, count):
    from tests.records.formats.test_formats import outb

    values = channels()[1]
    whole = outb(values, ["a", "b", "c"], ["(m)", "(rad)", "(-)"], scale=50.0)
    body = len(whole) - values.size * 2
    rng, read = np.random.default_rng(6), 0
    for k in range(count):
        change = damage.BYTES[rng.integers(0, len(damage.BYTES))]
        data = change(whole, rng)
        path = write(tmp_path, data or b"\n", "x.outb")
        try:
            record = outcome(path)
            if len(data) < len(whole) and data[:10] == whole[:10]:
                assert record is None
            if record is not None and data[:body] == whole[:body]:
                read += 1
                packed = np.frombuffer(data[body : len(whole)], "<i2").reshape(-1, 3)
                np.testing.assert_array_equal(record.values, packed / 50.0)
            if record is not None:
                pieces = list(iterate_record(path, 0.2))
                np.testing.assert_array_equal(np.concatenate([p.values for p in pieces]), record.values)
        except BaseException as error:
            error.add_note(f"{change.__name__}, file {k}")
            raise
    assert read > count / 10
    assert struct.unpack_from("<h", whole) == (2,)


@pytest.mark.parametrize("count", [60, pytest.param(500, marks=pytest.mark.slow)])
def test_damaged_openfast_text_is_refused_or_read_as_it_stands(tmp_path, count):
    time, values = channels()
    head = "\nmade by hand\n\n\na test\n\nTime\ta\tb\tc\n(s)\t(m)\t(rad)\t(-)\n"
    rows = ["\t".join([f"{t:.2f}", *(f"{x:.3f}" for x in row)]) for t, row in zip(time, values, strict=True)]
    whole = (head + "\n".join(rows) + "\n").encode()
    rng, read = np.random.default_rng(7), 0
    changes = damage.BYTES + damage.LINES
    for k in range(count):
        change = changes[rng.integers(0, len(changes))]
        data = change(whole, rng)
        path = write(tmp_path, data or b"\n", "x.out")
        try:
            record = outcome(path)
            if record is not None:
                read += 1
                rows_left = damage.rows_of(data, " ", ".", "utf-8", len(record.channels) + 1, False)[0]
                assert record.samples == len(rows_left)
                for i in range(len(record.channels)):
                    assert same_column(record.values[:, i], rows_left[:, i + 1])
        except BaseException as error:
            error.add_note(f"{change.__name__}, file {k}")
            (tmp_path / "bad.out").write_bytes(data)
            raise
    assert read > count / 10
