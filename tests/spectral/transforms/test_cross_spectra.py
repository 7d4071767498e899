"""Cross-spectra of blocks, against a Fourier sum written out."""

import numpy as np
import scipy.signal

from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.cross_spectra import pool, transform_block
from windsysid.spectral.transforms.dft import taper

RATE, LIMITS = 4.0, (0.1, 1.5)
READINGS = np.random.default_rng(1).normal(size=(400, 2)) + np.linspace(0.0, 3.0, 400)[:, None]


def test_a_block_is_the_tapered_fourier_sum_of_readings_without_trend():
    block = transform_block(READINGS, RATE, LIMITS)
    t, h = np.arange(400), taper(400)
    level = scipy.signal.detrend(READINGS, axis=0)
    k = block.bins[7]
    expected = np.sqrt(2.0 / RATE / np.sum(h**2)) * (h * np.exp(-2j * np.pi * k * t / 400)) @ level
    np.testing.assert_allclose(block.data[7], expected, atol=1e-12)
    assert LIMITS[0] < block.frequency[0] < block.frequency[-1] <= LIMITS[1]


def test_mean_squares_are_those_of_the_bins_in_a_range():
    ranges = ((0.1, 0.5), (0.5, 1.6), (1.7, 1.8))
    block = transform_block(READINGS, RATE, LIMITS, ranges)
    for energy, count, (low, high) in zip(block.energies[:2], block.independent[:2], ranges[:2], strict=True):
        inside = (block.frequency >= low) & (block.frequency < high)
        np.testing.assert_allclose(energy, np.mean(np.abs(block.data[inside]) ** 2, axis=0))
        assert count.tolist() == [inside.sum()] * 2
    assert np.isnan(block.energies[2]).all()


def test_pools_hold_the_mean_of_their_bins_and_blocks():
    blocks = [transform_block(READINGS * scale, RATE, LIMITS) for scale in (1.0, 2.0)]
    sums = BlockSums.of(blocks[0]).plus(blocks[1])
    rows = pool(sums, np.full(len(blocks[0].data), 5.0))
    first = slice(rows.first[0], rows.first[1])
    power = 2.5 * np.mean(blocks[0].data[first, :, None] * blocks[0].data[first, None, :].conj(), axis=0)
    np.testing.assert_allclose(rows.power[0], power)
    assert rows.counts.sum() == 2 * len(blocks[0].data)
    assert rows.counts[0] == 10.0
