"""Lines, dead channels and passing blades beside the modes of a fit."""

import math

import numpy as np
import pytest

from tests.identification.fits import CHANNELS, RATE, SAMPLES, TOWER, noise, outcome_of, record_of
from windsysid.checks.limits import HARMONIC_HALF_WIDTH_BINS
from windsysid.identification.estimate.fitted.modal_residuals import (
    channel_of,
    doubts_beside_modes,
    line_of,
    mode_of,
    ranges_of_narrow_band,
)
from windsysid.identification.estimate.fitted.modes import modes_of
from windsysid.loads.narrow_band import FREQUENCY, WIDTH
from windsysid.loads.statistics import Statistic

RECORD = record_of(noise())


def test_a_degree_of_freedom_has_the_frequency_and_the_damping_of_an_oscillator():
    v = TOWER.values
    omega = math.sqrt(v["k_side_side"] / v["mass_side_side"])
    expected = omega / (2.0 * math.pi), v["c_side_side"] / (2.0 * v["mass_side_side"] * omega)
    assert mode_of(TOWER, "side_side") == pytest.approx(expected)


def test_a_degree_of_freedom_shows_in_the_channel_along_it():
    outcome = outcome_of(RECORD)
    assert channel_of(outcome, RECORD, "side_side") == CHANNELS[0]
    assert channel_of(outcome, RECORD, "fore_aft") in (CHANNELS[1], None)
    gap = RECORD.with_channels({CHANNELS[0]: (np.where(RECORD.time < 1.0, np.nan, RECORD[CHANNELS[0]]), "m/s^2")})
    assert channel_of(outcome, gap, "side_side") is None


def test_a_line_beside_a_mode_stands_out_and_noise_does_not():
    assert (line := line_of(outcome_of(RECORD), RECORD)) is not None
    assert line.ratio < line.bound
    readings = noise()
    readings[:, 1] += np.sin(2.0 * np.pi * 0.43 * np.arange(len(readings)) / RATE)
    record = record_of(readings)
    line = line_of(outcome_of(record), record)
    assert line is not None
    assert line.ratio > line.bound
    assert line.channel == CHANNELS[1]
    assert line.frequency == pytest.approx(0.43, abs=RATE / len(readings))


def test_a_narrow_band_load_is_no_line_within_three_half_widths_of_its_frequency():
    statistics = Statistic(FREQUENCY, "Hz", 0.5, estimate=0.5), Statistic(WIDTH, "1", 0.01, estimate=0.04)
    outcome = outcome_of(RECORD, statistics=statistics)
    away = HARMONIC_HALF_WIDTH_BINS * 0.5 * 0.04
    expected = [(f - away, f + away) for f in (0.3, 0.5, 0.7)]
    np.testing.assert_allclose(ranges_of_narrow_band(outcome, RECORD, 0.2), expected)
    narrow = statistics[0], Statistic(WIDTH, "1", 0.01, estimate=1e-4)
    assert ranges_of_narrow_band(outcome._replace(statistics=narrow), RECORD, 0.2) == []
    assert ranges_of_narrow_band(outcome_of(RECORD), RECORD, 0.2) == []


def test_a_channel_in_which_nothing_vibrates_is_a_reason():
    rng, vibration = np.random.default_rng(3), [0.0, 0.0]
    for push in rng.standard_normal(4 * SAMPLES):  # an oscillator of 0.32 Hz
        vibration.append(2.0 * 0.995 * math.cos(0.5) * vibration[-1] - 0.995**2 * vibration[-2] + push)
    record = record_of(np.column_stack([vibration, 1e-3 * rng.standard_normal(len(vibration))]))
    outcome = outcome_of(record)
    modes = modes_of(outcome).modes
    (found,) = doubts_beside_modes(outcome, record, modes, TOWER.rotor_speed, filtered=True)
    assert (found.code, found.data["channels"]) == ("dead_channel", [CHANNELS[1]])
