"""Files in, records out, and back.

`read_record` and `write_record` pick the format by the file name; each format is one module:

========================================  ==========================  ==============
file name                                 module                      read / written
========================================  ==========================  ==============
``.csv``, ``.txt``, ``.dat``              `windsysid.formats.csv`     both
``.nc``, ``.nc4``, ``.netcdf``            `windsysid.formats.netcdf`  both
``.out``, ``.outb``                       `windsysid.formats.openfast`  read
========================================  ==========================  ==============

Whatever is wrong with a file becomes one line: a `RecordError` on reading, an `OutputError` on writing.
"""

from collections.abc import Callable
from pathlib import Path

from windsysid.errors import OutputError, RecordError
from windsysid.formats.csv import read_csv, write_csv
from windsysid.formats.files import check_input, write_beside
from windsysid.formats.netcdf import read_netcdf, write_netcdf
from windsysid.formats.openfast import read_openfast
from windsysid.record import Record

__all__ = ["read_csv", "read_netcdf", "read_openfast", "read_record", "write_record"]

_READERS: dict[str, Callable[[Path], Record]] = {
    **dict.fromkeys((".csv", ".txt", ".dat"), read_csv),
    **dict.fromkeys((".nc", ".nc4", ".netcdf"), read_netcdf),
    **dict.fromkeys((".out", ".outb"), read_openfast),
}
_WRITERS: dict[str, Callable[[Record, Path], None]] = {
    **dict.fromkeys((".csv", ".txt", ".dat"), write_csv),
    **dict.fromkeys((".nc", ".nc4", ".netcdf"), write_netcdf),
}


def read_record(path: str | Path) -> Record:
    """Read a record; the ending of the file name says which format it is.

    Parameters
    ----------
    path : str or Path
        CSV, netCDF or OpenFAST output, see the table above.

    Returns
    -------
    Record
        In SI units, named after the file.

    Raises
    ------
    RecordError
        If there is no such file, its ending is not one of those, or its content is not a record.
    """
    path = Path(path)
    check_input(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise RecordError(
            f"{path}: unknown ending '{path.suffix}', expected one of {', '.join(_READERS)}; "
            "rename the file after what it holds"
        )
    return reader(path)


def write_record(record: Record, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a record as CSV or netCDF; the ending of the file name says which.

    The file appears complete or not at all. CSV keeps every bit of times and values, but not
    `Record.attributes`; netCDF keeps everything.

    Parameters
    ----------
    record : Record
    path : str or Path
        Ends in ``.csv``, ``.txt``, ``.dat``, ``.nc``, ``.nc4`` or ``.netcdf``.
    overwrite : bool
        Replace a file that is already there.

    Raises
    ------
    OutputError
        If the file is already there, its folder is missing or not writable, or the ending is not one of
        those.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(
            f"{path}: cannot write files ending in '{path.suffix}', expected one of {', '.join(_WRITERS)}; "
            "choose another name"
        )
    write_beside(path, lambda temporary: writer(record, temporary), overwrite=overwrite)
