import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import ConfigurationError, OutputError, RecordError
from windsysid.records.formats import read_record, write_record
from windsysid.records.formats.contents.mapping import ChannelRule, Mapping
from windsysid.records.record import Record

SHARED = Path(__file__).parents[4] / "shared" / "data"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the reference records are not beside this checkout")


@pytest.fixture
def record():
    rng = np.random.default_rng(1)
    values = rng.standard_normal((50, 3)) * 10.0 ** rng.integers(-300, 300, (50, 3))
    values[3, 1] = np.nan
    values[4, 2] = -0.0
    values[:2, 0] = 0.1 + 0.2, np.nextafter(1.0, 2.0)
    return Record(
        np.cumsum(rng.random(50)),
        values,
        ("tower_x_acceleration", "blade_1_lag_displacement", "accelerometer, nacelle (aft)"),
        ("m/s^2", "rad", "as written: kg/m^3"),
        name="made up",
        attributes={"site": "hill – west", "empty": ""},
    )


def refused(path, match):
    """The file is refused with one line that names it and matches."""
    with pytest.raises(RecordError, match=match) as caught:
        read_record(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def csv_file(folder, text, name="x.csv"):
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


# CSV


def same_bits(one, other):
    return one.tobytes() == other.tobytes()


@pytest.mark.parametrize("name", ["x.csv", "x.txt", "x.nc", "X.NC4", "x.parquet"])
def test_a_round_trip_keeps_every_bit(tmp_path, record, name):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    write_record(record, tmp_path / name)
    again = read_record(tmp_path / name)
    assert same_bits(again.time, record.time)
    assert same_bits(np.nan_to_num(again.values, nan=7.0), np.nan_to_num(record.values, nan=7.0))
    assert np.array_equal(np.isnan(again.values), np.isnan(record.values))
    assert again.channels == record.channels
    assert again.units == record.units
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_netcdf_keeps_name_and_attributes(tmp_path, record):
    write_record(record, tmp_path / "x.nc")
    again = read_record(tmp_path / "x.nc")
    assert again.name == "made up"
    assert again.attributes == record.attributes


def test_csv_units_come_from_brackets_then_from_endings(tmp_path):
    header = (
        "time_s,a [deg],b (kN-m),speed_rpm,wind_m_s,power_W,gauge_V_per_V,hub_g,rotor_azimuth_rad,tower_lag_g [m],mast"
    )
    text = header + "\n" + "\n".join(f"{k},180,2,60,3,4,5,1,6,7,8" for k in range(2)) + "\n"
    record = read_record(csv_file(tmp_path, text))
    assert record.channels == (
        "a",
        "b",
        "speed",
        "wind",
        "power",
        "gauge",
        "hub",
        "rotor_azimuth",
        "tower_lag_g",
        "mast",
    )
    assert record.units == ("rad", "N*m", "rad/s", "m/s", "W", "1", "m/s^2", "rad", "m", "as written: unknown")
    assert record.values[1] == pytest.approx([np.pi, 2000, 2 * np.pi, 3, 4, 5, 9.80665, 6, 7, 8])
    assert record.name == "x.csv"


@pytest.mark.parametrize(("header", "step"), [("time [s]", 1), ("t (s)", 1), ("Time [ms]", 1e-3), ("time (min)", 60)])
def test_the_time_column_has_many_names(tmp_path, header, step):
    record = read_record(csv_file(tmp_path, f"{header},a [m]\n0,1\n1,2\n"))
    assert record.time[1] == pytest.approx(step)


def test_empty_cells_are_missing_and_blank_lines_and_a_byte_order_mark_are_nothing(tmp_path):
    path = csv_file(tmp_path, b"\xef\xbb\xbf\r\ntime [s],a [m],b [m]\r\n0, ,1\r\n\r\n1,NaN,\r\n")
    values = read_record(path).values
    assert np.isnan(values[:, 0]).all()
    assert np.array_equal(values[:, 1], [1.0, np.nan], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n \n", "only blank lines"),
        ("time [s],a [m]\n", "0 rows under the header"),
        ("time [s],a [m]\n0,1\n", "at least 2 samples, got 1"),
        ("time [s],a [m],b [m]\n0,1,2\n\n1,x1,3\n2,y,3\n", r"column 'a \[m\]', line 4: 'x1' is not a number"),
        ("time [s],a [m]\n0,1\n1,2\n2,inf\n", "channel 'a' is infinite at line 4"),
        ("time [s],a [m]\n0,1\n1,1e999\n", "channel 'a' is infinite at line 3"),
        ("time [s],a [m]\n0,1\n2,2\n1,2\n", "backwards at line 4"),
        ("time [s],a [m]\n0,1\n0,2\n1,2\n", "repeated at line 3"),
        ("time [s],a [m]\n,1\n,2\n", "time is missing or infinite everywhere"),
        ("time [s],a [m]\n0,1\n,2\n", "time at line 3 is nan"),
        ("time [s],a [furlong]\n0,1\n1,2\n", r"column 'a \[furlong\]': unknown unit 'furlong'"),
        ("time [m],a [m]\n0,1\n1,2\n", "not in a unit of time"),
        ("a [m],time\n0,1\n1,2\n", "first column is 'a"),
        ("time [s],a [m],a [m]\n0,1,1\n1,2,3\n", "'a' is listed twice"),
        ("time [s],a [m],\n0,1,1\n1,2,2\n", "column 3 has no name"),
        ("time [s],a [m],b [m]\n0,1,1\n1,2\n", "line 3 has 2 cells, expected 3"),
        ("time [s],a [m]\n0,1,5\n1,2,5\n", "line 2 has 3 cells, expected 2"),
        ("1,1\n0,2\n", "has no header line, and its first column does not increase"),
        ("hello\nworld\n", "one column"),
        ('"TOA5","logger"\n"TIMESTAMP","a"\n', "TOA5"),
        ('time [s],a [m]\n0,"1,5"\n1,"2,5"\n', "'1,5' is not a number"),
        (bytes(range(256)) * 20, "is binary, not text"),
        ("time [s],a\n".encode("utf-16"), "0 rows under the header"),
    ],
)
def test_a_bad_csv_is_refused_in_one_line(tmp_path, text, message):
    refused(csv_file(tmp_path, text), message)


