import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import windsysid as ws
from windsysid.errors import ConfigurationError, RecordError
from windsysid.inspection import inspect_record
from windsysid.records.formats import read_record
from windsysid.records.quantities import implied_unit
from windsysid.records.record import Record
from windsysid.signals.condition import resample
from windsysid.units import canonical, to_si


def make(time=None, channels=("tower_x_acceleration", "rotor_azimuth"), units=("m/s^2", "rad")):
    time = np.arange(100) * 0.01 if time is None else np.asarray(time, dtype=float)
    values = np.column_stack([np.sin(time + i) for i in range(len(channels))])
    return Record(time, values, channels, units, name="made up")


def test_importing_records_loads_neither_pandas_nor_xarray():
    code = (
        "import sys, windsysid.records.formats; print({'pandas', 'xarray', 'openfast_io', 'h5py'} & set(sys.modules))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "set()"


def test_a_record_knows_its_size_rate_and_duration():
    record = make()
    assert record.samples == 100
    assert record.rate == pytest.approx(100.0, rel=1e-12)
    assert record.duration == pytest.approx(0.99)
    assert record.is_uniform


def test_values_become_contiguous_float64():
    record = Record(np.arange(3.0), np.asfortranarray(np.ones((3, 2), dtype=int)), ("a", "b"), ("1", "m/s²"))
    assert record.values.flags.c_contiguous
    assert record.values.dtype == record.time.dtype == np.float64
    assert record.units == ("1", "m/s^2")


def test_a_channel_is_found_by_name_and_given_as_a_copy():
    record = make()
    azimuth = record["rotor_azimuth"]
    assert np.array_equal(azimuth, record.values[:, 1])
    azimuth[:] = 0.0
    assert record.values[5, 1] != 0.0
    assert "rotor_azimuth" in record
    assert "rotor_speed" not in record
    assert record.unit("rotor_azimuth") == "rad"


def test_a_misspelt_channel_brings_the_closest_name():
    with pytest.raises(RecordError, match=r"'tower_x_accelaration'.*did you mean tower_x_acceleration\?"):
        make()["tower_x_accelaration"]
    with pytest.raises(RecordError, match=r"'zzz'.*it has tower_x_acceleration, rotor_azimuth"):
        make()["zzz"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.ones((3, 2))}, "expected time"),
        ({"units": ("m",)}, "expected time"),
        ({"channels": ("a", "a")}, "'a' occurs twice"),
        ({"channels": ("a", "time")}, "called 'time'"),
        ({"channels": ("a", " b")}, "not a channel name"),
        ({"units": ("m", "deg")}, "'b' is in 'deg'.*expected 'rad'"),
        ({"units": ("m", "furlong")}, "unknown unit 'furlong'"),
        ({"time": [0.0, 1.0, 1.0, 2.0]}, r"repeated at sample 2 \(1.0 s, then 1.0 s\)"),
        ({"time": [0.0, 2.0, 1.0, 3.0]}, "backwards at sample 2"),
        ({"time": [0.0, np.nan, 1.0, 2.0]}, "time at sample 1 is nan"),
        ({"time": [np.nan] * 4}, "missing or infinite everywhere"),
        ({"values": [[0, 0], [0, 0], [0, np.inf], [0, 0]]}, "'b' is infinite at sample 2"),
        ({"time": [0.0], "values": [[0.0, 0.0]]}, "at least 2 samples, got 1"),
        ({"time": ["x", "y", "z", "w"]}, "must be numbers"),
    ],
)
def test_a_record_that_cannot_be_right_is_refused_in_one_line(change, message):
    good: dict[str, Any] = {
        "time": np.arange(4.0),
        "values": np.zeros((4, 2)),
        "channels": ("a", "b"),
        "units": ("m", "rad"),
    }
    Record(**good)
    with pytest.raises(RecordError, match=message) as caught:
        Record(**{**good, **change})
    assert "\n" not in str(caught.value)


def test_an_all_missing_channel_is_data():
    record = make().with_channels({"wind_speed": (np.full(100, np.nan), "m/s")})
    assert np.isnan(record["wind_speed"]).all()


def test_a_section_keeps_its_times_and_leaves_out_its_end():
    record = make(np.arange(1000) * 0.01 + 5.0).section(6.0, 7.0)
    assert record.samples == 100
    assert record.time[0] == pytest.approx(6.0)
    assert record.time[-1] == pytest.approx(6.99)
    assert np.array_equal(record["rotor_azimuth"], np.sin(record.time + 1))


