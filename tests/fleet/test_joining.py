"""SCADA beside rows: the same bytes whether it came before its records or after, and clear lines where it is wrong."""

import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from tests.fleet.conftest import contents, rows_of, workers_in_this_process
from windsysid.errors import ConfigurationError
from windsysid.fleet import joining
from windsysid.fleet.archive import add_rows, day_of, known_sources, place_of, rows_in
from windsysid.fleet.batch import Batch, batch
from windsysid.fleet.joining import NOT_JOINED_PREFIX, join, join_late
from windsysid.fleet.rows import Row, empty_row
from windsysid.fleet.scada import Scada

USUAL = 1.27
BEGIN = datetime(2026, 3, 1, tzinfo=UTC)


def scada(begin: datetime = BEGIN, lines: int = 4, **columns: list[float]) -> Scada:
    arrays = {name: np.array(values) for name, values in columns.items()}
    return Scada(begin, np.arange(0.0, 600.0 * lines, 600.0), 600.0, arrays)


def row(start: str | None = "2026-03-01T00:10:00Z", **known: object) -> Row:
    return empty_row("/a.csv", 1, "s") | {"status": "ok", "start": start, "duration": 600.0, "state": "unknown"} | known


def test_scada_that_comes_a_day_later_gives_the_same_bytes(
    taken: tuple[Batch, Path],
    data: Path,
    tmp_path: Path,
):
    late = tmp_path / "fleet.toml"
    late.write_text('[[turbine]]\nname = "T01"\npattern = "T01/*"\nturbine = "tower"\nscada = "late.csv"\n')
    archive = tmp_path / "archive"
    with workers_in_this_process():
        found = batch(data / "T01", fleet=late, archive=archive, workers=1)
    assert found.taken == {"ok": 3, "refused": 1}
    assert len(found.notes) == 2  # a record that is refused, and the file that is not there
    assert "late.csv is, the same command joins it" in str(found)
    assert {one["scada_wind_speed"] for one in rows_of(archive)} == {None}
    (tmp_path / "late.csv").write_bytes((data / "scada.csv").read_bytes())
    found = batch(data / "T01", fleet=late, archive=archive, workers=1)
    assert (found.taken, found.joined, found.notes) == ({}, 3, ())
    assert contents(archive) == contents(taken[1])
    assert batch(data / "T01", fleet=late, archive=archive, workers=1).joined == 0


def test_the_state_follows_from_scada_where_the_record_has_no_rotor_speed():
    found = join(row(), scada(rotor_speed=[1.0] * 4, power=[-1.0] * 4), USUAL)
    assert (found["state"], found["speed_bin"], found["rotor_speed"]) == ("idling", pytest.approx(0.7), 1.0)
    assert found["rotor_speed_min"] is None
    assert join(found, scada(rotor_speed=[1.0] * 4, power=[1.0] * 4), USUAL)["state"] == "running"
    own = row(state="running", rotor_speed=1.2, rotor_speed_min=1.1, rotor_speed_max=1.25)
    found = join(own, scada(rotor_speed=[0.1] * 4, power=[-1.0] * 4), USUAL)
    assert (found["state"], found["rotor_speed"], found["scada_rotor_speed"]) == ("idling", 1.2, 0.1)
    assert join(row(state=None), scada(rotor_speed=[1.0] * 4), USUAL)["state"] is None


def test_a_file_of_other_days_takes_nothing_away():
    known = join(row(), scada(wind_speed=[4.0, 6.0, 8.0, 9.0], power=[1.0] * 4), USUAL)
    assert known["scada_wind_speed"] == 6.0
    assert join(known, scada(datetime(2026, 3, 5, tzinfo=UTC), wind_speed=[1.0] * 4), USUAL) == known
    half = scada(datetime(2026, 3, 1, 0, 15, tzinfo=UTC), wind_speed=[1.0] * 4)
    assert join(known, half, USUAL) == known  # the record was held whole before
    assert join(row(), half, USUAL)["scada_wind_speed"] == 1.0
    corrected = join(known, scada(wind_speed=[4.0, 7.0, 8.0, 9.0]), USUAL)
    assert (corrected["scada_wind_speed"], corrected["scada_power"]) == (7.0, 1.0)
    assert join(known, scada(wind_speed=[4.0, np.nan, 8.0, 9.0]), USUAL)["scada_wind_speed"] is None


