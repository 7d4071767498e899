"""Records as comma-separated text: one header line, the time first, one row per sample.

    time [s],rotor_speed [rad/s],tower_x_acceleration [m/s^2]
    0.0,1.2671,0.0132
    0.01,1.2671,

The first column is the time: ``time``, ``t``, ``time [s]``, ``time_s``. Every other header cell is a name
with a unit, ``name [unit]`` or ``name (unit)``. Without brackets the unit is read from the end of the name if
it is one of `SUFFIXES` (``pitch_deg`` is the channel ``pitch`` in degrees); otherwise it is the SI unit that
the name implies (`windsysid.record.implied_unit`). Values are turned into SI. An empty cell or NaN means
missing.

Written files use ``name [unit]`` and the shortest digits that give back the same float64.
"""

import csv
import io
import re
import warnings
from pathlib import Path
from typing import NoReturn

import numpy as np

from windsysid.errors import RecordError
from windsysid.formats.files import check_input, read_start
from windsysid.record import Array, Record, check_channels, check_rows, convert, implied_unit

__all__ = ["MISSING", "SUFFIXES", "read_csv", "write_csv"]

SUFFIXES = {
    "_V_per_V": "V/V",
    "_m_s": "m/s",
    "_rpm": "rpm",
    "_deg": "deg",
    "_kNm": "kN*m",
    "_kN": "kN",
    "_W": "W",
    "_g": "g",
    "_s": "s",
}
"""Units that may end a column's name when it has none in brackets; longer ones first, capitals matter."""

MISSING = ("", "nan", "NaN", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "null", "NULL", "None")
"""Cells that say that a value is missing."""

_PLAIN = "expected comma-separated text with one header line; export it so"


def read_csv(path: str | Path) -> Record:
    """Read a record from comma-separated text.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Record
        In SI units, named after the file.

    Raises
    ------
    RecordError
        If the file is missing, empty or not such text, a cell is not a number (the first is named by column
        and line), a value is infinite, a unit is unknown, or the time is missing, unsorted or repeated.
    """
    path = Path(path)
    check_input(path)
    lines, numbers = _lines(path)
    header = _cells(lines[0])
    _refuse_other_dialects(path, lines[0], header)
    names, units = _header(path, header)
    _refuse_ragged(path, lines, numbers, len(header))
    table = _parse(path, lines, numbers, header)
    time, unit = convert(table[:, 0], units[0], f"{path}: column '{header[0]}'")
    if unit != "s":
        raise RecordError(f"{path}: the time column '{header[0]}' is not in a unit of time; expected 'time [s]'")
    columns = [convert(table[:, i], units[i], f"{path}: column '{header[i]}'") for i in range(1, len(header))]
    values = np.column_stack([values for values, _ in columns])
    try:
        check_channels(names[1:])
        check_rows(time, values, tuple(names[1:]), lambda row: f"line {numbers[row + 1]}")
        return Record(time, values, tuple(names[1:]), tuple(unit for _, unit in columns), name=path.name)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error


def write_csv(record: Record, path: Path) -> None:
    """Write the bare file; `windsysid.formats.write_record` is the safe way in."""
    import pandas as pd

    frame = pd.DataFrame(record.values)
    frame.insert(0, "time", record.time)
    header = [
        "time [s]",
        *(f"{name} [{unit}]" for name, unit in zip(record.channels, record.units, strict=True)),
    ]
    frame.to_csv(path, index=False, header=header, lineterminator="\n", encoding="utf-8")


def _lines(path: Path) -> tuple[list[str], list[int]]:
    """The lines that hold something, and their numbers in the file, counted from 1."""
    start = read_start(path, 4096)
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise RecordError(f"{path}: is UTF-16 text, expected UTF-8; save it as UTF-8")
    try:
        if b"\0" in start:
            raise UnicodeDecodeError("utf-8", start, 0, 1, "binary")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RecordError(
            f"{path}: is not UTF-8 text but binary or in another encoding; {_PLAIN}, or give the file the "
            "ending of what it is"
        ) from None
    kept = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not kept:
        raise RecordError(f"{path}: holds only blank lines; {_PLAIN}")
    return [line for _, line in kept], [number for number, _ in kept]


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True))]


