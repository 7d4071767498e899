"""A folder becomes an archive: each record once, failures as rows, the same bytes whatever happened on the way."""

import logging
import os
import shutil
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.fleet.conftest import contents, rows_of, workers_in_this_process
from windsysid.errors import ConfigurationError, OutputError, RecordError
from windsysid.fleet.archive import add_rows, day_of, place_of
from windsysid.fleet.batch import Batch, batch
from windsysid.fleet.members import read_fleet, single
from windsysid.fleet.rows import COLUMNS, empty_row
from windsysid.fleet.work.engine import run_on_dask
from windsysid.fleet.work.guard import Worker
from windsysid.fleet.work.tasks import Task, run_task


def test_every_record_is_a_row_under_its_day(taken: tuple[Batch, Path]):
    found, archive = taken
    assert found.taken == {"ok": 3, "refused": 1}
    assert set(contents(archive)) == {
        f"turbine=T01/month=2026-03/2026-03-{day}.parquet" for day in ("01", "02")
    }  # fmt: skip
    assert not [path for path in archive.rglob(".*") if path.is_file()]
    rows = {Path(row["source"]).name: row for row in rows_of(archive)}
    assert list(rows) == ["a.csv", "b.csv", "d_2026-03-02.csv", "c.csv"]  # by start; what has none comes first
    assert set(rows["a.csv"]) == set(COLUMNS)
    bad = rows["d_2026-03-02.csv"]
    assert bad["status"] == "refused"
    assert "'wet' is not a number" in bad["why"]
    good = rows["c.csv"]
    assert (good["status"], good["state"], good["scada_wind_speed"]) == ("ok", "running", 9.0)
    assert good["start"] == "2026-03-02T00:00:00Z"
    assert [p["name"] for p in good["parameters"]] == ["k_side_side", "c_side_side", "k_fore_aft", "c_fore_aft"]
    unknowns = 4 + len(good["statistics"]) + 6  # gains and axes of two sensors, mass of the top, aerodynamics
    assert len(good["covariance"]) == unknowns * (unknowns + 1) // 2
    assert good["modes"][0]["frequency"] == pytest.approx(0.3163, rel=0.03)


def test_a_row_says_what_identify_says(taken: tuple[Batch, Path], data: Path):
    import windsysid as ws

    row = rows_of(taken[1])[0]
    found = ws.identify(data / "T01" / "a.csv", "tower", formulation="spectral")
    assert {p["name"]: p["estimate"] for p in row["parameters"]} == pytest.approx(
        {e.name: e.estimate for e in found.estimates}, rel=1e-9
    )
    assert row["trusted"] == found.diagnosis.trusted
    assert {p["name"]: p["grade"] for p in row["parameters"]} == {e.name: e.grade for e in found.estimates}
    grades = [(m.frequency.grade, m.damping_ratio.grade) for m in found.modes]
    assert [(m["frequency_grade"], m["damping_ratio_grade"]) for m in row["modes"]] == grades
    assert found.provenance is not None
    assert row["record_hash"] == found.provenance.record_hash


def test_the_same_command_takes_only_what_is_new(taken: tuple[Batch, Path], data: Path, fleet: Path):
    before = contents(taken[1])
    again = batch(data, fleet=fleet, archive=taken[1])
    assert (again.taken, again.known) == ({}, 4)
    assert contents(taken[1]) == before


def test_other_settings_are_refused(taken: tuple[Batch, Path], data: Path, fleet: Path):
    with pytest.raises(ConfigurationError, match="is there with another turbine file"):
        batch(data, fleet=fleet, archive=taken[1], formulation="joint")


