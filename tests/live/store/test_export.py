"""A store's results as an archive and as netCDF."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.live.store.test_store import submit
from tests.live.store.things import SECOND, WINDOW, level, result, status
from windsysid.errors import ConfigurationError, OutputError
from windsysid.fleet.archive import files_of, read_table, turbines_of
from windsysid.fleet.rows import Row, empty_row
from windsysid.live.store import Keep
from windsysid.live.store.contents import Commit, Result
from windsysid.live.store.export import export_levels, export_results, levels_dataset
from windsysid.live.store.keep import DAY
from windsysid.live.store.sql_store import SqlStore
from windsysid.records.moments import moment_text

MIDNIGHT = 1_767_225_600 * SECOND


@pytest.fixture
def row() -> Row:
    channel = {"name": "δ", "unit": "m", "mean": 0.1 + 0.2, "std": None, "min": -1.0, "max": 1e-300, "missing": 0.5}
    return empty_row("", 0, "settings") | {"status": "refused", "why": "too short", "channels": [channel]}


def window(row: Row, number: int, turbine: str = "T01") -> Result:
    begun = MIDNIGHT + number * WINDOW
    text = moment_text(begun, 0)
    dated = row | {"source": f"{turbine} {text}", "start": text}
    return result(0, turbine)._replace(window=begun, until=begun + WINDOW, row=dated)


def test_results_become_an_archive_and_are_added_once(store: SqlStore, row: Row, tmp_path: Path):
    submit(store, Commit(results=[window(row, number) for number in range(-3, 3)]))
    archive = tmp_path / "archive"
    assert export_results(store, archive) == {"T01": 6}
    assert turbines_of(archive) == ("T01",)
    assert [day for day, _ in files_of(archive, "T01")] == ["2025-12-31", "2026-01-01"]
    found = read_table(archive, "T01").to_pylist()
    assert [entry["source"] for entry in found] == [
        f"T01 {moment_text(MIDNIGHT + n * WINDOW, 0)}" for n in range(-3, 3)
    ]
    assert found[0]["channels"] == row["channels"]
    before = {path: path.read_bytes() for path in archive.rglob("*.parquet")}
    submit(store, Commit(results=[window(row, 200), window(row, 0, "T02")]))
    assert export_results(store, archive) == {"T01": 1, "T02": 1}
    assert before.items() <= {path: path.read_bytes() for path in archive.rglob("*.parquet")}.items()


def test_results_of_days_whose_levels_were_thinned_are_exported(again, row: Row, tmp_path: Path):
    store = again(Keep(levels="1 day"))
    submit(store, Commit(results=[window(row, number) for number in range(4)]))
    store.thin(now=MIDNIGHT + 9 * DAY)
    assert len(store.levels("T01")) == 2
    assert export_results(store, tmp_path / "archive") == {"T01": 4}


def test_a_folder_with_other_files_takes_no_archive(store: SqlStore, tmp_path: Path):
    (tmp_path / "diary").touch()
    with pytest.raises(OutputError, match="holds files but no archive"):
        export_results(store, tmp_path)


def test_a_name_that_is_no_folders_is_refused(store: SqlStore, row: Row, tmp_path: Path):
    submit(store, Commit(results=[window(row, 0, "../T01")]))
    with pytest.raises(ConfigurationError, match="a folder has its name"):
        export_results(store, tmp_path / "archive")
    with pytest.raises(ConfigurationError, match="a folder has its name"):
        export_levels(store, tmp_path / "levels")
    assert not list(tmp_path.rglob("*.parquet"))


def test_levels_become_netcdf_with_units_and_times(store: SqlStore, row: Row, tmp_path: Path):
    late = window(row, 5000)._replace(levels=[level(estimate=2.0)])
    submit(store, Commit(results=[window(row, 0), late]))
    [path] = export_levels(store, tmp_path / "levels")
    assert path.name == "levels_T01.nc"
    with xr.open_dataset(path, engine="h5netcdf") as found:
        assert found["k_x"].attrs["units"] == "N/m"
        assert found["k_x_statistic"].attrs["units"] == "1"
        assert found["time"].values.astype("int64").tolist() == [MIDNIGHT, MIDNIGHT + 5000 * WINDOW]
        assert found["k_x"].values.tolist() == [1.1, 2.0]
        assert found["k_x_level"].values.tolist() == [0.1 + 0.2] * 2
        assert np.isnan(found["c_x_level"].values[1])
        assert found.attrs["Conventions"].startswith("CF-")
    export_levels(store, tmp_path / "levels")


def test_turbines_without_levels_have_no_file(store: SqlStore, row: Row, tmp_path: Path):
    submit(store, Commit(results=[window(row, 0)._replace(levels=[])], statuses=[status("T02")]))
    assert export_levels(store, tmp_path / "levels") == []
    assert levels_dataset(store, "T09").sizes == {"time": 0}
