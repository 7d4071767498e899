"""The cache on disk for results that take long: complete files only, shared by a user's processes.

It contains code that runs with the user's rights. So a file that another user may have changed counts as absent, and a
folder that others can change is not used (`windsysid.kernels.ownership`); a folder of root can serve all users.

Every file begins with the SHA-256 of what follows. A file that was cut, damaged or cannot be read counts as absent: it
is made again. Files are written under another name and moved to their own, so that processes at the same moment do not
disturb each other. Of processes that need the same file at the same moment one makes it, and the others wait for it
(`in_turn`).

A wheel carries a cache that was made for `portable_processor`, which nearly every machine of the last ten years
understands (`windsysid warm --portable`), so that the first command of an installation compiles nothing. What the
user's own cache has comes first; where the versions of Python and Numba or the processor are others, kernels are
compiled.
"""

import atexit
import errno
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

from platformdirs import user_cache_path

from windsysid.kernels.ownership import foreign, read_own
from windsysid.output.files import replace_file
from windsysid.output.locks import LOCK, release, try_lock

__all__ = [
    "SHIPPED", "cache_folder", "compile_anew", "in_turn", "keep", "kept", "portable_processor", "shipped_kernel",
    "write_whole",
]  # fmt: skip

MAX_WAIT_SECONDS = 120.0
"""[s] After which a process makes a file itself, whoever else is at it."""

_DIGEST = hashlib.sha256().digest_size

logger = logging.getLogger("windsysid")


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Cache folder of the user; a temporary one for this process if it cannot be written or others can change it."""
    try:
        given = os.environ.get("WINDSYSID_CACHE")
        folder = (Path(given) if given else user_cache_path("windsysid")).absolute()
        _make(folder)
        folder = folder.resolve()
        if why := foreign(folder):
            raise PermissionError(f"{why}; or set WINDSYSID_CACHE to a folder of your own")
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError) as error:  # RuntimeError: the user has no home
        logger.warning("cannot keep compiled models (%s): they are compiled anew in every process", error)
        own = tempfile.mkdtemp(prefix="windsysid-")
        atexit.register(shutil.rmtree, own, ignore_errors=True)
        return Path(own)


def kept(path: Path) -> bytes | None:
    """Read a file that `keep` wrote; None if the file is missing, cut off, damaged, not readable or another user's."""
    content = read_own(path)
    if content is None:
        return None
    digest, payload = content[:_DIGEST], content[_DIGEST:]
    return payload if hashlib.sha256(payload).digest() == digest else None


@contextmanager
def in_turn(path: Path) -> Iterator[None]:
    """Wait until no other process makes this file, and be the one that does; without a lock where there can be none.

    The file may be there afterwards: look before making it.
    """
    lock, until = path.with_name(f".{path.name}{LOCK}"), time.monotonic() + MAX_WAIT_SECONDS
    try:
        _make(path.parent)
        while (handle := try_lock(lock)) is None and not path.exists() and time.monotonic() < until:
            pass  # `try_lock` takes its time
    except OSError:
        handle = None
    try:
        yield
    finally:
        if handle is not None:
            release(handle, lock)


def keep(path: Path, payload: bytes) -> None:
    """Write a file for `kept`; where it cannot be written, say so once and go on without."""
    write_whole(path, hashlib.sha256(payload).digest() + payload)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that other processes see the whole file or none.

    Permissions follow the umask, but other users can never write.
    """

    def write(file: BinaryIO) -> None:
        file.write(content)
        if hasattr(os, "fchmod"):
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            os.fchmod(file.fileno(), mode & ~(stat.S_IWGRP | stat.S_IWOTH))

    try:
        _make(path.parent)
        replace_file(path, write)
    except OSError as error:
        _announce_unwritable(path.parent, str(error))


def _make(folder: Path) -> None:
    """Make a folder and its parents, which only the user can write, independently of the umask."""
    missing = [part for part in (folder, *folder.parents) if not part.exists()]
    for part in reversed(missing):
        part.mkdir(mode=0o755, exist_ok=True)
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))


@lru_cache(maxsize=1)
def _announce_unwritable(folder: Path, why: str) -> None:
    logger.warning("cannot keep compiled models in %s (%s): later runs will compile them again", folder, why)


SHIPPED = Path(__file__).with_name("in_the_wheel")
"""Folder of a wheel; a checkout has none."""

_PORTABLE = {
    "x86_64": ("x86-64-v3", ("avx", "avx2", "bmi", "bmi2", "cmov", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt")),
    "aarch64": ("generic", ()),
    "arm64": ("apple-m1", ()),
}
"""LLVM's name of a processor for each architecture, and the instructions that a machine must have."""


def portable_processor(triple: str) -> str | None:
    """LLVM's name of the processor that shipped code is made for; None if this machine cannot run such code."""
    from llvmlite import binding

    name, needed = _PORTABLE.get(triple.split("-")[0], (None, ()))
    has = binding.get_host_cpu_features() if needed else {}
    return name if all(has.get(one) for one in needed) else None


def compile_anew(*, portable: bool) -> None:
    """Use no shipped code from now on; if `portable`, compile for any processor of this kind: before Numba is
    imported."""
    from llvmlite import binding

    _ignored.append(SHIPPED)
    name = portable_processor(binding.get_process_triple())
    if portable and name is not None:
        os.environ |= {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""}


_ignored: list[Path] = []


def shipped_kernel(name: str) -> bytes | None:
    """Read the kernel of that file name; None if it was not shipped, or is not whole."""
    return None if SHIPPED in _ignored else kept(SHIPPED / "kernels" / name)
