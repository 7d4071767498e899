"""No unit is guessed: the file or the mapping gives a channel's unit, or the file is refused."""

import math

import numpy as np
import pytest

from tests.records.formats.helpers import refused, write
from windsysid.records.formats import iterate_record, read_record, write_record
from windsysid.records.quantities import plausible_units
from windsysid.records.record import Record

G = 9.80665

# What a logger could have written under a bare name: the units that a person would think of, seeing the values.
BARE = {
    "rotor_speed in rpm": ("rotor_speed", np.linspace(11.8, 12.4, 40), ("rpm",)),
    "rotor_speed in rad/s": ("rotor_speed", np.linspace(1.24, 1.29, 40), ("rad/s",)),
    "nacelle_yaw in degrees": ("nacelle_yaw", np.linspace(237.0, 241.5, 40), ("deg",)),
    "nacelle_yaw in either": ("nacelle_yaw", np.linspace(2.0, 2.5, 40), ("rad", "deg")),
    "azimuth in [0, 360)": ("rotor_azimuth", np.arange(40.0) * 9.0, ("deg",)),
    "azimuth in [0, 2 pi)": ("rotor_azimuth", np.arange(40.0) * math.tau / 40.0, ("rad",)),
    "an upright accelerometer in g": ("nacelle_y_acceleration", 1.0 + 0.01 * np.sin(np.arange(40.0)), ("g",)),
    "an upright accelerometer in mg": ("nacelle_y_acceleration", 1e3 + 10.0 * np.sin(np.arange(40.0)), ("mg",)),
    "an upright accelerometer in m/s²": ("nacelle_y_acceleration", G + 0.1 * np.sin(np.arange(40.0)), ("m/s^2",)),
    "a sideways accelerometer": ("tower_x_acceleration", 0.1 * np.sin(np.arange(40.0)), ("m/s^2", "g")),
    "a sideways accelerometer in mg": ("tower_x_acc", 80.0 * np.sin(np.arange(40.0)), ("mg", "mm/s^2")),
    "wind_speed": ("wind_speed", np.linspace(8.0, 14.0, 40), ("m/s", "km/h")),
    "strain": ("tower_strain", 120.0 * np.sin(np.arange(40.0)), ("microstrain",)),
    "nothing but zeros": ("rotor_speed", np.zeros(40), ()),
}


@pytest.mark.parametrize("case", BARE)
def test_the_units_that_are_named_are_those_in_which_the_values_make_sense(case):
    name, values, expected = BARE[case]
    assert plausible_units(name, values) == expected


def bare(folder, ending, name="rotor_speed", values=BARE["rotor_speed in rpm"][1]):
    """A file of one channel that has no unit."""
    path, time = folder / f"x.{ending}", np.arange(values.size) * 0.1
    if ending == "csv":
        lines = "".join(f"{t:.1f},{x!r}\n" for t, x in zip(time.tolist(), values.tolist(), strict=True))
        path.write_text(f"time,{name}\n{lines}")
    elif ending == "nc":
        import xarray as xr

        xr.Dataset({name: ("time", values)}, {"time": time}).to_netcdf(path, engine="h5netcdf")
    else:
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
        import pandas as pd

        pd.DataFrame({"time": time, name: values}).to_parquet(path, index=False)
    return path


@pytest.mark.parametrize("ending", ["csv", "nc", "parquet"])
def test_a_rotor_speed_without_a_unit_is_refused_in_every_format(tmp_path, ending):
    path = bare(tmp_path, ending)
    message = r"channel 'rotor_speed' has no unit; its values \(11.8 … 12.4\) are plausible in rpm; .*mapping"
    refused(path, message)
    refused(path, message, section=(0.0, 2.0))
    with pytest.raises(Exception, match="has no unit"):
        list(iterate_record(path, 1.0))
    mapping = write(tmp_path, '[channels.rotor_speed]\nunit = "rpm"\n', "m.toml")
    record = read_record(path, mapping=mapping)
    assert record.unit("rotor_speed") == "rad/s"
    np.testing.assert_allclose(record["rotor_speed"], BARE["rotor_speed in rpm"][1] * math.pi / 30.0, rtol=1e-15)


