r"""Text files as whole lines: the encoding found, line ends made one, read in pieces.

Loggers write UTF-8 with or without a byte-order mark, UTF-16, or the Windows code page, and end lines with
CR LF, LF or CR. `encoding_of` and `decoded` are the one rule for the encoding of every text format. `line_blocks`
gives all of them as UTF-8 with LF, a few MB at a time and always whole lines, so that parsers need not handle them.
The last line of a file that does not end its lines may be cut in the middle of a number: it comes last and alone, or
not at all if the caller disables it.
"""

import codecs
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.record import Array

__all__ = ["LineBlock", "decoded", "encoding_of", "last_line", "line_blocks", "plain_numbers"]

_BLOCK = 1 << 22  # bytes read at once
_MAX_LINE_BYTES = 1 << 26  # bytes of one line: beyond this the file is no table
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # begins as that of UTF-16
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


_MARK = "\ufeff"  # a byte-order mark is no part of a text, wherever somebody joined two files
_MISREAD, _MISREAD_MARK = ("cp1252", "latin-1"), codecs.BOM_UTF8.decode("cp1252")


class LineBlock(NamedTuple):
    r"""Whole lines of a file.

    Attributes
    ----------
    text : bytes
        UTF-8; every line ends in ``\n``, also a last one that did not.
    first : int
        Number of its first line in the file, counted from 1.
    done : float
        Fraction of the file that has been read.
    """

    text: bytes
    first: int
    done: float


def encoding_of(path: Path, wanted: str | None = None) -> str:
    """The encoding of a text file: the one that is required, its byte-order mark's, UTF-8, or the Windows code page.

    Raises
    ------
    RecordError
        If the file is binary, or does not begin in the encoding that is required.
    """
    with path.open("rb") as file:
        start = file.read(1 << 18)
    marked = _marked(start)
    if marked is not None or wanted is not None:
        return marked or codecs.lookup(str(wanted)).name
    if sum(start.count(byte) for byte in range(32) if byte not in b"\t\n\v\f\r\x1a"):
        raise RecordError("is binary, not text; expected a table as text; give the file the ending of what it is")
    return "utf-8" if _is_utf8(start) else _code_page(start)


def decoded(data: bytes) -> str:
    """Decode bytes by the rules of `encoding_of`; never fails."""
    try:
        text = data.decode(_marked(data) or "utf-8")
    except UnicodeDecodeError:
        text = data.decode(_code_page(data), errors="replace")
    return text.replace(_MARK, "")


def _marked(start: bytes) -> str | None:
    """Encoding by the byte-order mark, or UTF-16 if every other byte is zero; None if neither applies."""
    for mark, name in _MARKS:
        if start.startswith(mark):
            return name
    for odd, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        # Text of a table in UTF-16 is ASCII nearly throughout: every other byte is zero and the rest never is.
        if (
            len(start) >= 4
            and start[odd:200:2].count(0) > 0.9 * len(start[odd:200:2])
            and 0 not in start[1 - odd : 200 : 2]
        ):
            return name
    return None


def _is_utf8(text: bytes) -> bool:
    """Test whether bytes are UTF-8; the last character may be incomplete."""
    try:
        codecs.getincrementaldecoder("utf-8")().decode(text)
    except UnicodeDecodeError:
        return False
    return True


def _is_code_page(text: bytes) -> bool:
    """Test whether the first bytes outside ASCII are not UTF-8."""
    try:
        codecs.getincrementaldecoder("utf-8")().decode(text)
    except UnicodeDecodeError as error:
        return text[: error.start].isascii()
    return False


def _code_page(text: bytes) -> str:
    """Windows code page, or Latin-1 for bytes that the code page does not define."""
    return "latin-1" if any(byte in text for byte in b"\x81\x8d\x8f\x90\x9d") else "cp1252"


