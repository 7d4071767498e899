"""Peaks in a trace of gains."""

import numpy as np
import pytest

from windsysid.spectral.rotor_bands.peak_search import FREQUENCY_STEP, Trace, best_of

FREQUENCY = 0.5 * np.exp(FREQUENCY_STEP * np.arange(400))


def gains(*places: int) -> Trace:
    gain = np.zeros(400)
    gain[list(places)] = 20.0
    return Trace(FREQUENCY, gain)


def test_a_trace_is_interpolated_and_nothing_outside():
    found = gains(200).at(np.array([FREQUENCY[200], 0.1, 9.0]))
    np.testing.assert_allclose(found, [20.0, 0.0, 0.0])


def test_the_peak_nearby_is_found_and_without_one_the_place_itself():
    trace = gains(200)
    assert trace.peak(FREQUENCY[203], 0.012) == pytest.approx(FREQUENCY[200])
    assert trace.peak(FREQUENCY[300], 0.012) == FREQUENCY[300]


def test_a_widened_trace_has_the_greatest_gain_within_reach():
    found = gains(200).widened(3.0 * FREQUENCY_STEP)
    np.testing.assert_array_equal(np.flatnonzero(found.gain), np.arange(197, 204))


def test_the_best_factor_is_the_highest_and_rivals_are_nearly_as_high_and_far_away():
    at, log_frequency = np.linspace(-1.0, 1.0, 201), np.linspace(-0.5, 0.5, 201)
    score = np.zeros(201)
    score[50], score[150], score[52] = 30.0, 29.0, 29.5
    best, rivals = best_of(score, at, log_frequency)
    assert best == pytest.approx(-0.5)
    assert rivals == pytest.approx([np.exp(0.25)])
