"""What is particular to NI TDMS, universal files, MDF 4, LabVIEW and Dewesoft."""

import locale
import struct
import sys
import types
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.records.formats.helpers import refused, write
from windsysid.errors import ConfigurationError
from windsysid.inspection import inspect_record
from windsysid.records.formats import iterate_record, read_record
from windsysid.records.formats.contents.mapping import ChannelRule, Mapping, TimeRule

T = 200
VALUES = np.random.default_rng(8).standard_normal((T, 3))


def listed(**rules):
    return Mapping(channels={name: ChannelRule(unit=unit) for name, unit in rules.items()}, only_listed=True)


# NI TDMS


def tdms(path, *channels):
    nptdms = pytest.importorskip("nptdms", reason="nptdms is not installed")
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject(*channel) for channel in channels])
    return path


WAVE = {"wf_increment": 0.01, "unit_string": "g"}


def test_a_slower_channel_stands_in_the_rows_that_it_was_sampled_at(tmp_path):
    slow = {"wf_increment": 0.1, "unit_string": "rpm"}
    path = tdms(tmp_path / "x.tdms", ("g", "a", VALUES[:, 0], WAVE), ("g", "speed", VALUES[:20, 1], slow))
    record = read_record(path)
    assert record["a"].tobytes() == (VALUES[:, 0] * 9.80665).tobytes()
    speed = record["speed"]
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(speed)), np.arange(0, 200, 10))
    assert speed[::10].tobytes() == (VALUES[:20, 1] * (2.0 * np.pi / 60.0)).tobytes()
    pieces = list(iterate_record(path, 0.25))
    np.testing.assert_array_equal(np.concatenate([piece.values for piece in pieces]), record.values)
    part = read_record(path, section=(0.55, 0.65))
    np.testing.assert_array_equal(part.values, record.section(0.55, 0.65).values)
    assert read_record(path, mapping=listed(speed=None)).rate == pytest.approx(10.0, rel=1e-12)


@pytest.mark.parametrize(
    ("count", "wave"),
    [
        (20, {"wf_increment": 0.1001}),  # not at the times of the faster one
        (18, {"wf_increment": 0.1}),  # cut
        (20, {"wf_increment": 0.1, "wf_start_offset": 0.004}),  # between them
        (180, {"wf_increment": 0.01}),  # of the same rate, cut
        (200, {"wf_increment": 0.02}),  # twice as long
        (20, {"wf_increment": 0.1, "wf_start_time": np.datetime64("2021-07-07T12:00:00")}),  # who knows when
    ],
)
def test_channels_that_do_not_fit_each_other_are_refused_and_never_cut(tmp_path, count, wave):
    other = {"unit_string": "rpm", **wave}
    path = tdms(tmp_path / "x.tdms", ("g", "a", VALUES[:, 0], WAVE), ("g", "speed", VALUES[:count, 1], other))
    refused(path, r"'a' \(200 samples at 100 Hz\) and 'speed' \(.*\) are not sampled together")


def test_a_tdms_index_file_that_is_older_than_the_data_changes_nothing(tmp_path):
    path = tdms(tmp_path / "x.tdms", ("g", "a", VALUES[:50, 0], WAVE))
    (tmp_path / "x.tdms_index").write_bytes(b"TDSh" + path.read_bytes()[4:200])
    tdms(path, ("g", "a", VALUES[:, 0], WAVE))
    assert read_record(path).samples == T


def test_tdms_without_waveforms_takes_a_channel_of_moments_or_asks_for_the_rate(tmp_path):
    moments = np.datetime64("2021-07-07T12:00:00") + 10_000 * np.arange(T).astype("timedelta64[us]")
    path = tdms(tmp_path / "x.tdms", ("g", "Time", moments), ("g", "a", VALUES[:, 0], {"unit_string": "g"}))
    record = read_record(path)
    np.testing.assert_allclose(record.time, 0.01 * np.arange(T), atol=1e-9)
    assert record.start == "2021-07-07T12:00:00Z"
    path = tdms(tmp_path / "y.tdms", ("g", "a", VALUES[:, 0], {"unit_string": "g"}))
    refused(path, r"no series is known to be the time.*\[time\] rate")
    assert read_record(path, mapping=Mapping(time=TimeRule(rate=25.0))).rate == pytest.approx(25.0)


