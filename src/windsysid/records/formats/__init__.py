"""Files in, records out, and back.

`read_record`, `iterate_record` and `write_record` pick the format by the file name; each format is one module:

=========================================  ============================  ==============
file name                                  module                        read / written
=========================================  ============================  ==============
``.csv``, ``.txt``, ``.dat``, ``.tsv``     `windsysid.records.formats.csv`       both
``.nc``, ``.nc4``, ``.netcdf``             `windsysid.records.formats.netcdf`    both
``.parquet``                               `windsysid.records.formats.parquet`   both
``.out``, ``.outb``                        `windsysid.records.formats.openfast`  read
=========================================  ============================  ==============

What a file does not say about itself, a mapping file does (`windsysid.records.formats.mapping`). Whatever is wrong with
a file becomes one line: a `RecordError` on reading, an `OutputError` on writing; what is wrong with a mapping is a
`ConfigurationError`.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, TypeVar

from windsysid.errors import ConfigurationError, OutputError, RecordError
from windsysid.output.files import claim_file
from windsysid.records.formats.csv import open_csv, write_csv
from windsysid.records.formats.files import check_input, named_after
from windsysid.records.formats.mapping import Mapping, load_mapping
from windsysid.records.formats.netcdf import open_netcdf, write_netcdf
from windsysid.records.formats.openfast import open_openfast
from windsysid.records.formats.parquet import open_parquet, write_parquet
from windsysid.records.formats.source import Progress, Source, gather, gather_section, pieces
from windsysid.records.record import Record

__all__ = [
    "iterate_record", "load_mapping", "read_record", "write_record",
]  # fmt: skip

T = TypeVar("T")

_CSV, _NETCDF, _PARQUET = (".csv", ".txt", ".dat", ".tsv"), (".nc", ".nc4", ".netcdf"), (".parquet",)
# an opener is told whether the `whole` file will be read
_OPENERS: dict[str, Callable[..., Source]] = {
    **dict.fromkeys(_CSV, open_csv),
    **dict.fromkeys(_NETCDF, open_netcdf),
    **dict.fromkeys(_PARQUET, open_parquet),
    **dict.fromkeys((".out", ".outb"), open_openfast),
}
_WRITERS: dict[str, Callable[[Record, BinaryIO], None]] = {
    **dict.fromkeys(_CSV, write_csv),
    **dict.fromkeys(_NETCDF, write_netcdf),
    **dict.fromkeys(_PARQUET, write_parquet),
}


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
        CSV, netCDF, Parquet or OpenFAST output, see the table above.
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
    opener = _of_ending(path, _OPENERS)
    with named_after(path):
        if section is None:
            return gather(opener(path, rules, whole=True), progress)
        return gather_section(opener(path, rules), *section, progress)


def iterate_record(
    path: str | Path,
    seconds_per_piece: float,
    *,
    mapping: str | Path | Mapping | None = None,
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

    Yields
    ------
    Record
        Every sample of the file is in exactly one piece, in order; times are the record's own. A piece has at least
        2 samples: one that would stand alone beside a gap goes with the piece before.

    Raises
    ------
    RecordError, ConfigurationError
        As `read_record`, but where the bad place is reached.
    """
    path = Path(path)
    rules = _rules(mapping)
    if not 0.0 < seconds_per_piece < float("inf"):
        raise ConfigurationError(f"seconds_per_piece is {seconds_per_piece}, expected a time [s] above 0")
    opener = _of_ending(path, _OPENERS)
    with named_after(path):
        yield from pieces(opener(path, rules), seconds_per_piece, progress)


def _rules(mapping: str | Path | Mapping | None) -> Mapping:
    if mapping is None:
        return Mapping()
    return mapping if isinstance(mapping, Mapping) else load_mapping(mapping)


def _of_ending(path: Path, table: dict[str, T]) -> T:
    check_input(path)
    found = table.get(path.suffix.lower())
    if found is None:
        raise RecordError(
            f"{path}: unknown ending '{path.suffix}', expected one of {', '.join(table)}; "
            "rename the file after what it holds"
        )
    return found


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
    """Take the name of a record's file before there is a record; yields what writes it. Raises as `write_record`."""
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(
            f"{path}: cannot write files ending in '{path.suffix}', expected one of {', '.join(_WRITERS)}; "
            "choose another name"
        )
    with claim_file(path, overwrite=overwrite) as write:
        yield lambda record: write(lambda file: writer(record, file))
