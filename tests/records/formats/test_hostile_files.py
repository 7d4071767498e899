"""A file costs time and memory for what it holds, not for what it says, and none reads other files of the machine."""

import resource
import struct
import time
from contextlib import contextmanager, suppress

import h5py
import numpy as np
import pytest
from validation.format_samples import SAMPLES, truth

from tests.records.formats.helpers import refused, write
from windsysid.errors import RecordError
from windsysid.records.formats import read_record

T = 200


@contextmanager
def cheap(seconds=5.0, megabytes=256.0):
    """What happens inside costs little."""
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert time.process_time() - began < seconds
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1024 * megabytes


def graph(file):
    """30 groups with 2^30 paths."""
    group = file.create_group("g")
    for _ in range(30):
        group["b"] = group.create_group("a")
        group = group["a"]


def circle(file):
    file.create_group("g")["root"] = file["/"]


def deep(file):
    group = file
    for _ in range(500):
        group = group.create_group("a")


def unwritten(file):
    file.create_dataset("big", (10**9,), "f8")


def unwritten_chunks(file):
    file.create_dataset("big", (10**5, 10**5), "f4", chunks=(100, 100))[0, 0] = 1.0


def unwritten_in_many(file):
    for k in range(100):
        file.create_dataset(f"n{k}", (10**5,), "f8")


def unwritten_time(file):
    del file["time"]
    file.create_dataset("time", (10**9,), "f8", chunks=(1000,))


def external(file):
    file.create_dataset("e", (100,), "u1", external=[("/etc/hostname", 0, 100)])


