"""Bands of a machine whose matrices do not turn."""

import numpy as np
import pytest

from windsysid.errors import ConfigurationError, RecordError
from windsysid.spectral.rotor.build_parked import _bands, _given_amplitude, _grouped, _in_bands, pose_standing
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.statespace.gauss_markov import GaussMarkov


def test_every_mode_has_a_band_around_it(question: RotorQuestion, posed: Posed):
    for name in question.turbine.model.coordinates:
        assert any(low < question.frequency(name) < high for low, high in posed.bands)


def test_bins_are_those_of_the_bands(posed: Posed):
    f = posed.model.base
    assert all(any(low <= one <= high for low, high in posed.bands) for one in f)
    assert len(posed.model.data) == len(posed.model.counts)


def test_bands_that_meet_are_one(question: RotorQuestion):
    lifted = question.lifted(0)
    assert len(_bands([0.3, 0.35], lifted)) == 1
    assert len(_bands([0.3, 1.5], lifted)) == 2
    with pytest.raises(RecordError, match="sample faster"):
        _bands([20.0], lifted)


def test_neighbouring_bins_are_grouped_and_the_rest_left_out():
    np.testing.assert_array_equal(_grouped(np.arange(7), 3), [[0, 1, 2], [3, 4, 5]])


def test_ends_belong_to_a_band():
    found = _in_bands(np.array([0.1, 0.2, 0.3, 0.4]), [(0.2, 0.3), (0.35, 0.36)])
    np.testing.assert_array_equal(found, [False, True, True, False])


def test_the_amplitude_of_the_files_load_is_that_of_its_spectrum():
    load = GaussMarkov("load_x", 3.0, 0.5)
    expected = np.sqrt(4.0 * 0.5 * 9.0 * 0.5 / (1.0 + (2.0 * np.pi * 0.3 * 0.5) ** 2))
    assert _given_amplitude([load], "load_x", 0.3) == pytest.approx(expected)
    with pytest.raises(ConfigurationError, match="expected its rms"):
        _given_amplitude([load], "load_y", 0.3)


def test_a_record_of_few_bins_is_refused(question: RotorQuestion):
    short = question._replace(readings=question.readings[:250], inputs=question.inputs[:250])
    with pytest.raises(RecordError, match="longer record"):
        pose_standing(short, ())
    with pytest.raises(RecordError, match="longer record"):  # half of a record, in bands of the whole
        pose_standing(question, ((1e-4, 2e-4),))