# files


def test_what_is_not_a_file_is_refused(tmp_path):
    refused(tmp_path, "is a folder")
    refused(tmp_path / "nothing.csv", "no such file")
    refused(csv_file(tmp_path, "time [s],a\n", "x.xlsx"), "unknown ending '.xlsx'")


def test_nothing_is_overwritten_silently(tmp_path, record):
    path = tmp_path / "x.csv"
    path.write_text("precious")
    with pytest.raises(OutputError, match="already there; choose another name, or overwrite"):
        write_record(record, path)
    assert path.read_text() == "precious"
    write_record(record, path, overwrite=True)
    assert read_record(path).samples == 50


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, record, monkeypatch):
    def half(self, file, **_):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    import pandas as pd

    path = tmp_path / "x.csv"
    path.write_text("precious")
    monkeypatch.setattr(pd.DataFrame, "to_csv", half)
    with pytest.raises(OutputError, match="No space left"):
        write_record(record, path, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["x.csv"]
    assert path.read_text() == "precious"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x.csv/folder.csv", "is a file; choose a folder you may write to"),
        ("x.outb", "cannot write"),
        ("", "cannot write"),
    ],
)
def test_where_nothing_can_be_written_is_said(tmp_path, record, name, message):
    (tmp_path / "x.csv").write_text("precious")
    with pytest.raises(OutputError, match=message):
        write_record(record, tmp_path / name)
    (tmp_path / "d.csv").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        write_record(record, tmp_path / "d.csv", overwrite=True)


# netCDF