@pytest.mark.parametrize("ending", ["csv", "nc", "parquet"])
@pytest.mark.parametrize(
    ("name", "channel", "factor"),
    [("rotor_speed_rpm", "rotor_speed", math.pi / 30.0), ("tower_x_acceleration_mg", "tower_x_acceleration", 1e-3 * G),
     ("nacelle_yaw_deg", "nacelle_yaw", math.pi / 180.0), ("blade_1_root_moment_MNm", "blade_1_root_moment", 1e6)],
)  # fmt: skip
def test_a_name_that_ends_in_its_unit_has_one_in_every_format(tmp_path, ending, name, channel, factor):
    values = np.linspace(3.0, 4.0, 5)
    record = read_record(bare(tmp_path, ending, name, values))
    np.testing.assert_allclose(record[channel], values * factor, rtol=1e-15)


def test_the_compass_is_no_unit(tmp_path):
    """West is not watt and north no newton."""
    for name in ("tower_acceleration_W", "tower_acceleration_N", "tower_acceleration_s"):
        refused(bare(tmp_path, "csv", name), f"channel '{name}' has no unit")
    assert read_record(bare(tmp_path, "csv", "mast_N")).units == ("as written: unknown",)
    assert read_record(bare(tmp_path, "csv", "tower_force_N")).units == ("N",)


def test_values_that_are_plausible_in_si_alone_are_refused_too(tmp_path):
    refused(
        bare(tmp_path, "csv", values=np.linspace(1.24, 1.29, 9)),
        r"plausible in rad/s; write 'rotor_speed \[rad/s\]' in",
    )


def test_every_channel_without_a_unit_is_named_at_once(tmp_path):
    path = write(tmp_path, "time [s],rotor_speed,wind_speed,mast,pitch\n0,12,8,1,2\n1,12.1,9,1,2\n")
    refused(path, "channel 'rotor_speed' has no unit.*without a unit too: wind_speed, pitch$")
    listed = 'only_listed = true\n[channels.rotor_speed]\nunit = "rpm"\n'
    assert read_record(path, mapping=write(tmp_path, listed, "m.toml")).channels == ("rotor_speed",)


def test_empty_brackets_and_empty_attributes_are_no_unit(tmp_path):
    import xarray as xr

    refused(write(tmp_path, "time [s],rotor_speed []\n0,12\n1,12\n"), "has no unit")
    refused(write(tmp_path, "time [s],rotor_speed\ns,\n0,12\n1,12\n"), "has no unit")
    data = {"rotor_speed": ("time", [12.0, 12.0], {"units": ""})}
    xr.Dataset(data, {"time": [0.0, 1.0]}).to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
    refused(tmp_path / "x.nc", "has no unit")


def test_a_mapping_may_leave_values_alone_on_purpose(tmp_path):
    mapping = write(tmp_path, '[channels.rotor_speed]\nunit = "as written"\n', "m.toml")
    assert read_record(bare(tmp_path, "csv"), mapping=mapping).units == ("as written: unknown",)


def test_a_renamed_column_needs_a_unit(tmp_path):
    mapping = write(tmp_path, '[channels.A1]\nname = "tower_x_acceleration"\n', "m.toml")
    refused(bare(tmp_path, "csv", "A1"), "channel 'tower_x_acceleration' has no unit", mapping=mapping)


@pytest.mark.parametrize("ending", ["csv", "nc", "parquet"])
def test_what_windsysid_writes_says_every_unit(tmp_path, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    names, units = ("rotor_speed", "gauge", "mast"), ("rad/s", "1", "as written: unknown")
    write_record(Record(np.arange(3.0), np.ones((3, 3)), names, units), tmp_path / f"x.{ending}")
    assert read_record(tmp_path / f"x.{ending}").units == units
