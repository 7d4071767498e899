"""The commands live and export: what is wrong is said in lines, and a store becomes an archive."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from windsysid.cli import app
from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.fleet.rows import empty_row
from windsysid.live.store import open_store
from windsysid.live.store.contents import Commit, SeriesLevel
from windsysid.live.store.contents import Result as Stored
from windsysid.turbine.file import packaged_file

CONFIG = """
store = "store.sqlite"
[[turbine]]
name = "T01"
turbine = "tower"
[[source]]
kind = "mqtt"
broker = "mqtt://localhost"
"""

LEVEL = SeriesLevel("k_side_side", "N/m", "k", 1.0, 0.9, 1.1, 1.0, 0.95, 1.05, 0.0, 10.0)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_check_says_that_nothing_is_wrong_and_touches_nothing(tmp_path: Path):
    (tmp_path / "live.toml").write_text(CONFIG, encoding="utf-8")
    found = run("live", tmp_path / "live.toml", "--check")
    assert found.exit_code == 0, found.output
    assert "valid; 1 turbine, store" in found.output
    assert "source: MQTT broker mqtt://localhost, 1 turbine\n" in found.output
    assert [path.name for path in tmp_path.iterdir()] == ["live.toml"]


def test_all_that_is_wrong_is_said_in_a_line_each(tmp_path: Path):
    (tmp_path / "live.toml").write_text(CONFIG + "[page]\nport = -1\nhots = 3\n", encoding="utf-8")
    found = run("live", tmp_path / "live.toml")
    assert found.exit_code == 2
    lines = found.stderr.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("windsysid: ") for line in lines)
    assert "[page]: port: expected a whole number of 0 to 65535, got -1" in lines[0]
    assert "[page]: unknown key 'hots' (meant 'host'?)" in lines[1]


def test_a_file_of_another_kind_takes_few_lines(tmp_path: Path):
    """It took a line for each key that it has."""
    (tmp_path / "live.toml").write_text(packaged_file("tower"), encoding="utf-8")
    lines = run("live", tmp_path / "live.toml").stderr.splitlines()
    assert len(lines) <= 5, lines
    assert re.search(r"unknown keys 'name', 'description', '\w+' and \d+ more: expected store, ", lines[-1])


def test_of_many_faults_the_first_are_printed_and_all_by_check(tmp_path: Path):
    wrong = "".join(f"[[turbine]]\nname = {k}\n" for k in range(9))
    (tmp_path / "live.toml").write_text(wrong, encoding="utf-8")
    few = run("live", tmp_path / "live.toml").stderr.splitlines()
    every = run("live", tmp_path / "live.toml", "--check").stderr.splitlines()
    assert len(few) == 6
    assert few[:5] == every[:5]
    assert f"and {len(every) - 5} more: windsysid live --check" in few[5]


@pytest.mark.parametrize("options", [[], ["live.toml", "--demo"]])
def test_either_a_file_or_the_demo_is_asked_for(options: list[str]):
    assert isinstance(run("live", *options).exception, ConfigurationError)


def test_a_store_becomes_an_archive(tmp_path: Path):
    store = open_store(str(tmp_path / "store.sqlite"))
    row = empty_row("T01 2026-01-05", 0, "sha256:0")
    row |= {"status": "refused", "why": "short", "start": "2026-01-05T12:00Z"}
    store.submit(Commit(results=[Stored("T01", 10**18, 10**18 + 600 * 10**9, 0, row, (LEVEL,), b"")])).result()
    store.close()
    found = run("export", tmp_path / "store.sqlite", "--output", tmp_path / "archive", "--levels", tmp_path / "levels")
    assert found.exit_code == 0, found.output
    assert "T01: 1 rows added" in found.output
    assert list((tmp_path / "archive").glob("turbine=T01/*/*.parquet"))
    again = run("export", tmp_path / "store.sqlite", "--output", tmp_path / "archive")
    assert "T01: 0 rows added" in again.output


def test_a_store_that_is_not_there_is_not_made(tmp_path: Path):
    found = run("export", tmp_path / "store.sqlite", "--output", tmp_path / "archive")
    assert isinstance(found.exception, WindsysidError)
    assert not list(tmp_path.iterdir())
