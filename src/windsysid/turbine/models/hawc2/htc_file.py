"""Main input files of HAWC2: nested blocks of commands, and the tables of sections that they name.

A command ends at ``;``, which begins a comment; ``begin NAME`` and ``end NAME`` enclose a block, ``continue_in_file``
reads another file in between. Files are named relative to the folder in which HAWC2 runs, a parent of the main file's.
"""

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.input_file import InputFile

__all__ = ["Command", "HtcBlock", "read_htc", "read_sections"]

MAX_FILES = 100
"""Setting: files that one main file may continue in; a file that names itself would never end."""

SECTION_WIDTHS = (19, 30)
"""Setting: columns of a section: those of a beam, or with a full stiffness matrix."""


class Command(NamedTuple):
    """Words of a command, and where it stands."""

    words: tuple[str, ...]
    file: InputFile
    line: int

    def fail(self, message: str) -> NoReturn:
        """Raise a ConfigurationError that begins with file and line."""
        self.file.fail(self.line, f"{self.words[0]}: {message}")

    @property
    def where(self) -> str:
        """File and line."""
        return f"{self.file.path.name}:{self.line}"

    @property
    def value(self) -> str:
        """The first word behind its name."""
        return self.words[1] if len(self.words) > 1 else self.fail("expected a value")

    def numbers(self, first: int, count: int) -> Array:
        """`count` numbers (count,) from the word `first` on, the command's name being word 0."""
        words = self.words[first : first + count]
        if len(words) < count:
            self.fail(f"expected {first + count - 1} values, got {len(self.words) - 1}")
        return np.array([self.file.value(self.line, word, f"{self.words[0]}: ") for word in words])


class HtcBlock:
    """A block of commands and blocks, in the order of the file.

    Parameters
    ----------
    name
        After ``begin``.
    file, line
        Where it begins.
    root
        Folder to which names of files refer.
    """

    def __init__(self, name: str, file: InputFile, line: int, root: Path) -> None:
        self.name, self.file, self.line, self.root = name, file, line, root
        self.entries: list[Command] = []
        self.blocks: list[HtcBlock] = []

    def all(self, *names: str) -> "Iterator[HtcBlock]":
        """Blocks of these names."""
        return (block for block in self.blocks if block.name in names)

    def first(self, name: str) -> "HtcBlock | None":
        """The first block of that name."""
        return next(self.all(name), None)

    def block(self, name: str) -> "HtcBlock":
        """The first block of that name; an error where there is none."""
        if (found := self.first(name)) is None:
            self.file.fail(self.line, f"{self.name}: expected a block 'begin {name}', found none")
        return found

    def commands(self, *names: str) -> list[Command]:
        """Commands of these names; names may end in ``*``."""
        stems = tuple(name[:-1] for name in names if name.endswith("*"))
        return [e for e in self.entries if e.words[0] in names or (stems and e.words[0].startswith(stems))]

    def command(self, *names: str) -> Command:
        """The last command of one of these names; an error where there is none."""
        if not (found := self.commands(*names)):
            self.file.fail(self.line, f"{self.name}: expected a command {' or '.join(names)}, found none")
        return found[-1]

    def word(self, *names: str) -> str:
        """First value of a command."""
        return self.command(*names).value

    def open(self, name: str) -> InputFile:
        """The file that a command names."""
        entry = self.command(name)
        return InputFile(_resolve(self.root, entry), entry.where, self.file.read)


def read_htc(path: Path) -> HtcBlock:
    """Read a main input file with all files that it continues in.

    Raises
    ------
    ConfigurationError
        With file and line: a file that is missing, or a block without its end.
    """
    main = InputFile(path)
    found = HtcBlock("file", main, 1, _root(main))
    _fill([found], main, found.root)
    return found


