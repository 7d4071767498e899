"""The cache on disk for what takes long to make: files that are whole or not used, shared by processes and by people.

Every file begins with the SHA-256 of what follows. A file that was cut, damaged or cannot be read counts as absent: it
is made again. Files are written under another name and moved to their own, so that processes at the same moment do not
disturb each other. Of processes that want the same file at the same moment one makes it, and the others wait for it
(`in_turn`).
"""

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from platformdirs import user_cache_path

from windsysid.output.files import replace_file
from windsysid.output.locks import LOCK, release, try_lock

__all__ = ["cache_folder", "in_turn", "keep", "kept", "write_whole"]

LONGEST_WAIT = 120.0
"""[s] After which a process makes a file itself, whoever else is at it."""

_DIGEST = hashlib.sha256().digest_size

logger = logging.getLogger("windsysid")


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """The user's cache folder, or one for this process alone where that cannot be written."""
    try:
        given = os.environ.get("WINDSYSID_CACHE")
        folder = Path(given) if given else user_cache_path("windsysid")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError) as error:  # RuntimeError: the user has no home
        logger.warning("cannot keep compiled models (%s): they are compiled anew in every process", error)
        own = tempfile.mkdtemp(prefix="windsysid-")
        atexit.register(shutil.rmtree, own, ignore_errors=True)
        return Path(own)


def kept(path: Path) -> bytes | None:
    """What `keep` wrote into a file; None where it is not there, cut, damaged or not readable."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, payload = content[:_DIGEST], content[_DIGEST:]
    return payload if hashlib.sha256(payload).digest() == digest else None


@contextmanager
def in_turn(path: Path) -> Iterator[None]:
    """Wait until no other process makes this file, and be the one that does; without a lock where there can be none.

    The file may be there afterwards: look before making it.
    """
    lock, until = path.with_name(f".{path.name}{LOCK}"), time.monotonic() + LONGEST_WAIT
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
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
    """Write so that a second process at the same moment sees the whole file or none; permissions as the umask says."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, lambda file: file.write(content))
    except OSError as error:
        _announce_unwritable(path.parent, str(error))


@lru_cache(maxsize=1)
def _announce_unwritable(folder: Path, why: str) -> None:
    logger.warning("cannot keep compiled models in %s (%s): later runs will compile them again", folder, why)
