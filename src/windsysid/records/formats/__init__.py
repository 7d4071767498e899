"""Files in, records out, and back.

`read_record`, `iterate_record` and `write_record` pick the format by the file name; each format is one module, which
ends in its `Format`, and `FORMATS` below lists them. ``docs/records.md`` has the table.

What a file does not say about itself, a mapping file does (`windsysid.records.formats.contents.mapping`). Whatever is
wrong with a file becomes one line: a `RecordError` on reading, an `OutputError` on writing; what is wrong with a
mapping is a `ConfigurationError`.
"""

from collections.abc import Callable, Iterable, Iterator
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
    "FORMATS", "as_mapping", "format_of", "iterate_record", "load_mapping", "read_record", "write_record",
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
    """Read a record from a file; the ending of its name tells the format.

    Parameters
    ----------
    path : str or Path
        File in any format of ``docs/records.md``: CSV, netCDF, Parquet, OpenFAST, MATLAB, HDF5, TDMS, UFF, MDF and
        others.
    mapping : str, Path or Mapping, optional
        Mapping file (TOML): the column with the time, the notation of text, names, units and signs of channels.
    section : (float, float), optional
        Only the samples with start ≤ t < end [s], on the record's own clock. The rest is not kept in memory, and
        samples after the end are not read (OpenFAST text is read whole).
    progress : callable, optional
        Called with the fraction of the file that has been read, 0 to 1.

    Returns
    -------
    Record
        In SI units, under the name it was written with, otherwise the file's. In OpenFAST output, `rotor_azimuth` is
        wrapped to [0, 2π), and the time is as uniform as it was before it was rounded for the file. Values of an
        unknown unit stay as they are, with the unit ``"as written: <unit>"``.

    Raises
    ------
    RecordError
        If there is no such file, its ending is unknown, its content is damaged or no record, a cell is not a number
        (the first is named by column and line), a value is infinite, a unit is unknown, the time is missing, unsorted
        or repeated, the section reaches outside the record, or an optional package is not installed.
    ConfigurationError
        If the mapping is wrong or lists a column that is not there.

    See Also
    --------
    iterate_record : Read a file in pieces.
    write_record : Write a record.
    load_mapping : Read a mapping file.
    inspect : Faults of a record.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> path = Path(tempfile.mkdtemp()) / "logger.csv"
    >>> ws.write_record(ws.Record([0.0, 0.1, 0.2], [[0.1], [0.2], [0.1]], ("Acc X",), ("m/s^2",)), path)
    >>> ws.read_record(path)["Acc X"].tolist()
    [0.1, 0.2, 0.1]
    >>> rules = path.with_suffix(".toml")
    >>> _ = rules.write_text('channels."Acc X" = {name = "tower_x_acceleration", sign = -1}')
    >>> ws.read_record(path, mapping=rules, section=(0.0, 0.15))["tower_x_acceleration"].tolist()
    [-0.1, -0.2]
    """
    path = Path(path)
    rules = as_mapping(mapping)
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
    """Read a record in pieces, for files that do not fit into memory.

    Parameters
    ----------
    path : str or Path
        As in `read_record`.
    seconds_per_piece : float
        Length of a piece [s]; pieces begin at multiples of it after the first sample.
    mapping, progress
        As in `read_record`.
    section : (float, float), optional
        Only the samples with start ≤ t < end [s]; a section that reaches outside the record is an error at its end.

    Yields
    ------
    Record
        Every sample of the file, or of the section, is in exactly one piece, in order; times are the record's own. A
        piece has at least 2 samples: a single one next to a gap is added to the piece before.

    Raises
    ------
    RecordError, ConfigurationError
        As raised by `read_record`, once the faulty place is reached.

    See Also
    --------
    identify_pieces : Identification from pieces.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> path = Path(tempfile.mkdtemp()) / "tower.csv"
    >>> ws.write_record(ws.simulate("tower", duration=60.0, rate=20.0), path)
    >>> [piece.samples for piece in ws.iterate_record(path, 25.0)]
    [500, 500, 200]
    """
    path = Path(path)
    rules = as_mapping(mapping)
    if not 0.0 < seconds_per_piece < float("inf"):
        raise ConfigurationError(f"seconds_per_piece is {seconds_per_piece}, expected a time [s] above 0")
    found = format_of(path)
    with named_after(path):
        yield from pieces(_opened(found, path, rules), seconds_per_piece, progress, section)


def _opened(found: Format, path: Path, rules: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file as a source without repeated channels."""
    return without_repeats(found.open(path, rules, whole=whole))


def as_mapping(mapping: str | Path | Mapping | None) -> Mapping:
    """A mapping from itself or the path of its file; None maps nothing. ConfigurationError as of `load_mapping`."""
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
    """Write a record as CSV, netCDF or Parquet; the ending of the file name tells which.

    The file appears complete or not at all; a missing folder is made. CSV keeps every bit of times and values and the
    start, but not `Record.attributes`; netCDF and Parquet keep everything.

    Parameters
    ----------
    record : Record
        Record to write.
    path : str or Path
        Ends in ``.csv``, ``.txt``, ``.dat``, ``.tsv``, ``.nc``, ``.nc4``, ``.netcdf`` or ``.parquet``.
    overwrite : bool, default False
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, it cannot be written, or the ending is not one of those.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> path = Path(tempfile.mkdtemp()) / "tower.csv"
    >>> ws.write_record(ws.simulate("tower", duration=60.0, rate=20.0), path)
    >>> ws.read_record(path).channels[:2]
    ('rotor_azimuth', 'rotor_speed')
    """
    with claim_record(path, overwrite=overwrite) as write:
        write(record)


@contextmanager
def claim_record(
    path: str | Path, *, overwrite: bool = False, inputs: Iterable[str | Path] = ()
) -> Iterator[Callable[[Record], None]]:
    """Reserve the name of a record's file, none of the `inputs`, before there is a record; yields its writer.

    Raises as `write_record`.
    """
    path = Path(path)
    written = tuple(one for one in FORMATS if one.write is not None)
    writer = next((one.write for one in written if one.is_named(path)), None)
    if writer is None:
        raise OutputError(
            f"{path}: cannot write files ending in '{path.suffix}', expected one of {_endings(written)}; "
            "choose another name"
        )
    with claim_file(path, overwrite=overwrite, inputs=inputs) as write:
        yield lambda record: write(lambda file: writer(record, file))
