"""Names of files that no text can hold, links that lead nowhere and what is no file at all, in a folder of records."""

import os
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from tests.fleet.conftest import rows_of, workers_in_this_process
from windsysid.fleet.batch import batch
from windsysid.fleet.paths import UNKNOWN_SIZE, record_paths, size_or_unknown, why_missing
from windsysid.output.files import path_text

WET = "time [s],tower_x_acceleration [m/s^2]\n0,1\n1,wet\n"
NAMES = [
    b"nic\xe9.csv", b"a\nb.csv", b"ctrl\x1b[31mx.csv", b"n" * 240 + b".csv", b"d$$o.csv", b"[red]x[bold].csv",
    b"-dash.csv", b"<script>.csv", b"*.csv", b"sp ace .csv",
]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Damaged records of any name, a link that leads nowhere, one that leads to itself, a named pipe and a folder."""
    folder = tmp_path / "data"
    (folder / "sub.csv").mkdir(parents=True)
    for name in NAMES:
        try:
            Path(os.fsdecode(os.fsencode(folder) + b"/" + name)).write_text(WET)
        except OSError:
            pytest.skip("this file system has other names")
    (folder / "dangling.csv").symlink_to(tmp_path / "gone.csv")
    (folder / "loop.csv").symlink_to(folder / "loop.csv")
    os.mkfifo(folder / "pipe.csv")
    return folder


def test_files_and_broken_links_are_records_and_pipes_and_folders_are_none(folder: Path):
    found = record_paths(folder, folder / "archive")
    assert len(found) == len(NAMES) + 2
    assert all(path.encode() for path in found)
    assert not [path for path in found if path.endswith(("pipe.csv", "sub.csv"))]
    assert record_paths(f"{folder}/*.csv*", folder / "archive") == found
    assert record_paths(folder / "loop.csv", folder / "archive") == [str(folder / "loop.csv")]


def test_a_pipe_alone_is_no_record(folder: Path):
    with pytest.raises(ValueError, match=r"pipe\.csv: expected a file, a folder or a pattern with records, got none"):
        record_paths(folder / "pipe.csv", folder / "archive")


@pytest.mark.parametrize("workers", [workers_in_this_process, pytest.param(nullcontext, marks=pytest.mark.slow)])
def test_every_file_has_its_row_and_says_what_to_do(folder: Path, tmp_path: Path, workers: Callable[[], Any]):
    for _ in range(2):  # the second time what failed is tried again, and what was refused is known
        with workers():
            found = batch(folder, archive=tmp_path / "archive", turbine="tower", workers=1)
    assert found.taken == {"failed": 3}
    assert found.known == len(NAMES) - 1
    rows = {Path(row["source"]).name: row for row in rows_of(tmp_path / "archive", "tower")}
    assert len(rows) == len(NAMES) + 2
    assert (rows["dangling.csv"]["status"], rows["dangling.csv"]["tries"]) == ("failed", 2)
    assert rows["dangling.csv"]["why"] == "the target of the link does not exist: correct or remove the link"
    assert rows["loop.csv"]["why"] == rows["dangling.csv"]["why"]
    assert "rename the file" in rows["nic\\xe9.csv"]["why"]
    others = [row for name, row in rows.items() if row["status"] == "refused"]
    assert len(others) == len(NAMES) - 1
    assert all("'wet' is not a number" in row["why"] for row in others)
    assert all(line.isprintable() for line in str(found).split("\n"))


def test_why_a_file_is_missing_is_said(tmp_path: Path):
    assert why_missing(str(tmp_path)) is None
    assert why_missing("s3://bucket/record.csv") is None
    assert why_missing(str(tmp_path / "gone.csv")) == "the file does not exist any more: copy it again"
    assert size_or_unknown(str(tmp_path / "gone.csv")) == UNKNOWN_SIZE
    assert path_text("/d/nic\udce9.csv") == "/d/nic\\xe9.csv"
    assert path_text("/d/niç.csv") == "/d/niç.csv"
