"""An archive: one Parquet dataset of rows, a file for each turbine and day, and nothing else.

    ARCHIVE/turbine=T01/month=2026-03/2026-03-02.parquet

The files are the list of what was taken: a record whose file has a row, with the same size, is not taken again. A file
appears whole or not at all (`windsysid.output.files.replace_file`). It is rewritten as a whole when rows are added, its
rows sorted by time and source, so that the same records give the same bytes in whatever order they were taken. Any
program that reads Hive-partitioned Parquet reads an archive.

Parquet has checksums of its pages but none of its footer, where one flipped bit renames a column or a coefficient. A
digest of the whole file therefore stands before the footer, at a place that no reader of Parquet looks at.
"""

import hashlib
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from windsysid.errors import ConfigurationError, OutputError
from windsysid.fleet.remote import is_remote
from windsysid.fleet.rows import COLUMNS, COUNT, FLAG, MOMENT, NUMBER, NUMBERS, TEXT, TEXTS, Row
from windsysid.output.files import explain_errors, make_folders, replace_file
from windsysid.output.folders import without
from windsysid.output.locks import LOCK, release, try_lock
from windsysid.records.formats.contents.format import package
from windsysid.records.moments import moment

__all__ = [
    "UNDATED", "Known", "add_rows", "claim_archive", "day_of", "files_of", "is_archive", "known_sources", "place_of",
    "read_table", "rows_in", "table_of", "turbines_of",
]  # fmt: skip

FORM = b"windsysid archive 1\n"
"""First entry of every digest: the format of the files."""

DIGEST_BYTES = 32
TAIL_BYTES = 8
"""Behind the footer of a Parquet file: the footer's length, and four letters."""

UNDATED = "undated"
"""Prefix of the day of a record whose day is not known."""
_DATE = re.compile(r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?!\d{3})")


class Known(NamedTuple):
    """A record that an archive has: size of its file, what came of it, how often it was tried, with which settings,
    the day that it is filed under, and when it began (as column ``time``) and how long it is [s], where it says so."""

    size: int
    status: str
    tries: int
    settings: str
    day: str
    time: datetime | None = None
    seconds: float | None = None


def is_archive(folder: str | Path) -> bool:
    """Test whether a folder is an archive."""
    return any(path.is_dir() for path in Path(folder).glob("turbine=*"))


def has_records_of(archive: Path, folder: str) -> bool:
    """Test whether the first records of an archive are below a folder, which may be in an object store."""
    first = next((path for turbine in turbines_of(archive) for _, path in files_of(archive, turbine)), None)
    sources = [] if first is None else [row["source"] for row in rows_in(first, ["source"])]
    home = folder if is_remote(folder) else str(Path(folder).resolve() / "_").removesuffix("_")
    return not sources or any(str(source).startswith(home) for source in sources)


def day_of(start: str | None, source: str) -> str:
    """The day that a record is filed under.

    That of its start, UTC where its zone is known; otherwise the date in its file's name; otherwise one of 256
    divisions of what has no date.
    """
    if start is not None:
        begun = moment(start)
        return (begun if begun.tzinfo is None else begun.astimezone(UTC)).date().isoformat()
    named = _DATE.findall(Path(source).name)
    if named and int(named[-1][1]) in range(1, 13) and int(named[-1][2]) in range(1, 32):
        return "-".join(named[-1])
    return f"{UNDATED}-{hashlib.sha256(source.encode()).hexdigest()[:2]}"


def place_of(archive: Path, turbine: str, day: str) -> Path:
    """The file of a turbine's day."""
    month = UNDATED if day.startswith(UNDATED) else day[:7]
    return archive / f"turbine={turbine}" / f"month={month}" / f"{day}.parquet"


@contextmanager
def claim_archive(archive: Path) -> Iterator[None]:
    """Hold an archive against other processes that add to it; made where it is missing.

    Raises
    ------
    OutputError
        If it holds files but no archive, another process adds to it, or it cannot be written.
    """
    with explain_errors(f"archive {archive}", "choose another folder, with space left"):
        if archive.is_dir() and not is_archive(archive) and any(not p.name.endswith(LOCK) for p in archive.iterdir()):
            raise OutputError(f"archive {archive}: holds files but no archive: choose another folder")
        make_folders(archive, [])
        lock = archive / LOCK
        handle = try_lock(lock)
    if handle is None:
        raise OutputError(f"archive {archive}: another process adds to it; wait for it, or choose another folder")
    try:
        yield
    finally:
        release(handle, lock)


def add_rows(path: Path, rows: Sequence[Row]) -> None:
    """Put rows into the file of a day, in place of rows of the same sources.

    Raises
    ------
    OutputError
        If it cannot be written, or what is there is not ours; it is then as it was.
    """
    pq = _parquet("pyarrow.parquet")
    with explain_errors(str(path), "make room, and give the same command again: it goes on"):
        by_source = {row["source"]: row for row in (rows_in(path) if path.exists() else [])}
        by_source |= {row["source"]: row for row in rows}
        ordered = sorted(by_source.values(), key=lambda row: (row["start"] or "", row["source"]))
        table = table_of(ordered)
        content = io.BytesIO()
        pq.write_table(table, content, compression="zstd")
        whole = _sealed(content.getvalue())
        make_folders(path.parent, [])
        replace_file(path, lambda file: file.write(whole))