def test_a_bad_netcdf_is_refused_in_one_line(tmp_path, record):
    import xarray as xr

    refused(csv_file(tmp_path, "time [s],a\n0,1\n1,2\n", "x.nc"), "is not netCDF-4")
    refused(csv_file(tmp_path, b"CDF\x01" + bytes(100), "y.nc"), "classic netCDF")
    refused(csv_file(tmp_path, b"\x89HDF\r\n\x1a\n" + bytes(range(200)), "z.nc"), "damaged")
    write_record(record, tmp_path / "good.nc")
    whole = (tmp_path / "good.nc").read_bytes()
    refused(csv_file(tmp_path, whole[: len(whole) // 2], "cut.nc"), "damaged")
    xr.Dataset({"map": (("lat", "lon"), np.ones((2, 3)))}).to_netcdf(tmp_path / "map.nc", engine="h5netcdf")
    refused(tmp_path / "map.nc", "not a record: expected a coordinate 'time'")


def test_scalars_of_a_netcdf_file_are_left_out_with_a_note_and_refused_where_they_are_listed(tmp_path):
    import xarray as xr

    dataset = xr.Dataset({"u": ("time", np.arange(5.0)), "height": 80.0, "fs": 10.0}, {"time": 0.1 * np.arange(5)})
    dataset.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
    record = read_record(tmp_path / "x.nc")
    assert (record.channels, record.attributes["left_out"]) == (("u",), "height, fs")
    with pytest.raises(RecordError, match=r"'fs' is float64 with dimensions \(\)"):
        read_record(tmp_path / "x.nc", mapping=Mapping(channels={"fs": ChannelRule(unit="1")}))


def test_netcdf_packed_elsewhere_reads_as_xarray_unpacks_it(tmp_path):
    import xarray as xr

    value = np.array([-1.5, 0.25, np.nan, 700.125])
    station = {"station": 7.0, "height": ("time", np.ones(4))}  # coordinates that are no channel
    dataset = xr.Dataset(
        {"u": ("time", value, {"units": "m/s"})}, {"time": ("time", np.arange(4.0), {"units": "s"}), **station}
    )
    packing = {"dtype": "int16", "scale_factor": 0.125, "add_offset": 300.0, "_FillValue": -32768}
    dataset.to_netcdf(tmp_path / "x.nc", engine="h5netcdf", encoding={"u": packing})
    record = read_record(tmp_path / "x.nc")
    assert record.channels == ("u",)
    with xr.open_dataset(tmp_path / "x.nc", engine="h5netcdf") as expected:
        np.testing.assert_array_equal(record["u"], expected["u"])
    assert np.isnan(record["u"][2])
    assert record["u"][3] == 700.125


def test_a_slash_in_a_name_cannot_go_to_netcdf(tmp_path):
    record = Record(np.arange(2.0), np.ones((2, 1)), ("u/v",), ("1",))
    with pytest.raises(OutputError, match="'u/v'"):
        write_record(record, tmp_path / "x.nc")


# OpenFAST

NAMES = [
    "Azimuth",
    "RotSpeed",
    "IPDefl2",
    "TipALgyb1",
    "RootMxb3",
    "YawBrTAgyp",
    "YawBrRDxt",
    "Other",
    "AeroDens",
]
UNITS = ["(deg)", "(rpm)", "(m)", "(m/s^2)", "(kN-m)", "(m/s^2)", "(deg)", "(mm)", "(kg/m^3)"]
ROWS = np.array(
    [[0, 60, 1, 2, 3, 4, 180, 5, 1.25], [300, 60, -1, -2, -3, -4, 90, -5, 1.25], [0, 0, 0, 0, 0, 0, 0, 0, 0]]
)


def outb(rows=ROWS, names=NAMES, units=UNITS, step=0.01, scale=100.0):
    """A packed binary file, format 2, of rows that fit int16 when multiplied by `scale`."""
    n, description = len(names), b"a test"
    text = b"".join(cell.ljust(10).encode() for cell in ["Time", *names, "(s)", *units])
    return (
        struct.pack("<hiidd", 2, n, len(rows), 0.0, step)
        + np.full(n, scale, "<f4").tobytes()
        + np.zeros(n, "<f4").tobytes()
        + struct.pack("<i", len(description))
        + description
        + text
        + np.round(rows * scale).astype("<i2").tobytes()
    )


def out(rows=ROWS, step=0.01):
    lines = [
        "",
        "made by hand",
        "",
        "",
        "a test",
        "",
        "\t".join(["Time", *NAMES]),
        "\t".join(["(s)", *UNITS]),
    ]
    lines += [f"{step * k:.4f}\t" + "\t".join(map(str, row)) for k, row in enumerate(rows)]
    return "\n".join(lines) + "\n"


@pytest.fixture(params=["x.outb", "x.out"])
def openfast(request, tmp_path):
    return csv_file(
        tmp_path, outb(ROWS / 10, scale=50.0) if request.param == "x.outb" else out(ROWS / 10), request.param
    )


def test_openfast_channels_come_under_our_names_signs_and_units(openfast):
    record = read_record(openfast)
    assert record.name == openfast.name
    assert record.attributes["description"] == "a test"
    assert np.array_equal(record.time, [0.0, 0.01, 0.02])
    expected = {
        "rotor_azimuth": ([np.pi / 2, np.pi * 2 / 3], "rad"),
        "rotor_speed": ([0.2 * np.pi, 0.2 * np.pi], "rad/s"),
        "blade_2_tip_lag_deflection": ([-0.1, 0.1], "m"),
        "blade_1_tip_lag_acceleration": ([-0.2, 0.2], "m/s^2"),
        "blade_3_root_lag_moment": ([300.0, -300.0], "N*m"),
        "tower_x_acceleration": ([0.4, -0.4], "m/s^2"),
        "tower_roll": ([np.pi / 10, np.pi / 20], "rad"),
        "Other": ([5e-4, -5e-4], "m"),
        "AeroDens": ([0.12 if openfast.suffix == ".outb" else 0.125] * 2, "kg/m^3"),
    }
    assert record.channels == tuple(expected)
    for name, (values, unit) in expected.items():
        assert record.unit(name) == unit
        assert record[name][:2] == pytest.approx(values), name


# OpenFAST's axes as its documentation names them, in x downwind, y left looking downwind, z up, and the rotor at rest
# with blade 1 up. Blade 1 stands up (+z) and moves to the right as seen downwind (-y), because the rotor turns
# clockwise as seen downwind.
DOWNWIND, LEFT, UP = np.eye(3)
BLADE_1_GOES = np.cross(DOWNWIND, UP)  # clockwise as seen downwind: about +x by the right-hand rule
LAG = -BLADE_1_GOES  # y of the blade's axes: what OpenFAST calls positive in the rotor plane is against the rotation
AXES = {
    "TTDspSS": LEFT, "YawBrTVyp": LEFT, "YawBrTAyp": LEFT, "YawBrTAgyp": LEFT, "NcIMUTAgys": LEFT,
    "TTDspFA": DOWNWIND, "YawBrTVxp": DOWNWIND, "YawBrTAxp": DOWNWIND, "YawBrTAgxp": DOWNWIND, "Wind1VelX": DOWNWIND,
    "YawBrRDxt": DOWNWIND, "RootMxb1": DOWNWIND, "RootMxc1": DOWNWIND, "RotSpeed": DOWNWIND,  # vectors of a rotation
    "TipALyb1": LAG, "TipALgyb1": LAG, "IPDefl1": LAG, "NcIMUTVys": LEFT, "NcIMUTAys": LEFT, "NcIMUTVxs": DOWNWIND,
    "NcIMUTAxs": DOWNWIND, "NcIMUTAgxs": DOWNWIND, "NcIMUTVzs": UP, "NcIMUTAzs": UP, "NcIMUTAgzs": UP,
    "Wave1Elev": UP, "NacYaw": UP,
}  # fmt: skip
# Ours, seen upwind: x to the right, y up, z towards the viewer, so x is OpenFAST's y and z its x; turning is counted
# about z.
OUR_X, OUR_Y, OUR_Z = LEFT, UP, DOWNWIND
OUR_AXES = {"tower_x": OUR_X, "nacelle_x": OUR_X, "tower_z": OUR_Z, "wind_speed": OUR_Z, "tower_roll": OUR_Z,
            "rotor_speed": OUR_Z, "blade_1_root": OUR_Z, "blade_1_tip": np.cross(OUR_Z, UP),
            "nacelle_y_": OUR_Y, "nacelle_z": OUR_Z, "wave": OUR_Y, "nacelle_yaw": -OUR_Y}  # fmt: skip


def test_every_openfast_channel_has_the_sign_of_the_documented_frames(tmp_path):
    from windsysid.records.formats.openfast import CHANNELS

    assert {name.replace("#", "1") for name in CHANNELS} == {*AXES, "Azimuth", "BldPitch1"}
    names, ones = list(AXES), np.ones((3, len(AXES)))
    record = read_record(csv_file(tmp_path, outb(ones, names, ["(1)"] * len(names)), "x.outb"))
    for name, axis, channel in zip(names, AXES.values(), record.channels, strict=True):
        ours = next(ours for start, ours in OUR_AXES.items() if channel.startswith(start))
        assert record[channel][0] == axis @ ours, name


def test_the_azimuth_of_a_blade_that_stands_up_is_a_quarter_turn_and_grows_with_openfasts(tmp_path):
    """From x, to the right as seen upwind, counter-clockwise: up is a quarter turn on."""
    rows = np.array([[0.0], [90.0], [180.0]])
    azimuth = read_record(csv_file(tmp_path, outb(rows, ["Azimuth"], ["(deg)"]), "x.outb"))["rotor_azimuth"]
    np.testing.assert_allclose(azimuth, [0.5 * np.pi, np.pi, 1.5 * np.pi], atol=1e-12)


def test_the_azimuth_stays_wrapped_to_one_turn(tmp_path):
    rows = np.array([[269.0], [270.0], [271.0], [360.0]])
    azimuth = read_record(csv_file(tmp_path, outb(rows, ["Azimuth"], ["(deg)"], scale=50.0), "x.outb"))["rotor_azimuth"]
    np.testing.assert_allclose(np.sin(azimuth), np.cos(np.deg2rad(rows[:, 0])), atol=1e-12)
    assert (azimuth >= 0.0).all()
    assert (azimuth < 2.0 * np.pi).all()


def test_times_rounded_to_four_decimals_become_exactly_uniform(tmp_path):
    record = read_record(csv_file(tmp_path, out(np.tile(ROWS, (400, 1)), step=0.00625), "x.out"))
    assert np.array_equal(record.time, 0.00625 * np.arange(1200))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (outb()[:-1], "cut off: 3 samples of 9 channels need"),
        (outb()[:60], "cut off"),
        (outb()[:11], "not OpenFAST binary"),
        (b"rubbish" * 50, "not OpenFAST binary"),
        (struct.pack("<hii", 2, 2_000_000_000, 2_000_000_000) + bytes(100), "cut off"),
        (struct.pack("<hii", 2, -5, 7) + bytes(100), "not OpenFAST binary"),
        (outb(names=["Azimuth"] * 9), "'rotor_azimuth' is listed twice with different units"),
        (outb(ROWS[:1]), "at least 2 samples, got 1"),
        (outb(ROWS[:0]), "at least 2 samples, got 0"),
        (
            outb().replace(np.full(9, 100, "<f4").tobytes(), bytes(36)),
            "'rotor_speed' is infinite at sample 0",
        ),
        (outb(step=0.0), "time is repeated at sample 1"),
        (b"", "empty"),
    ],
)
def test_a_bad_outb_is_refused_in_one_line(tmp_path, content, message):
    refused(csv_file(tmp_path, content, "x.outb"), message)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (out().replace("\t-3.0", "\tabc"), "channel 'RootMxb3', line 10: 'abc' is not a number"),
        (out().replace("\t-3.0", "\tInfinity"), "channel 'blade_3_root_lag_moment' is infinite at line 10"),
        (out()[:-20], "line 11 has . cells, expected 10"),
        (out(ROWS[:0]), "at least 2 samples, got 0"),
        (out(ROWS[:1]), "at least 2 samples, got 1"),
        (out(step=0.0), "repeated at line 10"),
        ("time [s],a\n0,1\n1,2\n", "not OpenFAST text"),
        (bytes(range(256)) * 20, "is binary, not text"),
    ],
)
def test_a_bad_out_is_refused_in_one_line(tmp_path, content, message):
    refused(csv_file(tmp_path, content, "x.out"), message)


