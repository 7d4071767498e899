"""NumPy's files: structured arrays, matrices with a mapping, named arrays; damage and pickles are refused."""

import io
import zipfile

import numpy as np
import pytest

from tests.records.formats.helpers import refused, write
from windsysid.records.formats import iterate_record, load_mapping, read_record

TIME = 0.05 * np.arange(200)
VALUES = np.random.default_rng(4).standard_normal((200, 3))


def structured(kind="f8"):
    table = np.zeros(200, dtype=[("time", "f8"), ("tower_x_acceleration_mg", kind), ("rotor_speed_rpm", kind)])
    for name, column in zip(table.dtype.names or (), (TIME, *VALUES.T), strict=False):
        table[name] = column
    return table


@pytest.mark.parametrize("kind", ["f8", "f4", ">f8"])
def test_the_fields_of_a_structured_array_are_channels(tmp_path, kind):
    np.save(tmp_path / "x.npy", structured(kind))
    record = read_record(tmp_path / "x.npy")
    assert record.channels == ("tower_x_acceleration", "rotor_speed")
    assert record.units == ("m/s^2", "rad/s")
    np.testing.assert_array_equal(record.time, TIME)
    np.testing.assert_allclose(record["tower_x_acceleration"], VALUES[:, 0] * 9.80665e-3, rtol=1e-6)
    pieces = list(iterate_record(tmp_path / "x.npy", 3.0))
    assert np.concatenate([p.values for p in pieces]).tobytes() == record.values.tobytes()


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_matrix_is_read_with_a_rate_and_names_and_refused_without(tmp_path, order, turned):
    np.save(tmp_path / "x.npy", np.array(VALUES.T if turned else VALUES, order=order))
    refused(tmp_path / "x.npy", r"no series is known to be the time.*\[time\] rate")
    toml = '[time]\nrate = 20.0\n[channels."column_2"]\nname = "tower_z_acceleration"\nunit = "g"\n'
    record = read_record(tmp_path / "x.npy", mapping=load_mapping(write(tmp_path, toml, "m.toml")))
    assert record.channels == ("column_1", "tower_z_acceleration", "column_3")
    np.testing.assert_allclose(record["tower_z_acceleration"], VALUES[:, 1] * 9.80665)
    np.testing.assert_array_equal(record.time, np.arange(200) / 20.0)


def test_a_column_of_a_matrix_can_be_the_time(tmp_path):
    np.save(tmp_path / "x.npy", np.column_stack([TIME, VALUES]))
    rules = load_mapping(write(tmp_path, '[time]\ncolumn = "column_1"\nunit = "s"\n', "m.toml"))
    record = read_record(tmp_path / "x.npy", mapping=rules)
    assert record.channels == ("column_2", "column_3", "column_4")
    np.testing.assert_array_equal(record.time, TIME)


def test_a_vector_is_a_channel(tmp_path):
    np.save(tmp_path / "x.npy", VALUES[:, 0])
    rules = load_mapping(write(tmp_path, "[time]\nrate = 20.0\n", "m.toml"))
    np.testing.assert_array_equal(read_record(tmp_path / "x.npy", mapping=rules)["column_1"], VALUES[:, 0])


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_named_arrays_are_channels_and_constants_are_left_out_and_said(tmp_path, save):
    save(
        tmp_path / "x.npz", time_s=TIME, acc_m_s2=VALUES[:, 0], y=VALUES.T, wn=np.array([1.2, 3.4]), who=np.array("me")
    )
    record = read_record(tmp_path / "x.npz")
    assert record.channels == ("acc", "y_1", "y_2", "y_3")
    assert record.attributes["left_out"] == "wn"
    np.testing.assert_array_equal(record["y_3"], VALUES[:, 2])


def test_an_npz_without_a_time_says_what_fs_is(tmp_path):
    np.savez(tmp_path / "x.npz", y=VALUES, fs=20.0)
    refused(tmp_path / "x.npz", r"the file says fs = 20; .*\[time\] rate")


def test_dates_become_seconds(tmp_path):
    moments = np.datetime64("2021-07-07T12:00:00.000000000") + (1e9 * TIME).round().astype("m8[ns]")
    np.savez(tmp_path / "x.npz", time=moments, a=VALUES[:, 0])
    np.testing.assert_allclose(read_record(tmp_path / "x.npz").time, TIME, atol=1e-9)


@pytest.mark.filterwarnings("ignore:Stored array in format 3.0")
def test_names_beyond_latin_1_are_read(tmp_path):
    values = np.zeros(200, dtype=[("time", "f8"), ("Ω_rpm", "f8")])
    values["time"], values["Ω_rpm"] = TIME, VALUES[:, 0]
    np.save(tmp_path / "x.npy", values)
    np.savez(tmp_path / "x.npz", x=values)
    for name in ("x.npy", "x.npz"):
        record = read_record(tmp_path / name)
        np.testing.assert_allclose(record["Ω"], VALUES[:, 0] * 2.0 * np.pi / 60.0)


def test_dates_in_months_are_no_channel(tmp_path):
    months = np.arange(200).astype("M8[M]")
    np.savez(tmp_path / "x.npz", time=TIME, a=VALUES[:, 0], month=months)
    assert read_record(tmp_path / "x.npz").attributes["left_out"] == "month"
    np.savez(tmp_path / "y.npz", time=months, a=VALUES[:, 0])
    refused(tmp_path / "y.npz", "time")


def test_pickles_are_never_read(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was run",))

    np.save(tmp_path / "x.npy", np.array([Trap()] * 200, dtype=object), allow_pickle=True)
    refused(tmp_path / "x.npy", "no array of numbers")
    np.savez(tmp_path / "x.npz", time=TIME, a=VALUES[:, 0], trap=np.array([Trap()] * 200, dtype=object))
    assert read_record(tmp_path / "x.npz").attributes["left_out"] == "trap"
    mixed = np.array([(0.0, Trap())] * 200, dtype=[("time", "f8"), ("trap", object)])
    np.save(tmp_path / "x.npy", mixed, allow_pickle=True)
    refused(tmp_path / "x.npy", "Python objects, which are not read")


def test_what_is_cut_off_or_no_array_is_refused(tmp_path):
    np.save(tmp_path / "whole.npy", structured())
    whole = (tmp_path / "whole.npy").read_bytes()
    for size in (7, 20, 100, len(whole) - 1):
        refused(write(tmp_path, whole[:size], "x.npy"), "cut off|damaged")
    refused(write(tmp_path, whole + whole, "x.npy"), "more than one array")
    refused(write(tmp_path, "time,a\n0,1\n1,2\n", "x.npy"), "no array of NumPy")
    refused(write(tmp_path, "time,a\n0,1\n1,2\n", "x.npz"), "no array of NumPy")
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("readme.txt", "none")
    refused(tmp_path / "x.npz", "holds no array")
    np.save(tmp_path / "x.npy", VALUES[:20])
    refused(tmp_path / "x.npy", "'column' is 20 by 3, which does not show the axis of the time")


def test_an_array_that_is_declared_and_not_there_takes_no_memory(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    refused(write(tmp_path, header.getvalue() + bytes(800), "x.npy"), "is cut off: x.npy needs 80000000")
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("time.npy", header.getvalue() + bytes(800))
    refused(tmp_path / "x.npz", "is cut off: time.npy needs 80000000")
