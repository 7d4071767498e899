"""Files in, records out, and back.

`read_record`, `iterate_record` and `write_record` pick the format by the file name; each format is one module, which
ends in its `Format`, and `FORMATS` below lists them. ``docs/records.md`` has the table.

What a file does not say about itself, a mapping file does (`windsysid.records.formats.contents.mapping`). Whatever is
wrong with a file becomes one line: a `RecordError` on reading, an `OutputError` on writing; what is wrong with a
mapping is a `ConfigurationError`.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from windsysid.errors import ConfigurationError, OutputError, RecordError
from windsysid.output.files import claim_file
from windsysid.records.formats import (
    bladed,
    csv,
    dewesoft,
    hawc2,
    hdf5,
    lvm,
    matlab,
    mdf,
    netcdf,
    npy,
    openfast,
    parquet,
    tdms,
    uff,
)
from windsysid.records.formats.access.files import check_input, named_after, read_start
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping, load_mapping
from windsysid.records.formats.contents.source import (
    FileSource,
    Progress,
    gather,
    gather_section,
    pieces,
    without_repeats,
)
from windsysid.records.record import Record

__all__ = [
    "FORMATS", "format_of", "iterate_record", "load_mapping", "read_record", "write_record",
]  # fmt: skip

FORMATS: tuple[Format, ...] = (
    netcdf.FORMAT, parquet.FORMAT, openfast.FORMAT, matlab.FORMAT, hdf5.FORMAT, tdms.FORMAT, uff.FORMAT,
    npy.FORMAT, mdf.FORMAT, dewesoft.FORMAT, lvm.FORMAT, bladed.FORMAT, hawc2.FORMAT, csv.FORMAT,
)  # fmt: skip
"""All formats; of several that share an ending, the one whose content is not known by its first bytes comes last."""

_START = 128  # bytes: the first of a file tell its format


def read_record(
    path: str | Path,
    *,
    mapping: str | Path | Mapping | None = None,
    section: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Record:
    """Read a record; the ending of the file name says which format it is.

    Parameters
    ----------
    path : str or Path
        Any format of ``docs/records.md``.
    mapping : str, Path or Mapping, optional
        Mapping file (TOML): which column is the time, how text is written, names, units and signs of channels.
    section : (float, float), optional
        Only the samples with start ≤ t < end [s], on the record's own clock. The rest is not kept in memory, and
        what comes after it is not read (OpenFAST text is read whole).
    progress : callable, optional
        Called with the fraction of the file that has been read, 0 to 1.

    Returns
    -------
    Record
        In SI units, under the name it was written with, otherwise the file's. Of OpenFAST's output, `rotor_azimuth` is
        wrapped to [0, 2π), the time is as uniform as it was before it was rounded for the file, and a unit that
        windsysid does not know stays with its values as ``"as written: <unit>"``.

    Raises
    ------
    RecordError
        If there is no such file, its ending is not one of those, its content is damaged or no record, a cell is not a
        number (the first is named by column and line), a value is infinite, a unit is unknown, the time is missing,
        unsorted or repeated, the section reaches outside the record, or an optional package is not installed.
    ConfigurationError
        If the mapping is wrong or lists a column that is not there.
    """
    path = Path(path)
    rules = _rules(mapping)
    found = format_of(path)
    with named_after(path):
        if section is None:
            return gather(_opened(found, path, rules, whole=True), progress)
        return gather_section(_opened(found, path, rules), *section, progress)


def iterate_record(
    path: str | Path,
    seconds_per_piece: float,
    *,
    mapping: str | Path | Mapping | None = None,
    section: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Iterator[Record]:
    """The record in pieces, for files that do not fit into memory.

    Parameters
    ----------
    path : str or Path
    seconds_per_piece : float
        [s]; pieces begin at multiples of it after the first sample.
    mapping, progress
        As in `read_record`.
    section : (float, float), optional
        Only the samples with start ≤ t < end [s]; an end outside the record is reported at its end.

    Yields
    ------
    Record
        Every sample of the file, or of the section, is in exactly one piece, in order; times are the record's own. A
        piece has at least 2 samples: one that would stand alone next to a gap goes with the piece before.

    Raises
    ------
    RecordError, ConfigurationError
        As `read_record`, but where the bad place is reached.
    """
    path = Path(path)
    rules = _rules(mapping)
    if not 0.0 < seconds_per_piece < float("inf"):
        raise ConfigurationError(f"seconds_per_piece is {seconds_per_piece}, expected a time [s] above 0")
    found = format_of(path)
    with named_after(path):
        yield from pieces(_opened(found, path, rules), seconds_per_piece, progress, section)


def _opened(found: Format, path: Path, rules: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file as a source without repeated channels."""
    return without_repeats(found.open(path, rules, whole=whole))


def _rules(mapping: str | Path | Mapping | None) -> Mapping:
    if mapping is None:
        return Mapping()
    return mapping if isinstance(mapping, Mapping) else load_mapping(mapping)


def format_of(path: Path) -> Format:
    """The format of a file, by the ending of its name, and by its content where several formats share the ending.

    Raises
    ------
    RecordError
        If there is no such file, or no format has this ending; the content then says which ending it should have.
    """
    check_input(path)
    start = read_start(path, _START)
    named = [one for one in FORMATS if one.is_named(path)]
    if named:
        return next((one for one in named if one.holds(path, start)), named[-1])
    by_content = next((one for one in FORMATS if one.begins and start.startswith(one.begins)), None)
    if by_content is not None:
        raise RecordError(
            f"{path}: unknown ending '{path.suffix}', but it holds {by_content.name}: rename it to end in"
            f" '{by_content.endings[0]}'"
        )
    raise RecordError(
        f"{path}: unknown ending '{path.suffix}', expected one of {_endings(FORMATS)}; rename the file after what it"
        " holds"
    )


def _endings(formats: tuple[Format, ...]) -> str:
    return ", ".join(dict.fromkeys(ending for one in formats for ending in one.endings))


def write_record(record: Record, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a record as CSV, netCDF or Parquet; the ending of the file name says which.

    The file appears complete or not at all; a folder that is missing is made. CSV keeps every bit of times and values
    and the start, but not `Record.attributes`; netCDF and Parquet keep everything.

    Parameters
    ----------
    record : Record
    path : str or Path
        Ends in ``.csv``, ``.txt``, ``.dat``, ``.tsv``, ``.nc``, ``.nc4``, ``.netcdf`` or ``.parquet``.
    overwrite : bool
        Replace a file that is already there.

    Raises
    ------
    OutputError
        If the file is already there, it cannot be written, or the ending is not one of those.
    """
    with claim_record(path, overwrite=overwrite) as write:
        write(record)


@contextmanager
def claim_record(path: str | Path, *, overwrite: bool = False) -> Iterator[Callable[[Record], None]]:
    """Reserve the name of a record's file before there is a record; yields its writer. Raises as `write_record`."""
    path = Path(path)
    written = tuple(one for one in FORMATS if one.write is not None)
    writer = next((one.write for one in written if one.is_named(path)), None)
    if writer is None:
        raise OutputError(
            f"{path}: cannot write files ending in '{path.suffix}', expected one of {_endings(written)}; "
            "choose another name"
        )
    with claim_file(path, overwrite=overwrite) as write:
        yield lambda record: write(lambda file: writer(record, file))
