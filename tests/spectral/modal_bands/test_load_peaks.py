"""Peaks of loads among modes: seas, and two peaks of one shape."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.stats import beta

from windsysid.spectral.modal_bands.load_peaks import shape_ratio, with_comb_odds, with_harmonic_odds, with_load_odds
from windsysid.spectral.oma.mode import Doubt, OperationalMode

from ..oma.modes import mode

FIRST, SECOND = (0.3, 0.6, 1.0), (1.0, 0.6, -0.6)


def loads_among(*modes: OperationalMode) -> list[bool]:
    return [one.doubted_for("load") for one in with_load_odds(modes)]


def test_a_sea_below_a_mode_is_named_and_the_mode_is_not():
    assert loads_among(mode(0.12, 0.08, FIRST), mode(0.4, 0.01, FIRST), mode(1.1, 0.01, SECOND)) == [True, False, False]
    told = with_load_odds([mode(0.12, 0.08, FIRST), mode(0.13, 0.01, FIRST)])[0]
    assert (told.frequency.grade, told.damping_ratio.grade) == ("C", "C")
    assert "load or mode" in told.doubts[0]
    assert "0.13 Hz (MAC 1.000)" in told.doubts[0]


def test_two_close_peaks_of_one_shape_are_not_two_modes():
    assert loads_among(mode(1.78, 0.005, FIRST), mode(1.82, 0.005, FIRST)) == [True, True]
    assert loads_among(mode(1.78, 0.005, FIRST), mode(1.82, 0.005, SECOND)) == [False, False]


def test_bending_modes_that_look_alike_to_few_sensors_are_modes():
    assert loads_among(mode(0.3, 0.01, (1.0, 0.02)), mode(2.1, 0.01, (1.0, 0.01))) == [False, False]
    assert loads_among(mode(0.3, 0.01, FIRST), mode(2.1, 0.01, FIRST)) == [False, False]


def test_a_peak_between_modes_with_a_combination_of_their_shapes_is_a_load():
    """A force on one storey of a frame drives the modes below and above its frequency."""
    shapes = eigh(2.0 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1) - np.diag([0.0, 0.0, 0.0, 0.0, 1.0]))[1].T
    modes = [mode(f, 0.01, tuple(shape)) for f, shape in zip((1.0, 2.9, 4.6, 5.9, 6.7), shapes, strict=True)]
    forced = mode(1.7, 0.005, tuple(shapes[0] + 0.7 * shapes[1] + 0.05 * shapes[2]))
    assert loads_among(modes[0], forced, *modes[1:]) == [False, True, False, False, False, False]
    assert loads_among(*(modes[0], mode(1.7, 0.005, tuple(shapes[3])), *modes[1:3])) == [False] * 4


def test_a_steady_envelope_is_a_load_and_a_random_one_frees_a_narrow_mode():
    narrow = mode(0.9, 0.002, (1.0, 0.1))
    assert loads_among(narrow) == [True]
    assert loads_among(replace(narrow, steadiness=0.02)) == [False]
    assert loads_among(replace(narrow, damping_ratio=mode(damping=0.01).damping_ratio, steadiness=100.0)) == [True]
    assert loads_among(replace(mode(0.12, 0.08), steadiness=0.001)) == [True]  # waves are random, too


def test_weak_evidence_of_a_machine_is_enough():
    """A machine whose amplitude varies by 40 % had grade A in 8 of 24 records of a tower with two channels."""
    peak = mode(0.9, 0.007, (1.0, 0.1))
    assert loads_among(replace(peak, steadiness=3.0)) == [True]
    assert loads_among(replace(peak, steadiness=1.0)) == [False]


def test_a_damped_tower_above_the_waves_is_a_mode():
    assert loads_among(mode(0.33, 0.08, (1.0, 0.1)), mode(0.32, 0.007, (0.1, 1.0))) == [False, False]


def test_modes_that_are_doubtful_themselves_are_no_evidence():
    skirt = mode(1.82, 0.005, FIRST, (Doubt("border", ""),))
    assert loads_among(mode(1.78, 0.01, FIRST), skirt)[0] is False


def test_shapes_of_two_modes_are_random_directions():
    """The density of the squared cosine of random directions, by SciPy's beta distribution."""
    one, two = mode(1.0, shape=(1.0, 0.5, 0.3, 0.8)), mode(1.1, shape=(0.8, -0.5, 0.3, 1.0))
    sharp = [replace(each, shape_std=np.zeros(4)) for each in (one, two)]
    ratio, mac = shape_ratio(sharp[0], sharp[1:], 0.5)
    off, scales = 1.0 - mac, np.array([0.005, 0.05])
    of_load = float(np.mean(np.exp(-off / scales) / scales))
    assert ratio == pytest.approx(of_load / (0.99 * beta(0.5, 1.5).pdf(mac) + 0.01 * of_load))


def harmonics_among(*modes: OperationalMode, turning: float = 0.5) -> list[bool]:
    return [one.doubted_for("load") for one in with_comb_odds(modes, turning)]


def test_a_comb_of_wide_peaks_is_a_rotor_and_modes_between_them_are_not():
    """OpenFAST at 16 m/s without a speed channel: 0.758 Hz = 6P and 1.12 Hz = 9P were modes of grade A and B."""
    comb = [mode(0.38, 0.07), mode(0.757, 0.042), mode(1.12, 0.043)]
    modes = [mode(0.165, 0.009), mode(0.62, 0.009), mode(0.862, 0.015)]
    assert harmonics_among(*comb, *modes) == [True, True, True, False, False, False]
    told = with_comb_odds(comb, 0.5)[1].doubts[0]
    assert "2 times 0.38 Hz" in told


def test_narrow_harmonics_of_a_turbine_whose_speed_varies_are_a_comb():
    """Björkö's electrical power had 1P and 2P as modes of grade A, 0.8 and 1.5 % wide."""
    assert harmonics_among(mode(1.124, 0.0079), mode(2.246, 0.0148)) == [True] * 2
    assert harmonics_among(*(mode(0.8 * k, 0.004) for k in (1, 2, 3))) == [True] * 3


def test_modes_at_multiples_are_modes_where_nothing_names_a_turbine():
    """As those of a cable."""
    assert harmonics_among(mode(1.124, 0.0079), mode(2.246, 0.0148), turning=0.01) == [False] * 2
    assert harmonics_among(*(mode(0.8 * k, 0.004) for k in (1, 2, 3, 4)), turning=0.01) == [False] * 4
    assert harmonics_among(mode(0.4, 0.03), mode(1.03, 0.03)) == [False] * 2
    assert harmonics_among() == []


def test_a_peak_near_a_multiple_of_the_known_speed_is_a_harmonic_if_the_speed_varies_as_much():
    peaks = [mode(1.10, 0.006), mode(1.40, 0.01), mode(2.31, 0.012)]
    named = with_harmonic_odds(peaks, 1.135, 0.018)
    assert [one.doubted_for("load") for one in named] == [True, False, True]
    assert "near 2P, 2.27 ± 0.041 Hz" in named[2].doubts[0]
    assert not any(one.doubted_for("load") for one in with_harmonic_odds(peaks, 1.135, 0.001))
