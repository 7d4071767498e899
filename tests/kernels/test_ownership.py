"""Code from the cache runs as the user: what another user can have changed is not used."""

import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from windsysid.kernels import cache, jit, ownership, stored
from windsysid.kernels.ownership import foreign, read_own

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and modes are POSIX")


@pytest.fixture(autouse=True)
def _nothing_known(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No folder was looked at before, no group is private, and the home folder is elsewhere."""
    monkeypatch.setattr(ownership, "_own", set())
    monkeypatch.setattr(ownership, "_private_group", lambda: None)
    monkeypatch.setattr(ownership, "_home", lambda: None)
    cache.cache_folder.cache_clear()
    yield
    cache.cache_folder.cache_clear()


@pytest.fixture
def own(tmp_path: Path) -> Path:
    folder = tmp_path / "own"
    folder.mkdir(mode=0o755)
    (folder / "file").write_bytes(b"content")
    (folder / "file").chmod(0o644)
    return folder


def test_what_is_the_users_alone_is_read(own):
    assert foreign(own) == ""
    assert read_own(own / "file") == b"content"


@pytest.mark.parametrize("mode", [0o664, 0o646, 0o666, 0o622])
def test_a_file_that_others_can_write_is_absent(own, mode):
    (own / "file").chmod(mode)
    assert read_own(own / "file") is None


def test_a_file_of_another_user_is_absent(own, monkeypatch):
    assert read_own(own / "file") == b"content"  # and its folder is known
    monkeypatch.setattr(ownership, "_owners", lambda: (0xFFFE, 0xFFFE))
    assert read_own(own / "file") is None


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a file away")
@pytest.mark.parametrize("name", ["file", "."])
def test_a_file_or_folder_that_was_given_to_another_user_is_not_used(own, name):
    os.chown(own / name, 4242, -1)
    assert read_own(own / "file") is None
    assert ("belongs to another user (4242)" in foreign(own)) == (name == ".")


def test_links_and_what_is_no_file_are_absent(own):
    (own / "link").symlink_to(own / "file")
    os.mkfifo(own / "fifo")
    assert read_own(own / "link") is None
    assert read_own(own / "missing") is None
    assert read_own(own) is None


@pytest.mark.parametrize("mode", [0o775, 0o757, 0o777, 0o1777])
def test_a_folder_that_others_can_write_is_not_used_nor_what_is_in_it(own, mode):
    own.chmod(mode)
    assert f"{own} can be written by others (mode {mode:o}): chmod go-w" in foreign(own)
    assert read_own(own / "file") is None
    own.chmod(0o755)  # as advised
    assert read_own(own / "file") == b"content"


@pytest.mark.parametrize(("mode", "used"), [(0o777, False), (0o775, False), (0o1777, True), (0o755, True)])
def test_folders_above_may_be_written_by_others_only_where_they_are_sticky(own, mode, used):
    inner = own / "a" / "b"
    inner.mkdir(parents=True, mode=0o755)
    (own / "a").chmod(0o755)
    inner.chmod(0o755)
    own.chmod(mode)
    assert (foreign(inner) == "") == used


def test_the_check_ends_at_the_users_home(own, monkeypatch):
    inner = own / "cache"
    inner.mkdir(mode=0o755)
    own.parent.chmod(0o777)
    try:
        assert foreign(inner) != ""
        monkeypatch.setattr(ownership, "_home", lambda: own)
        assert foreign(inner) == ""
        own.chmod(0o777)
        ownership._own.clear()
        assert str(own) in foreign(inner)
    finally:
        own.parent.chmod(0o700)


def test_a_folder_behind_a_link_is_checked_where_it_is(own, tmp_path):
    (tmp_path / "link").symlink_to(own)
    own.chmod(0o777)
    assert str(own) in foreign(tmp_path / "link")


def test_the_users_private_group_counts_as_the_user(own, monkeypatch):
    monkeypatch.setattr(ownership, "_private_group", lambda: (own / "file").stat().st_gid)
    (own / "file").chmod(0o664)
    assert read_own(own / "file") == b"content"
    (own / "file").chmod(0o666)
    assert read_own(own / "file") is None


@pytest.mark.parametrize(
    ("name", "members", "private"),
    [("ada", [], True), ("ada", ["ada"], True), ("ada", ["eve"], False), ("all", [], False)],
)
def test_a_group_is_private_by_its_name_and_its_members(monkeypatch, name, members, private):
    monkeypatch.undo()
    grp, pwd = pytest.importorskip("grp"), pytest.importorskip("pwd")
    monkeypatch.setattr(pwd, "getpwuid", lambda _: SimpleNamespace(pw_name="ada", pw_gid=7))
    monkeypatch.setattr(grp, "getgrgid", lambda _: SimpleNamespace(gr_name=name, gr_gid=7, gr_mem=members))
    ownership._private_group.cache_clear()
    assert ownership._private_group() == (7 if private else None)
    ownership._private_group.cache_clear()


def test_a_cache_that_others_can_write_is_done_without_in_one_line_whose_advice_works(own, monkeypatch, caplog):
    own.chmod(0o777)
    monkeypatch.setenv("WINDSYSID_CACHE", str(own))
    other = cache.cache_folder()
    assert other != own
    assert foreign(other) == ""
    (said,) = [record.getMessage() for record in caplog.records]
    assert f"{own} can be written by others (mode 777): chmod go-w; or set WINDSYSID_CACHE" in said
    own.chmod(0o755)
    cache.cache_folder.cache_clear()
    assert cache.cache_folder() == own


@pytest.mark.parametrize("mask", [0o000, 0o002, 0o022, 0o077])
def test_what_the_cache_makes_is_its_own_whatever_the_umask(tmp_path, monkeypatch, mask):
    tmp_path.chmod(0o755)
    monkeypatch.setenv("WINDSYSID_CACHE", str(tmp_path / "a" / "b"))
    before = os.umask(mask)
    try:
        folder = cache.cache_folder()
        cache.keep(folder / "kernels" / "x", b"payload")
    finally:
        os.umask(before)
    assert folder == tmp_path / "a" / "b"
    assert cache.kept(folder / "kernels" / "x") == b"payload"


def fresh(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setattr(jit, "cache_folder", lambda: folder)


def _square(x: float) -> float:
    return x * x


def test_a_kernel_on_disk_is_no_pickle_and_comes_back_as_it_was(own, monkeypatch):
    from numba import types

    fresh(monkeypatch, own)
    assert jit.compiled(_square, types.float64(types.float64))(3.0) == 9.0
    (path,) = own.rglob("*.kernel")
    payload = cache.kept(path)
    assert payload is not None
    with pytest.raises(pickle.UnpicklingError):
        pickle.loads(payload)
    monkeypatch.setattr(jit, "keep", lambda *_: pytest.fail("compiled again"))
    assert jit.compiled(_square, types.float64(types.float64))(4.0) == 16.0


class Evil:
    """A pickle that leaves a mark."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.mark),)


def test_a_pickle_in_the_place_of_a_kernel_runs_nothing(own, monkeypatch):
    from numba import types

    fresh(monkeypatch, own)
    jit.compiled(_square, types.float64(types.float64))
    (path,) = own.rglob("*.kernel")
    cache.keep(path, pickle.dumps(Evil(own / "mark")))
    assert jit.compiled(_square, types.float64(types.float64))(3.0) == 9.0
    assert not (own / "mark").exists()


def test_a_kernel_imports_no_module_by_a_name_that_it_holds(own, monkeypatch):
    (own / "left_here.py").write_text("raise SystemExit('imported')\n")
    monkeypatch.syspath_prepend(str(own))
    with pytest.raises(ImportError, match="not loaded"):
        stored._module("left_here")
    assert stored._module("numpy") is np


def test_what_belongs_to_this_process_alone_is_not_kept():
    result = SimpleNamespace(
        lifted=(), objectmode=False, reload_init=(), library=SimpleNamespace(has_dynamic_globals=False),
        environment=SimpleNamespace(consts=["a constant"], globals={"__name__": "x"}),
        _find_referenced_environments=list,
    )  # fmt: skip
    assert stored.packed(result) is None
    result.environment.consts = []
    result.library.has_dynamic_globals = True
    assert stored.packed(result) is None
