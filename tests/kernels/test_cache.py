"""The cache of compiled models: damaged files are made again, processes share it, old code never meets new sources."""

import importlib
import multiprocessing
import os
import pkgutil
import stat
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import windsysid
from tests.mechanics.models import symbols
from windsysid.kernels import assemble, cache, jit
from windsysid.mechanics import compile as compiling
from windsysid.mechanics import compile_model
from windsysid.mechanics.equations import Equations


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of this test's own."""
    for module in (jit, compiling):
        monkeypatch.setattr(module, "cache_folder", lambda: tmp_path)
    return tmp_path


def decay_rate(monkeypatch: pytest.MonkeyPatch) -> float:
    """−k x at k = 3 and x = 2 by a small compiled model, as a new process would load it."""
    monkeypatch.setattr(compiling, "_loaded", {})
    monkeypatch.setattr(assemble, "_assembled", {})
    x, k = symbols("x k")
    value = np.empty(1)
    model = compile_model(Equations("decay", (x,), (), (k,), (), (-k * x,)))
    model.rates(np.array([2.0]), np.zeros(0), np.array([3.0]), np.zeros(0), value)
    return float(value[0])


def flipped(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "emptied": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "flipped at the start": lambda content: flipped(content, 3),
    "flipped in the middle": lambda content: flipped(content, len(content) // 2),
    "flipped at the end": lambda content: flipped(content, len(content) - 3),
    "replaced": lambda content: b"\xff" * 200,
}


@pytest.mark.parametrize("ending", [".py", ".code", ".kernel"])
def test_a_damaged_file_is_made_again(folder: Path, monkeypatch: pytest.MonkeyPatch, ending: str):
    assert decay_rate(monkeypatch) == -6.0
    (path,) = folder.rglob(f"*{ending}")
    good = path.read_bytes()
    for what, damage in DAMAGE.items():
        path.write_bytes(damage(good))
        assert decay_rate(monkeypatch) == -6.0, what
        mended = path.read_bytes()
        assert mended == good or ending == ".kernel", what  # machine code may come out in another order
        assert cache.kept(path) is not None or ending == ".py", what
    assert len(list(folder.rglob("*.*"))) == 3


def test_a_whole_kernel_is_loaded_and_not_compiled_again(folder: Path, monkeypatch: pytest.MonkeyPatch):
    decay_rate(monkeypatch)
    kept = {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")}
    monkeypatch.setattr(jit, "keep", lambda *_: pytest.fail("compiled again"))
    assert decay_rate(monkeypatch) == -6.0
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")} == kept


def test_others_who_share_the_cache_can_read_it(folder: Path, monkeypatch: pytest.MonkeyPatch):
    usual = os.umask(0o022)
    try:
        decay_rate(monkeypatch)
    finally:
        os.umask(usual)
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert len(files) == 3
    for path in files:
        assert stat.S_IMODE(path.stat().st_mode) == 0o644, path.name


def test_a_cache_that_cannot_be_written_is_done_without(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    cache._announce_unwritable.cache_clear()
    assert decay_rate(monkeypatch) == -6.0
    assert [record.getMessage() for record in caplog.records if "No space left" in record.getMessage()]
    assert not [path for path in folder.rglob("*") if path.is_file()]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork, so that the processes start at the same moment")
@pytest.mark.parametrize("times", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_two_processes_compile_at_once_in_one_cold_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, times: int):
    context = multiprocessing.get_context("fork")
    made, keep = tmp_path / "made", cache.keep

    def note(path: Path, payload: bytes) -> None:
        with made.open("a") as file:
            file.write(f"{path.name}\n")
        keep(path, payload)

    monkeypatch.setattr(jit, "keep", note)
    for n in range(times):
        shared, start = tmp_path / str(n), context.Barrier(2)
        shared.mkdir()
        for module in (jit, compiling):
            monkeypatch.setattr(module, "cache_folder", lambda shared=shared: shared)

        def compile_at_once(start=start) -> None:
            start.wait()
            os._exit(0 if decay_rate(monkeypatch) == -6.0 else 1)

        both = [context.Process(target=compile_at_once) for _ in range(2)]
        for process in both:
            process.start()
        for process in both:
            process.join(60.0)
        assert [process.exitcode for process in both] == [0, 0]
        assert sorted(path.suffix for path in shared.rglob("*.*")) == [".code", ".kernel", ".py"]
        assert decay_rate(monkeypatch) == -6.0
        assert len(made.read_text().splitlines()) == n + 1, "one compiled, and the other waited for it"


def test_a_kernel_depends_on_the_source_of_every_helper_it_can_use():
    kernels = 0
    for info in pkgutil.walk_packages(windsysid.__path__, "windsysid."):
        module = importlib.import_module(info.name)
        helpers = {getattr(getattr(value, "py_func", None), "__module__", "") for value in vars(module).values()}
        used = {name for name in helpers - {info.name} if name.startswith("windsysid.")}
        if used:
            kernels += len(used)
            sources = jit._sources(Path(str(module.__file__)))
            assert {name.removeprefix("windsysid.") for name in used} | {"kernels.jit"} <= set(sources), info.name
    assert kernels > 20


def test_a_changed_source_changes_the_name_of_a_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / "rows.py").write_text("a = 1\n")
    (tmp_path / "kernel.py").write_text("def f():\n    from windsysid.kernels.rows import a\n")
    monkeypatch.setattr(jit, "_PACKAGE", tmp_path)
    before = jit._sources(tmp_path / "kernel.py")
    (tmp_path / "kernels" / "rows.py").write_text("a = 2\n")
    jit._source.cache_clear()
    after = jit._sources(tmp_path / "kernel.py")
    assert set(before) == set(after) == {"", "kernels.rows", "kernels.jit"}
    assert [name for name in before if before[name] != after[name]] == ["kernels.rows"]
    jit._source.cache_clear()