def test_a_section_may_end_one_step_after_the_last_sample():
    assert make().section(0.0, 1.0).samples == 100


@pytest.mark.parametrize(
    "bounds",
    [(0.5, 1.2), (-0.5, 0.5), (2.0, 3.0), (0.5, 0.5), (0.6, 0.5), (0.501, 0.502), (np.nan, 0.5), (0, np.inf)],
)
def test_a_section_outside_or_empty_names_the_records_own_range(bounds):
    with pytest.raises(RecordError, match=r"the record runs from 0 to 0\.99 s") as caught:
        make().section(*bounds)
    assert "\n" not in str(caught.value)


def test_select_orders_and_with_channels_converts():
    record = make()
    assert record.select(["rotor_azimuth"]).channels == ("rotor_azimuth",)
    turned = record.select(["rotor_azimuth", "tower_x_acceleration"])
    assert np.array_equal(turned["tower_x_acceleration"], record["tower_x_acceleration"])
    assert turned.units == ("rad", "m/s^2")
    more = record.with_channels({"rotor_speed": (np.full(100, 60.0), "rpm"), "rotor_azimuth": (np.ones(100), "rad")})
    assert more.channels == ("tower_x_acceleration", "rotor_azimuth", "rotor_speed")
    assert more["rotor_speed"] == pytest.approx(2.0 * np.pi)
    assert (more["rotor_azimuth"] == 1.0).all()
    assert record["rotor_azimuth"][0] != 1.0
    with pytest.raises(RecordError, match="unknown unit"):
        record.with_channels({"a": (np.ones(100), "furlong")})
    with pytest.raises(RecordError, match="expected values"):
        record.with_channels({"a": (np.ones(99), "m")})
    assert record.with_name("other").name == "other"


def test_a_uniform_record_is_its_own_grid():
    record = make()
    assert record.on_uniform_grid() is record


def test_gaps_become_missing_rows():
    time = np.arange(1000) * 0.02 + 3.0
    kept = np.ones(1000, dtype=bool)
    kept[[10, 11, 500]] = False
    record = make(time[kept])
    assert not record.is_uniform
    assert record.rate == pytest.approx(50.0)
    grid = record.on_uniform_grid()
    assert grid.is_uniform
    np.testing.assert_allclose(grid.time, time, atol=1e-9)
    assert np.isnan(grid.values[~kept]).all()
    assert np.array_equal(grid.values[kept], record.values)


def test_times_written_with_few_digits_go_back_to_their_grid():
    # 64 Hz with four decimals: rounding of 5e-5 s is 0.3 % of a step, and the median step is off by as much.
    time = np.round(np.arange(2000) / 64.0, 4)
    grid = make(time).on_uniform_grid()
    assert grid.samples == 2000
    assert grid.rate == pytest.approx(64.0, rel=1e-5)


def test_jitter_asks_for_resampling():
    time = np.arange(100) * 0.01
    time[40] += 0.0015
    with pytest.raises(RecordError, match=r"irregular sampling: sample 40 .* 15 % .*resample"):
        make(time).on_uniform_grid()
    time[40] -= 0.0007
    assert make(time).on_uniform_grid().samples == 100


def test_a_gap_of_years_is_refused_before_it_fills_the_memory():
    record = make([0.0, 0.01, 0.02, 1.7e9, 1.7e9 + 0.01])
    told = r"made up: the gap of 1.7e\+09 s after 0.02 s is too long \(1.7e\+11 rows\)"
    for use in (Record.on_uniform_grid, inspect_record, lambda one: resample(one, 100.0)):
        with pytest.raises(RecordError, match=told) as caught:
            use(record)
        low, high = map(float, re.findall(r"keep (\S+) to (\S+) s", str(caught.value))[0])
        assert record.section(low, high).on_uniform_grid().samples == 3


def test_xarray_and_back_gives_the_same_record():
    record = Record(
        np.array([0.0, 0.5]),
        np.array([[1.0, np.nan], [2.0, 3.0]]),
        ("b", "a"),
        ("m", "rad"),
        "x",
        {"site": "hill"},
    )
    dataset = record.to_xarray()
    assert dataset["b"].attrs["units"] == "m"
    again = Record.from_xarray(dataset)
    assert np.array_equal(again.values, record.values, equal_nan=True)
    assert (again.channels, again.units, again.name) == (record.channels, record.units, record.name)
    assert again.attributes == record.attributes