def read_table(archive: str | Path, turbine: str, columns: Sequence[str] | None = None) -> Any:
    """The rows of a turbine as an Arrow table, in order of the files; all columns, or those named.

    Raises
    ------
    ConfigurationError
        If the folder is no archive, has no such turbine, or one of its files is damaged.
    """
    pa = _parquet("pyarrow")
    names = turbines_of(archive)
    if turbine not in names:
        raise ConfigurationError(f"archive {archive}: no turbine '{turbine}': expected one of {', '.join(names)}")
    return pa.concat_tables([_table_of(path, columns) for _, path in files_of(Path(archive), turbine)])


def turbines_of(archive: str | Path) -> tuple[str, ...]:
    """The names of an archive's turbines.

    Raises
    ------
    ConfigurationError
        If the folder is no archive.
    """
    folders = sorted(path.name for path in Path(archive).glob("turbine=*") if path.is_dir())
    if not folders:
        raise ConfigurationError(without("an archive of windsysid batch", archive))
    return tuple(name.removeprefix("turbine=") for name in folders)


def known_sources(archive: Path, turbine: str) -> dict[str, Known]:
    """Rows of a turbine in an archive, by the path of the record's file."""
    columns = ["source", "source_bytes", "status", "tries", "settings", "time", "duration"]
    found: dict[str, Known] = {}
    for day, path in files_of(archive, turbine):
        for row in rows_in(path, columns):
            size, status, tries, settings, begun, seconds = (row[column] for column in columns[1:])
            found[row["source"]] = Known(size, status, tries, settings, day, begun, seconds)
    return found


def files_of(archive: Path, turbine: str) -> Iterator[tuple[str, Path]]:
    """Day and path of every file of a turbine, in order."""
    for path in sorted((archive / f"turbine={turbine}").glob("month=*/*.parquet")):
        if not path.name.startswith("."):
            yield path.stem, path


def rows_in(path: Path, columns: Sequence[str] | None = None) -> list[Row]:
    """The rows of one file; ConfigurationError where it is damaged."""
    rows: list[Row] = _table_of(path, columns).to_pylist()
    return rows


def _table_of(path: Path, columns: Sequence[str] | None = None) -> Any:
    """The rows of one file."""
    pa, pq = _parquet("pyarrow"), _parquet("pyarrow.parquet")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read ({error.strerror}): check the disk") from None
    if not _is_sealed(content):
        raise ConfigurationError(
            f"{path}: is damaged, or not written by windsysid batch: move it away and repeat the command"
        )
    # A file object of Python, which pyarrow's threads hold, ends the process by a signal where they outlive Python.
    with pq.ParquetFile(pa.BufferReader(content)) as file:
        found = file.read(columns=columns, use_threads=False)
    return found.cast(_schema(found.column_names))  # files of an older version lack grades


def _sealed(content: bytes) -> bytes:
    """A Parquet file with the digest of it before its footer."""
    at = _footer(content)
    return content[:at] + hashlib.sha256(FORM + content).digest() + content[at:]


def _is_sealed(content: bytes) -> bool:
    """Test whether a file has the bytes that were written."""
    at = _footer(content)
    digest, before = content[at - DIGEST_BYTES : at], content[: at - DIGEST_BYTES]
    return at > DIGEST_BYTES and digest == hashlib.sha256(FORM + before + content[at:]).digest()


def _footer(content: bytes) -> int:
    """Position of the footer of a Parquet file; negative if there cannot be one."""
    return len(content) - TAIL_BYTES - int.from_bytes(content[-TAIL_BYTES:-4], "little")


def table_of(rows: Sequence[Row]) -> Any:
    """Rows as an Arrow table with the columns of an archive."""
    dated = [{**row, "time": None if row["start"] is None else _date(row["start"])} for row in rows]
    return _parquet("pyarrow").Table.from_pylist(dated, schema=_schema(COLUMNS))


def _schema(names: Iterable[str]) -> Any:
    """Types of these columns of an archive."""
    pa = _parquet("pyarrow")
    plain = {
        NUMBER: pa.float64(), COUNT: pa.int64(), TEXT: pa.string(), TEXTS: pa.list_(pa.string()), FLAG: pa.bool_(),
        NUMBERS: pa.list_(pa.float64()), MOMENT: pa.timestamp("us"),
    }  # fmt: skip
    fields = []
    for name in names:
        kind = COLUMNS[name]
        inner = kind if isinstance(kind, dict) else None
        typed = pa.list_(pa.struct([(key, plain[of]) for key, of in inner.items()])) if inner else plain[str(kind)]
        fields.append(pa.field(name, typed))
    return pa.schema(fields)


def _date(start: str) -> Any:
    """A moment as a date without a zone: UTC where the zone is known."""
    begun = moment(start)
    return begun if begun.tzinfo is None else begun.astimezone(UTC).replace(tzinfo=None)


def _parquet(module: str) -> Any:
    return package(module, "archives", "fleet")