def test_the_rate_that_labview_gives_where_none_was_set_is_a_warning(tmp_path):
    unset, fast = {**WAVE, "wf_increment": 1.0}, ("g", "b", VALUES[:, 1], WAVE)
    found = inspect_record(tdms(tmp_path / "x.tdms", ("g", "a", VALUES[:, 0], unset)))
    assert [one.severity for one in found.findings if "LabVIEW's default" in one.text] == ["warning"]
    other = tdms(tmp_path / "y.tdms", fast, ("g", "scada", VALUES[:2, 0], unset))
    assert "LabVIEW's default" not in str(inspect_record(other))


def test_the_rate_of_a_file_that_says_its_times_is_not_given_again(tmp_path):
    path = tdms(tmp_path / "x.tdms", ("g", "a", VALUES[:, 0], WAVE))
    with pytest.raises(ConfigurationError, match="the file itself says its times"):
        read_record(path, mapping=Mapping(time=TimeRule(rate=50.0)))


def test_tdms_channels_of_one_name_are_called_after_their_groups(tmp_path):
    path = tdms(tmp_path / "x.tdms", ("top", "a", VALUES[:, 0], WAVE), ("base", "a", VALUES[:, 1], WAVE))
    assert set(read_record(path).channels) == {"top_a", "base_a"}
    rules = Mapping(channels={"base/a": ChannelRule(name="low", sign=-1)}, only_listed=True)
    record = read_record(path, mapping=rules)
    assert record["low"].tobytes() == (VALUES[:, 1] * -9.80665).tobytes()


def test_tdms_channels_that_need_other_bytes_than_the_segments_hold_are_refused(tmp_path):
    path = tdms(tmp_path / "x.tdms", ("g", "a", VALUES[:, 0], WAVE), ("g", "b", VALUES[:, 1], WAVE))
    count = struct.pack("<IIQ", 10, 1, T)  # float64, one dimension, so many values
    whole = path.read_bytes()
    assert whole.count(count) == 2
    for other in (T - 1, T + 1, 1 << 40):  # with the first channel one shorter, the second would begin one earlier
        path.write_bytes(whole.replace(count, struct.pack("<IIQ", 10, 1, other), 1))
        refused(path, "is damaged")


# universal files


def uff(path, *sets, mode="add"):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed")
    for one in sets:
        usual = {
            "func_type": 1, "rsp_node": 1, "rsp_dir": 1, "ref_node": 1, "ref_dir": 1, "x": np.arange(T) / 51.2,
            "abscissa_spacing": 1, "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 12, "binary": 1,
            "orddenom_spec_data_type": 0, "ordinate_axis_units_lab": "m/s^2", "rsp_ent_name": "tower",
        }  # fmt: skip
        pyuff.UFF(str(path))._write_set(pyuff.prepare_58(**{**usual, **one}), mode)
    return path


def test_universal_files_name_points_and_directions_where_titles_do_not(tmp_path):
    ends = [{"rsp_node": 12, "rsp_dir": -3, "data": VALUES[:, 0]}, {"rsp_node": 4, "data": VALUES[:, 1]}]
    record = read_record(uff(tmp_path / "x.uff", *ends))
    assert record.channels == ("tower_12_minus_z", "tower_4_x")
    assert record.time.tobytes() == ((1.0 / 51.2) * np.arange(T)).tobytes()  # the file says 1.95312E-02 s


def test_spectra_in_a_universal_file_are_left_out_and_said(tmp_path):
    spectrum = {"func_type": 4, "abscissa_spec_data_type": 18, "data": VALUES[:, 0] + 1j, "id1": "frf"}
    path = uff(tmp_path / "x.uff", {"data": VALUES[:, 1], "id1": "top"}, spectrum)
    record = read_record(path)
    assert record.channels == ("top",)
    assert record.attributes["left_out"] == "data sets 58b"
    refused(uff(tmp_path / "y.uff", spectrum), "holds no function over time")


