"""Ways to damage a file, all from one seeded generator, and an independent reading of what is left."""

import math

import numpy as np

CELLS = [
    b"abc", b"True", b"1e400", b"-1e400", b"1e308", b"-1e308", b"1,5", b"1.5.2", b"", b" ", b"inf", b"-Infinity",
    b"--", b"0x1F",
    b"1_0", b"2021-01-01", b"2021-07-07T12:00:00Z", "１".encode(), b'"', b'""', b"'1'", b"#", b"%1", b"nan", b"NULL",
    b"\xef\xbb\xbf1", b"1 2", b"1;2", b"1\t2", b"1,234", b"1.234,5", b"1e", b"+", b"\xff", b"\xb2",
    b"1" * 400, b"5e-324",
    b"1d3", b"(1)", b"$1", b"1%", b"1\x0b", b"\x0c", b"\xc2\xa01", b"9" * 5000,
]  # fmt: skip


def truncate(data, rng):
    return data[: rng.integers(0, len(data) + 1)]


def change_bytes(data, rng):
    damaged = bytearray(data)
    for _ in range(rng.integers(1, 6)):
        damaged[rng.integers(0, len(damaged))] = rng.integers(0, 256)
    return bytes(damaged)


def flip_bit(data, rng):
    damaged = bytearray(data)
    damaged[rng.integers(0, len(damaged))] ^= 1 << rng.integers(0, 8)
    return bytes(damaged)


def delete_bytes(data, rng):
    at, size = rng.integers(0, len(data)), rng.integers(1, 9)
    return data[:at] + data[at + size :]


def insert_bytes(data, rng):
    at = rng.integers(0, len(data))
    return data[:at] + rng.bytes(rng.integers(1, 9)) + data[at:]


def repeat_bytes(data, rng):
    at, size = rng.integers(0, len(data)), rng.integers(1, 40)
    return data[: at + size] + data[at:]


def swap_bytes(data, rng):
    damaged = bytearray(data)
    i, j = rng.integers(0, len(data), 2)
    damaged[i], damaged[j] = damaged[j], damaged[i]
    return bytes(damaged)


def zero_bytes(data, rng):
    at, size = rng.integers(0, len(data)), rng.integers(1, 200)
    size = min(size, len(data) - at)
    return data[:at] + bytes(size) + data[at + size :]


def move_bytes(data, rng):
    i, j = sorted(rng.integers(0, len(data), 2))
    return data[j:] + data[i:j] + data[:i]


def insert_mark(data, rng):
    at = rng.integers(0, len(data))
    return data[:at] + [b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff"][rng.integers(0, 3)] + data[at:]


def symbol_for_symbol(data, rng):
    symbols = [b",", b";", b"\t", b".", b'"', b"\n", b"\r", b" ", b"#", b"-", b"e"]
    i, j = rng.integers(0, len(symbols), 2)
    return data.replace(symbols[i], symbols[j], int(rng.integers(1, 4)) if rng.random() < 0.7 else -1)


def _mark(lines):
    return next((m for m in (b";", b"\t", b",", b" ") if m in b"".join(lines)), b",")


def _lines(change):
    def damaged(data, rng):
        lines = data.split(b"\n")
        change(lines, rng)
        return b"\n".join(lines)

    damaged.__name__ = change.__name__
    return damaged


@_lines
def delete_line(lines, rng):
    del lines[rng.integers(0, len(lines))]


@_lines
def repeat_line(lines, rng):
    at = rng.integers(0, len(lines))
    lines.insert(rng.integers(0, len(lines)), lines[at])


@_lines
def swap_lines(lines, rng):
    i, j = rng.integers(0, len(lines), 2)
    lines[i], lines[j] = lines[j], lines[i]


@_lines
def shuffle_lines(lines, rng):
    first = rng.integers(0, min(5, len(lines)))
    lines[first:] = [lines[i] for i in first + rng.permutation(len(lines) - first)]


@_lines
def change_cell(lines, rng):
    mark = _mark(lines)
    for _ in range(rng.integers(1, 4)):
        at = rng.integers(0, len(lines))
        cells = lines[at].split(mark)
        cells[rng.integers(0, len(cells))] = CELLS[rng.integers(0, len(CELLS))]
        lines[at] = mark.join(cells)


@_lines
def change_column(lines, rng):
    mark = _mark(lines)
    cell, column = CELLS[rng.integers(0, len(CELLS))], rng.integers(0, 4)
    for at in range(rng.integers(0, 6), len(lines)):
        cells = lines[at].split(mark)
        if column < len(cells):
            cells[column] = cell
            lines[at] = mark.join(cells)


@_lines
def lose_cells_of_a_column(lines, rng):
    mark = _mark(lines)
    column = rng.integers(0, 4)
    for at in range(rng.integers(0, 20), rng.integers(20, 60)):
        if at < len(lines):
            cells = lines[at].split(mark)
            del cells[column : column + 1]
            lines[at] = mark.join(cells)


@_lines
def repeat_header_cell(lines, rng):
    mark = _mark(lines)
    at = rng.integers(0, min(4, len(lines)))
    cells = lines[at].split(mark)
    cells[-1] = cells[rng.integers(0, len(cells))]
    lines[at] = mark.join(cells)


@_lines
def many_columns(lines, rng):
    mark = _mark(lines)
    first = rng.integers(0, 3)
    for at in range(len(lines)):
        if lines[at].strip():
            more = [b"x%d" % i if at < first else b"%d" % i for i in range(500)]
            lines[at] = lines[at].rstrip(b"\r") + mark + mark.join(more)


BYTES = [truncate, change_bytes, flip_bit, delete_bytes, insert_bytes, repeat_bytes, swap_bytes, zero_bytes, move_bytes]
LINES = [
    insert_mark, symbol_for_symbol, delete_line, repeat_line, swap_lines, shuffle_lines, change_cell, change_column,
    lose_cells_of_a_column, repeat_header_cell, many_columns,
]  # fmt: skip

NOTHING = ("", "nan", "-nan", "na", "n/a", "null", "none")


def number(cell, decimal):
    """The number in a cell, NaN for a missing one, None for what is neither; written apart from the reader."""
    cell = cell.strip()
    if len(cell) > 1 and cell[0] == cell[-1] == '"':
        cell = cell[1:-1].strip()
    if cell.lower() in NOTHING or cell.upper() in ("INF", "-INF", "+INF"):
        return math.nan
    if (decimal == "," and "." in cell) or "_" in cell:
        return None
    try:
        return float(cell.replace(decimal, "."))
    except ValueError:
        return None


def rows_of(data, delimiter, decimal, encoding, width, stamps):
    """All rows of a damaged table (n, width) as numbers, and whether other text stands among them.

    A row is a line as wide as the table whose cells are numbers or missing; times that are text count as 0.
    """
    text = data.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    text = text.replace("\ufeff", "").replace("ï»¿", "")  # a byte-order mark is no part of it
    rows, strangers = [], 0
    lines = text.split("\n")
    for i, line in enumerate(lines):
        if not line.strip():
            continue
        cells = line.split(delimiter if delimiter != " " else None)
        if stamps:
            cells[0] = "0" if cells[0].strip(' "')[:2] == "20" else "x"
        values = [number(cell, decimal) for cell in cells]
        if len(values) == width and None not in values and not all(map(math.isnan, values)):
            rows.append(values)
        elif rows and i < len(lines) - 1:
            strangers += 1
    return np.array(rows).reshape(len(rows), width), strangers
