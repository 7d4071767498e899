"""Every remedy that a message of a reader names is tried: what the message says is done, and the file is read."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from tests.records.formats.helpers import refused, write
from windsysid.records.formats import load_mapping, read_record

K = range(40)


def table(header, row):
    return header + "\n" + "".join(row(k) + "\n" for k in K)


REMEDIES = {
    # what is wrong: (content, words of the message, mapping that it names or content that it asks for)
    "no unit": (
        table("time [s],rotor_speed", lambda k: f"{0.1 * k:.1f},12.{k}"), "write 'rotor_speed",
        '[channels."rotor_speed"]\nunit = "rpm"\n',
    ),
    "unknown unit": (
        table("time [s],a [furlong]", lambda k: f"{0.1 * k:.1f},{k}.5"), 'unit = "as written"',
        '[channels."a"]\nunit = "as written"\n',
    ),
    "the time is not first": (
        table("a [m],time [s]", lambda k: f"{k}.5,{0.1 * k:.1f}"), r"\[time\] column", '[time]\ncolumn = "time"\n',
    ),
    "dates in another format": (
        table("time,a [m]", lambda k: f"07.07.2021 12:00:{k:02d},{k}.5"),
        r'\[time\] format = "%d\.%m\.%Y %H:%M:%S"', '[time]\nformat = "%d.%m.%Y %H:%M:%S"\n',
    ),
    "a time of day without its date": (
        table("Tag,Uhr,a [m]", lambda k: f"2021-07-07,12:00:{k:02d},{k}.5").replace("Tag", "time"),
        r"has no date|is neither|\[time\]", '[time]\ncolumn = ["time", "Uhr"]\n[csv]\ndelimiter = ","\n',
    ),
    "thousands or decimals": (
        table("time [s];a [m]", lambda k: f"{k};1,{200 + k}"), r"\[csv\] decimal", '[csv]\ndecimal = ","\n',
    ),
    "an infinite value": (
        table("time [s],a [m]", lambda k: f"{0.1 * k:.1f},{'inf' if k == 7 else k}"), "leave the cell empty",
        table("time [s],a [m]", lambda k: f"{0.1 * k:.1f},{'' if k == 7 else k}"),
    ),
    "a row that is not as wide": (
        table("time [s],a [m]", lambda k: f"{0.1 * k:.1f}" if k == 7 else f"{0.1 * k:.1f},{k}.5"),
        "complete or remove that line", table("time [s],a [m]", lambda k: "" if k == 7 else f"{0.1 * k:.1f},{k}.5"),
    ),
    "columns of one name": (
        table("time [s],a [m],a [m]", lambda k: f"{0.1 * k:.1f},{k}.5,{k}"), r'\[channels\."a#2"\] name = "a_2"',
        '[channels."a#2"]\nname = "a_2"\n',
    ),
    "nothing listed": (
        table("time [s],a [m]", lambda k: f"{0.1 * k:.1f},{k}.5"), None, 'only_listed = true\n[channels."a"]\n',
    ),
    "no time in OpenFAST text": (
        table("Zeit\ta\n(s)\t(m)", lambda k: f"{0.1 * k:.1f}\t{k}.5"), "give the file the ending of what it is",
        "x.csv",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REMEDIES)
def test_what_a_message_of_a_text_reader_advises_works(tmp_path, what):
    content, words, remedy = REMEDIES[what]
    name = "x.out" if "OpenFAST" in what else "x.csv"
    path = write(tmp_path, content, name)
    if words is not None:
        refused(path, words)
    if remedy.startswith(("[", "only")):
        record = read_record(path, mapping=load_mapping(write(tmp_path, remedy, "m.toml")))
    else:
        record = read_record(write(tmp_path, content if remedy == "x.csv" else remedy, "x.csv"))
    assert record.samples >= 39


def test_a_file_in_two_encodings_is_read_in_the_one_that_its_mapping_names(tmp_path):
    rows = "".join(f"{0.01 * k:.2f},{k}.5,ü\n" for k in range(25_000))
    path = write(tmp_path, ("time [s],a [m],note\n" + rows).encode() + "250.00,1.5,ü\n".encode("latin-1"))
    rules = 'only_listed = true\n[channels."a"]\n'
    given = load_mapping(write(tmp_path, rules, "m.toml"))
    refused(path, r"is not UTF-8 text near line \d+; .*\[csv\] encoding", mapping=given)
    rules += '[csv]\nencoding = "latin-1"\n'
    assert read_record(path, mapping=load_mapping(write(tmp_path, rules, "m.toml"))).samples == 25_001


def test_series_of_several_clocks_are_read_when_those_of_one_are_listed(tmp_path):
    savemat(tmp_path / "x.mat", {"a": np.arange(100.0), "b": np.arange(7.0)})
    rate = "[time]\nrate = 20.0\n"
    refused(tmp_path / "x.mat", r"\[time\] rate")
    refused(tmp_path / "x.mat", "with only_listed = true", mapping=load_mapping(write(tmp_path, rate, "m.toml")))
    rules = 'only_listed = true\n[channels."a"]\n' + rate
    assert read_record(tmp_path / "x.mat", mapping=load_mapping(write(tmp_path, rules, "m.toml"))).samples == 100


def test_a_matrix_whose_time_axis_is_not_clear_is_read_with_a_vector_of_the_time(tmp_path):
    savemat(tmp_path / "x.mat", {"y": np.ones((30, 20))})
    refused(tmp_path / "x.mat", "save the time as a vector next to it")
    savemat(tmp_path / "x.mat", {"y": np.ones((30, 20)), "t": 0.1 * np.arange(30.0)})
    assert len(read_record(tmp_path / "x.mat").channels) == 20


def test_text_in_a_parquet_file_is_left_out_as_the_message_says(tmp_path):
    pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    frame = pd.DataFrame({"time": 0.1 * np.arange(40), "a [m]": np.arange(40.0), "who": ["me"] * 40})
    frame.to_parquet(tmp_path / "x.parquet", index=False)
    refused(tmp_path / "x.parquet", "leave it out or convert it")
    rules = load_mapping(write(tmp_path, 'only_listed = true\n[channels."a"]\n', "m.toml"))
    assert read_record(tmp_path / "x.parquet", mapping=rules).channels == ("a",)
