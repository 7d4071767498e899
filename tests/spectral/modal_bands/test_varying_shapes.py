"""Vibration whose shape varies over a band, and modes."""

import numpy as np

from windsysid.spectral.modal_bands.limits import MAX_LOAD_ODDS
from windsysid.spectral.modal_bands.model import Modes
from windsysid.spectral.modal_bands.model_order import BandFit, fit_band
from windsysid.spectral.modal_bands.varying_shapes import background_log_odds

BINS = np.arange(400, 520)


def between_modes(seed: int) -> np.ndarray:
    """Transforms (k, 3) of a record of 400 s at 10 Hz: response to two loads between two modes, without noise."""
    rng = np.random.default_rng(seed)
    x = BINS[:, None] / BINS.mean() - 1.0
    loads = rng.normal(size=(len(BINS), 6)).view(complex)
    shapes = np.array([[1.0, 0.6, 0.2], [0.1, -0.2, 0.1], [0.0, 0.001, -0.002]])
    return np.asarray(loads @ shapes + x * loads[:, :1] * np.array([-1.0, 0.5, 1.0]))


def log_odds(found: BandFit) -> list[float]:
    return background_log_odds(found.fit, found.band, len(BINS), range(len(found.fit.modes.frequency)))


def test_modes_that_represent_a_varying_shape_are_doubtful():
    fits = [fit_band(between_modes(seed), BINS, 4000, 10.0, 1, 5) for seed in range(2)]
    assert sum(len(found.fit.modes.frequency) for found in fits) >= 2, "the evidence is for modes that are none"
    assert min(odds for found in fits for odds in log_odds(found)) > np.log(MAX_LOAD_ODDS)


def test_a_mode_is_not_a_varying_shape(one_mode: Modes, transforms: tuple[np.ndarray, np.ndarray]):
    bins, values = transforms
    found = fit_band(values, bins, 4000, 10.0, 1, 5)
    assert len(found.fit.modes.frequency) == 1
    assert background_log_odds(found.fit, found.band, len(bins), [0])[0] < -5.0
    assert background_log_odds(found.fit, found.band, len(bins), []) == []


def test_a_mode_among_vibration_of_varying_shape_is_kept():
    rng, values = np.random.default_rng(9), between_modes(9)
    response = 1.0 / (1.0 - (BINS / 455.0) ** 2 + 0.02j * BINS / 455.0)
    load = rng.normal(size=(len(BINS), 2)).view(complex)
    values = values + 0.2 * load * response[:, None] * np.array([0.5, -0.3, 0.8])
    found = fit_band(values, BINS, 4000, 10.0, 1, 5)
    near = int(np.argmin(np.abs(found.fit.modes.frequency - 1.1375)))
    assert abs(found.fit.modes.frequency[near] / 1.1375 - 1.0) < 0.01
    assert background_log_odds(found.fit, found.band, len(BINS), [near])[0] < np.log(MAX_LOAD_ODDS)
