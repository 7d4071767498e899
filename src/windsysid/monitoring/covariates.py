"""A file of what else moved: a line for each record."""

import csv
import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.configuration import special_file_kind
from windsysid.errors import ConfigurationError
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
        raise ConfigurationError(f"covariates {path}: cannot be read: {error}") from None
    if len(lines) != count:
        raise ConfigurationError(f"covariates {path}: expected {count} lines, one for each record, got {len(lines)}")
    columns: dict[str, Array] = {}
    time, dates, folders = None, list[datetime](), list[str]()
    for name in lines[0]:
        texts = [(line[name] or "").strip() for line in lines]
        if name == "folder":
            folders = texts
            continue
        if name == "time" and not _is_number(texts[0]):
            try:
                dates = [datetime.fromisoformat(text) for text in texts]
                time = np.array([(date - dates[0]).total_seconds() for date in dates])
            except (ValueError, TypeError):
                raise ConfigurationError(
                    f"covariates {path}: expected times in seconds or as 2026-03-31T12:00, got {texts[0]!r}"
                ) from None
            continue
        bad = [text for text in texts if text and not _is_number(text)]
        if bad:
            raise ConfigurationError(
                f"covariates {path}: expected numbers in column '{name}', got {bad[0]!r}: leave the column out"
            )
        columns[name] = np.array([float(text) if text else math.nan for text in texts])
    return CovariateTable(path, columns, columns.pop("time", time), dates, folders)


def lines_of(table: CovariateTable, folders: Sequence[Path], spans: Sequence[Span] | None) -> list[int]:
    """The line of each folder; ConfigurationError where that is not sure."""
    count = len(folders)
    order = list(range(count)) if spans is None else sorted(range(count), key=lambda i: spans[i].begin)
    hint = "add a column 'folder' with the names of the folders"
    if table.folders:
        lines: dict[str, list[int]] = {}
        for line, name in enumerate(table.folders):
            lines.setdefault(name, []).append(line)
        for folder in folders:
            if len(lines.get(folder.name, [])) != 1:
                raise ConfigurationError(
                    f"covariates {table.path}: expected one line of folder '{folder.name}', got"
                    f" {len(lines.get(folder.name, []))}"
                )
        return [lines[folder.name][0] for folder in folders]
    if spans is not None and table.dates and (table.dates[0].tzinfo is None) == (spans[0].begin.tzinfo is None):
        rows = [0] * count
        for i, line in zip(order, sorted(range(count), key=lambda k: table.dates[k]), strict=True):
            if abs(table.dates[line] - spans[i].begin) > spans[i].end - spans[i].begin:
                raise ConfigurationError(
                    f"covariates {table.path}: no line has the time of '{folders[i].name}',"
                    f" {spans[i].begin.isoformat()}: correct it, or {hint}"
                )
            rows[i] = line
        return rows
    if spans is not None:
        rising = order == list(range(count)) if table.time is None else bool((np.diff(table.time[order]) > 0.0).all())
        if not rising:
            raise ConfigurationError(
                f"covariates {table.path}: the order of its lines contradicts when the records began: {hint}"
            )
    return list(range(count))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
