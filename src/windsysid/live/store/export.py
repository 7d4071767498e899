"""Export of a store: an archive for `windsysid monitor` and `windsysid report`, and netCDF."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from windsysid.fleet.archive import add_rows, claim_archive, day_of, known_sources, place_of
from windsysid.fleet.members import Member
from windsysid.live.store.keep import DAY
from windsysid.live.store.sql_store import SqlStore
from windsysid.output.files import explain_errors, replace_file

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["export_levels", "export_results", "levels_dataset"]

READ_SPAN_NS = 10 * DAY
"""Stream time that is read from the store at once."""

ESTIMATE = (("", "of the window alone"), ("_low", "lower end of ±2σ"), ("_high", "upper end of ±2σ"))
LEVEL = (
    ("_level", "as known after the window"),
    ("_level_low", "lower end of ±2σ"),
    ("_level_high", "upper end of ±2σ"),
)


def export_results(store: SqlStore, archive: str | Path) -> dict[str, int]:
    """Add the rows of all windows to an archive of `windsysid batch`, but those that it has.

    Parameters
    ----------
    archive
        A folder; made where it is missing.

    Returns
    -------
    dict
        How many rows were added, by turbine.

    Raises
    ------
    OutputError
        If the folder holds something else, or cannot be written.
    ConfigurationError
        If a turbine's name cannot be a folder's.
    StoreError
        If the store cannot be read.
    """
    archive = Path(archive)
    added: dict[str, int] = {}
    with claim_archive(archive):
        for turbine in store.turbines():
            Member(turbine, "")  # its name becomes a folder's
            known, added[turbine] = known_sources(archive, turbine), 0
            for since, until in _pieces(store, turbine):
                days: dict[str, list[dict[str, Any]]] = {}
                for result in store.results(turbine, since=since, until=until):
                    row = dict(result.row)
                    if row["source"] not in known:
                        days.setdefault(day_of(row["start"], row["source"]), []).append(row)
                for day, rows in days.items():
                    add_rows(place_of(archive, turbine, day), rows)
                    added[turbine] += len(rows)
    return added


def export_levels(store: SqlStore, folder: str | Path) -> list[Path]:
    """Write each turbine's levels into a netCDF file, ``levels_T01.nc``, in place of an older one.

    Returns
    -------
    list of Path
        The files: none of a turbine without levels.

    Raises
    ------
    OutputError
        If one cannot be written.
    ConfigurationError
        If a turbine's name cannot be a file's.
    StoreError
        If the store cannot be read.
    """
    written = []
    for turbine in store.turbines():
        Member(turbine, "")
        found = levels_dataset(store, turbine)
        if not found.sizes["time"]:
            continue
        path = Path(folder) / f"levels_{turbine}.nc"
        content = bytes(found.to_netcdf(engine="h5netcdf"))
        with explain_errors(str(path), "choose a folder you may write to, with space left"):
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, partial(_write, content))
        written.append(path)
    return written


def _write(content: bytes, file: BinaryIO) -> None:
    file.write(content)


def levels_dataset(store: SqlStore, turbine: str) -> "xr.Dataset":
    """All levels of a turbine.

    Returns
    -------
    xarray.Dataset
        Over ``time``, the windows' starts (UTC). Of a series ``k_x`` the variables ``k_x``, ``k_x_low`` and
        ``k_x_high`` are the estimate of the window alone, ``k_x_level``, ``k_x_level_low`` and ``k_x_level_high`` what
        was known after it, in the series' unit; ``k_x_statistic`` and ``k_x_limit`` are the test for a jump.

    Raises
    ------
    StoreError
        If the store cannot be read.
    """
    import xarray as xr

    from windsysid._version import __version__

    times: list[int] = []
    series: dict[str, tuple[dict[str, str], list[int], list[tuple[float | None, ...]]]] = {}
    for since, until in _pieces(store, turbine):
        for window, level in store.levels(turbine, since=since, until=until, most=10**9):
            if not times or times[-1] != window:
                times.append(window)
            named = series.setdefault(level.name, ({"units": level.unit or "1", "kind": level.kind}, [], []))
            named[1].append(len(times) - 1)
            named[2].append(level[3:11])
    variables: dict[str, Any] = {}
    for name, (attrs, places, numbers) in series.items():
        values = np.full((len(times), 8), np.nan)
        values[places] = np.array(numbers, dtype=float)
        name = name.replace("/", "_")
        tests = (("_statistic", "test for a jump"), ("_limit", "where the test calls it a jump"))
        for i, (suffix, text) in enumerate((*ESTIMATE, *LEVEL, *tests)):
            said = attrs if i < 6 else attrs | {"units": "1"}
            variables[f"{name}{suffix}"] = ("time", values[:, i], said | {"long_name": f"{name}: {text}"})
    time = np.array(times, dtype="datetime64[ns]")
    return xr.Dataset(
        variables, {"time": ("time", time, {"standard_name": "time", "long_name": "start of the window, UTC"})},
        {"Conventions": "CF-1.11", "title": f"levels of {turbine}", "source": f"windsysid {__version__}"},
    )  # fmt: skip


def _pieces(store: SqlStore, turbine: str) -> Iterator[tuple[int, int]]:
    """Spans of time that hold all windows of a turbine [ns since 1970]."""
    extent = store.extent(turbine)
    if extent is not None:
        first, newest = extent
        for since in range(first, newest + 1, READ_SPAN_NS):
            yield since, since + READ_SPAN_NS