def test_killed_and_in_another_order_the_archive_has_the_same_bytes(
    taken: tuple[Batch, Path], data: Path, fleet: Path, tmp_path: Path
):
    task = task_of(data, tmp_path / "turbine=T01" / "month=2026-03" / "2026-03-01.parquet", "b.csv")
    worker = Worker(300.0)
    killer = threading.Thread(target=kill_once, args=(worker,))
    killer.start()
    run_task(task, worker, lambda *_: None)
    killer.join()
    worker.close()
    with workers_in_this_process():
        assert batch(data, fleet=fleet, archive=tmp_path, workers=1).known == 1
    assert contents(tmp_path) == contents(taken[1])  # of which one row is of a worker process


def kill_once(worker: Worker) -> None:
    while worker._process is None:
        time.sleep(0.01)
    time.sleep(2.0)
    process = worker._process
    if process is not None:
        os.kill(process.pid, signal.SIGKILL)


def test_a_worker_that_was_killed_is_started_again():
    worker = Worker(300.0)
    process = worker._running()
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert worker._running().pid != process.pid
    worker.close()


def test_a_record_that_hangs_becomes_a_row_and_the_next_is_taken(data: Path, tmp_path: Path):
    worker = Worker(300.0)
    process = worker._running()
    os.kill(process.pid, signal.SIGSTOP)
    worker.limit = 0.2
    statuses: list[str] = []

    def tell(status: str, _: str) -> None:
        statuses.append(status)
        worker.limit = 300.0

    run_task(
        task_of(data, tmp_path / "turbine=T01" / "month=2026-03" / "2026-03-01.parquet", "a.csv", "d_2026-03-02.csv"),
        worker,
        tell,
    )
    worker.close()
    assert statuses == ["failed", "refused"]
    (row,) = [row for row in rows_of(tmp_path) if row["status"] == "failed"]
    assert (row["why"], row["tries"]) == ("did not finish within 0.2 s and was ended", 1)
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def task_of(data: Path, place: Path, *names: str) -> Task:
    member = read_fleet(data / "fleet.toml")[0]
    sources = tuple((str((data / "T01" / name).resolve()), 0) for name in names)
    return Task(member, "2026-03-01", str(place), sources, "spectral", member.settings("spectral"), 300.0)


def test_a_full_disk_ends_the_run_and_leaves_what_was(tmp_path: Path):
    from tests.cli.disks import files_of_at_most

    path = tmp_path / "turbine=T" / "month=2026-03" / "2026-03-01.parquet"
    add_rows(path, [empty_row("/a.csv", 1, "s")])
    before = path.read_bytes()
    with files_of_at_most(1000), pytest.raises(OutputError, match="make room, and give the same command again"):
        add_rows(path, [empty_row("/b.csv", 1, "s")])
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]
    add_rows(path, [empty_row("/b.csv", 1, "s")])
    assert [row["source"] for row in rows_of(tmp_path, "T")] == ["/a.csv", "/b.csv"]


