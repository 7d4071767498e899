"""A saved result comes back as the object that made it, or one line says why not."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import windsysid as ws
from tests.identification.test_own_equations import fitted, shaken
from windsysid.errors import ConfigurationError
from windsysid.output.folders import result_file
from windsysid.output.locks import MANIFEST
from windsysid.records.formats.netcdf import sealed
from windsysid.results import storage
from windsysid.results.serialization import as_plain, finite, from_plain
from windsysid.spectral.oma.known_modes import as_modes

pytestmark = pytest.mark.usefixtures("without_effects")


@pytest.fixture(scope="module")
def record() -> ws.Record:
    return ws.simulate(ws.load_turbine("tower"), duration=120.0, rate=10.0, seed=1)


@pytest.fixture(scope="module")
def found(record: ws.Record) -> ws.results.Identification:
    return ws.identify(record, "tower", formulation="joint")


@pytest.fixture(scope="module")
def saved(found: ws.results.Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "result"
    found.save(folder)
    return folder


def equal(a: Any, b: Any) -> None:
    """Every number is the same, NaN too."""
    left, right = as_plain(a), as_plain(b)
    assert left == right


def test_an_identification_comes_back(found: ws.results.Identification, saved: Path, tmp_path: Path):
    again = ws.load_result(saved)
    assert isinstance(again, ws.results.Identification)
    assert str(again) == str(found)
    for field in fields(found):
        a, b = getattr(found, field.name), getattr(again, field.name)
        if field.name in ("mean", "std"):  # made of the histories in SI
            np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-12)
        else:
            equal(a, b)
    assert repr(again.posterior) == repr(found.posterior)
    np.testing.assert_array_equal(again.posterior.cov, found.posterior.cov)
    assert len(again.plot().axes) == len(found.plot().axes)
    assert again.to_dataframe().equals(found.to_dataframe())
    again.save(tmp_path / "again")
    assert str(ws.load_result(tmp_path / "again")) == str(found)


def test_a_result_of_an_older_version_comes_back_with_its_sentences(
    found: ws.results.Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """It had no findings, but sentences."""
    written = storage._rest

    def as_before(result: ws.results.Identification) -> dict[str, Any]:
        rest = written(result)
        judged = as_plain(rest.pop("diagnosis"))
        del rest["findings"], judged["findings"]
        return rest | {"notes": ["a note"], "diagnosis": judged | {"reasons": ["a reason"], "remarks": ["a remark"]}}

    monkeypatch.setattr(storage, "_rest", as_before)
    found.save(tmp_path / "old")
    again = ws.load_result(tmp_path / "old")
    assert isinstance(again, ws.results.Identification)
    assert {one.code for one in again.findings} == {"unknown"}
    assert again.diagnosis.reasons == ("a reason",)
    assert again.diagnosis.remarks == ("a remark",)
    assert again.notes == ("a note",)
    assert not again.diagnosis.trusted
    monkeypatch.undo()
    again.save(tmp_path / "new")
    newest = ws.load_result(tmp_path / "new")
    assert isinstance(newest, ws.results.Identification)
    assert newest.findings == again.findings


def test_modes_of_version_0_2_come_back(
    found: ws.results.Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """They were (value, low, high), with both references in a tuple."""
    written = storage._rest

    def as_before(result: ws.results.Identification) -> dict[str, Any]:
        modes = [
            {
                "name": mode.name,
                "frequency_hz": [getattr(mode.frequency, part) for part in ("estimate", "low", "high")],
                "damping_ratio": [getattr(mode.damping_ratio, part) for part in ("estimate", "low", "high")],
                "reference": None if i == 0 else [one.reference for _, one in mode.quantities],
            }
            for i, mode in enumerate(result.modes)
        ]
        return written(result) | {"modes": modes}

    monkeypatch.setattr(storage, "_rest", as_before)
    found.save(tmp_path / "old")
    again = ws.load_result(tmp_path / "old")
    assert isinstance(again, ws.results.Identification)
    for i, (mode, known) in enumerate(zip(again.modes, found.modes, strict=True)):
        for (_, one), (_, other) in zip(mode.quantities, known.quantities, strict=True):
            assert (one.estimate, one.low, one.high, one.unit) == (other.estimate, other.low, other.high, other.unit)
            assert one.std == pytest.approx(other.std, rel=1e-9)
            assert (one.grade, one.reference) == ("", None if i == 0 else other.reference)


def test_the_summary_has_every_finding_as_data(found: ws.results.Identification, saved: Path):
    listed = json.loads((saved / "summary.json").read_text(encoding="utf-8"))["findings"]
    assert [one["code"] for one in listed] == [one.code for one in found.findings]
    assert {"code", "severity", "text", "quantities", "data"} == set(listed[0])
    texts = [one["text"] for one in listed if one["severity"] == "note"]
    assert texts == json.loads((saved / "summary.json").read_text(encoding="utf-8"))["notes"]
    assert [one["data"] for one in listed] == [finite(one.data) for one in found.findings]


def test_a_result_of_spectra_comes_back(record: ws.Record, tmp_path: Path):
    found = ws.identify(record, "tower", formulation="spectral")
    found.save(tmp_path / "x")
    assert str(ws.load_result(tmp_path / "x")) == str(found)


def test_a_fit_of_own_equations_comes_back(tmp_path: Path):
    found = fitted(shaken(400))
    found.save(tmp_path / "x")
    again = ws.load_result(tmp_path / "x")
    assert isinstance(again, ws.models.Fit)
    assert str(again) == str(found)
    assert again.states == found.states
    np.testing.assert_array_equal(again.state_mean, found.state_mean)


def of_modes(found: ws.results.Identification, record: ws.Record) -> Any:
    return ws.modes(found)


def of_comparison(found: ws.results.Identification, record: ws.Record) -> Any:
    return ws.compare(found, found)


def of_oma(found: ws.results.Identification, record: ws.Record) -> Any:
    return ws.oma(record, turbine="tower")


def of_damping(found: ws.results.Identification, record: ws.Record) -> Any:
    return ws.damping([found.posterior, found.posterior])


def of_monitor(found: ws.results.Identification, record: ws.Record) -> Any:
    from windsysid.monitoring.series import RecordBlocks

    rng = np.random.default_rng(0)
    theta = 0.01 * rng.standard_normal((60, 1))
    blocks = RecordBlocks(
        ("k_x",), 3600.0 * np.arange(60.0), theta, np.full((60, 1), 0.01), (True,), (1.0,), np.empty((60, 0)),
    )  # fmt: skip
    return ws.monitor(blocks)


@pytest.mark.parametrize("make", [of_modes, of_comparison, of_oma, of_damping, of_monitor])
def test_other_answers_come_back(
    make: Callable[..., Any], found: ws.results.Identification, record: ws.Record, tmp_path: Path
):
    answer = make(found, record)
    answer.save(tmp_path / "x")
    again = ws.load_result(tmp_path / "x")
    assert type(again) is type(answer)
    assert str(again) == str(answer)
    equal(again, answer)
    frame = answer.to_dataframe()
    assert len(frame)
    assert again.to_dataframe().equals(frame)
    assert "<" in answer._repr_html_()
    assert len(again.plot().axes) == len(answer.plot().axes)


def test_a_table_of_an_answer_holds_its_numbers(found: ws.results.Identification, record: ws.Record):
    change = of_comparison(found, record).coefficients[0]
    row = ws.compare(found, found).to_dataframe().set_index("name").loc[change.name]
    assert (row["before"], row["after"], row["moved"]) == (change.before, change.after, False)

    watched = of_monitor(found, record)
    assert watched.to_xarray()["level"].sel(name="k_x").to_numpy() == pytest.approx(watched.series[0].level)
    assert watched.to_dataframe()["level"].to_numpy() == pytest.approx(watched.series[0].level)

    diagram = ws.modes(found)
    curve = diagram.curves[0]
    drawn = diagram.to_xarray()["frequency"].sel(mode=curve.name)
    np.testing.assert_array_equal(drawn, curve.frequency)
    assert drawn["speed"].attrs == {"units": "rad/s"}

    split = of_damping(found, record).splits[0]
    parts = ws.damping([found.posterior, found.posterior]).to_dataframe().set_index(["name", "part"])
    totals = parts.loc[(split.name, "total")]
    assert [tuple(values) for values in totals[["estimate", "low", "high"]].to_numpy()] == list(
        map(tuple, split.measured)
    )


def test_a_record_comes_back_from_its_table(record: ws.Record):
    from windsysid.records.coercion import as_record

    again = as_record(record.to_dataframe())
    assert (again.channels, again.units) == (record.channels, record.units)
    np.testing.assert_array_equal(again.values, record.values)
    np.testing.assert_allclose(again.time, record.time)


def test_the_page_of_a_result_is_drawn_again(saved: Path, tmp_path: Path, run: Callable[..., Any]):
    ended = run("report", saved, "--output", tmp_path / "again")
    assert ended.code == 0
    assert "trust:" in ended.out
    names = sorted(path.name for path in (tmp_path / "again").glob("[!.]*"))
    assert names == ["identification.nc", "report.html", "summary.json"]


def test_what_is_no_result_is_one_line(tmp_path: Path):
    for folder, why in ((tmp_path, ", got no result in it"), (tmp_path / "none", "; check the name and the folder")):
        with pytest.raises(ConfigurationError, match=f"expected a result of windsysid{why}"):
            ws.load_result(folder)
    for text in (
        "{}",
        "[]",
        "no JSON",
        '{"answer": ' + "[" * 100_000,
        '{"answer": "Path", "fields": {}}',
        '{"answer": "Plan", "fields": {"turbine": 1}}',
    ):
        (tmp_path / "answer.json").write_text(text)
        with pytest.raises(ConfigurationError, match=r"answer\.json is damaged or of another version"):
            ws.load_result(tmp_path)


def test_json_that_is_nested_too_deeply_is_one_line_wherever_a_result_is_read(tmp_path: Path):
    deep = "[" * 100_000
    (tmp_path / "summary.json").write_text(deep)
    with pytest.raises(ConfigurationError, match="expected a result of windsysid oma"):
        as_modes(tmp_path)
    (tmp_path / ".windsysid").mkdir()
    (tmp_path / ".windsysid" / MANIFEST).write_text(deep)
    assert result_file(tmp_path, "summary.json") == tmp_path / "summary.json"


def test_an_identification_whose_fields_are_nested_too_deeply_is_one_line(saved: Path, tmp_path: Path):
    shutil.copytree(saved, tmp_path / "deep")
    path = result_file(tmp_path / "deep", "identification.nc")
    path.write_bytes(path.read_bytes().rpartition(b"windsysid crc32 ")[0])
    with h5py.File(path, "r+") as file:
        file.attrs["statistics"] = "[" * 50_000
    path.write_bytes(sealed(path.read_bytes()))
    with pytest.raises(ConfigurationError, match="identification"):
        ws.load_result(tmp_path / "deep")


def test_plain_values_keep_what_json_has_no_word_for():
    values = (1.5, math.inf, -math.inf, math.nan)
    again = from_plain(tuple[float, ...], as_plain(values))
    np.testing.assert_array_equal(again, values)
    matrix = np.array([[1.0 + 2.0j, np.nan]])
    np.testing.assert_array_equal(from_plain(type(matrix) and np.ndarray[Any, Any], as_plain(matrix)), matrix)
    with pytest.raises(TypeError, match="no file holds a object"):
        as_plain(object())


def test_answers_are_drawn_in_a_figure_of_ones_own(found: ws.results.Identification):
    from matplotlib.figure import Figure

    own = Figure(figsize=(12, 5), layout="constrained")
    left, right = own.subplots(1, 2)
    assert found.plot(ax=left).figure is own
    ws.modes(found).plot(ax=right)
    own.draw_without_rendering()
    assert len(own.axes) > 2
    with pytest.raises(ConfigurationError, match="ax: expected axes that subplots or add_subplot made"):
        found.plot(ax=own.add_axes((0.0, 0.0, 1.0, 1.0)))


def test_a_difference_of_nothing_has_no_minus(found: ws.results.Identification):
    reference = found.estimates[0].estimate * (1.0 + 1e-6)
    same = replace(found, estimates=(replace(found.estimates[0], reference=reference),))
    assert same.table().rows[0][-1] == "+0.0 %"
