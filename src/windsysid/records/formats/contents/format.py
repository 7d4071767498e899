"""Interface of a file format: a name, endings, first bytes, functions that open and write it.

A format is one module that ends in ``FORMAT = Format(...)``; `windsysid.records.formats` lists them. The ending of a
file's name says which formats it could be. Where several share an ending, the content decides: the first bytes, or a
file next to it. The packages that a format needs are imported when a file is opened, by `package`.
"""

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from windsysid.errors import RecordError
from windsysid.records.formats.contents.source import FileSource
from windsysid.records.record import Record

__all__ = ["Format", "package"]


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    name : str
        As its users call it.
    endings : tuple of str
        Of file names, in small letters; ``#`` stands for digits.
    open : callable
        ``open(path, mapping, whole=False)`` gives a `FileSource`; it is passed whether the `whole` file will be read.
    write : callable or None
        ``write(record, file)``; None where windsysid only reads.
    begins : tuple of bytes
        First bytes of such files; empty where they tell nothing.
    claims : callable or None
        Whether a file with one of the endings is of this format, where its first bytes do not tell.
    """

    name: str
    endings: tuple[str, ...]
    open: Callable[..., FileSource]
    write: Callable[[Record, BinaryIO], None] | None = None
    begins: tuple[bytes, ...] = ()
    claims: Callable[[Path], bool] | None = None

    def is_named(self, path: Path) -> bool:
        """Test whether the name of a file has one of the endings."""
        suffix = path.suffix.lower()
        return any(re.fullmatch(re.escape(ending).replace(r"\#", r"\d+"), suffix) for ending in self.endings)

    def holds(self, path: Path, start: bytes) -> bool:
        """Test whether the content, or a neighbouring file, shows that the file is of this format."""
        return (bool(self.begins) and start.startswith(self.begins)) or (self.claims is not None and self.claims(path))


def package(module: str, what: str, extra: str) -> Any:
    """Import an optional package.

    Parameters
    ----------
    module : str
        Its module.
    what : str
        The files that need it, for the message.
    extra : str
        The extra of windsysid that installs it.

    Raises
    ------
    RecordError
        If it is not installed; the line says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        needed = module.split(".")[0]
        raise RecordError(f'{what} need {needed}; install it with: pip install "windsysid[{extra}]"') from error
