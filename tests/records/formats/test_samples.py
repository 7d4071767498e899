"""Every format, written by somebody else's library, is read bit for bit; cut files are refused, damaged ones never
end in a traceback."""

import numpy as np
import pytest
from validation.format_samples import SAMPLES, files_of, truth
from validation.formats import damaged

from tests.records.formats.test_fuzz import outcome
from windsysid.records.formats import iterate_record, read_record
from windsysid.records.moments import moment
from windsysid.units import si_unit, to_si

SERIES = [name for name in SAMPLES if name not in ("CSV", "Parquet", "netCDF-4", "OpenFAST .outb")]
"""The formats whose readers have no tests of damage of their own."""


def written(name, folder):
    sample = SAMPLES[name]
    if sample.package:
        pytest.importorskip(sample.package, reason=f"{sample.package} is not installed")
    path = folder / f"x{sample.ending}"
    sample.write(path, *truth(sample))
    return path, sample


@pytest.mark.parametrize("name", SAMPLES)
def test_a_format_is_read_as_it_was_written(tmp_path, name):
    path, sample = written(name, tmp_path)
    time, values = truth(sample)
    record = read_record(path, mapping=sample.mapping)
    assert record.channels == sample.names
    assert record.units == tuple(map(si_unit, sample.units))
    expected = np.column_stack([values[:, i] * to_si(1.0, unit) for i, unit in enumerate(sample.units)])
    if sample.scaled:
        np.testing.assert_allclose(record.values, expected, rtol=1e-12)
    else:
        assert record.values.tobytes() == expected.tobytes()
    np.testing.assert_allclose(record.time, time + sample.begin, rtol=0.0, atol=1e-12)
    assert (record.start and moment(record.start)) == (sample.start and moment(sample.start))


@pytest.mark.parametrize("name", SERIES)
def test_sections_and_pieces_are_the_whole_record(tmp_path, name):
    path, sample = written(name, tmp_path)
    record = read_record(path, mapping=sample.mapping)
    pieces = list(iterate_record(path, 1.0, mapping=sample.mapping))
    assert len(pieces) == 8
    np.testing.assert_array_equal(np.concatenate([piece.values for piece in pieces]), record.values)
    part = read_record(path, mapping=sample.mapping, section=(2.0, 3.0))
    np.testing.assert_array_equal(part.values, record.section(2.0, 3.0).values)
    np.testing.assert_array_equal(part.time, record.section(2.0, 3.0).time)


@pytest.mark.parametrize("name", SERIES)
def test_a_file_that_was_cut_is_refused(tmp_path, name):
    path, sample = written(name, tmp_path)
    target = files_of(sample, path)[0]
    whole, record = target.read_bytes(), read_record(path, mapping=sample.mapping)
    cuts = [1, 2, 3, 100, len(whole) // 2, len(whole) - 30, *np.random.default_rng(1).integers(1, len(whole) - 1, 10)]
    for cut in cuts:
        if whole[:-cut].endswith(b"    -1\n"):
            continue  # a universal file that ends between two sets is whole
        target.write_bytes(whole[:-cut])
        left = outcome(path, sample.mapping)
        if left is not None:  # only a line end or what fills the last block is gone
            assert (left.time.tobytes(), left.values.tobytes()) == (record.time.tobytes(), record.values.tobytes())
            assert cut < 16


@pytest.mark.parametrize("name", [name for name in SERIES if name not in ("HDF5", "MATLAB 7.3")])
def test_a_damaged_file_is_one_line_or_a_record_of_as_many_samples(tmp_path, name):
    # damaged HDF5 can make its library hang; validation/formats.py reads it in a process of its own
    path, sample = written(name, tmp_path)
    rng = np.random.default_rng(3)
    for k in range(40):
        target = files_of(sample, path)[k % max(1, len(sample.files))]
        whole = target.read_bytes()
        target.write_bytes(damaged(whole, rng))
        record = outcome(path, sample.mapping)
        target.write_bytes(whole)
        assert record is None or record.samples == truth(sample)[0].size