def test_a_data_set_that_holds_other_numbers_than_it_says_is_refused(tmp_path):
    for binary in (0, 1):
        path = uff(tmp_path / f"{binary}.uff", {"data": VALUES[:, 0], "id1": "top", "binary": binary})
        whole = path.read_bytes()
        assert whole.count(b"       200         1") == 1
        path.write_bytes(whole.replace(b"       200         1", b"       199         1"))
        refused(path, "declares 199 samples, expected 199 numbers, got 200")


def test_a_universal_file_of_seven_bytes_is_refused(tmp_path):
    path = uff(tmp_path / "x.uff", {"data": VALUES[:, 1], "id1": "top"}, mode="overwrite")
    if path.stat().st_size < 100:  # what pyuff leaves of a binary set in its mode overwrite
        refused(path, "no universal file|cut off|no function over time")
    refused(write(tmp_path, b"    -1\n", "y.uff"), "cut off|no function over time")


# MDF


def test_mdf_groups_have_clocks_of_their_own(tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="asammdf is not installed")
    path, time = tmp_path / "x.mf4", np.cumsum(0.01 + 0.001 * np.abs(VALUES[:, 2]))
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(VALUES[:, 0], time, unit="g", name="a")])
        invalid = np.arange(T) == 3
        file.append([asammdf.Signal(VALUES[:, 1], time + 1.0, unit="kN", name="b", invalidation_bits=invalid)])
        file.save(path, overwrite=True)
    refused(path, "'a' .200 samples of 'group 0'. and 'b' .200 samples of 'group 1'. are not sampled together")
    record = read_record(path, mapping=listed(b=None))
    assert record.time.tobytes() == (time + 1.0).tobytes()
    np.testing.assert_array_equal(record["b"], np.where(np.arange(T) == 3, np.nan, VALUES[:, 1] * 1e3))


def test_an_mdf_that_its_logger_did_not_close_or_of_version_3_is_refused(tmp_path):
    refused(write(tmp_path, b"UnFinMF 4.10    " + bytes(200), "x.mf4"), "was not closed by its logger")
    refused(write(tmp_path, b"MDF     3.30    " + bytes(200), "x.mf4"), r"is MDF 3\.30, expected version 4")
    refused(write(tmp_path, b"hello" * 50, "x.mf4"), "is not MDF")


@pytest.mark.parametrize(("at", "value"), [(4, 1 << 17), (4, 9), (8, 128), (16, 64)])  # place, bits, place of validity
def test_an_mdf_channel_outside_its_rows_is_refused(tmp_path, at, value):
    """The library reads what stands in memory there, or the interpreter dies."""
    asammdf = pytest.importorskip("asammdf", reason="asammdf is not installed")
    path = tmp_path / "x.mf4"
    with asammdf.MDF(version="4.10") as file:
        marked = asammdf.Signal(
            VALUES[:, 0], 0.01 * np.arange(T), unit="g", name="a", invalidation_bits=np.arange(T) == 3
        )
        file.append([marked])
        file.save(path, overwrite=True)
    assert read_record(path).samples == T
    content = bytearray(path.read_bytes())
    places = [k for k in range(len(content)) if content[k : k + 4] == b"##CN"]
    facts = [k + 24 + 8 * struct.unpack_from("<Q", content, k + 16)[0] for k in places]
    (value_channel,) = [k for k in facts if content[k] == 0]
    struct.pack_into("<I", content, value_channel + at, value)
    refused(write(tmp_path, bytes(content), "y.mf4"), "is damaged: channel 'a' lies outside its rows")


# LabVIEW

HEAD = (
    "LabVIEW Measurement\t\nSeparator\t{s}\nDecimal_Separator\t{d}\nX_Columns\t{x}\nDate\t2021/07/07\n"
    "***End_of_Header***\t\n\n"
)
SEGMENT = (
    "Channels{t}2{t}\nSamples{t}3{t}3{t}\nDate{t}2021/07/07{t}2021/07/07\n"
    "Time{t}12:00:{k:02d}{d}5{t}12:00:{k:02d}{d}5\nY_Unit_Label{t}g{t}kN\nX0{t}0{d}0{t}0{d}0\nDelta_X{t}0{d}25{t}0{d}25\n"
    "***End_of_Header***{t}\nX_Value{t}a{t}b{t}Comment\n"
)