def _fill(stack: list[HtcBlock], file: InputFile, root: Path) -> None:
    """Read commands into the innermost open block."""
    depth = len(stack)
    for number, line in enumerate(file.lines, start=1):
        words = line.split(";")[0].split()
        entry = Command((words[0].lower(), *words[1:]), file, number) if words else None
        if entry is None:
            continue
        if entry.words[0] == "exit":
            break
        if entry.words[0] == "begin":
            stack.append(HtcBlock(entry.value.lower(), file, number, root))
            stack[-2].blocks.append(stack[-1])
        elif entry.words[0] == "end":
            if len(stack) <= depth or stack[-1].name != entry.value.lower():
                entry.fail(f"expected the end of '{stack[-1].name}' (line {stack[-1].line}), got '{entry.value[:40]}'")
            stack.pop()
        elif entry.words[0] == "continue_in_file":
            if len(file.read) >= MAX_FILES:
                entry.fail(f"expected up to {MAX_FILES} files, got more: does a file continue in itself?")
            _fill(stack, InputFile(_resolve(root, entry), entry.where, file.read), root)
        else:
            stack[-1].entries.append(entry)
    if len(stack) > depth:
        file.fail(len(file.lines), f"expected 'end {stack[-1].name}' (line {stack[-1].line}), found none")


def _resolve(root: Path, entry: Command) -> Path:
    """Path of the file that a command names; upper and lower case are alike where no such file exists."""
    found = root
    for part in Path(entry.value.strip("\"'").replace("\\", "/")).parts:
        exact = found / part
        if not exact.exists() and found.is_dir():
            exact = next((p for p in sorted(found.iterdir()) if p.name.lower() == part.lower()), exact)
        found = exact
    return found


def _root(main: InputFile) -> Path:
    """The folder in which HAWC2 runs: the nearest one above from which the first file of a table is found."""
    for number, line in enumerate(main.lines, start=1):
        words = line.split(";")[0].split()
        if len(words) > 1 and words[0].lower() in ("filename", "continue_in_file"):
            entry = Command(tuple(words), main, number)
            folders = [main.path.absolute().parent, *main.path.absolute().parents[1:4]]
            return next((folder for folder in folders if _resolve(folder, entry).is_file()), folders[0])
    return main.path.absolute().parent


def read_sections(block: HtcBlock) -> tuple[Array, InputFile, int]:
    """Read the table of a ``timoschenko_input``: rows (n, 19) or (n, 30), its file, and the number of its first line.

    Raises
    ------
    ConfigurationError
        With file and line: a missing set, rows of another width, or distances that do not ascend.
    """
    file, wanted = block.open("filename"), block.command("set").numbers(1, 2).astype(int)
    at, count = _subset(file, int(wanted[0]), int(wanted[1]))
    if not at:
        file.fail(1, f"expected set {wanted[0]} with subset {wanted[1]} ({block.command('set').where}), found none")
    if count < 2:
        file.fail(at, "expected two or more rows")
    rows = [_row(file, number, count) for number in range(at + 1, at + 1 + count)]
    for number, (one, other) in enumerate(pairwise(rows), start=at + 2):
        if len(one) != len(other) or other[0] <= one[0]:
            file.fail(number, f"expected rows of one width and ascending distances, got {other[0]:g} after {one[0]:g}")
    return np.array(rows), file, at + 1


def _subset(file: InputFile, wanted: int, subset: int) -> tuple[int, int]:
    """Line of a subset ``$`` of a set ``#``, 0 if there is none, and the number of its rows."""
    current = 0
    for number, line in enumerate(file.lines, start=1):
        mark = re.match(r"\s*([#$])\s*(\d+)(?:\s+(\d+))?", line)
        if mark and mark[1] == "#":
            current = int(mark[2])
        elif mark and (current, int(mark[2])) == (wanted, subset):
            return number, int(mark[3] or 0)
    return 0, 0


def _row(file: InputFile, number: int, count: int) -> list[float]:
    words = file.lines[number - 1].split() if number <= len(file.lines) else []
    if len(words) not in SECTION_WIDTHS:
        file.fail(number, f"expected a row of 19 or 30 numbers, {count} rows in all, got {len(words)} values")
    return [file.value(number, word) for word in words]
