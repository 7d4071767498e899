"""A file in which a library hangs, crashes or fills the memory is refused, and the session of the user goes on."""

import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
from validation.format_samples import SAMPLES, truth

from tests.records.formats.helpers import refused
from windsysid.records.formats import read_record
from windsysid.records.formats.access import probing
from windsysid.records.formats.access.probing import ProcessGuard

T = 100


def written(name: str, folder: Path) -> Path:
    sample = SAMPLES[name]
    if sample.package:
        pytest.importorskip(sample.package)
    path = folder / f"x{sample.ending}"
    sample.write(path, *truth(sample))
    return path


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ProcessGuard, "on", False)


@pytest.fixture(params=[".h5", *(pytest.param(one, marks=pytest.mark.slow) for one in (".nc", ".mat"))])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"mast{request.param}"
    with h5py.File(path, "w", userblock_size=512 if request.param == ".mat" else 0) as file:
        for name, unit, values in (("time", "s", 0.1 * np.arange(T)), ("sway", "m", np.sin(np.arange(T)))):
            file[name] = values
            file[name].attrs["units"] = unit
        if request.param == ".nc":
            file["time"].make_scale("time")
            file["sway"].dims[0].attach_scale(file["time"])
    if request.param == ".mat":
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


DOES = [
    ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "library crashes in it"),
    ("while True: pass", "library hangs in it"),
    ("import os; os._exit(3)", "library needs more than 268 MB"),
]


@pytest.mark.usefixtures("alone")
@pytest.mark.skipif(sys.platform != "linux", reason="forks on Linux only")
@pytest.mark.parametrize(("does", "told"), DOES)
def test_what_hangs_or_crashes_in_a_fork_is_one_line(path: Path, does: str, told: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(probing, "read", lambda *_: exec(does))
    monkeypatch.setattr(probing, "MAX_SECONDS", 1.0)
    monkeypatch.setattr(probing, "MAX_WALL_TIME_RATIO", 0.5)
    refused(path, told)


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(("does", "told"), DOES)
def test_what_hangs_or_crashes_in_another_interpreter_is_one_line(
    path: Path, does: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    reader = tmp_path / "reader.py"
    reader.write_text(does)
    monkeypatch.setattr(probing, "READER", reader)
    monkeypatch.setattr(probing, "MAX_SECONDS", 1.0)
    monkeypatch.setattr(probing, "MAX_WALL_TIME_RATIO", 0.5)
    with ThreadPoolExecutor(1) as others:  # no other thread than the main one forks
        others.submit(refused, path, told).result()


@pytest.mark.usefixtures("alone")
def test_a_sound_file_is_read_as_ever(path: Path):
    record = read_record(path)
    np.testing.assert_array_equal(record["sway"], np.sin(np.arange(T)))
    assert probing._probed.cache_info().currsize >= 1


@pytest.mark.usefixtures("alone")
@pytest.mark.skipif(sys.platform != "linux", reason="forks on Linux only")
@pytest.mark.parametrize(
    "name",
    ["HDF5", *(pytest.param(one, marks=pytest.mark.slow) for one in ("netCDF-4", "MATLAB 5–7", "MATLAB 7.3", "MDF 4"))],
)
def test_a_small_sound_file_costs_a_tenth_of_a_second_more(tmp_path: Path, name: str):
    sample = SAMPLES[name]
    path = written(name, tmp_path)
    read_record(path, mapping=sample.mapping)
    spent: dict[bool, list[float]] = {True: [], False: []}
    for on in (True, False) * 3:  # the least of three: other work on the machine adds to processor time
        ProcessGuard.on = on
        probing._probed.cache_clear()
        began = time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        read_record(path, mapping=sample.mapping)
        spent[on].append(time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - began)
    assert min(spent[False]) - min(spent[True]) < 0.1


@pytest.mark.parametrize(
    "name",
    ["HDF5", "MATLAB 5–7", *(pytest.param(one, marks=pytest.mark.slow) for one in ("netCDF-4", "MATLAB 7.3", "MDF 4"))],
)
def test_the_reader_reads_all_of_it(tmp_path: Path, name: str):
    path = written(name, tmp_path)
    library = {"MDF 4": "asammdf", "MATLAB 5–7": "scipy.io"}.get(name, "h5py")
    command = [sys.executable, "-P", str(probing.READER), library, str(path), "20", str(1 << 28)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.usefixtures("alone")
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory hold on Linux only")
@pytest.mark.parametrize("thread", [False, True])
def test_a_file_that_asks_for_more_memory_than_it_may_is_refused(
    path: Path, thread: bool, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(probing, "MAX_MEMORY", 1 << 22)
    with h5py.File(path, "r+") as file:
        file.create_dataset("block", data=np.zeros(1 << 24, "f4"), chunks=(1 << 24,), compression="gzip")
    if thread:
        with ThreadPoolExecutor(1) as others:
            others.submit(refused, path, "library needs more than").result()
    else:
        refused(path, "library needs more than")
