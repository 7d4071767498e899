"""Whether equations explain cross-spectra, on a record of white noise whose spectrum is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from windsysid.results.finding import Finding
from windsysid.spectral.lti.check import doubts_of, frequency_ranges
from windsysid.spectral.lti.limits import MIN_RESONANCE_FREEDOM
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.cross_spectra import pool, transform_block

RATE, LIMITS = 10.0, (0.2, 4.0)
RANGES = frequency_ranges(LIMITS)


def judged(
    readings: np.ndarray, density: float = 2.0 / RATE, decay: float = 1.0, settled: bool = True
) -> list[Finding]:
    """Doubts about blocks of 200 s under a white spectrum and a pole of a decay [1/s]."""
    blocks = [transform_block(part, RATE, LIMITS, RANGES) for part in np.split(readings, 4)]
    sums = BlockSums.of(blocks[0])
    for block in blocks[1:]:
        sums = sums.plus(block)
    rows = pool(sums, np.full(len(blocks[0].data), 8.0))
    model: Any = SimpleNamespace(
        spectrum=lambda f, _: density * np.broadcast_to(np.eye(1, dtype=np.complex128), (len(f), 1, 1)),
        poles=lambda _: np.array([-decay + 6.0j, -decay - 6.0j]),
    )
    fit: Any = SimpleNamespace(settled=settled, rows=rows, smear=0.0, unknowns=np.zeros(0))
    return doubts_of(model, sums, fit, ("a",), sums.energies)


@pytest.fixture(scope="module")
def noise() -> np.ndarray:
    return np.random.default_rng(2).normal(size=(8000, 1))


def test_ranges_go_from_one_frequency_to_the_other_without_gaps():
    edges = np.array(RANGES)
    assert (edges[0, 0], edges[-1, 1]) == pytest.approx((0.2, 1.001 * 4.0))
    np.testing.assert_array_equal(edges[1:, 0], edges[:-1, 1])
    assert frequency_ranges((0.0, 4.0))[0][0] == 0.0


def test_a_record_that_the_spectrum_explains_raises_no_doubt(noise: np.ndarray):
    assert judged(noise) == []


def test_a_level_that_is_not_the_spectrums_is_a_doubt(noise: np.ndarray):
    assert judged(noise, density=6.0 / RATE)


def test_halves_of_unequal_loudness_are_a_doubt(noise: np.ndarray):
    louder = noise * np.where(np.arange(8000) < 4000, 1.5, 0.5)[:, None]
    density = 2.0 / RATE * (1.5**2 + 0.5**2) / 2.0
    assert any(one.code == "nonstationary" for one in judged(louder, density))


def test_a_narrow_resonance_or_an_unfinished_search_is_a_doubt(noise: np.ndarray):
    (narrow,) = judged(noise, decay=0.9 * MIN_RESONANCE_FREEDOM / 200.0)
    assert narrow.code == "narrow_resonance"
    assert len(judged(noise, settled=False)) == 1
