"""Operational modal analysis of bands that rotor harmonics of a varying speed cover."""

import numpy as np
import pytest

import windsysid as ws

from .oscillators import modal_responses
from .test_oma import RATE, turning


def wandering_rotor(seed, swing, peak=3.735, duration=600.0):
    """Two tower channels under a rotor whose speed varies by `swing`, with sharp peaks that wide harmonics cover."""
    rng = np.random.default_rng(seed)
    samples = int(duration * RATE)
    slow = np.convolve(rng.standard_normal(samples + 2000), np.hanning(600), "valid")[:samples]
    speed = 9.34 * np.pi / 30.0 * (1.0 + swing * slow / slow.std())
    psi = np.cumsum(speed) / RATE
    q, _ = modal_responses([0.49, peak - 1.3, peak - 0.7, peak], [0.01, 5e-4, 5e-4, 5e-4], RATE, samples, rng)
    q /= q.std(axis=0)
    x = q @ [0.05, 0.004, 0.004, 0.004] + 0.02 * np.cos(3.0 * psi)
    y = np.column_stack([x, 0.1 * rng.standard_normal(samples) + 0.5 * x]) + 0.005 * rng.standard_normal((samples, 2))
    return {
        "tower_x_acceleration": y[:, 0], "tower_z_acceleration": y[:, 1], "rotor_speed": speed,
        "rotor_azimuth": np.mod(psi, 2.0 * np.pi),
    }  # fmt: skip


def around_3p(columns):
    """A band that lies whole under the third harmonic [Hz]."""
    once = columns["rotor_speed"].mean() / (2.0 * np.pi)
    return (3.0 * once - 0.025, 3.0 * once + 0.025)


@pytest.mark.parametrize("without", ["", "rotor_azimuth"])
def test_a_band_under_a_harmonic_of_a_varying_speed_is_left_out_with_a_note(without):
    columns = wandering_rotor(5, 0.11)
    band = around_3p(columns)
    columns.pop(without, None)
    found = ws.oma(turning(columns), bands=[band, (1.6, 1.75)])
    assert not found.trusted
    assert band in found.empty
    assert [note for note in found.notes if "was left out: rotor harmonics" in note]


def test_narrow_peaks_between_wide_harmonics_end_in_no_error():
    found = ws.oma(turning(wandering_rotor(5, 0.11)))
    assert not any(mode.trusted for mode in found.modes)


def test_a_band_that_a_harmonic_covers_in_one_of_two_records_is_left_out_of_both():
    both = [wandering_rotor(seed, swing) for seed, swing in ((5, 0.001), (6, 0.11))]
    found = ws.oma([turning(columns) for columns in both], bands=[around_3p(both[1])])
    assert not any(mode.trusted for mode in found.modes)
    assert [note for note in found.notes if "was left out: rotor harmonics" in note]
