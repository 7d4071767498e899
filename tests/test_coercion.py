"""What a function takes for a record, a turbine, a result; and how short they say themselves."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sympy as sp
import xarray as xr

import windsysid as ws
from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.coercion import as_record
from windsysid.results.coercion import as_posterior
from windsysid.turbine.coercion import as_turbine

pytestmark = pytest.mark.usefixtures("without_effects")


@pytest.fixture(scope="module")
def record() -> ws.Record:
    return ws.simulate("verne555", duration=10.0, rate=50.0, seed=1)


def as_frame(record: ws.Record) -> pd.DataFrame:
    headings = [f"{name} [{unit}]" for name, unit in zip(record.channels, record.units, strict=True)]
    return pd.DataFrame(record.values, columns=headings, index=pd.Index(record.time, name="time"))


def as_dataset(record: ws.Record) -> xr.Dataset:
    columns = {
        name: ("time", record[name], {"units": unit}) for name, unit in zip(record.channels, record.units, strict=True)
    }
    return xr.Dataset(columns, coords={"time": record.time})


def test_a_record_is_taken_from_a_file_a_frame_or_a_dataset(record: ws.Record, tmp_path: Path):
    ws.write_record(record, tmp_path / "record.csv")
    frame = as_frame(record)
    dated = frame.set_index(pd.Timestamp("2024-05-01") + pd.to_timedelta(record.time, unit="s"))
    column = frame.reset_index().rename(columns={"time": "time [s]"})
    said = pd.DataFrame(record.values, columns=list(record.channels), index=record.time)
    said.attrs["units"] = dict(zip(record.channels, record.units, strict=True))
    for given in (
        tmp_path / "record.csv",
        str(tmp_path / "record.csv"),
        frame,
        dated,
        column,
        said,
        as_dataset(record),
    ):
        taken = as_record(given)
        np.testing.assert_allclose(taken.time, record.time, atol=1e-9)
        np.testing.assert_allclose(taken.values, record.values, rtol=1e-12)
        assert (taken.channels, taken.units) == (record.channels, record.units)
    degrees = frame.rename(columns={"rotor_azimuth [rad]": "rotor_azimuth [deg]"})
    np.testing.assert_allclose(as_record(degrees)["rotor_azimuth"], np.deg2rad(record["rotor_azimuth"]))


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ([1.0, 2.0], "expected a Record, the path of a file, a pandas DataFrame or an xarray Dataset, got list"),
        (pd.DataFrame({"a": [1.0, 2.0]}), "'a' has no unit: expected a column 'a .unit.'"),
        (pd.DataFrame({"a [furlong]": [1.0, 2.0]}), "unknown unit 'furlong'"),
        (pd.DataFrame({"a [m]": ["x", "y"]}), "'a': expected numbers"),
        (pd.DataFrame(index=[0.0, 1.0]), "expected channels"),
        (pd.DataFrame({"a [m]": [1.0, 2.0], "time [m]": [0.0, 1.0]}), "time: expected s, got m"),
        (xr.Dataset({"a": ("x", [1.0, 2.0])}), "expected a coordinate 'time'"),
        (xr.Dataset({"a": ("time", [1.0, 2.0])}, coords={"time": [0.0, 1.0]}), "'a' has no unit"),
    ],
)  # fmt: skip
def test_what_is_no_record_is_refused(given: object, complaint: str):
    with pytest.raises(RecordError, match=complaint):
        as_record(given)  # type: ignore[arg-type]


def test_a_mapping_goes_wherever_a_path_goes(record: ws.Record, tmp_path: Path):
    """Only `read_record` took one: a logger's file had to be read first, whatever was to be done with it."""
    told, path, rules = {"tower_x_acceleration": "Acc X"}, tmp_path / "logger.csv", tmp_path / "rules.toml"
    names = tuple(told.get(name, name) for name in record.channels)
    ws.write_record(ws.Record(record.time, record.values, names, record.units), path)
    rules.write_text('channels."Acc X" = {name = "tower_x_acceleration"}')
    for mapping in (rules, str(rules), ws.load_mapping(rules)):
        assert as_record(path, mapping).channels == record.channels
    found = ws.identify(path, "verne555", formulation="joint", loads="broadband", mapping=rules)
    assert found.provenance is not None
    assert found.provenance.options["mapping"]["channels"]["Acc X"]["name"] == "tower_x_acceleration"
    assert "tower_x_acceleration" in ws.inspect(path, mapping=rules).record.channels
    assert ws.oma([path], mapping=rules, sensors=["tower_x_acceleration"]).channels == ("tower_x_acceleration",)
    for read in (
        lambda **given: ws.free_decay(path, **given),
        lambda **given: ws.profile_likelihood(path, "verne555", "k_x", **given),
    ):
        with pytest.raises(ConfigurationError, match=r"missing\.toml: no such file, expected a mapping"):
            read(mapping=tmp_path / "missing.toml")


