"""What stands out of a fleet: sisters, jumps, ice, sensors; and what does not."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from validation.fleet import BEGIN, Fault, simulate_fleet
from validation.years import Site

from windsysid.errors import ConfigurationError
from windsysid.fleet.archive import add_rows, place_of, read_table, table_of
from windsysid.fleet.overview import Overview, oversee, overview_of
from windsysid.fleet.rows import COLUMNS, Row, empty_row
from windsysid.fleet.series import archive_blocks, blocks_of
from windsysid.fleet.sisters import stand

PLACE = Site("tower", ("k_side_side", "c_side_side"), np.array([0.004, 0.35]), 8.0)
HOURS = 2400
SOFT = Fault("T02", "soft", datetime(2025, 11, 20, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC))
SENSOR = Fault("T04", "sensor", datetime(2025, 11, 5, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC))


@pytest.fixture(scope="module")
def rows() -> dict[str, list[Row]]:
    return dict(simulate_fleet(PLACE, 7, turbines=5, hours=HOURS, faults=(SOFT, SENSOR)))


@pytest.fixture(scope="module")
def page(rows: dict[str, list[Row]]) -> Overview:
    tables = {name: table_of(theirs) for name, theirs in rows.items()}
    return overview_of(tables, Path("simulated"), alarms_per_year=0.1)


def test_a_softened_turbine_and_a_failing_sensor_are_named_and_no_other(page: Overview, rows: dict[str, list[Row]]):
    assert {(event.turbine, event.kind) for event in page.events} == {("T02", "turbine"), ("T04", "sensor")}
    (fall,) = [event.sentence for event in page.events if event.turbine == "T02"]
    assert fall.startswith("k_side_side fell by ")
    first = next(row["start"] for row in rows["T02"] if row["start"] >= SOFT.begin.isoformat())
    assert first[:10] in fall
    (sensor,) = page.failing
    assert (sensor.channel, sensor.kind, sensor.shared) == ("tower_x_acceleration", "spikes", False)
    assert sensor.share == pytest.approx(0.6, abs=0.1)


@pytest.fixture(scope="module")
def files(page: Overview) -> dict[str, bytes]:
    return page.files()


def test_the_page_shows_every_turbine(page: Overview, files: dict[str, bytes]):
    html = files["report.html"].decode()
    assert all(name in html for name in ("T01", "T02", "T05", "Data availability", "2025-11"))
    assert files["summary.json"]
    assert "T02: k_side_side fell" in str(page)
    glance = page.glances["T01"]
    assert glance.records == glance.identified
    assert glance.available == pytest.approx(glance.records * 600.0 / (HOURS * 3600.0), rel=0.01)
    assert sum(glance.states.values()) == pytest.approx(1.0)


def test_the_page_of_an_archive_without_results_says_what_is_missing(rows: dict[str, list[Row]]):
    """Empty axes, under "nothing stands out"."""
    found = overview_of({"T01": table_of(rows["T01"][:5])}, Path("simulated"), alarms_per_year=0.1)
    html = found.files()["report.html"].decode()
    assert "no turbine is watched (1 turbine)" in str(found)
    assert "No turbine has the 12 records" in html
    assert "windsysid batch" in html
    assert "nothing stands out" not in html


def test_the_page_has_plots_and_no_pictures(files: dict[str, bytes]):
    html = files["report.html"].decode()
    assert "data:image/png" not in html
    assert "k_side_side: change of the level" in html
    assert "turbines of the same type" in html


def test_the_command_reports_an_archive(run, tmp_path: Path, rows: dict[str, list[Row]]):
    archive = tmp_path / "archive"
    for name, theirs in [*rows.items()][:3]:
        some = theirs[:150]
        for row in some:
            row["record"] = "simulated"
        add_rows(place_of(archive, name, "2025-09-01"), some)
    ended = run("report", archive, "--output", tmp_path / "page")
    assert ended.code == 0, ended.err
    assert "nothing stands out in 3 turbines" in ended.out
    assert {path.name for path in (tmp_path / "page").iterdir()} == {
        "report.html", "fleet.png", "summary.json", ".windsysid",
    }  # fmt: skip
    ended = run("monitor", archive)
    assert ended.out.count("no jump") == 3
    ended = run("monitor", archive, "--turbine", "T01")
    assert "k_side_side" in ended.out
    for arguments, message in (
        (("monitor", archive, "--turbine", "T9"), "no turbine 'T9'"),
        (("monitor", archive, "--output", tmp_path / "watched"), "give --turbine"),
        (("monitor", archive, "--covariates", tmp_path / "x.csv"), "leave the file out"),
        (("report", tmp_path), "expected an archive of windsysid batch"),
    ):
        ended = run(*arguments)
        assert (ended.code, len(ended.err)) == (2, 1)
        assert message in ended.err[0]
    assert archive_blocks(archive, "T01").names == ("k_side_side", "c_side_side")
    assert len(oversee(archive).glances) == 3


def test_healthy_sisters_have_an_outlier_as_often_as_stated():
    rng = np.random.default_rng(11)
    fleets = 1000
    named = 0
    for _ in range(fleets):
        levels = {f"T{i}": (1.0 + 0.01 * value, 0.002) for i, value in enumerate(rng.standard_normal(10))}
        named += any(one.outlier for one in stand(levels, "k", 0.05))
    assert named / fleets == pytest.approx(0.05, abs=4.0 * np.sqrt(0.05 * 0.95 / fleets))


def test_one_uncertain_sister_is_no_outlier_and_one_far_off_is():
    rng = np.random.default_rng(3)
    levels = {f"T{i}": (1.0 + 0.01 * value, 0.001) for i, value in enumerate(rng.standard_normal(9))}
    assert [one.outlier for one in stand({**levels, "X": (1.1, 0.001)}, "k", 0.05)][-1]
    assert not [one.outlier for one in stand({**levels, "X": (1.1, 0.08)}, "k", 0.05)][-1]
    assert stand(dict(list(levels.items())[:4]), "k", 0.05) == []


def test_states_are_covariates_and_rare_ones_are_left_out(rows: dict[str, list[Row]]):
    of = [dict(row) for row in rows["T01"]]
    for row in of[:40]:
        row["state"] = "transient"
    of[50]["state"] = "unknown"
    blocks = blocks_of(table_of(of))
    assert blocks.covariate_names == ("parked", "wind_speed", "strong_wind", "temperature", "rotor_speed")
    assert len(blocks.time) < len(of) - 40
    parked = blocks.covariates[:, 0] == 1.0
    assert np.ptp(blocks.covariates[parked, 1]) == 0.0  # the wind on a parked rotor is in the state's own effect
    assert np.ptp(blocks.covariates[parked, 3]) > 1.0
    most = next(int(note.split()[-2]) for note in blocks.notes if note.startswith("strong_wind is what"))
    wind, strong = blocks.covariates[~parked, 1], blocks.covariates[~parked, 2]
    np.testing.assert_allclose(strong, np.maximum(wind - most, 0.0))
    assert 0.02 < (strong > 0.0).mean() < 0.25
    assert any("starts or stops" in note for note in blocks.notes)
    assert any("was unknown were left out" in note for note in blocks.notes)
    assert blocks.begin is not None
    assert blocks.begin >= BEGIN


def test_records_that_begin_together_count_once(rows: dict[str, list[Row]]):
    of = rows["T01"][:200]
    again = [{**row, "source": f"/copy{row['source']}"} for row in of]
    one, two = blocks_of(table_of(of)), blocks_of(table_of([*again, *of]))
    np.testing.assert_array_equal(one.theta, two.theta)
    assert any("begin when another does" in note for note in two.notes)


def graded(row: Row, **reasons: str) -> Row:
    """The row with coefficients of grade C, each with its reason; the others have B."""
    parameters = [
        {**one, "grade": "C" if one["name"] in reasons else "B", "reason": reasons.get(one["name"])}
        for one in row["parameters"]
    ]
    return row | {"parameters": parameters, "trusted": not reasons}


def test_a_record_counts_for_the_quantities_that_it_determines(rows: dict[str, list[Row]], tmp_path: Path):
    of = [row for row in rows["T01"] if row["status"] == "ok"][:400]
    some = [graded(row, **({} if i % 4 else {"c_side_side": "prior_conflict"})) for i, row in enumerate(of)]
    blocks, whole = blocks_of(table_of(some)), blocks_of(table_of(of))
    assert blocks.names == ("k_side_side", "c_side_side")
    np.testing.assert_array_equal(blocks.theta[:, 0], whole.theta[:, 0])
    lost = np.isnan(blocks.theta[:, 1])
    np.testing.assert_array_equal(blocks.theta[~lost, 1], whole.theta[~lost, 1])
    assert blocks.left_out == {"c_side_side": {"prior_conflict": int(lost.sum())}}
    assert 0.2 < lost.mean() < 0.3
    page = overview_of({"T01": table_of(some)}, Path("simulated"), alarms_per_year=0.1)
    assert page.glances["T01"].usable == {"k_side_side": 400, "c_side_side": 300}
    assert page.glances["T01"].trusted == pytest.approx(0.75)
    assert page.glances["T01"].least_usable == "c_side_side 75 %"
    html = page.files()["report.html"].decode()
    assert "300 of 400" in html
    assert "prior conflict" in html
    assert page.summary()["turbines"]["T01"]["usable"] == {"k_side_side": 400, "c_side_side": 300}


def test_an_archive_without_grades_is_read_and_added_to(
    rows: dict[str, list[Row]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    of = [row | {"trusted": i % 4 > 0} for i, row in enumerate(rows["T01"]) if row["status"] == "ok"][:200]
    new = {"grade", "reason", "frequency_grade", "damping_ratio_grade"}
    with monkeypatch.context() as old:
        for name in ("parameters", "modes"):
            columns = COLUMNS[name]
            assert isinstance(columns, dict)
            old.setitem(COLUMNS, name, {key: kind for key, kind in columns.items() if key not in new})
        for day, some in (("2025-09-01", of[:80]), ("2025-09-02", of[80:150])):
            add_rows(place_of(tmp_path, "T01", day), some)
    usable = blocks_of(read_table(tmp_path, "T01"))
    assert usable.left_out == {name: {"not_trusted": int(np.isnan(usable.theta[:, 0]).sum())} for name in usable.names}
    assert np.isfinite(usable.theta[:, 0]).sum() > 100
    add_rows(place_of(tmp_path, "T01", "2025-09-02"), [graded(row) for row in of[150:]])
    assert sum(oversee(tmp_path).glances["T01"].usable.values()) == 2 * (sum(row["trusted"] for row in of[:150]) + 50)


def test_zones_must_agree_and_records_be_enough(rows: dict[str, list[Row]]):
    of = [dict(row) for row in rows["T01"][:200]]
    of[3]["start"] = of[3]["start"].removesuffix("Z")
    with pytest.raises(ConfigurationError, match="with a zone and without"):
        blocks_of(table_of(of))
    with pytest.raises(ConfigurationError, match="at least 12 identified records"):
        blocks_of(table_of(of[:5]))
    with pytest.raises(ConfigurationError, match="no record says when it began"):
        overview_of({"T": table_of([empty_row("/a", 1, "s") | {"status": "ok"}])}, Path("x"), alarms_per_year=0.1)
