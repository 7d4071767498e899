"""The command line loses nothing of the user's: neither files that exist nor results when the disk is full."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.disks import files_of_at_most
from windsysid.output.folders import claim
from windsysid.records.formats import read_record, write_record
from windsysid.results.posterior import load_posterior
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("records") / "good.csv"
    write_record(simulate_record(load_turbine("verne555"), duration=20.0, rate=100.0, seed=1), path)
    return path


@pytest.fixture(scope="module")
def brief(record: Path) -> Path:
    """The first four seconds of it."""
    write_record(read_record(record).section(0.0, 4.0), record.with_name("brief.csv"))
    return record.with_name("brief.csv")


def test_overwriting_keeps_what_is_the_users_and_leaves_the_new_result(run, record, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert run("inspect", record, "--output", out).code == 0
    mine = {"good.txt": "years", "notes/today.md": "of work", "figures/overview.png": "mine"}
    for name, text in mine.items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text(text)
    monkeypatch.chdir(out)  # --output . lost even the new result
    assert run("inspect", record, "--output", ".", "--overwrite", "--section-length", "5").code == 0
    assert {name: (out / name).read_text() for name in mine} == mine
    assert {path.name for path in out.glob("[!.]*")} == {
        "inspection.json", "report.html", "good.txt",
        "notes", "figures",
    }  # fmt: skip


@pytest.mark.parametrize(
    "command",
    [("modes",), ("compare", "other"), ("damping", "other"), ("monitor", "other"), ("compare", "other", "swap")],
)
def test_the_result_that_is_read_is_not_overwritten(run, tmp_path, command):
    kept = {"summary.json": b"{}", "identification.nc": b"a long night"}
    for name in ("result", "other"):
        with claim(tmp_path / name) as write:
            write(kept)
    read = [tmp_path / "result", *(tmp_path / name for name in command[1:2])]
    if "swap" in command:
        read.reverse()
    ended = run(command[0], *read, "--output", tmp_path / "result", "--overwrite")
    assert ended.code == 2
    assert ended.err == [
        f"windsysid: output {tmp_path / 'result'} is the result that is to be read: choose another folder"
    ]
    assert {path.name: path.read_bytes() for path in (tmp_path / "result").glob("[!.]*")} == kept


@pytest.mark.parametrize("command", [("identify", "--turbine", "verne555"), ("inspect",)])
def test_the_folder_of_the_record_is_not_for_results(run, record, tmp_path, command):
    mine = tmp_path / "data" / "good.csv"
    mine.parent.mkdir()
    mine.write_bytes(record.read_bytes())
    (mine.parent / "summary.json").write_text("mine")
    ended = run(command[0], mine, *command[1:], "--output", mine.parent, "--overwrite")
    assert (ended.code, ended.out) == (2, "")
    assert "holds good.csv, which is to be read: choose a folder of its own" in ended.err[0]
    assert {path.name for path in mine.parent.iterdir()} == {"good.csv", "summary.json"}


def test_two_commands_do_not_share_an_output(run, record, tmp_path, monkeypatch):
    def work(*_: object, **__: object) -> None:
        pytest.fail("the second began its work")

    monkeypatch.setattr("windsysid.identification.identify.identify", work)
    monkeypatch.setattr("windsysid.simulation.record.simulate_record", work)
    with claim(tmp_path / "out"):
        ended = run("identify", record, "--turbine", "verne555", "--output", tmp_path / "out")
    assert (ended.code, len(ended.err), ended.out) == (2, 1, "")
    assert "another windsysid is writing there" in ended.err[0]
    (tmp_path / "x.csv").write_text("mine")
    for name, complaint in (("x.csv", "already there"), ("x.xlsx", "cannot write files ending in '.xlsx'")):
        ended = run("simulate", "--turbine", "tower", "--output", tmp_path / name)
        assert ended.code == 2
        assert complaint in ended.err[0]
    assert (tmp_path / "x.csv").read_text() == "mine"


def test_a_simulated_record_finds_its_folder_made(run, tmp_path):
    assert run("simulate", "--turbine", "tower", "--duration", "5", "--output", tmp_path / "new" / "x.nc").code == 0
    assert read_record(tmp_path / "new" / "x.nc").samples == 500
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["x.nc"]


@pytest.mark.parametrize("name", ["x.nc", "x.csv", "x.parquet"])
def test_a_full_disk_while_a_record_is_written_is_one_line(run, tmp_path, name):
    if name == "x.parquet":
        pytest.importorskip("pyarrow")
    command = ("simulate", "--turbine", "tower", "--duration", "5", "--output", tmp_path / name)
    assert run(*command).code == 0
    before = (tmp_path / name).read_bytes()
    with files_of_at_most(4000):
        ended = run(*command, "--overwrite", "--seed", "2")
    assert ended.code == 2
    assert len(ended.err) == 1
    assert "cannot be written: File too large" in ended.err[0]
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [(name, before)]


def test_a_full_disk_does_not_take_the_estimates_away(run, record, tmp_path):
    options = ("--turbine", "verne555", "--no-report", "--section", "0", "5")
    command = ("identify", record, *options, "--output", tmp_path / "out")
    assert run(*command).code == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").glob("[!.]*")}
    with files_of_at_most(4000):
        ended = run(*command, "--overwrite", "--prior-scale", "1.1")
    assert ended.code == 2
    assert "k_beta_3" in ended.out  # printed before it was saved
    assert len(ended.err) == 1
    assert "cannot be written: File too large; choose another folder, with space left" in ended.err[0]
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").glob("[!.]*")} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_run_in_pieces_keeps_what_it_knows_until_the_result_is_saved(run, brief, tmp_path, monkeypatch):
    command = (
        "identify",
        brief,
        "--turbine",
        "verne555",
        "--no-report",
        "--in-pieces",
        "2 s",
        "--output",
        tmp_path / "out",
    )
    assert run(*command).code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    reference = load_posterior(tmp_path / "out").theta
    with files_of_at_most(4000):
        ended = run(*command, "--overwrite")
    assert (ended.code, len(ended.err)) == (2, 1)
    assert ".out.checkpoint.npz cannot be written: File too large" in ended.err[0]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("windsysid.output.folders._commit", full)
        ended = run(*command, "--overwrite")
    assert ended.code == 2
    assert "k_beta_3" in ended.out
    assert {path.name for path in tmp_path.iterdir()} == {"out", ".out.checkpoint.npz"}
    assert run(*command, "--overwrite").code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (load_posterior(tmp_path / "out").theta == reference).all()


def test_a_section_comes_in_pieces(run, brief, tmp_path):
    command = ("identify", brief, "--turbine", "verne555", "--no-report", "--in-pieces", "2 s", "--section")
    ended = run(*command, "1", "4", "--output", tmp_path / "out")
    assert ended.code == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["section"] == pytest.approx([1.0, 4.0], abs=0.03)
    ended = run(*command, "1", "900", "--output", tmp_path / "other")
    assert ended.code == 2
    assert "reaches outside the record" in ended.err[0]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_command_that_is_told_to_end_leaves_nothing_half_done(tmp_path):
    command = ("simulate", "--turbine", "tower", "--duration", "100000", "--output", str(tmp_path / "new" / "x.csv"))
    with subprocess.Popen(
        [sys.executable, "-m", "windsysid", *command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        while not list(tmp_path.glob("new/.*")):
            assert process.poll() is None
            time.sleep(0.02)
        time.sleep(0.2)
        os.kill(process.pid, signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    assert process.returncode not in (0, -signal.SIGTERM)
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
@pytest.mark.parametrize("command", [pytest.param("identify", marks=pytest.mark.slow), "inspect"])
def test_a_result_is_saved_though_nobody_reads_what_is_printed(tmp_path: Path, command: str):
    """``windsysid identify record.csv | head -3`` saved nothing."""
    record = tmp_path / "tower.csv"
    write_record(simulate_record("tower", duration=400.0, rate=4.0, seed=1), record)
    read, write = os.pipe()
    os.close(read)
    arguments = [command, str(record), "--turbine", "tower", "--output", str(tmp_path / "out")]
    arguments += ["--formulation", "spectral"] if command == "identify" else []
    with os.fdopen(write, "wb") as closed:
        ended = subprocess.run(
            [sys.executable, "-m", "windsysid", *arguments], stdout=closed, stderr=subprocess.PIPE, check=False
        )
    assert b"Traceback" not in ended.stderr
    assert (tmp_path / "out" / "report.html").exists()
