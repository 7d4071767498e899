"""What is needed later is compiled by a second process, which is started once, and only when something is compiled."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from windsysid.filters import ekf
from windsysid.kernels import ahead


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The commands that were started, on a machine of two processors."""
    commands: list[list[str]] = []

    def start(command: list[str], **_: Any) -> None:
        commands.append(command)

    monkeypatch.setattr(ahead, "usable_processors", lambda: [0, 1])
    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(ahead, "_later", [])
    monkeypatch.setattr(ahead, "_processes", [])
    return commands


def test_nothing_is_started_where_nothing_is_compiled_or_wanted(started: list[list[str]]) -> None:
    ahead.something_is_compiled()
    ahead.compile_ahead(ekf.run_kernel)
    assert not started


def test_the_second_process_is_started_once(started: list[list[str]]) -> None:
    ahead.compile_ahead(ekf.run_kernel)
    ahead.something_is_compiled()
    ahead.something_is_compiled()
    assert started == [[sys.executable, "-m", "windsysid.kernels.ahead", "windsysid.filters.ekf:run_kernel"]]


def test_one_processor_has_nothing_to_gain(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "usable_processors", lambda: [0])
    ahead.compile_ahead(ekf.run_kernel)
    ahead.something_is_compiled()
    assert not started


def test_what_the_second_process_compiles_is_in_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WINDSYSID_CACHE", str(tmp_path))
    subprocess.run([sys.executable, "-m", "windsysid.kernels.ahead", "windsysid.kernels.philox:_uniform"], check=True)
    assert [path.suffix for path in (tmp_path / "kernels").glob("*philox*")] == [".kernel"]
