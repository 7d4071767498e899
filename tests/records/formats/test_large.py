import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.records.formats.helpers import refused, write
from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats import iterate_record, read_record, write_record
from windsysid.records.record import Record

NAMES = ["x.csv", "x.nc", "x.parquet", "x.outb", "x.out"]


def make(folder, name, rows=5000, gap=True):
    """A record of 100 Hz with a gap, in the format that the name says."""
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    if ".out" in name:
        from tests.records.formats.test_formats import out, outb

        values = np.tile(np.arange(rows)[:, None] % 300, (1, 9)).astype(float)
        return write(folder, outb(values) if name.endswith("b") else out(values), name)
    time = np.arange(rows) * 0.01
    time[rows // 2 :] += 7.0 if gap else 0.0
    values = np.random.default_rng(2).standard_normal((rows, 3))
    write_record(Record(time, values, ("a", "b", "c"), ("m", "rad", "1")), folder / name)
    return folder / name


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Blocks of a few rows, so that their seams are tested."""
    from windsysid.records.formats import csv, netcdf, parquet
    from windsysid.records.formats.text import text

    plain = text.line_blocks
    monkeypatch.setattr(csv, "line_blocks", lambda *a, **k: plain(*a, **{"size": 1000, **k}))
    monkeypatch.setattr(csv, "_HEAD", 4000)
    monkeypatch.setattr(netcdf, "_VALUES", 1000)
    monkeypatch.setattr(netcdf, "_MAX_VALUES_AT_ONCE", 100)
    monkeypatch.setattr(parquet, "_VALUES", 1000)


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one in ("x.csv", "x.nc"))) for one in NAMES]
)
def test_a_section_read_is_the_section_of_the_whole(tmp_path, name):
    path = make(tmp_path, name)
    whole = read_record(path)
    last = whole.time[-1]
    for start, end in [
        (0.0, last),
        (0.0, 1.0),
        (3.0, 3.5),
        (20.0, 34.0),
        (last - 1.0, last + 0.01),
        (last - 0.02, last),
    ]:
        part, expected = read_record(path, section=(start, end)), whole.section(start, end)
        assert part.time.tobytes() == expected.time.tobytes()
        np.testing.assert_array_equal(part.values, expected.values)
        assert (part.channels, part.units, part.attributes) == (expected.channels, expected.units, expected.attributes)
    for start, end in [(-1.0, 1.0), (1.0, 100.0), (90.0, 91.0), (2.0, 2.0), (3.0, 2.0), (2.001, 2.002), (-9.0, -8.0)]:
        refused(path, "the record runs from 0 to" if start < end else "is empty", section=(start, end))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seconds", [0.5, 3.0, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.013, 100.0))])
def test_pieces_together_are_the_whole(tmp_path, name, seconds):
    path = make(tmp_path, name, 1000)
    whole = read_record(path)
    pieces = list(iterate_record(path, seconds))
    assert np.concatenate([piece.time for piece in pieces]).tobytes() == whole.time.tobytes()
    np.testing.assert_array_equal(np.concatenate([piece.values for piece in pieces]), whole.values)
    assert all(piece.channels == whole.channels for piece in pieces)
    if seconds == 0.5:
        assert {piece.samples for piece in pieces} <= {49, 50, 51}


@pytest.mark.parametrize("name", NAMES)
def test_pieces_of_a_section_are_the_section(tmp_path, name):
    path = make(tmp_path, name, 1000)
    whole = read_record(path)
    start, end = float(whole.time[150]), float(whole.time[-100])
    pieces = list(iterate_record(path, 0.5, section=(start, end)))
    expected = whole.section(start, end)
    assert np.concatenate([piece.time for piece in pieces]).tobytes() == expected.time.tobytes()
    np.testing.assert_array_equal(np.concatenate([piece.values for piece in pieces]), expected.values)
    assert pieces[0].samples in (49, 50, 51)  # counted from the section's start
    for outside in ((-1.0, 1.0), (1.0, 100.0), (2.0, 2.0)):
        with pytest.raises(RecordError, match="the section"):
            list(iterate_record(path, 0.5, section=outside))


def test_a_bad_place_beyond_the_first_block_is_named(tmp_path):
    path = make(tmp_path, "x.csv", 820, gap=False)
    lines = path.read_text().split("\n")
    for at, rows, message in [
        (700, [lines[699], lines[699]], "repeated at line 701"),
        (800, ["7.99,1,x,2"], r"column 'b \[rad\]', line 801: 'x'"),
        (800, ["7.99,1,inf,2"], "channel 'b' is infinite at line 801"),
        (800, ["7.99,1"], "line 801 has 2 cells"),
    ]:
        bad = write(tmp_path, "\n".join([*lines[:at], *rows, *lines[at + 1 :]]), "bad.csv")
        refused(bad, message)
        with pytest.raises(RecordError, match=message):
            list(iterate_record(bad, 1.0))


def test_pieces_of_no_length_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="seconds_per_piece is 0"):
        list(iterate_record(make(tmp_path, "x.csv"), 0))


@pytest.mark.parametrize("name", NAMES)
def test_progress_rises_from_nothing_to_all(tmp_path, name):
    seen: list[float] = []
    read_record(make(tmp_path, name, 2000), progress=seen.append)
    assert seen == sorted(seen)
    assert (seen[0], seen[-1]) == (0.0, 1.0)
    if name in ("x.csv", "x.nc", "x.parquet"):
        assert len(seen) > 5


MEMORY = """
import sys
import numpy, pandas, xarray, h5netcdf
try:
    import pyarrow.parquet
except ImportError:
    pass
from windsysid.records.formats import iterate_record, read_record
def most():
    # Greatest memory of this process so far [kB]; getrusage would count that of the process that started it.
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
path = sys.argv[1]
read_record(path, section=(0.0, 1.0))
before = most()
samples = sum(piece.samples for piece in iterate_record(path, 100.0))
late = read_record(path, section=(2900.0, 2901.0)).samples
print(samples, late, (most() - before) / 1024)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="how much memory was used is asked of Linux")
@pytest.mark.parametrize(
    "name", ["x.csv", *(pytest.param(name, marks=pytest.mark.slow) for name in ("x.outb", "x.nc", "x.parquet"))]
)
def test_reading_in_pieces_needs_little_memory(tmp_path, name, monkeypatch):
    monkeypatch.undo()  # blocks of the size that users have
    rows = 600_000 if name in ("x.parquet", "x.outb") else 300_000  # the libraries themselves take 40 to 60 MB
    columns = 40 if name != "x.csv" else 8
    names = tuple(f"c{i}" for i in range(columns))
    if name == "x.outb":
        from tests.records.formats.test_formats import outb

        path = write(tmp_path, outb(np.ones((rows, columns)), list(names), ["(m)"] * columns), name)
    elif name == "x.csv":
        row = ",".join(["0.123456789"] * columns)
        lines = (f"{k / 100:.2f},{row}\n" for k in range(rows))
        path = write(tmp_path, "time," + ",".join(f"c{i}" for i in range(columns)) + "\n" + "".join(lines), name)
    else:
        if name == "x.parquet":
            pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
        path = tmp_path / name
        write_record(Record(np.arange(rows) / 100.0, np.ones((rows, columns)), names, ("m",) * columns), path)
    shown = subprocess.run([sys.executable, "-c", MEMORY, str(path)], capture_output=True, text=True, check=True)
    samples, late, megabytes = shown.stdout.split()
    assert (int(samples), int(late)) == (rows, 100)
    whole = rows * (columns + 1) * 8 / 2**20  # 94 or 188 MB, 21 MB for CSV
    assert float(megabytes) < (0.5 * whole if name != "x.csv" else whole)


@pytest.mark.slow
def test_ten_million_rows_of_text_are_read(tmp_path):
    path = tmp_path / "x.csv"
    with path.open("w") as file:
        file.write("time [s],a [m],b [m],c [m]\n")
        for k in range(0, 10_000_000, 100_000):
            file.write("".join(f"{i / 100:.2f},{i % 997}.5,-0.25,{i % 13}e-3\n" for i in range(k, k + 100_000)))
    record = read_record(path)
    assert record.samples == 10_000_000
    np.testing.assert_array_equal(record["a"], np.arange(10_000_000) % 997 + 0.5)
