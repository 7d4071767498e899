"""MATLAB of both kinds and HDF5 of any layout, written by scipy and h5py, are read bit for bit."""

from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from tests.records.formats.helpers import refused, write
from windsysid.errors import ConfigurationError
from windsysid.records.formats import iterate_record, read_record
from windsysid.records.formats.contents.mapping import ChannelRule, Mapping, TimeRule

T = 300
TIME = 0.01 * np.arange(T)
RNG = np.random.default_rng(5)
ACC, TABLE = RNG.standard_normal(T), RNG.standard_normal((T, 3))
CONTENT = {
    "t": TIME,
    "acc_m_s2": ACC,
    "fs": 100.0,
    "site": "hill",
    "tower": {"top_mm": TABLE, "deep": {"roll_deg": ACC}},
}
READ = {"acc": ACC, "top_1": TABLE[:, 0] * 1e-3, "top_3": TABLE[:, 2] * 1e-3, "roll": ACC * (np.pi / 180.0)}


def matlab_73(path, content=CONTENT):
    """A file as MATLAB's -v7.3 writes it: HDF5 behind a header, axes reversed, classes as attributes."""

    def put(group, values):
        for name, value in values.items():
            if isinstance(value, dict):
                put(group.create_group(name), value)
                continue
            text = isinstance(value, str)
            array = np.array([list(value.encode())], "<u2") if text else np.atleast_2d(np.asarray(value, dtype=float))
            turned = array.T if text or np.ndim(value) != 1 else array  # MATLAB's (T, 1) lies there as (1, T)
            group[name] = turned
            group[name].attrs["MATLAB_class"] = np.bytes_("char" if text else "double")

    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, content)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    return path


def matlab_5(path, content=CONTENT, compressed=True):
    savemat(path, content, do_compression=compressed)
    return path


@pytest.mark.parametrize("save", [matlab_73, matlab_5, lambda path: matlab_5(path, compressed=False)])
def test_both_kinds_of_matlab_file_give_the_same_record(tmp_path, save):
    record = read_record(save(tmp_path / "x.mat"))
    assert record.time.tobytes() == TIME.tobytes()
    assert set(record.channels) == {"acc", "top_1", "top_2", "top_3", "roll"}
    for name, values in READ.items():
        assert record[name].tobytes() == values.tobytes()
    assert record.unit("acc") == "m/s^2"
    assert record.unit("roll") == "rad"


@pytest.mark.parametrize("save", [matlab_73, matlab_5])
def test_a_matlab_file_without_a_time_asks_for_the_rate_and_says_what_fs_is(tmp_path, save):
    path = save(tmp_path / "x.mat", {"acc_m_s2": ACC, "fs": 100.0})
    refused(path, r"no series is known to be the time.*fs = 100.*\[time\] rate")
    record = read_record(path, mapping=Mapping(time=TimeRule(rate=100.0, start="2021-07-07T12:00:00Z")))
    assert record.time.tobytes() == (np.arange(T) / 100.0).tobytes()
    assert record.start == "2021-07-07T12:00:00Z"


def test_a_row_of_channels_is_not_taken_for_a_sample(tmp_path):
    content = {"t": TIME, "rows": TABLE, "columns": TABLE.T}
    for save in (matlab_73, matlab_5):
        record = read_record(save(tmp_path / "x.mat", content))
        for k in range(3):
            assert record[f"rows_{k + 1}"].tobytes() == record[f"columns_{k + 1}"].tobytes() == TABLE[:, k].tobytes()


def test_a_matrix_as_long_as_the_time_both_ways_is_refused(tmp_path):
    matlab_5(tmp_path / "x.mat", {"t": np.arange(4.0), "a": np.eye(4)})
    refused(tmp_path / "x.mat", "4 by 4, as long as the time both ways")


def layout(path):
    with h5py.File(path, "w") as file:
        file["raw/daq"] = TABLE.T
        file["raw/daq"].attrs["units"] = "mg"
        file["raw/clock"] = TIME * 1000.0
        file["met/wind"] = np.arange(10.0)
        kind = np.dtype([("level", "<f4"), ("id", "<i8"), ("what", "S4")])
        rows = np.zeros(T, kind)
        rows["level"] = ACC
        file["table"] = rows
        file["packed"] = np.arange(T, dtype="i2")
        file["packed"].attrs.update({"units": "m", "scale_factor": 0.5, "add_offset": 1.0, "_FillValue": np.int16(7)})
        file.attrs["start_time"] = "2021-07-07T12:00:00Z"
        file["here"] = h5py.SoftLink("/raw/clock")
        file["raw/again"] = file["raw"]  # a group that holds itself
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/a")
    return path


def test_hdf5_of_any_layout_is_read_by_its_mapping(tmp_path):
    rules = {"raw/daq_*": ChannelRule(), "table/level": ChannelRule(name="rotor_speed", unit="rpm", sign=-1)}
    mapping = Mapping(time=TimeRule(column="raw/clock", unit="ms"), channels=rules, only_listed=True)
    path = layout(tmp_path / "x.h5")
    record = read_record(path, mapping=mapping)
    assert record.channels == ("daq_1", "daq_2", "daq_3", "rotor_speed")
    assert record["daq_2"].tobytes() == (TABLE[:, 1] * (9.80665 * 1e-3)).tobytes()
    np.testing.assert_array_equal(record["rotor_speed"], ACC.astype("<f4").astype(float) * -(2.0 * np.pi / 60.0))
    np.testing.assert_array_equal(record.time, TIME * 1000.0 * 1e-3)
    assert record.start == "2021-07-07T12:00:00Z"
    pieces = list(iterate_record(path, 0.5, mapping=mapping))
    np.testing.assert_array_equal(np.concatenate([piece.values for piece in pieces]), record.values)
    part = read_record(path, mapping=mapping, section=(1.0, 2.0))
    np.testing.assert_array_equal(part.values, record.section(1.0, 2.0).values)