def test_a_mapping_of_what_is_no_file_is_refused(record: ws.Record):
    with pytest.raises(ConfigurationError, match="mapping: expected the path of a file as the record, got a Record"):
        ws.oma(record, mapping="rules.toml")


def test_pieces_that_are_one_record_or_a_path_are_refused(record: ws.Record):
    """AttributeError: the characters of a path were taken for records."""
    for given in ("logger.csv", record):
        with pytest.raises(ConfigurationError, match="pieces: expected records in order, as iterate_record yields"):
            ws.identify_pieces(given, "verne555")  # type: ignore[arg-type]


def test_a_fit_takes_a_path_and_its_mapping(tmp_path: Path):
    """A path was taken for an iterable of pieces: AttributeError."""
    q, v, w, k = sp.symbols("q v w k")
    spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    time = np.linspace(0.0, 19.95, 400)
    record = ws.Record(time, (np.exp(-0.1 * time) * np.cos(2.0 * time))[:, None], ("Pos 1",), ("m",))
    ws.write_record(record, tmp_path / "logger.csv")
    (tmp_path / "rules.toml").write_text('channels."Pos 1" = {name = "position"}')
    found = ws.models.fit(
        spring, tmp_path / "logger.csv", mapping=tmp_path / "rules.toml", values={"w": 0.0}, cov=np.eye(2),
        parameters=[ws.models.Parameter("k", 3.0, 0.5)], sensors=[ws.models.Reading("position", q, noise=0.01)],
    )  # fmt: skip
    assert found["k"].estimate == pytest.approx(4.01, abs=0.02)


def test_every_function_takes_names_paths_and_results(tmp_path: Path):
    found = ws.identify(as_frame(ws.simulate("tower", duration=300.0, rate=5.0, seed=1)), "tower", loads="broadband")
    k = found["k_side_side"].estimate
    assert k == pytest.approx(ws.load_turbine("tower").values["k_side_side"], rel=0.1)
    found.save(tmp_path)
    assert "no change" in str(ws.compare(found, tmp_path)).lower()
    assert ws.modes("tower").turbine == "tower"
    assert ws.modes(str(tmp_path)).banded
    assert ws.damping([found, str(tmp_path)]).sentence
    for short in (repr(found), repr(found.posterior), repr(found.machine), repr(ws.modes("tower"))):
        assert len(short) < 300
        assert "tower" in short
    assert repr(ws.compare(found, tmp_path)).count("\n") == 0


def test_what_is_no_turbine_and_no_result_is_refused(tmp_path: Path):
    for wrong in (5, None, ["verne555"]):
        with pytest.raises(ConfigurationError, match="expected a Turbine, the name of a packaged one"):
            as_turbine(wrong)  # type: ignore[arg-type]
        with pytest.raises(ConfigurationError, match="expected what identify returned"):
            as_posterior(wrong)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="expected a result of windsysid identify"):
        as_posterior(tmp_path)


def test_a_prompt_completes_the_public_names():
    assert set(ws.__all__) <= set(dir(ws))
