"""Scores of parts of a band: their dispersion where the model is true, and where it is not."""

import numpy as np
import pytest

from windsysid.checks.dispersion import PartScores
from windsysid.spectral.modal_bands.model import Modes, row_scores, scores
from windsysid.spectral.modal_bands.model_order import fit_band
from windsysid.spectral.modal_bands.part_scores import part_scores, widening_of
from windsysid.spectral.transforms.dft import Band, transform

from .drawn import BINS, RATE, SAMPLES, vibration


def found_in(values: np.ndarray) -> list[PartScores]:
    """Scores of the parts of a band around 1 Hz."""
    found = fit_band(transform(values, RATE)[1][BINS], BINS, SAMPLES, RATE, 1, 1)
    segments = [[transform(part, RATE) for part in np.array_split(values, count)] for count in (8, 4, 2)]
    return part_scores(found, segments, SAMPLES, RATE)


def test_rows_add_up_to_the_scores_of_the_band(one_mode: Modes, exact_band: Band):
    gradient, fisher = row_scores(one_mode, exact_band)
    whole = scores(one_mode, exact_band)
    np.testing.assert_allclose(gradient.sum(axis=0), whole.gradient, atol=1e-8 * np.sqrt(whole.fisher.max()))
    np.testing.assert_allclose(fisher.sum(axis=0), whole.fisher, rtol=1e-9, atol=1e-9 * whole.fisher.max())


def test_scores_of_stationary_vibration_scatter_as_their_information_says():
    """The mean of r over records is 1; 16 records of 8 groups have a standard error of 0.13."""
    ratios: dict[tuple[str, int], list[float]] = {}
    for seed in range(16):
        for parts in found_in(vibration(seed)):
            for at in (0, 1):  # frequency, damping
                seen = parts.dispersion(np.eye(1, len(parts.pull), at)[0])
                assert seen is not None
                ratios.setdefault((parts.over, at), []).append(seen.ratio)
    assert len(ratios) == 4
    assert [float(np.mean(some)) for some in ratios.values()] == pytest.approx([1.0] * 4, abs=0.39)


def test_a_frequency_that_varies_widens_its_interval_and_names_the_segments():
    """1.0 Hz in one half and 1.02 Hz in the other: the half-width is 0.01 Hz."""
    values = np.concatenate([vibration(1)[: SAMPLES // 2], vibration(2, 1.02)[: SAMPLES // 2]])
    found = widening_of(found_in(values), 0)
    assert found.factor > 2.0
    assert found.over == "time"
    assert "segments of the record contradict each other" in found.cause


def test_a_second_peak_that_the_model_lacks_widens_by_its_place():
    values = vibration(1) + 0.3 * vibration(2, 1.06, 0.004)
    found = widening_of(found_in(values), 1)
    assert found.factor > 1.5