def _refuse_other_dialects(path: Path, line: str, header: list[str]) -> None:
    if header[0] == "TOA5":
        raise RecordError(f"{path}: looks like a Campbell TOA5 file with four header lines; {_PLAIN}")
    if len(header) == 1 or ";" in line:
        for mark, what in (
            (";", "separated by semicolons, perhaps with decimal commas"),
            ("\t", "separated by tabs"),
        ):
            if mark in line:
                raise RecordError(f"{path}: looks {what}; {_PLAIN} (decimal points, commas between the cells)")
        if len(line.split()) > 1 and all(map(_is_number, line.split())):
            raise RecordError(f"{path}: looks separated by spaces and has no header line; {_PLAIN}")
        raise RecordError(f"{path}: the header line '{line.strip()[:60]}' has one column; {_PLAIN}, the time first")
    if all(map(_is_number, header)):
        raise RecordError(
            f"{path}: has no header line, its first line holds numbers; write 'time,name [unit],...' above"
        )


def _header(path: Path, header: list[str]) -> tuple[list[str], list[str]]:
    names, units = [], []
    for number, cell in enumerate(header, 1):
        if not cell:
            raise RecordError(f"{path}: column {number} has no name; expected 'name [unit]'; name it or remove it")
        name, unit = _name_and_unit(cell)
        names.append(name)
        units.append(unit)
    if names[0].lower() not in ("time", "t"):
        raise RecordError(f"{path}: the first column is '{header[0]}', expected 'time [s]'; put the time first")
    return names, units


def _name_and_unit(cell: str) -> tuple[str, str]:
    bracketed = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", cell)
    if bracketed:
        square, round_ = bracketed[2], bracketed[3]
        return bracketed[1], square if square is not None else round_
    for suffix, unit in SUFFIXES.items():
        if cell.endswith(suffix) and cell != suffix:
            return cell.removesuffix(suffix), unit
    return cell, "s" if cell.lower() in ("time", "t") else implied_unit(cell)


def _refuse_ragged(path: Path, lines: list[str], numbers: list[int], expected: int) -> None:
    for line, number in zip(lines, numbers, strict=True):
        got = len(_cells(line)) if '"' in line else line.count(",") + 1
        if got != expected:
            raise RecordError(
                f"{path}: line {number} has {got} cells, expected {expected} as in the header; the file "
                "may be cut off or have decimal commas; complete or remove that line"
            )
    if len(lines) < 3:
        raise RecordError(f"{path}: has {len(lines) - 1} rows under the header, expected at least 2; export it again")


def _parse(path: Path, lines: list[str], numbers: list[int], header: list[str]) -> Array:
    import pandas as pd

    try:
        with warnings.catch_warnings():
            # Newer pandas reads every digit anyway and warns about the option that older ones need for it.
            warnings.filterwarnings("ignore", message=".*float_precision", category=Warning)
            frame = pd.read_csv(
                io.StringIO("\n".join(lines[1:])),
                header=None,
                dtype=np.float64,
                float_precision="round_trip",
                skipinitialspace=True,
                keep_default_na=False,
                na_values=list(MISSING),
            )
    except (ValueError, OverflowError):
        _name_bad_cell(path, lines, numbers, header)
    return frame.to_numpy()


def _name_bad_cell(path: Path, lines: list[str], numbers: list[int], header: list[str]) -> NoReturn:
    for line, number in zip(lines[1:], numbers[1:], strict=True):
        for name, cell in zip(header, _cells(line), strict=False):
            if not _is_number(cell) and cell not in MISSING:
                raise RecordError(
                    f"{path}: column '{name}', line {number}: '{cell[:40]}' is not a number; write a "
                    "number with a decimal point, or nothing where the value is missing"
                )
    raise RecordError(f"{path}: some cell is not a number; {_PLAIN}")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python reads 1_000, a file does not mean it
