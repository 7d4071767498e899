"""Records with the same motion, by their correlation."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.spectral.oma.assemble import RecordAnalysis
from windsysid.spectral.oma.condition import prepare_readings, transforms
from windsysid.spectral.oma.duplicate_records import find_duplicates
from windsysid.spectral.oma.search import RecordSpectrum, SearchedBands

MOTION = np.random.default_rng(4).normal(size=(5000, 2))


def analysis(values: np.ndarray, name: str) -> RecordAnalysis:
    names = ("floor_1_acceleration", "floor_2_acceleration")
    record = ws.Record(np.arange(len(values)) / 10.0, values, names, ("m/s^2",) * 2, name=name)
    readings = prepare_readings(record, None)
    return RecordAnalysis(record, readings, SearchedBands(RecordSpectrum(readings, *transforms(readings)), (), ()), ())


@pytest.mark.parametrize(("shift", "found"), [(0, 1), (500, 1), (2000, 0)])
def test_overlapping_windows_are_found_and_following_ones_are_not(shift: int, found: int):
    gain = 1.0 if shift else -2.0
    other = gain * MOTION[shift : shift + 2000] + 1e-3 * MOTION[-2000:]
    pair = [analysis(MOTION[:2000], "one"), analysis(other, "other")]
    doubts = ["one and other contain the same motion, which counts twice"]
    assert find_duplicates(pair) == doubts * found


def test_records_of_other_rates_or_channels_are_not_compared():
    one = analysis(MOTION[:2000], "one")
    other = one._replace(readings=one.readings._replace(rate=20.0, fixed=one.readings.fixed + 1e-9))
    renamed = one._replace(readings=other.readings._replace(rate=10.0, names=("a", "b")))
    assert find_duplicates([one, other]) == find_duplicates([one, renamed]) == []
