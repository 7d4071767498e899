"""Transforms in a frame that turns, against sinusoids of known frequencies."""

import numpy as np
import pytest

from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.rotating_frame import MAX_GROUPS, combine_groups, turned_block, turned_spectra

RATE, SAMPLES, HZ = 10.0, 4000, 0.2
TIME = np.arange(SAMPLES) / RATE
AZIMUTH = 2.0 * np.pi * HZ * TIME


def test_a_sinusoid_at_f_stands_at_f_minus_k_turns_in_the_turning_frame():
    spectra = turned_spectra(np.cos(2.0 * np.pi * 0.93 * TIME)[:, None], AZIMUTH, RATE, 1)
    peaks = {k: np.argmax(np.abs(Y[:, 0, 0])) / spectra.duration for k, Y in spectra.data.items()}
    assert peaks == pytest.approx({0: 0.93, 1: 0.73, -1: 1.13}, abs=1.0 / spectra.duration)
    assert spectra.rotor_hz == pytest.approx(HZ)


def test_a_block_reads_blades_at_one_frequency_and_the_support_at_three():
    readings = np.random.default_rng(2).normal(size=(SAMPLES, 3))
    spectra = turned_spectra(readings, AZIMUTH, RATE, 1)
    block = turned_block(spectra, np.array([True, False, False]), 49)
    expected = np.column_stack([spectra.data[0][:50, :, 0], spectra.data[1][:50, 0, 0], spectra.data[-1][:50, 0, 0]])
    np.testing.assert_array_equal(block.vectors, expected)
    np.testing.assert_allclose(block.energies, np.mean(np.abs(spectra.data[0][:50, :, 0]) ** 2, axis=0))
    assert np.all((block.independent > 10.0) & (block.independent <= 50.0))


def test_combined_groups_have_the_products_of_their_blocks_and_their_mean_speed():
    support = np.array([True, False])
    rng = np.random.default_rng(3)
    blocks = [turned_block(turned_spectra(rng.normal(size=(400, 2)), AZIMUTH[:400], RATE, 1), support) for _ in "abc"]
    blocks = [block._replace(rotor_hz=HZ + 0.01 * i) for i, block in enumerate(blocks)]
    sums = BlockSums.of(blocks[0], MAX_GROUPS).plus(blocks[1]).plus(blocks[2])
    whole, first = combine_groups(sums), combine_groups(sums, [0])
    ours = np.einsum("big,bjg->bij", whole.data[0], whole.data[1].conj())
    every = sum(block.data[0][:, :, None] * block.data[1][:, None, :].conj() for block in blocks)
    np.testing.assert_allclose(ours[:, :, 0], every[:, :, 0], atol=1e-12)
    assert (whole.blocks, first.blocks) == (3.0, 1.0)
    assert whole.rotor_hz == pytest.approx(HZ + 0.01)
    assert whole.recent is not None
    np.testing.assert_array_equal(whole.recent[-1][:, :, 0], blocks[2].data[2])
