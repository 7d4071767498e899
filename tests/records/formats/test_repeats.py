"""A channel that a file lists several times: kept once where its values are the same, named where they are not."""

import json

import numpy as np
import pytest

from tests.records.formats.helpers import refused, write
from tests.records.formats.test_formats import out, outb
from windsysid.inspection import inspect_record
from windsysid.records.formats import iterate_record, load_mapping, read_record

ROWS = "".join(f"{0.1 * k:.1f},{k},{{}},{k if k % 3 else ''}\n" for k in range(300))
SAME = "time [s],a [m],a [m],b [m]\n" + "".join(line.format(line.split(",")[1]) + "\n" for line in ROWS.splitlines())


def test_a_channel_that_is_listed_twice_with_the_same_values_is_kept_once_and_said(tmp_path):
    record = read_record(write(tmp_path, SAME))
    assert record.channels == ("a", "b")
    assert record.attributes["repeated"] == "listed several times with the same values, one kept: a"
    np.testing.assert_array_equal(record["a"], np.arange(300.0))
    pieces = list(iterate_record(tmp_path / "x.csv", 7.0))
    assert np.concatenate([piece["a"] for piece in pieces]).tobytes() == record["a"].tobytes()
    assert read_record(tmp_path / "x.csv", section=(3.0, 9.0)).channels == ("a", "b")
    assert any("one kept: a" in note for note in inspect_record(record).notes)


def test_missing_values_in_the_same_places_are_the_same(tmp_path):
    rows = "0,,\n1,2,2\n2,NaN,\n3,4,4\n"
    assert read_record(write(tmp_path, "time [s],a [m],a [m]\n" + rows)).channels == ("a",)


def other(folder):
    return write(folder, SAME.replace("29.0,290,290,", "29.0,290,291,"))


def test_a_channel_that_is_listed_twice_with_different_values_is_refused_and_the_advice_works(tmp_path):
    path = other(tmp_path)
    match = r"channel 'a' is listed twice with different values \(line 292\); rename one .*: (.*)"
    refused(path, match)
    advice = '[channels."a#2"] name = "a_2"'
    rules = load_mapping(write(tmp_path, advice.replace("] ", "]\n") + "\n", "m.toml"))
    record = read_record(path, mapping=rules)
    assert record.channels == ("a", "a_2", "b")
    assert (record["a"][290], record["a_2"][290], record.unit("a_2")) == (290.0, 291.0, "m")


@pytest.mark.parametrize(("key", "value"), [("a#1", 290.0), ("a#2", 291.0), ("a [m]#2", 291.0)])
def test_one_of_several_columns_of_a_name_can_be_chosen(tmp_path, key, value):
    rules = load_mapping(write(tmp_path, f"only_listed = true\n[channels.{json.dumps(key)}]\n", "m.toml"))
    record = read_record(other(tmp_path), mapping=rules)
    assert (record.channels, record["a"][290]) == (("a",), value)


def test_columns_of_one_name_in_different_units_are_refused(tmp_path):
    refused(write(tmp_path, SAME.replace("a [m],a [m]", "a [m],a [rad]")), "listed twice with different units")


def test_two_columns_that_a_mapping_calls_the_same_are_refused(tmp_path):
    rules = load_mapping(write(tmp_path, '[channels."b"]\nname = "a"\n', "m.toml"))
    refused(write(tmp_path, SAME), "occurs twice", mapping=rules)


@pytest.mark.parametrize("name", ["x.out", "x.outb"])
def test_openfast_output_that_lists_a_channel_twice_is_read(tmp_path, name):
    rows = np.column_stack([np.arange(9.0)] * 9)
    text = out(rows).replace("RotSpeed", "Azimuth").replace("rpm", "deg")
    names = ["Azimuth", "Azimuth", "RootFxc1", "RootFxc1"]
    path = write(tmp_path, text if name == "x.out" else outb(rows[:, :4], names, ["(deg)"] * 2 + ["(kN)"] * 2), name)
    record = read_record(path)
    assert record.channels[0] == "rotor_azimuth"
    assert len(record.channels) == (8 if name == "x.out" else 2)
    different = rows[:, :4] + [0.0, 1.0, 0.0, 0.0]
    path = write(tmp_path, outb(different, names, ["(deg)"] * 2 + ["(kN)"] * 2), "x.outb")
    refused(path, r"'rotor_azimuth' is listed twice with different values \(sample 0\)")
    rules = load_mapping(write(tmp_path, '[channels."rotor_azimuth#2"]\nname = "other"\n', "m.toml"))
    assert read_record(path, mapping=rules).channels == ("rotor_azimuth", "other", "RootFxc1")