def test_what_is_not_ours_is_not_overwritten(tmp_path: Path, data: Path, fleet: Path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds files but no archive"):
        batch(data, fleet=fleet, archive=tmp_path)
    path = tmp_path / "turbine=T" / "month=2026-03" / "2026-03-01.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table({"x": [1]}), path)
    with pytest.raises(ConfigurationError, match="not written by windsysid batch: move it away"):
        add_rows(path, [empty_row("/a.csv", 1, "s")])
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(ConfigurationError, match="is damaged"):
        rows_of(tmp_path, "T")


def test_a_changed_bit_of_an_archive_is_never_read(tmp_path: Path):
    """Parquet has no checksum of its footer: a bit of it renamed a column, and a coefficient."""
    path = tmp_path / "turbine=T" / "month=2026-03" / "2026-03-01.parquet"
    add_rows(path, [empty_row(f"/{name}.csv", 1, "s") | {"start": "2026-03-01T00:00:00Z"} for name in "ab"])
    whole = path.read_bytes()
    assert [row["source"] for row in rows_of(tmp_path, "T")] == ["/a.csv", "/b.csv"]
    for at in range(0, len(whole), 31):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :])
        with pytest.raises(ConfigurationError, match="is damaged"):
            rows_of(tmp_path, "T")
    for cut in (0, 3, 8, 50, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(ConfigurationError, match="is damaged"):
            add_rows(path, [empty_row("/c.csv", 1, "s")])
        assert path.read_bytes() == whole[:cut]


def test_a_file_that_grew_is_taken_again(tmp_path: Path):
    from windsysid.fleet.archive import Known
    from windsysid.fleet.batch import _new

    path = tmp_path / "a.csv"
    path.write_text("12345")
    known = {str(path): Known(5, "ok", 0, "s", "2026-03-01")}
    assert _new([str(path)], known) == []
    path.write_text("123456")
    assert _new([str(path)], known) == [str(path)]
    for status, tries, taken in (("failed", 1, True), ("failed", 3, False), ("refused", 0, False)):
        assert bool(_new([str(path)], {str(path): Known(6, status, tries, "s", "2026-03-01")})) == taken


def test_a_day_is_that_of_the_start_then_of_the_name():
    assert day_of("2026-03-01T23:30:00-02:00", "x.csv") == "2026-03-02"
    assert day_of("2026-03-01T23:30:00", "2020-01-01.csv") == "2026-03-01"
    assert day_of(None, "/data/2019-01-01/T01_20260301_2330.csv") == "2026-03-01"
    assert day_of(None, "/data/20261399.csv").startswith("undated-")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", "expected tables"),
        ('[[turbine]]\nname = "A"\npattern = "A/*"', "'turbine' is missing"),
        ('[[turbine]]\nname = "A"\npattern = "*"\nturbine = "tower"\nscda = "x"', "unknown key 'scda'"),
        ('[[turbine]]\nname = "../A"\npattern = "*"\nturbine = "tower"', "a folder has its name"),
        ('[[turbine]]\nname = "A"\npattern = "*"\nturbine = "tower"\n' * 2, "two turbines are called 'A'"),
    ],
)
def test_a_wrong_fleet_file_is_refused(tmp_path: Path, text: str, message: str):
    path = tmp_path / "fleet.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        read_fleet(path)