def test_openfast_has_no_start_but_the_one_of_the_mapping(tmp_path, openfast):
    assert read_record(openfast).start is None  # its header has the date of the simulation
    (tmp_path / "m.toml").write_text('[time]\nstart = "2021-07-07T12:00:00"\nzone = "UTC"\n')
    assert read_record(openfast, mapping=tmp_path / "m.toml").start == "2021-07-07T12:00:00Z"
    (tmp_path / "m.toml").write_text('[time]\nunit = "min"\n')
    with pytest.raises(ConfigurationError, match="leave only start and zone"):
        read_record(openfast, mapping=tmp_path / "m.toml")


@pytest.mark.parametrize(
    ("alias", "channel"),
    [
        ("LSSTipV", "rotor_speed"), ("LSSTipVxa", "rotor_speed"), ("LSSTipPxa", "rotor_azimuth"),
        ("RootMEdg2", "blade_2_root_lag_moment"), ("RootMIP3", "blade_3_root_inplane_moment"),
        ("YawPzn", "nacelle_yaw"), ("PtchPMzc1", "blade_1_pitch"), ("BldPitch2", "blade_2_pitch"),
        ("WindVxi", "wind_speed"), ("TTDspRoll", "tower_roll"), ("YawBrTDyt", "tower_x_displacement"),
        ("Wave1Elev", "wave_elevation"), ("NcIMUTAxs", "nacelle_z_acceleration_kinematic"), ("RootMEdg", "RootMEdg"),
        ("TwrBsMyt", "TwrBsMyt"), ("RootMFlp1", "RootMFlp1"),
    ],
)  # fmt: skip
def test_other_names_of_a_channel_of_openfast_mean_the_same(tmp_path, alias, channel):
    from windsysid.records.formats.openfast import ALIASES, CHANNELS

    assert {*ALIASES.values()} <= {*CHANNELS}
    rows = 10.0 + np.arange(4.0)[:, None]
    assert read_record(csv_file(tmp_path, outb(rows, [alias], ["(1)"]), "x.outb")).channels == (channel,)