def virtual(file):
    layout = h5py.VirtualLayout((T,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "d", (T,))
    file.create_virtual_dataset("v", layout)


def link(file):
    file["l"] = h5py.ExternalLink("other.h5", "/d")


def made(folder, ending, fill):
    path = folder / f"x{ending}"
    with h5py.File(folder / "other.h5", "w") as other:
        other["d"] = np.full(T, 7.0)
    with h5py.File(path, "w", userblock_size=512 if ending == ".mat" else 0) as file:
        for name, unit, values in (("time", "s", 0.1 * np.arange(T)), ("sway", "m", np.sin(np.arange(T)))):
            file[name] = values
            file[name].attrs["units"] = unit
        file["time"].make_scale("time")
        file["sway"].dims[0].attach_scale(file["time"])
        fill(file)
    if ending == ".mat":
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


@pytest.mark.parametrize("ending", [".h5", ".nc", ".mat"])
@pytest.mark.parametrize("fill", [graph, circle])
def test_each_group_is_visited_once_however_many_paths_lead_to_it(tmp_path, ending, fill):
    path = made(tmp_path, ending, fill)
    with cheap():
        assert read_record(path).channels == ("sway",)


@pytest.mark.parametrize("ending", [".h5", ".nc", ".mat"])
@pytest.mark.parametrize(
    ("fill", "told"),
    [
        (deep, "levels deep"),
        (unwritten, "'big' declares 1000000000 values, most of which were never written"),
        (unwritten_chunks, "'big' declares 10000000000 values"),
        (unwritten_in_many, "declares 100000 values"),
        (unwritten_time, "'time' declares"),
        (external, "'e' has its values in another file, which is not read"),
        (virtual, "'v' has its values in another file, which is not read"),
    ],
)
def test_what_an_hdf5_file_declares_and_does_not_hold_is_refused(tmp_path, ending, fill, told):
    path = made(tmp_path, ending, fill)
    with cheap():
        refused(path, told)


def test_links_to_other_files_are_not_followed(tmp_path):
    for ending in (".h5", ".mat"):
        assert read_record(made(tmp_path, ending, link)).channels == ("sway",)
    refused(made(tmp_path, ".nc", link), "'l' is a link to another file, which is not followed")


def test_a_part_that_was_never_written_is_read_as_its_fill_value(tmp_path):
    def part(file):
        file.create_dataset("some", (T,), "f8", chunks=(10,), fillvalue=np.nan)[:20] = 1.0

    record = read_record(made(tmp_path, ".h5", part))
    assert np.isfinite(record["some"]).sum() == 20


def blocks_of(raw):
    """Kind and links of each block of an MDF file, by its first byte."""
    found, left = {}, [64]
    while left:
        at = left.pop()
        kind, count = raw[at + 2 : at + 4].decode("latin-1"), struct.unpack_from("<Q", raw, at + 16)[0]
        if at not in found and raw[at : at + 2] == b"##" and count < 100:
            found[at] = (kind, struct.unpack_from(f"<{count}Q", raw, at + 24))
            left += [link for link in found[at][1] if link]
    return found


def test_chains_of_mdf_blocks_that_come_back_are_refused(tmp_path):
    pytest.importorskip("asammdf")
    sample = SAMPLES["MDF 4"]
    path = tmp_path / "x.mf4"
    sample.write(path, *truth(sample))
    raw = path.read_bytes()
    blocks = blocks_of(raw)
    tried = 0
    for at, (kind, _) in blocks.items():
        if kind not in ("HD", "DG", "CG", "CN", "FH"):
            continue
        for target in [place for place, (other, _) in blocks.items() if other == kind and place <= at][:2]:
            content = bytearray(raw)
            struct.pack_into("<Q", content, at + 24, target)
            path.write_bytes(content)
            with cheap(2.0):
                refused(path, "comes back to byte")
            tried += 1
    assert tried > 10


def nested(depth, *, packed=False):
    """A MATLAB file of version 5 with structures in structures."""
    import zlib

    def element(kind, data):
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    def head(kind, name):
        shape = element(5, struct.pack("<2i", 1, 1))
        return element(6, struct.pack("<II", kind, 0)) + shape + element(1, name)

    body = element(14, head(6, b"") + element(9, struct.pack("<d", 1.0)))
    heads, size = [], len(body)
    for k in reversed(range(depth)):
        fields = struct.pack("<HHi", 5, 4, 2) + element(1, b"f\0")
        inside = head(2, b"s" if k == 0 else b"") + fields
        heads.append(struct.pack("<II", 14, len(inside) + size) + inside)
        size += len(heads[-1])
    body = b"".join(reversed(heads)) + body
    if packed:
        body = struct.pack("<II", 15, len(zlib.compress(body))) + zlib.compress(body)
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + body


@pytest.mark.parametrize("packed", [pytest.param(False, marks=pytest.mark.slow), True])
def test_matlab_structures_in_structures_do_not_end_the_interpreter(tmp_path, packed, monkeypatch):
    from windsysid.records.formats.access.probing import ProcessGuard

    monkeypatch.setattr(ProcessGuard, "on", False)
    refused(write(tmp_path, nested(20_000, packed=packed), "x.mat"), "MATLAB library crashes|is damaged")
    refused(write(tmp_path, nested(3, packed=packed), "x.mat"), "no series is known to be the time|no array of numbers")


LONG = [
    "0.1" + " " * 3_000_000 + "1",
    "0.1," + " \t" * 1_000_000 + "2",
    "1" * 1_000_000 + "x,2",
    "0.1," + '"a' * 500_000,
]


@pytest.mark.parametrize("line", LONG, ids=["blanks", "blanks and tabs", "digits", "quotes"])
@pytest.mark.parametrize("mark", [",", *(pytest.param(one, marks=pytest.mark.slow) for one in (";", " ", "\t"))])
def test_a_long_row_takes_a_time_in_proportion_to_its_length(tmp_path, line, mark):
    rows = [f"0{mark}1", line.replace(",", mark), f"1{mark}1", f"2{mark}2"]
    for k in (0, 1, 3):
        table = [*rows[:k], rows[1], *rows[k:]] if k != 1 else rows
        path = write(tmp_path, f"time [s]{mark}sway [m]\n" + "\n".join(table) + "\n")
        with cheap(2.0), suppress(RecordError):
            assert read_record(path).samples == 4


def test_a_long_line_of_a_universal_file_takes_a_time_in_proportion_to_its_length(tmp_path):
    pytest.importorskip("pyuff")
    sample = SAMPLES["UFF 58"]
    path = tmp_path / "x.uff"
    sample.write(path, *truth(sample))
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([*lines[:13], b" 1.00000e+00" * 100_000, *lines[13:]]))
    with cheap(2.0):
        refused(path, "set 58")
