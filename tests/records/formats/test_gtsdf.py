"""DTU's time series format: blocks, packed integers, names that occur twice, damage."""

import h5py
import numpy as np
import pytest

from tests.records.formats.helpers import refused
from windsysid.records.formats import iterate_record, read_record
from windsysid.records.formats.contents.mapping import Mapping, TimeRule

T = 300
VALUES = np.random.default_rng(3).standard_normal((T, 3)).cumsum(axis=0)
NAMES = [b"Omega", b"Mx coo: tower", b"Mx coo: tower"]
UNITS = [b"rad/s", b"kNm", b"kNm"]
ABOUT = [b"Rotor speed", b"node 1", b"node 2"]


def gtsdf(path, blocks=2, packed=True, type_=b"General time series data format v0", **changes):
    """A file as wetb's gtsdf.save and gtsdf.append_block write it."""
    with h5py.File(path, "w") as file:
        file.attrs["type"], file.attrs["no_blocks"] = type_, changes.get("no_blocks", blocks)
        file.attrs["name"], file.attrs["description"] = b"tower", b"a test"
        for key, texts in (("names", NAMES), ("units", UNITS), ("descriptions", ABOUT)):
            file.create_dataset(f"attribute_{key}", data=np.array(texts))
        for number, rows in enumerate(np.array_split(np.arange(T), blocks)):
            block, part = file.create_group(f"block{number:04d}"), VALUES[rows]
            block.attrs["time_step"], block.attrs["time_start"] = 0.05, 10.0 + 0.05 * rows[0]
            if not packed:
                block.create_dataset("data", data=part)
                continue
            offsets = part.min(axis=0)
            gains = np.ptp(part, axis=0) / (np.iinfo(np.uint16).max - 1)
            block.create_dataset("data", data=np.round((part - offsets) / gains).astype(np.uint16))
            block.create_dataset("gains", data=gains)
            block.create_dataset("offsets", data=offsets)
    return path


@pytest.mark.parametrize("blocks", [1, 3])
@pytest.mark.parametrize("packed", [True, False])
def test_all_blocks_are_read_with_gains_offsets_names_and_units(tmp_path, blocks, packed):
    record = read_record(gtsdf(tmp_path / "x.hdf5", blocks, packed))
    assert record.channels == ("Omega", "Mx coo: tower node 1", "Mx coo: tower node 2")
    assert record.units == ("rad/s", "N*m", "N*m")
    step = np.ptp(VALUES) / 65_534 if packed else 1e-12  # of the integers
    np.testing.assert_allclose(record.values / [1.0, 1e3, 1e3], VALUES, rtol=0.0, atol=step)
    np.testing.assert_allclose(record.time, 10.0 + 0.05 * np.arange(T))
    assert record.attributes["description"] == "a test"
    pieces = list(iterate_record(tmp_path / "x.hdf5", 4.0))
    assert np.concatenate([piece.values for piece in pieces]).tobytes() == record.values.tobytes()
    part = read_record(tmp_path / "x.hdf5", section=(12.0, 13.0))
    np.testing.assert_array_equal(part.values, record.section(12.0, 13.0).values)


def test_the_greatest_integer_is_missing_and_times_may_be_listed(tmp_path):
    path = gtsdf(tmp_path / "x.hdf5", 1)
    with h5py.File(path, "r+") as file:
        file["block0000/data"][7, 1] = np.iinfo(np.uint16).max
        file["block0000"].create_dataset("time", data=2.0 * np.arange(T))
    record = read_record(path)
    assert np.argwhere(np.isnan(record.values)).tolist() == [[7, 1]]
    np.testing.assert_allclose(record.time, 10.0 + 0.1 * np.arange(T))


def test_a_file_without_names_and_steps_needs_its_rate(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.attrs["type"], file.attrs["no_blocks"] = "General time series data format", 1
        file.create_dataset("block0000/data", data=VALUES)
    refused(tmp_path / "x.h5", r"say the rate \[Hz\] there \(\[time\] rate\)")
    record = read_record(tmp_path / "x.h5", mapping=Mapping(time=TimeRule(rate=20.0)))
    assert record.channels == ("column_1", "column_2", "column_3")
    assert record.rate == pytest.approx(20.0)


def test_blocks_that_do_not_fit_are_refused(tmp_path):
    refused(gtsdf(tmp_path / "x.hdf5", no_blocks=3), "has no table block0002/data")
    refused(gtsdf(tmp_path / "y.hdf5", no_blocks=0), "blocks of different width, or none")
    refused(gtsdf(tmp_path / "z.hdf5", no_blocks=10**9), "has no table block0002/data")
    with h5py.File(gtsdf(tmp_path / "w.hdf5"), "r+") as file:
        del file["block0001/gains"]
        file.create_dataset("block0001/gains", data=[1.0])
    refused(tmp_path / "w.hdf5", "has 1 numbers in /block0001/gains, expected 3")
