"""The turbines of a fleet, and which file is a record of which.

A fleet file lists them:

    [[turbine]]
    name = "T01"
    pattern = "T01/*"          # of its records, as the end of their paths
    turbine = "tower"          # a packaged turbine or a TOML file
    mapping = "logger.toml"
    sensors = "sensors.toml"
    scada = "scada/T01.csv"
    scada_mapping = "scada.toml"

Paths in it are relative to its own folder.
"""

import fnmatch
import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windsysid.configuration import read_tables
from windsysid.errors import ConfigurationError
from windsysid.mechanics.sensor_lists import read_sensors
from windsysid.records.formats import load_mapping
from windsysid.results.provenance import mapping_tables, sensor_tables, turbine_hash
from windsysid.turbine.file import load_turbine, packaged_turbines

__all__ = ["Member", "member_of", "read_fleet", "single"]

_FILES = ("mapping", "sensors", "scada", "scada_mapping")


@dataclass(frozen=True)
class Member:
    """One turbine of a fleet, as passed to workers: names and paths, no content.

    Attributes
    ----------
    name
        Under which the archive has it.
    turbine
        A packaged turbine or the path of a TOML file.
    pattern
        Of the end of its records' paths; empty for all.
    mapping, sensors, scada, scada_mapping
        Paths of files, absolute; None where there is none.
    """

    name: str
    turbine: str
    pattern: str = ""
    mapping: str | None = None
    sensors: str | None = None
    scada: str | None = None
    scada_mapping: str | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w. -]*\w", self.name) or self.name.startswith("."):
            raise ConfigurationError(
                f"turbine '{self.name}': expected letters, digits, points, dashes, blanks: a folder has its name"
            )

    def has(self, path: Path) -> bool:
        """Test whether a file is a record of this turbine, by its path."""
        return not self.pattern or fnmatch.fnmatchcase(path.as_posix(), f"*/{self.pattern.lstrip('/')}")

    def settings(self, formulation: str) -> str:
        """SHA-256 of all inputs other than the records: turbine, sensors, mapping, formulation.

        Raises
        ------
        ConfigurationError
            If one of its files is wrong: all are read.
        """
        parts = [turbine_hash(load_turbine(self.turbine)), formulation]
        if self.mapping is not None:
            parts.append(repr(mapping_tables(load_mapping(self.mapping))))
        if self.sensors is not None:
            parts.append(repr(sensor_tables(read_sensors(self.sensors))))
        return f"sha256:{hashlib.sha256(repr(parts).encode()).hexdigest()}"


def single(turbine: str, **files: str | Path | None) -> Member:
    """The one turbine that all records are of, named as its own file names it."""
    path = turbine if turbine in packaged_turbines() else str(Path(turbine).resolve())
    given = {key: None if value is None else str(Path(value).resolve()) for key, value in files.items()}
    return Member(name=load_turbine(turbine).name, turbine=path, pattern="", **given)


def read_fleet(path: str | Path) -> tuple[Member, ...]:
    """The turbines of a fleet file.

    Raises
    ------
    ConfigurationError
        In one line: the file, the turbine, what was expected and what was got.
    """
    path = Path(path)
    tables = read_tables(path, "a fleet file")
    listed = tables.pop("turbine", None)
    if tables or not isinstance(listed, list) or not listed:
        got = ", ".join(tables) or "none"
        raise ConfigurationError(f"fleet {path}: expected tables [[turbine]] and nothing else, got {got}")
    members = [_member(path, i, table) for i, table in enumerate(listed, 1)]
    (name, count), *_ = Counter(member.name for member in members).most_common(1)
    if count > 1:
        raise ConfigurationError(f"fleet {path}: two turbines are called '{name}': give each a name of its own")
    return tuple(members)


def _member(path: Path, number: int, table: Any) -> Member:
    _check_keys(f"fleet {path}: [[turbine]] {number}", table)
    turbine = table["turbine"]
    if turbine not in packaged_turbines():
        turbine = str((path.parent / turbine).resolve())
    files = {key: str((path.parent / table[key]).resolve()) for key in _FILES if table.get(key)}
    return Member(table["name"], turbine, table["pattern"], **files)


def _check_keys(where: str, table: Any) -> None:
    keys = ("name", "pattern", "turbine", *_FILES)
    if not isinstance(table, dict) or not all(isinstance(value, str) for value in table.values()):
        raise ConfigurationError(f"{where}: expected every value to be a text in quotes")
    wrong = [f"unknown key '{key}'" for key in table if key not in keys]
    wrong += [f"'{key}' is missing" for key in keys[:3] if not table.get(key)]
    if wrong:
        raise ConfigurationError(
            f"{where}: {wrong[0]}: expected {', '.join(keys[:3])} and, if there are any, {', '.join(_FILES)}"
        )


def member_of(path: Path, members: Sequence[Member]) -> Member | None:
    """The turbine that a file is a record of; None where no pattern fits.

    Raises
    ------
    ConfigurationError
        If two patterns fit.
    """
    found = [member for member in members if member.has(path)]
    if len(found) > 1:
        raise ConfigurationError(
            f"{path} fits the patterns of '{found[0].name}' and '{found[1].name}': make the patterns differ"
        )
    return found[0] if found else None