def test_labview_without_times_has_a_grid_and_decimal_commas(tmp_path):
    text = HEAD.format(s="Tab", d=",", x="No") + SEGMENT.format(t="\t", d=",", k=1)
    text += "\t1,5\t2,0\tstart\n\t2,5\t3,0\n\t\t4,0\n"
    record = read_record(write(tmp_path, text.replace("\n", "\r\n"), "x.lvm"))
    np.testing.assert_array_equal(record.time, [0.0, 0.25, 0.5])
    np.testing.assert_array_equal(record["a"] / 9.80665, [1.5, 2.5, np.nan])
    np.testing.assert_array_equal(record["b"], [2e3, 3e3, 4e3])
    assert record.start == "2021-07-07T12:00:01.5"


def test_labview_segments_that_begin_anew_are_set_apart_by_their_moments(tmp_path):
    text = HEAD.format(s="Comma", d=".", x="One")
    for k in (1, 9):
        text += SEGMENT.format(t=",", d=".", k=k) + "0.0,1,2\n0.25,1,2\n0.5,1,2\n\n"
    record = read_record(write(tmp_path, text, "x.lvm"))
    np.testing.assert_array_equal(record.time, [0.0, 0.25, 0.5, 8.0, 8.25, 8.5])


def test_labview_segments_that_lost_rows_are_refused(tmp_path):
    text = HEAD.format(s="Tab", d=".", x="One") + SEGMENT.format(t="\t", d=".", k=1) + "0.0\t1\t2\n0.25\t1\t2\n"
    refused(write(tmp_path, text, "x.lvm"), "a segment says 3 samples and has 2")
    refused(write(tmp_path, text + "0.5\t1", "x.lvm"), "cut off|2 cells")
    refused(write(tmp_path, text + "0.5\tabc\t2\n", "x.lvm"), "column 'a', line 19: 'abc' is not a number")


# Dewesoft


class Channel:
    array_size, unit, number_of_samples = 1, "g", T

    def __init__(self, k, rate):
        self.k, self.sample_rate = k, rate

    def scaled(self, T1=None, count=None):
        first = 0 if T1 is None else int(T1 * self.sample_rate)
        count = T if count is None else count
        time = (np.arange(T) / (self.sample_rate or 7.0))[first : first + count]
        return time, VALUES[first : first + count, self.k]


class File(dict[str, Any]):
    info = types.SimpleNamespace(start_store_time=datetime(2021, 7, 7, 12, tzinfo=UTC))

    def __init__(self, path):
        if b"hello" in Path(path).read_bytes():
            raise RuntimeError("4")
        super().__init__(acc_1=Channel(0, 100.0), acc_2=Channel(1, 100.0), gps=Channel(2, 0.0))


def test_dewesoft_channels_of_one_rate_are_a_record(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "dwdatareader", types.SimpleNamespace(DWFile=File))
    path = write(tmp_path, b"recording", "x.dxd")
    refused(path, "'acc_1' .200 samples of '100 Hz'. and 'gps' .200 samples of 'gps'. are not sampled together")
    rules = listed(acc_1=None, acc_2=None)
    record = read_record(path, mapping=rules)
    assert record.time.tobytes() == (np.arange(T) / 100.0).tobytes()
    assert record["acc_2"].tobytes() == (VALUES[:, 1] * 9.80665).tobytes()
    assert record.start == "2021-07-07T12:00:00Z"
    part = read_record(path, mapping=rules, section=(0.5, 1.0))
    np.testing.assert_array_equal(part.values, record.section(0.5, 1.0).values)


def test_a_file_that_dewesofts_library_does_not_read_is_refused_in_one_line(tmp_path):
    pytest.importorskip("dwdatareader", reason="dwdatareader is not installed")
    refused(write(tmp_path, b"hello" * 100, "x.dxd"), "cannot be read by Dewesoft's library")


def test_dewesofts_library_leaves_the_language_of_the_program_alone(tmp_path):
    pytest.importorskip("dwdatareader")
    before = locale.setlocale(locale.LC_ALL)
    refused(write(tmp_path, b"hello" * 100, "x.dxd"), "cannot be read by Dewesoft's library")
    assert locale.setlocale(locale.LC_ALL) == before