def test_packed_hdf5_is_unpacked_and_what_is_no_channel_is_said(tmp_path):
    record = read_record(layout(tmp_path / "x.h5"), mapping=Mapping(time=TimeRule(column="clock", unit="ms")))
    expected = np.arange(T) * 0.5 + 1.0
    expected[7] = np.nan
    np.testing.assert_array_equal(record["packed"], expected)
    assert record.attributes["left_out"] == "met/wind, table/what"


def test_an_array_of_another_length_is_refused_where_it_is_listed(tmp_path):
    rules = Mapping(time=TimeRule(column="clock", unit="ms"), channels={"wind": ChannelRule(unit="m/s")})
    refused(
        layout(tmp_path / "x.h5"),
        "'clock' .300 samples. and .*'wind' .10 samples. are not sampled together",
        mapping=rules,
    )
    with pytest.raises(ConfigurationError, match=r'channels\."nothing"'):
        read_record(
            tmp_path / "x.h5", mapping=Mapping(time=TimeRule(column="clock"), channels={"nothing": ChannelRule()})
        )


def test_what_is_no_such_file_is_refused(tmp_path):
    refused(write(tmp_path, b"hello", "x.h5"), "is not HDF5")
    refused(write(tmp_path, b"hello" * 50, "x.mat"), "is no MATLAB file")
    whole = layout(tmp_path / "x.h5").read_bytes()
    refused(write(tmp_path, whole[: len(whole) // 2], "x.h5"), "damaged or cut off")


def test_a_pattern_gives_many_channels_a_unit_and_names_none(tmp_path):
    path = matlab_5(tmp_path / "x.mat", {"t": TIME, **{f"ch{k}": ACC for k in range(16)}})
    record = read_record(path, mapping=Mapping(channels={"ch*": ChannelRule(unit="mg"), "ch3": ChannelRule(unit="g")}))
    assert len(record.channels) == 16
    assert record["ch1"].tobytes() == (ACC * (9.80665 * 1e-3)).tobytes()
    assert record["ch3"].tobytes() == (ACC * 9.80665).tobytes()
    with pytest.raises(ValueError, match="a pattern gives many channels one name"):
        Mapping(channels={"ch*": ChannelRule(name="a")})
    refused(path, "no such column", mapping=Mapping(channels={"zz*": ChannelRule(unit="mg")}))


def fields(names):
    table = np.zeros(T, dtype=[(name, "f8") for name in names])
    for name, values in zip(names, (TIME, ACC, TABLE[:, 0]), strict=True):
        table[name] = values
    return table


def hdf5_groups(path, names):
    """A dataset of each name: HDF5 cuts the names at the slash."""
    with h5py.File(path, "w") as file:
        for name, values in zip(names, (TIME, ACC, TABLE[:, 0]), strict=True):
            file[f"rec/{name}"] = values


def hdf5_compound(path, names):
    with h5py.File(path, "w") as file:
        file["rec"] = fields(names)


SAVED = {
    "datasets.h5": hdf5_groups,
    "compound.h5": hdf5_compound,
    "structured.npy": lambda path, names: np.save(path, fields(names)),
    "structured.npz": lambda path, names: np.savez(path, rec=fields(names)),
    "named.npz": lambda path, names: np.savez(path, **{name: fields(names)[name] for name in names}),
}


@pytest.mark.parametrize("name", SAVED)
@pytest.mark.parametrize("form", ["{} [{}]", "{} ({})", "{}[{}]"])
def test_a_slash_in_the_brackets_of_a_unit_parts_no_groups(tmp_path, name, form):
    names = [form.format(*cell) for cell in (("time", "s"), ("ax", "mm/s^2"), ("ay", "mm/s^2"))]
    SAVED[name](tmp_path / name, names)
    record = read_record(tmp_path / name)
    assert record.channels == ("ax", "ay")
    assert record.units == ("m/s^2", "m/s^2")
    np.testing.assert_allclose(record["ax"], 1e-3 * ACC)
    assert "left_out" not in record.attributes


def test_structures_of_matlab_may_have_units_in_the_names_of_fields(tmp_path):
    savemat(tmp_path / "x.mat", {"rec": {"time": TIME, "ax [m/s^2]": ACC, "ay [m/s^2]": ACC}})
    assert read_record(tmp_path / "x.mat").channels == ("ax", "ay")


def test_groups_with_channels_of_one_name_and_unit_stay_apart(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["time"] = TIME
        file["top/ax [m/s^2]"], file["base/ax [m/s^2]"] = ACC, ACC
    record = read_record(tmp_path / "x.h5")
    assert record.channels == ("base_ax", "top_ax")
    assert record.units == ("m/s^2", "m/s^2")


def test_an_array_of_another_length_is_left_out_where_the_time_has_its_unit_in_brackets(tmp_path):
    arrays: dict[str, Any] = {"time [s]": TIME, "ax [m/s^2]": ACC, "gains": np.arange(4.0)}
    np.savez(tmp_path / "x.npz", **arrays)
    record = read_record(tmp_path / "x.npz")
    assert (record.channels, record.attributes["left_out"]) == (("ax",), "gains")