def test_another_clock_is_a_note_that_goes_when_it_is_mended():
    local = scada(datetime(2026, 3, 1), wind_speed=[4.0] * 4)
    found = join(row(notes=["mine"]), local, USUAL)
    assert found["notes"][0] == "mine"
    assert found["notes"][1].startswith(NOT_JOINED_PREFIX)
    assert len(found["notes"][1]) <= 160
    found = join(found, scada(wind_speed=[4.0] * 4), USUAL)
    assert (found["notes"], found["scada_wind_speed"]) == (["mine"], 4.0)
    assert join(row(start=None), local, USUAL) == row(start=None)


def test_only_what_changed_is_written(tmp_path: Path):
    days = ("2026-03-01", "2026-03-02")
    for day in days:
        add_rows(place_of(tmp_path, "T", day), [row(f"{day}T00:10:00Z") | {"source": f"/{day}.csv"}])
    before = {day: place_of(tmp_path, "T", day).stat().st_ino for day in days}
    assert join_late(tmp_path, "T", scada(wind_speed=[4.0] * 4), USUAL, known_sources(tmp_path, "T")) == 1
    after = {day: place_of(tmp_path, "T", day).stat().st_ino for day in days}
    assert [before[day] == after[day] for day in days] == [False, True]
    assert [one["scada_wind_speed"] for one in rows_of(tmp_path, "T")] == [4.0, None]


def test_only_days_that_scada_speaks_of_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    starts = [BEGIN + timedelta(days=i) for i in range(-10, 10)]
    for i, start in enumerate(starts):
        text = start.isoformat() if i % 2 else start.astimezone(timezone(timedelta(hours=-8))).isoformat()
        one = row(text) | {"source": f"/{i}.csv"}
        add_rows(place_of(tmp_path, "T", day_of(text, "")), [one])
    other = row("2026-03-03T00:00:00Z") | {"source": "/other.csv"}  # filed by the date in its file's name
    add_rows(place_of(tmp_path, "T", "2026-12-24"), [other])
    known = known_sources(tmp_path, "T")
    read: list[str] = []

    def counted(path: Path, columns: Sequence[str] | None = None) -> list[Row]:
        read.append(path.stem)
        return rows_in(path, columns)

    monkeypatch.setattr(joining, "rows_in", counted)
    table = scada(BEGIN + timedelta(days=2), lines=144, wind_speed=[4.0] * 144)
    assert join_late(tmp_path, "T", table, USUAL, known) == 2
    assert len(set(read)) == 5  # of 21: a day before and after, since clocks may differ
    joined = {one["source"]: one["scada_wind_speed"] for one in rows_of(tmp_path, "T")}
    assert {source for source, speed in joined.items() if speed == 4.0} == {"/12.csv", "/other.csv"}
    read.clear()
    assert join_late(tmp_path, "T", scada(datetime(2030, 1, 1), wind_speed=[4.0] * 4), USUAL, known) == 0
    assert read == []


def test_scada_of_another_clock_and_damaged_scada_end_the_run_before_any_work(data: Path, tmp_path: Path):
    table = tmp_path / "scada.csv"
    for text, message in (
        ("2026-03-01T23:00:00,8\n2026-03-02T00:00:00,9\n", "SCADA of 'tower' does not say its zone"),
        ("2026-03-01T23:00:00Z,8\n2026-03-01T22:00:00Z,9\n", r"SCADA of 'tower': .*the time runs backwards at line 3"),
        ("2026-03-01T23:00:00Z,8\n2026-03-02T00:00:00Z,wet\n", r"SCADA of 'tower': .*'wet' is not a number"),
    ):
        table.write_text("time,wind_speed [m/s]\n" + text)
        with workers_in_this_process(), pytest.raises(ConfigurationError, match=message):
            batch(data / "T01", turbine="tower", scada=table, archive=tmp_path / "archive", workers=1)
    assert not list((tmp_path / "archive").rglob("*.parquet"))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux lists them")
def test_an_archive_is_read_without_threads_that_may_outlive_python(tmp_path: Path):
    add_rows(tmp_path / "day.parquet", [row()])
    count = "len(os.listdir('/proc/self/task'))"
    script = (
        "import os, sys; from pathlib import Path; import pyarrow.parquet; from windsysid.fleet.archive import rows_in;"
        f" before = {count}; rows_in(Path(sys.argv[1])); sys.exit({count} - before)"
    )
    assert subprocess.run([sys.executable, "-c", script, str(tmp_path / "day.parquet")], check=False).returncode == 0
