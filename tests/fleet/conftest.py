"""Four records of one turbine in two days, SCADA beside them, and the archive that becomes of them."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from windsysid.fleet.archive import read_table
from windsysid.fleet.batch import Batch, batch
from windsysid.fleet.members import Member
from windsysid.fleet.rows import Row, row_of
from windsysid.fleet.work import worker as worker_process
from windsysid.fleet.work.guard import Worker
from windsysid.records.formats import write_record
from windsysid.results.serialization import finite
from windsysid.simulation.record import simulate_record

MINUTES = (("T01/a.csv", 50), ("T01/b.csv", 55), ("T01/c.csv", 60))
"""Two records end a day, one begins the next."""


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    for seed, (name, minute) in enumerate(MINUTES):
        start = f"2026-03-{1 + minute // 60:02d}T{(23 + minute // 60) % 24:02d}:{minute % 60:02d}:00Z"
        record = simulate_record("tower", duration=300.0, rate=10.0, seed=seed)
        write_record(replace(record, start=start, name=name), folder / name)
    (folder / "T01" / "d_2026-03-02.csv").write_text("time [s],tower_x_acceleration [m/s^2]\n0,1\n1,wet\n")
    (folder / "scada.csv").write_text("time [s],wind_speed [m/s]\n2026-03-01T23:00:00Z,8\n2026-03-02T00:00:00Z,9\n")
    return folder


@pytest.fixture(scope="session")
def fleet(data: Path) -> Path:
    path = data / "fleet.toml"
    path.write_text('[[turbine]]\nname = "T01"\npattern = "T01/*"\nturbine = "tower"\nscada = "scada.csv"\n')
    return path


_ROWS: dict[tuple[str, str], Row] = {}
"""Rows of records that were identified in this process, by source and settings, before SCADA is joined."""


def _row_once(row: Row, *given: Any) -> Row:
    key = row["source"], row["settings"]
    if key not in _ROWS:
        _ROWS[key] = row_of(row, *given)
    return dict(_ROWS[key])


def _ask(worker: Worker, request: Mapping[str, Any]) -> dict[str, Any]:
    """The answer of a worker process, made in this process."""
    member = Member(**request["member"])
    if request["do"] == "look":
        return {"start": worker_process._start_of(request["source"], member)}
    row = worker_process.take(request["source"], member, request["formulation"], request["settings"], lambda _: None)
    answer: dict[str, Any] = json.loads(json.dumps({"row": finite(row)}))
    return answer


@contextmanager
def workers_in_this_process() -> Iterator[None]:
    """Take records without worker processes, and identify each of them once for all tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Worker, "ask", _ask)
        patch.setattr(worker_process, "row_of", _row_once)
        yield


@pytest.fixture(scope="session")
def taken(data: Path, fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Batch, Path]:
    archive = tmp_path_factory.mktemp("archives") / "whole"
    with workers_in_this_process():
        return batch(data, fleet=fleet, archive=archive, workers=1), archive


def contents(archive: Path) -> dict[str, bytes]:
    return {path.relative_to(archive).as_posix(): path.read_bytes() for path in archive.rglob("*.parquet")}


def rows_of(archive: Path, turbine: str = "T01") -> list[Row]:
    rows: list[Row] = read_table(archive, turbine).to_pylist()
    return rows