def line_blocks(path: Path, encoding: str, *, size: int = _BLOCK, keep_last: bool = True) -> Iterator[LineBlock]:
    """The lines of a file in blocks of about `size` bytes.

    Parameters
    ----------
    path : Path
    encoding : str
    size : int
        Bytes read at once.
    keep_last : bool
        Whether a last line without a line end is given too.

    Raises
    ------
    RecordError
        If the text is not in that encoding, holds a NUL, or has a line of more than 64 MB.
    """
    decoder = codecs.getincrementaldecoder(encoding)()
    lines = io.IncrementalNewlineDecoder(None, translate=True)
    total, read, number, rest = max(os.path.getsize(path), 1), 0, 1, ""
    plain = True  # ASCII so far
    with path.open("rb") as file:
        while True:
            data = file.read(size)
            read += len(data)
            try:
                if plain and encoding == "utf-8" and _is_code_page(data):  # the part that was examined is ASCII
                    encoding = _code_page(data)
                    decoder = codecs.getincrementaldecoder(encoding)()
                plain = plain and data.isascii()
                text = lines.decode(decoder.decode(data) if data else _flushed(decoder), final=not data)
                text = rest + text.replace(_MARK, "")
            except UnicodeError:
                raise RecordError(
                    f"is not {encoding.upper()} text near line {number + rest.count(chr(10))}; save it as UTF-8, "
                    "or name its encoding in the mapping file: [csv] encoding"
                ) from None
            if encoding in _MISREAD:
                text = text.replace(_MISREAD_MARK, "")
            cut = text.rfind("\n") + 1
            whole, rest = text[:cut], text[cut:]
            if len(rest) > _MAX_LINE_BYTES:
                raise RecordError(f"line {number + whole.count(chr(10))} is longer than 64 MB; the file is no table")
            if whole:
                yield _block(whole, number, read / total)
                number += whole.count("\n")
            if not data:
                break
    if rest and keep_last:
        yield _block(rest + "\n", number, 1.0)


def plain_numbers(text: bytes) -> Array:
    """All numbers of a text (n,), between blanks and line ends.

    Raises
    ------
    RecordError
        If one of them is no number, or nothing ends the last line, which may be cut in the middle of a number.
    """
    if not text.endswith((b"\n", b"\r", b"\x1a")):
        raise RecordError("ends in the middle of a line; it is cut off; run the simulation or copy it again")
    cells = text.split()
    try:
        if b"_" in text or not text.isascii():  # Python reads 1_000 and the digits of every script as numbers
            raise ValueError
        return np.array(cells, dtype="S").astype(np.float64)
    except ValueError:
        bad = next((cell for cell in cells if not _is_plain(cell)), b"")
        shown = bad[:20].decode("ascii", errors="replace")
        raise RecordError(
            f"holds '{shown}' among the numbers; it is damaged; run the simulation or copy it again"
        ) from None


def _is_plain(cell: bytes) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell.isascii() and b"_" not in cell


def last_line(path: Path, encoding: str) -> str | None:
    """The last line of a file if nothing ends it, None if it is ended."""
    wide = encoding.startswith("utf-16")
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        size = file.tell()
        start = max(0, size - (1 << 20))
        file.seek(start + (start % 2 if wide else 0))
        tail = file.read()
    name = "utf-16-be" if wide and _is_big_endian(path, encoding) else "utf-16-le" if wide else encoding
    text = tail.decode(name.removesuffix("-sig"), errors="replace")
    text = text.replace(_MARK, "").replace(_MISREAD_MARK, "")
    if text.endswith(("\n", "\r")):
        return None
    return text.replace("\r", "\n").rsplit("\n", 1)[-1]


def _is_big_endian(path: Path, encoding: str) -> bool:
    with path.open("rb") as file:
        return encoding.endswith("be") or file.read(2) == codecs.BOM_UTF16_BE


def _flushed(decoder: codecs.IncrementalDecoder) -> str:
    try:
        return decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return ""  # half a character at the very end: the file is cut off


def _block(text: str, number: int, done: float) -> LineBlock:
    if "\0" in text:
        line = number + text[: text.index("\0")].count("\n")
        raise RecordError(f"line {line} holds a NUL character: the file is binary or damaged; copy or export it again")
    return LineBlock(text.encode("utf-8", errors="replace"), number, done)