def test_of_two_names_of_one_channel_the_first_gets_ours(tmp_path):
    rows = np.column_stack([np.arange(4.0), 1.0 + np.arange(4.0), np.arange(4.0)])
    path = csv_file(tmp_path, outb(rows, ["RotSpeed", "LSSTipVxa", "LSSTipV"], ["(rpm)"] * 3), "x.outb")
    assert read_record(path).channels == ("rotor_speed", "LSSTipVxa", "LSSTipV")


def test_bytes_behind_the_counted_rows_of_an_outb_are_left_out_and_said(tmp_path):
    whole = read_record(csv_file(tmp_path, outb(), "x.outb"))
    for tail in (b"\1" * 7, outb(), bytes(100_000)):
        record = read_record(csv_file(tmp_path, outb() + tail, "x.outb"))
        assert record.values.tobytes() == whole.values.tobytes()
        assert record.attributes["left_over"].startswith(f"{len(tail)} bytes after the 3 counted samples")


def test_openfast_files_are_read_without_openfast_io(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openfast_io", None)
    monkeypatch.setitem(sys.modules, "openfast_io.FAST_output_reader", None)
    assert read_record(csv_file(tmp_path, out(), "x.out")).samples == 3
    assert read_record(csv_file(tmp_path, outb(), "x.outb")).samples == 3


def test_text_output_has_the_numbers_that_openfast_io_reads(tmp_path):
    reader = pytest.importorskip("openfast_io.FAST_output_reader", reason="openfast_io is not installed")
    path = csv_file(tmp_path, out(np.random.default_rng(1).standard_normal((50, 9))), "x.out")
    table, _ = reader.load_ascii_output(str(path))
    record = read_record(path)
    np.testing.assert_allclose(record.time, table[:, 0], rtol=1e-15)
    np.testing.assert_array_equal(record["AeroDens"], table[:, 9])


@pytest.mark.parametrize(
    "heading",
    ["\n These predictions were generated by MoorDyn v2.3.8 on 01-Jan-2025 at 10:00:00.\n\n", "", "MoorDyn v2.2.2\n"],
)
def test_the_output_of_a_module_of_openfast_is_read_wherever_its_names_stand(tmp_path, heading):
    rows = "".join(f"{0.1 * k:10.4f} {1e6 + k:15.5e} {k * 1e3:15.5e}\n" for k in range(20))
    text = heading + "      Time        FairTen1        AnchTen1\n       (s)             (N)            (kN)\n" + rows
    record = read_record(csv_file(tmp_path, text, "mono.MD.out"))
    assert (record.channels, record.units, record.samples) == (("FairTen1", "AnchTen1"), ("N", "N"), 20)
    assert record["FairTen1"][3] == 1e6
    refused(
        csv_file(tmp_path, text.replace("1.00000e+06", "1.0x"), "mono.MD.out"),
        f"line {text[: -len(rows)].count(chr(10)) + 1}: '1.0x'",
    )


# records that other people made


@needs_shared
def test_the_signs_of_a_real_openfast_file_are_those_of_the_rotor_plane_seen_upwind():
    record = read_record(SHARED / "openfast" / "a2_rot12_decay_min.outb")
    g, x, roll = 9.80665, record["tower_x_displacement"], record["tower_roll"]
    assert record.samples == 60001
    assert record.is_uniform
    assert np.array_equal(record.time, np.arange(60001) * 0.01)
    # The tower leans to +x by turning clockwise: kappa of the data sheet, with the sign of our roll.
    assert roll @ x / (x @ x) == pytest.approx(-0.020889, rel=1e-3)
    np.testing.assert_allclose(np.gradient(x, 0.01)[1:-1], record["tower_x_velocity"][1:-1], atol=5e-3)
    # An accelerometer reads acceleration plus g upwards; 2e-4 is what int16 packing of ±3 m/s² leaves.
    gravity = record["tower_x_acceleration"] - record["tower_x_acceleration_kinematic"]
    np.testing.assert_allclose(gravity, g * np.sin(roll), atol=2e-4)
    # The nacelle's accelerometer sits 2.233 m above the tower top and turns with it, counter-clockwise positive.
    bending = np.gradient(np.gradient(roll, 0.01), 0.01)[2:-2]
    above = (record["nacelle_x_acceleration"] - record["tower_x_acceleration"])[2:-2]
    assert -(above @ bending) / (bending @ bending) == pytest.approx(2.233, rel=0.01)
    assert np.corrcoef(record["nacelle_x_acceleration"], record["tower_x_acceleration"])[0, 1] > 0.99
    turned = np.unwrap(record["rotor_azimuth"])
    assert (turned[-1] - turned[0]) / record.duration == pytest.approx(record["rotor_speed"].mean(), rel=1e-5)
    for b in (1, 2, 3):
        point = f"blade_{b}_tip_lag"
        lag = record[f"{point}_deflection"]
        angle = record["rotor_azimuth"] + 2.0 * np.pi * (b - 1) / 3.0 + roll + 0.0282 * lag
        gravity = record[f"{point}_acceleration"] - record[f"{point}_acceleration_kinematic"]
        np.testing.assert_allclose(gravity, g * np.cos(np.deg2rad(5.0)) * np.cos(angle), atol=0.02)
        assert np.corrcoef(record[f"blade_{b}_root_lag_moment"], lag)[0, 1] > 0.9


@needs_shared
def test_measured_records_are_read_with_their_suffix_units():
    record = read_record(SHARED / "bjorko" / "operation_20210707_20Hz.csv")
    assert record.channels == ("rotor_speed", "wind_speed", "electric_power", "pitch")
    assert record.units == ("rad/s", "m/s", "W", "rad")
    assert record["rotor_speed"][0] == pytest.approx(66.6138 * 2 * np.pi / 60)
    assert record.rate == pytest.approx(20.0)
    assert read_record(SHARED / "bjorko" / "pull_release_10Hz.csv").channels == ("tower_base_strain_NS",)


@needs_shared
def test_a_measured_table_without_header_is_read_with_units_unknown():
    record = read_record(SHARED / "elcentro" / "elcentro_NS.dat")
    assert record.channels == ("column_2",)
    assert record.units == ("as written: unknown",)
    assert record.samples == 2688
    assert record.rate == pytest.approx(50.0)
    assert record["column_2"][1] == -1.1012760e-2


@needs_shared
@pytest.mark.parametrize("name", ["bjorko/Bjorko_Sensors_Specs_Metadata.csv", "openfast"])
def test_other_peoples_files_that_are_no_records_are_refused(name):
    refused(SHARED / name, "expected")
