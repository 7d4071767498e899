"""Records as netCDF-4: one variable (time,) per channel with its ``units``, times in seconds.

Everything a `Record` holds is kept, names and attributes included, so that reading gives back what was
written. Files from elsewhere are read if they are built the same way: a coordinate ``time`` [s] and numbers
along it.
"""

from pathlib import Path

from windsysid.errors import OutputError, RecordError
from windsysid.formats.files import check_input, read_start
from windsysid.record import Record

__all__ = ["read_netcdf", "write_netcdf"]

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_netcdf(path: str | Path) -> Record:
    """Read a record from netCDF-4.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Record
        In SI units, under the name it was written with, otherwise the file's.

    Raises
    ------
    RecordError
        If the file is missing, damaged or not netCDF-4, or does not hold a record.
    """
    import xarray as xr

    path = Path(path)
    check_input(path)
    start = read_start(path, len(_HDF5))
    if start[:3] == b"CDF":
        raise RecordError(f"{path}: is classic netCDF, expected netCDF-4; convert it with 'nccopy -k nc4'")
    if start != _HDF5:
        raise RecordError(f"{path}: is not netCDF-4; give the file the ending of what it is, or export it again")
    try:
        # Times are plain seconds: xarray must not turn them into dates or time spans.
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False, decode_timedelta=False) as opened:
            dataset = opened.load()
    except Exception as error:  # damaged HDF5 raises nearly anything
        reason = " ".join(str(error).split())[:120]
        raise RecordError(f"{path}: is damaged, cut off or not netCDF-4 ({reason}); copy or export it again") from error
    try:
        record = Record.from_xarray(dataset)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    return record if "windsysid_name" in dataset.attrs else record.with_name(path.name)


def write_netcdf(record: Record, path: Path) -> None:
    """Write the bare file; `windsysid.formats.write_record` is the safe way in.

    Raises
    ------
    OutputError
        If a name cannot stand in a netCDF file.
    """
    for name in (*record.channels, *record.attributes):
        if "/" in name:
            raise OutputError(f"'{name}' cannot be a name in netCDF because of the '/'; rename it or write CSV")
    dataset = record.to_xarray()
    # NaN is the mark of a missing value already; a fill value would only say so again.
    plain = {str(name): {"_FillValue": None} for name in dataset.variables}
    dataset.to_netcdf(path, engine="h5netcdf", encoding=plain)