def test_from_xarray_guesses_no_unit():
    import xarray as xr

    dataset = xr.Dataset({"rotor_speed": ("time", [12.0, 12.1]), "mast": ("time", [1.0, 2.0])}, {"time": [0.0, 1.0]})
    with pytest.raises(RecordError, match=r"'rotor_speed' has no unit; its values \(12 … 12.1\) are plausible in rpm"):
        Record.from_xarray(dataset)
    assert Record.from_xarray(dataset.drop_vars("rotor_speed")).units == ("as written: unknown",)


def test_from_xarray_converts_units_and_refuses_what_is_no_record():
    import xarray as xr

    dataset = xr.Dataset({"pitch": ("time", [180.0, 90.0], {"units": "deg"})}, {"time": [0.0, 1.0]})
    assert Record.from_xarray(dataset)["pitch"] == pytest.approx([np.pi, np.pi / 2])
    with pytest.raises(RecordError, match="expected a coordinate 'time'"):
        Record.from_xarray(dataset.rename(time="lat"))
    with pytest.raises(RecordError, match="'grid' is float64 with dimensions"):
        Record.from_xarray(dataset.assign(grid=(("time", "x"), np.ones((2, 3)))))


def test_the_short_description_says_what_is_inside():
    shown = str(make())
    assert shown.splitlines()[0] == "Record 'made up': 100 samples at 100 Hz, 0.99 s, 2 channels"
    assert "tower_x_acceleration [m/s^2], rotor_azimuth [rad]" in shown


@pytest.mark.parametrize(
    ("channel", "unit"),
    [
        ("tower_x_acceleration", "m/s^2"),
        ("blade_1_lag_acceleration", "rad/s^2"),
        ("blade_1_tip_lag_acceleration", "m/s^2"),
        ("tower_y_displacement", "m"),
        ("blade_2_lag_displacement", "rad"),
        ("blade_2_lag_velocity", "rad/s"),
        ("rotor_azimuth", "rad"),
        ("rotor_speed", "rad/s"),
        ("wind_speed", "m/s"),
        ("something", None),
    ],
)
def test_a_channels_name_implies_its_unit(channel, unit):
    assert implied_unit(channel) == unit


@pytest.mark.parametrize(
    ("written", "known"),
    [("(kN-m)", "kN*m"), ("(sec)", "s"), ("m/s²", "m/s^2"),
     ("(deg/s^2)", "deg/s^2"), ("(-)", "-"), ("°", "deg"),
     ("kNm", "kN*m"), ("με", "µε"), ("m/sec^2", "m/s^2"), ("(rpm)", "rpm"),
     ("[kg m²]", "kg*m^2"), ("deg/sec", "deg/s")],
)  # fmt: skip
def test_one_unit_has_many_spellings(written, known):
    assert canonical(written) == known


def test_an_unknown_unit_is_never_guessed():
    with pytest.raises(ConfigurationError, match="unknown unit 'furlong'"):
        to_si(1.0, "furlong")


def test_unequal_times_are_kept_to_a_sixty_fourth_of_a_step():
    rng = np.random.default_rng(1)
    time = np.array(sorted((0.01 * np.arange(500) + 0.002 * rng.standard_normal(500)).tolist()))
    record = Record(time=time, values=time[:, None], channels=("a",), units=("m",), name="jitter")  # as the stamps say
    own = record.on_own_times()
    steps, which = own.intervals()
    assert len(steps) < 200
    np.testing.assert_allclose(np.cumsum(steps[which[1:]]), own.time[1:] - own.time[0], atol=1e-5)
    kept = np.isin(time, own["a"])
    assert np.max(np.abs(own.time - time[kept])) < 0.011 / 64
    even = Record(time=np.linspace(0.0, 0.08, 9), values=np.zeros((9, 1)), channels=("a",), units=("m",), name="even")
    assert even.on_own_times() is even
    assert even.intervals()[0].tolist() == pytest.approx([0.01])


def test_samples_on_one_tick_are_joined():
    record = Record(
        time=np.array([0.0, 0.013, 0.01301, 0.02, 0.034]),
        values=np.array([[1.0, 5.0], [2.0, np.nan], [np.nan, 7.0], [3.0, 6.0], [4.0, 8.0]]),
        channels=("a", "b"),
        units=("m", "m"),
        name="two loggers",
    )
    own = record.on_own_times()
    np.testing.assert_array_equal(own.values, [[1.0, 5.0], [2.0, 7.0], [3.0, 6.0], [4.0, 8.0]])