def test_wrong_options_are_refused_before_any_work(tmp_path: Path, data: Path, fleet: Path):
    archive = tmp_path / "archive"
    for options, message in (
        ({}, "Expected one of turbine"),
        ({"turbine": "tower", "workers": 0}, "workers: expected 1"),
        ({"turbine": "tower", "formulation": "force-balance"}, "formulation: expected"),
        ({"turbine": "tower", "limit": 0.0}, "limit: expected"),
        ({"fleet": fleet, "scada": "x.csv"}, "names mapping, sensors and SCADA itself"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            batch(data, archive=archive, **options)
    with pytest.raises(ConfigurationError, match="got none"):
        batch(tmp_path / "*.csv", archive=archive, turbine="tower")
    assert not archive.exists()


def test_two_patterns_for_one_file_are_refused(tmp_path: Path, data: Path):
    text = '[[turbine]]\nname = "{}"\npattern = "*.csv"\nturbine = "tower"\n'
    (tmp_path / "fleet.toml").write_text(text.format("A") + text.format("B"))
    with pytest.raises(ConfigurationError, match="fits the patterns of 'A' and 'B'"):
        batch(data / "T01", fleet=tmp_path / "fleet.toml", archive=tmp_path / "archive")


def test_the_command_says_what_it_took(run, tmp_path: Path, data: Path):
    shutil.copy(data / "T01" / "d_2026-03-02.csv", tmp_path / "bad.csv")
    taking = ("batch", tmp_path / "bad.csv", "--turbine", "tower", "--output", tmp_path / "archive", "--workers", 1)
    with workers_in_this_process():
        ended = run(*taking)
    assert ended.code == 0
    assert "1 record taken" in ended.out
    why = "no record was identified (1 refused: "
    assert why in ended.out
    assert "next:" not in ended.out
    again = run(*taking)
    assert "next:" not in again.out
    for command in ("report", "monitor"):
        refused = run(command, tmp_path / "archive")
        assert refused.code == 2
        assert why in "".join(refused.err)
        assert "when it began" not in "".join(refused.err)
    assert "1 refused: " in ended.out
    assert "'wet' is not a number" in ended.out
    ended = run("batch", tmp_path / "none", "--turbine", "tower", "--output", tmp_path / "archive")
    assert ended.code == 2
    assert len(ended.err) == 1


def test_a_typo_in_a_fleet_file_is_seen(tmp_path: Path, data: Path):
    text = '[[turbine]]\nname = "{}"\npattern = "{}"\nturbine = "{}"\n'
    path = tmp_path / "fleet.toml"
    path.write_text(text.format("A", "T1/*", "tower"))
    with pytest.raises(
        ConfigurationError, match=r"no file fits a pattern, T1/\* of 'A' for one; got 5, .*a.csv for one"
    ):
        batch(data, fleet=path, archive=tmp_path / "archive")
    path.write_text(text.format("A", "T01/*", "towr"))
    with pytest.raises(ConfigurationError, match="'A': no turbine"):
        batch(data, fleet=path, archive=tmp_path / "archive")
    path.write_text(text.format("A", "*/d_*", "tower") + text.format("B", "T2/*", "tower"))
    with workers_in_this_process():
        found = batch(data, fleet=path, archive=tmp_path / "archive", workers=1)
    assert found.unmatched == 4
    assert found.notes[1:] == ("no file fits the pattern of 'B': T2/*",)


def test_a_turbine_with_too_few_records_does_not_keep_others_from_being_watched(run, tmp_path: Path):
    rows = [
        empty_row(f"/{i}", 1, "s") | {
            "status": "ok", "start": f"2026-03-{i + 1:02d}T00:00:00Z", "trusted": True, "state": "running",
            "duration": 600.0, "parameters": [{
                "name": "k", "unit": "N/m", "prior_centre": 1.0, "prior_spread": 0.3, "logarithmic": True,
                "coordinate_scale": 1.0, "own": 0.01 * (-1.0) ** i, "own_std": 0.01,
            }],
        }
        for i in range(28)
    ]  # fmt: skip
    for row in rows:
        add_rows(place_of(tmp_path, "T1", row["start"][:10]), [row])
    add_rows(place_of(tmp_path, "T2", "2026-03-01"), rows[:1])
    ended = run("monitor", tmp_path)
    assert ended.code == 0
    assert ended.out.splitlines()[0].startswith("T1: ")
    assert ended.out.splitlines()[1].startswith("T2 is not watched: expected at least")
    shutil.rmtree(tmp_path / "turbine=T1")
    ended = run("monitor", tmp_path)
    assert (ended.code, len(ended.err)) == (2, 1)


def test_one_turbine_has_the_name_of_its_file():
    assert single("tower").name == "tower"


def test_without_dask_the_one_line_installs_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RecordError, match=r'install it with: pip install "windsysid\[fleet\]"'):
        run_on_dask([], "tcp://127.0.0.1:1", lambda *_: None)


def test_what_dask_logs_is_not_shown_and_its_loggers_are_as_before(monkeypatch: pytest.MonkeyPatch):
    distributed = pytest.importorskip("distributed", reason="the extra windsysid[fleet] is not installed")
    logger = logging.getLogger("distributed.client")  # has a level of its own
    before, heard = logger.level, []

    def refusing(*_: object, **__: object) -> None:
        heard.append(logger.isEnabledFor(logging.ERROR))
        raise OSError

    monkeypatch.setattr(distributed, "Client", refusing)
    with pytest.raises(ConfigurationError, match="cannot be reached"):
        run_on_dask([], "tcp://127.0.0.1:1", lambda *_: None)
    assert heard == [False]
    assert logger.level == before
