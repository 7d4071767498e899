"""The cache on disk for what takes long to make: files that are whole or not used, shared by processes and by people.

Every file begins with the SHA-256 of what follows. A file that was cut, damaged or cannot be read counts as absent: it
is made again. Files are written under another name and moved to their own, so that processes at the same moment do not
disturb each other.
"""

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
from functools import lru_cache
from pathlib import Path

from platformdirs import user_cache_path

from windsysid.output.files import replace_file

__all__ = ["cache_folder", "keep", "kept", "write_whole"]

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
