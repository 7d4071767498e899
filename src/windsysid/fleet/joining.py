"""Joining of SCADA to the rows of records, whichever came first.

SCADA has no part in an identification, so that a row which was written before its SCADA gets it later, with no record
opened again, and then has the bytes of a row that was written after.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from windsysid.errors import ConfigurationError, RecordError
from windsysid.fleet.archive import Known, add_rows, place_of, rows_in
from windsysid.fleet.members import Member
from windsysid.fleet.rows import Row
from windsysid.fleet.scada import SCADA_COLUMNS, Scada, read_scada
from windsysid.records.moments import has_zone, moment
from windsysid.turbine.operation import operation

__all__ = ["NOT_JOINED_PREFIX", "check_clocks", "join", "join_late", "read_scadas"]

NOT_JOINED_PREFIX = "SCADA was not joined"
"""Prefix of the note on a row without SCADA."""

_READ = (
    "source", "start", "duration", "state", "speed_bin", "rotor_speed", "rotor_speed_min", "rotor_speed_max", "notes",
    *(f"scada_{name}" for name in SCADA_COLUMNS),
)  # fmt: skip
"""Columns that `join` reads or fills."""


def read_scadas(members: Sequence[Member]) -> tuple[dict[str, Scada], tuple[str, ...]]:
    """SCADA of each turbine that has a file of it, and a sentence for each whose file is not there yet.

    Raises
    ------
    ConfigurationError
        If a file is damaged.
    """
    found, missing = {}, []
    for member in members:
        if member.scada is None:
            continue
        if not Path(member.scada).exists():
            missing.append(f"SCADA of '{member.name}' is not there: once {member.scada} is, the same command joins it")
            continue
        try:
            found[member.name] = read_scada(member.scada, member.scada_mapping)
        except RecordError as error:
            raise ConfigurationError(f"SCADA of '{member.name}': {error}") from None
    return found, tuple(missing)


def check_clocks(name: str, scada: Scada, starts: Iterable[str]) -> None:
    """ConfigurationError where SCADA of a turbine says its zone and none of its records does, or the other way."""
    zone = scada.begin.tzinfo is not None
    if any(has_zone(start) == zone for start in starts):
        return
    told = "says its zone, and no record does" if zone else "does not say its zone, and all records do"
    raise ConfigurationError(
        f"SCADA of '{name}' {told}: give [time] zone in its mapping file, or in that of the records"
    )


def join(row: Row, scada: Scada, usual: float) -> Row:
    """A row with the SCADA of its record, and with the state that follows.

    Of a record that the file does not hold whole, what an earlier file said stays.

    Parameters
    ----------
    row
        With columns `_READ` at least.
    scada
        Of its turbine.
    usual
        The turbine's usual rotor speed [rad/s].
    """
    if row["start"] is None:
        return row
    start, seconds = moment(row["start"]), row["duration"]
    notes = [note for note in row["notes"] if not note.startswith(NOT_JOINED_PREFIX)]
    try:
        found = scada.during(start, seconds)
    except ConfigurationError as error:
        return row | {"notes": [*notes, f"{NOT_JOINED_PREFIX}: {error}"]}
    whole = scada.holds(start, seconds)
    said = {name: found.get(name) for name in scada.columns if whole or row[f"scada_{name}"] is None}
    row = row | {f"scada_{name}": value for name, value in said.items()} | {"notes": notes}
    return row | _operation(row, usual)


def _operation(row: Row, usual: float) -> Row:
    """State of the rotor by the record's own speed, or by SCADA's mean if it has none."""
    if row["state"] is None:  # the record could not be looked at
        return {}
    power = row["scada_power"]
    if row["rotor_speed_min"] is not None:
        state, at, *_ = operation(row["rotor_speed"], row["rotor_speed_min"], row["rotor_speed_max"], usual, power)
        return {"state": state, "speed_bin": at}
    mean = row["scada_rotor_speed"]
    if mean is None or usual <= 0.0:
        return {}
    state, at, mean, _, _ = operation(abs(mean), abs(mean), abs(mean), usual, power)
    return {"state": state, "speed_bin": at, "rotor_speed": mean}


def join_late(archive: Path, turbine: str, scada: Scada, usual: float, known: Mapping[str, Known]) -> int:
    """Join SCADA to rows of a turbine that an archive has; how many changed.

    Only files that hold a record near the time of which SCADA speaks are read.

    Parameters
    ----------
    known
        What the archive has of the turbine.

    Raises
    ------
    OutputError
        If a file cannot be written; it is then as it was, and the same call goes on.
    """
    changed = 0
    for day in sorted({one.day for one in known.values() if scada.is_near(one.time, one.seconds)}):
        path = place_of(archive, turbine, day)
        both = [(row, join(row, scada, usual)) for row in rows_in(path, _READ)]
        late = {row["source"]: joined for row, joined in both if joined != row}
        if late:
            add_rows(path, [row | late[row["source"]] for row in rows_in(path) if row["source"] in late])
            changed += len(late)
    return changed
