"""File of covariates, one line for each record."""

import csv
import math
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.configuration import special_file_kind
from windsysid.errors import ConfigurationError, unreadable
from windsysid.monitoring.dates import Span

__all__ = ["CovariateTable", "lines_of", "read_covariates"]


class CovariateTable(NamedTuple):
    """A file of covariates: columns (T,), time [s] from the first line, the dates, and the folders if it names them."""

    path: Path
    columns: dict[str, Array]
    time: Array | None
    dates: list[datetime]
    folders: list[str]


def read_covariates(path: Path, count: int) -> CovariateTable:
    """A CSV file with one line a record."""
    kind = special_file_kind(path)
    if kind:
        raise ConfigurationError(f"covariates {path}: is {kind}, expected a CSV file; save it as a file first")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        raise ConfigurationError(unreadable(path, "a CSV file of covariates", error)) from None
    if len(lines) != count:
        raise ConfigurationError(f"covariates {path}: expected {count} lines, one for each record, got {len(lines)}")
    texts = _texts(path, lines)
    folders = texts.pop("folder", [])
    time, dates = None, list[datetime]()
    if "time" in texts and not _is_number(texts["time"][0]):
        time, dates = _times(path, texts.pop("time"))
    columns = {name: _numbers(path, name, column) for name, column in texts.items()}
    return CovariateTable(path, columns, columns.pop("time", time), dates, folders)


def _texts(path: Path, lines: Sequence[dict[str, str | None]]) -> dict[str, list[str]]:
    """The cells of each column."""
    if any(None in line for line in lines):
        raise ConfigurationError(f"covariates {path}: a line has more cells than the first line has names of columns")
    return {name: [(line[name] or "").strip() for line in lines] for name in lines[0]}


def _times(path: Path, texts: Sequence[str]) -> tuple[Array, list[datetime]]:
    """Times (T,) of a column [s] from the first, and the dates."""
    try:
        dates = [datetime.fromisoformat(text) for text in texts]
        return np.array([(date - dates[0]).total_seconds() for date in dates]), dates
    except (ValueError, TypeError):
        raise ConfigurationError(
            f"covariates {path}: expected times in seconds or as 2026-03-31T12:00, got {texts[0]!r}"
        ) from None


def _numbers(path: Path, name: str, texts: Sequence[str]) -> Array:
    """A column of numbers, NaN where it is empty."""
    bad = [text for text in texts if text and not _is_number(text)]
    if bad:
        raise ConfigurationError(
            f"covariates {path}: expected numbers in column '{name}', got {bad[0]!r}: leave the column out"
        )
    return np.array([float(text) if text else math.nan for text in texts])


def lines_of(table: CovariateTable, folders: Sequence[Path], spans: Sequence[Span] | None) -> list[int]:
    """The line of each folder; ConfigurationError where that is not sure."""
    count = len(folders)
    if table.folders:
        return _lines_by_name(table, folders)
    if spans is None:
        return list(range(count))
    order = sorted(range(count), key=lambda i: spans[i].begin)
    if table.dates and (table.dates[0].tzinfo is None) == (spans[0].begin.tzinfo is None):
        return _lines_by_date(table, folders, spans, order)
    rising = order == list(range(count)) if table.time is None else bool((np.diff(table.time[order]) > 0.0).all())
    if not rising:
        raise ConfigurationError(
            f"covariates {table.path}: the order of its lines contradicts when the records began: {_HINT}"
        )
    return list(range(count))


_HINT = "add a column 'folder' with the names of the folders"


def _lines_by_name(table: CovariateTable, folders: Sequence[Path]) -> list[int]:
    count = Counter(table.folders)
    for folder in folders:
        if count[folder.name] != 1:
            raise ConfigurationError(
                f"covariates {table.path}: expected one line of folder '{folder.name}', got {count[folder.name]}"
            )
    line = {name: i for i, name in enumerate(table.folders)}
    return [line[folder.name] for folder in folders]


def _lines_by_date(
    table: CovariateTable, folders: Sequence[Path], spans: Sequence[Span], order: Sequence[int]
) -> list[int]:
    rows = [0] * len(folders)
    for i, line in zip(order, sorted(range(len(folders)), key=table.dates.__getitem__), strict=True):
        if abs(table.dates[line] - spans[i].begin) > spans[i].end - spans[i].begin:
            raise ConfigurationError(
                f"covariates {table.path}: no line has the time of '{folders[i].name}',"
                f" {spans[i].begin.isoformat()}: correct it, or {_HINT}"
            )
        rows[i] = line
    return rows


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
