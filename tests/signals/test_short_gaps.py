"""Short gaps are filled by the conditional mean of a stationary process, without images of regular gaps."""

import numpy as np
import pytest

from windsysid.signals.short_gaps import fill_short_gaps, in_short_gaps

SAMPLES = np.arange(4000)
VIBRATION = np.sin(0.8 * SAMPLES + 0.3) + 0.5 * np.cos(1.9 * SAMPLES)  # up to 0.3 of the sampling rate


def lost(how, seed=0):
    return {
        "random": np.random.default_rng(seed).random(SAMPLES.size) < 0.1,
        "periodic": SAMPLES % 10 == 7,
        "pairs": SAMPLES % 15 < 2,
    }[how] & (SAMPLES > 0) & (SAMPLES[-1] > SAMPLES)  # fmt: skip


@pytest.mark.parametrize("how", ["random", "periodic", "pairs"])
def test_sinusoids_are_continued_where_straight_lines_and_splines_fail(how):
    values = 3.0 + VIBRATION + 1e-3 * np.random.default_rng(1).standard_normal(SAMPLES.size)
    missing = lost(how)
    filled = fill_short_gaps(np.where(missing, np.nan, values), 10)
    assert np.std((filled - values)[missing]) < 0.02
    np.testing.assert_array_equal(filled[~missing], values[~missing])


def test_regular_gaps_leave_no_images():
    values = VIBRATION + 0.05 * np.random.default_rng(2).standard_normal(SAMPLES.size)
    filled = fill_short_gaps(np.where(lost("periodic"), np.nan, values), 10)
    window = np.hanning(SAMPLES.size)
    of_filled, of_whole = (np.abs(np.fft.rfft(window * one)) for one in (filled, values))
    assert np.max(of_filled - of_whole) < 0.01 * np.max(of_whole)


def test_long_gaps_and_ends_stay_missing():
    values = VIBRATION.copy()
    for rows in (slice(0, 3), slice(100, 110), slice(200, 211), slice(-2, None)):
        values[rows] = np.nan
    filled = fill_short_gaps(values, 10)
    assert np.flatnonzero(np.isnan(filled)).tolist() == [0, 1, 2, *range(200, 211), 3998, 3999]
    assert in_short_gaps(np.isnan(values), 10).sum() == 10


@pytest.mark.parametrize("values", [np.full(100, np.nan), np.r_[1.0, np.nan, 1.0], np.where(SAMPLES % 9, 2.0, np.nan)])
def test_what_holds_nothing_to_predict_from_is_left_or_constant(values):
    filled = fill_short_gaps(values, 10)
    known = np.isfinite(values)
    np.testing.assert_array_equal(filled[known], values[known])
    assert np.all(np.isnan(filled[~known]) | (np.abs(filled[~known] - 2.0) < 1e-9))