def test_a_clock_that_was_set_back_is_told_from_rows_in_disorder():
    time = np.arange(400) / 20.0
    time[200:] -= 3600.0
    with pytest.raises(RecordError, match=r"runs backwards at sample 200.*a clock was set back"):
        make(time)
    time = np.arange(400) / 20.0
    time[[200, 201]] = time[[201, 200]]
    with pytest.raises(RecordError, match="sort the rows"):
        make(time)


@pytest.mark.parametrize("unit", ["kg", "kN", "mm/s"])
def test_an_acceleration_in_the_unit_of_another_quantity_is_refused(unit, tmp_path):
    """`inspect` and `oma` took it without a word."""
    rows = [f"{0.1 * k:.1f},{k % 7}" for k in range(100)]
    (tmp_path / "a.csv").write_text("\n".join([f"time [s],Beschleunigung quer [{unit}]", *rows]) + "\n")
    expected = rf"'Beschleunigung quer': expected a unit of acceleration \(m/s\^2, g, .*got {unit}; .*unit = \"g\"$"
    with pytest.raises(RecordError, match=expected):
        read_record(tmp_path / "a.csv")
    with pytest.raises(RecordError, match="'NacAccX': expected a unit of acceleration"):
        Record(np.arange(9.0), np.zeros((9, 1)), ("NacAccX",), ("N",))


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("acc x", "V"), ("acc temp", "degC"), ("acc load", "N"), ("a", "kg"), ("hydraulic_acc_pressure", "Pa"),
        ("accelerometer_tilt", "rad"),
    ],
)  # fmt: skip
def test_raw_readings_and_other_quantities_of_an_accelerometer_are_taken(name, unit):
    assert Record(np.arange(9.0), np.zeros((9, 1)), (name,), (unit,)).units == (unit,)


def test_a_channel_is_a_copy_of_a_record_with_one_channel_too():
    record = Record(np.arange(9.0), np.zeros((9, 1)), ("tower_x_acceleration",), ("m/s^2",))
    record["tower_x_acceleration"][:] = 1.0
    assert not record.values.any()


def test_a_record_from_an_array():
    values = np.random.default_rng(1).normal(size=(100, 2))
    record = ws.Record.from_array(values, 10.0, units=("g", "mm"))
    assert record.channels == ("channel_1", "channel_2")
    assert record.units == ("m/s^2", "m")
    np.testing.assert_allclose(record.values, values * [9.80665, 1e-3])
    np.testing.assert_allclose(record.time[[0, -1]], [0.0, 9.9])
    one = ws.Record.from_array(values[:, 0], 10.0, channels="floor")
    assert (one.channels, one.units) == (("floor",), ("m/s^2",))


@pytest.mark.parametrize(
    ("values", "options", "message"),
    [
        (np.zeros((2, 100)), {}, r"expected values \(T, m\), a row per sample.*got values \(2, 100\), .*rate 10"),
        (np.zeros((100, 2)), {"channels": "floor"}, r"m channels, .*, 1 channels, rate"),
        (np.zeros((100, 2)), {"channels": 3}, r"m channels, .*, 1 channels, rate"),
        (np.zeros((100, 2)), {"channels": ("a", "a")}, "occurs twice"),
        (np.zeros(100), {"units": "quux"}, "unknown unit 'quux'"),
        ("abc", {}, "could not convert"),
        (3.0, {}, r"got values \(1, 1\)"),
        (np.zeros((9, 2, 2)), {}, "too many values"),
        (np.zeros((100, 2)), {"units": ("g", "g", "g")}, "and m units"),
    ],
)
def test_an_array_that_is_no_record_is_a_clear_error(values, options, message):
    with pytest.raises(ws.RecordError, match=message):
        ws.Record.from_array(values, 10.0, **options)


def test_other_tables_are_named_by_their_type():
    with pytest.raises(ws.RecordError, match="DataFrame: expected one of pandas, got int"):
        ws.Record.from_dataframe(3)  # type: ignore[arg-type]
    with pytest.raises(ws.RecordError, match="Dataset: expected one of xarray, got int"):
        ws.Record.from_xarray(3)  # type: ignore[arg-type]
    with pytest.raises(ws.RecordError, match=r"got ndarray: call Record\.from_array\(values, rate\)"):
        ws.oma(np.zeros((100, 2)))  # type: ignore[arg-type]
