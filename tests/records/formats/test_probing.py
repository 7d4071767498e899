"""A file in which the HDF5 library hangs or crashes is refused, and the session of the user goes on."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.records.formats.helpers import refused
from windsysid.records.formats import probing, read_record
from windsysid.records.formats.probing import Guard

T = 100


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Guard, "on", False)


@pytest.fixture(params=[".h5", ".nc", ".mat"])
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


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("does", "told"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "the HDF5 library crashes in it"),
        ("while True: pass", "the HDF5 library hangs in it"),
    ],
)
def test_what_hangs_or_crashes_is_one_line(
    path: Path, does: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    reader = tmp_path / "reader.py"
    reader.write_text(does)
    monkeypatch.setattr(probing, "READER", reader)
    monkeypatch.setattr(probing, "SECONDS", 0.5)
    monkeypatch.setattr(probing, "WAIT_FACTOR", 1.0)
    refused(path, told)


@pytest.mark.usefixtures("alone")
def test_a_sound_file_is_read_as_ever(path: Path):
    record = read_record(path)
    np.testing.assert_array_equal(record["sway"], np.sin(np.arange(T)))
    assert probing._probed.cache_info().currsize >= 1


def test_the_reader_reads_all_of_it(path: Path):
    import subprocess
    import sys

    done = subprocess.run([sys.executable, "-P", str(probing.READER), str(path), "20"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
