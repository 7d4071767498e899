"""Sums over blocks, against sums written out."""

import numpy as np
import pytest

from windsysid.spectral.transforms.block_sums import BlockSums, cut_blocks, cut_turns, factored
from windsysid.spectral.transforms.cross_spectra import FixedBlock

RANGES = ((0.0, 0.25), (0.25, 2.0))


def block(seed: int, bins: int = 6) -> FixedBlock:
    rng = np.random.default_rng(seed)
    return FixedBlock(rng.normal(size=(bins, 2)) + 1j * rng.normal(size=(bins, 2)), 2, 40, 2.0, RANGES)


def products(blocks: list[FixedBlock], weights: list[float]) -> np.ndarray:
    every = [w * b.data[:, :, None] * b.data[:, None, :].conj() for b, w in zip(blocks, weights, strict=True)]
    return np.asarray(np.sum(every, axis=0))


def test_what_is_forgotten_counts_less_in_the_sum_and_in_the_number_of_blocks():
    blocks = [block(seed) for seed in range(3)]
    sums = BlockSums.of(blocks[0]).plus(blocks[1], 0.5).plus(blocks[2], 0.5)
    np.testing.assert_allclose(sums.power, products(blocks, [0.25, 0.5, 1.0]), atol=1e-13)
    assert sums.blocks == 1.75
    assert sums.sizes == (3,)
    np.testing.assert_allclose(sums.energies, [b.energies for b in blocks])


def test_groups_hold_successive_blocks_and_their_halves_add_up_to_all():
    blocks = [block(seed) for seed in range(11)]
    sums = BlockSums.of(blocks[0], 4)
    for one in blocks[1:]:
        sums = sums.plus(one)
    assert sums.sizes == (4, 4, 3)
    assert sums.halves() == (range(1), range(1, 3))
    np.testing.assert_allclose(sums.powers[2], products(blocks[8:], [1.0] * 3), atol=1e-13)
    np.testing.assert_allclose(sums.power, products(blocks, [1.0] * 11), atol=1e-12)
    assert BlockSums.of(blocks[0], 4).halves() is None


def test_a_block_of_other_frequencies_is_refused():
    with pytest.raises(ValueError, match="expected a block of"):
        BlockSums.of(block(0)).plus(block(1, bins=5))


def test_what_was_stored_is_restored():
    sums = BlockSums.of(block(0), 4).plus(block(1))
    again = BlockSums.restored(sums.stored(), FixedBlock)
    assert again.last._replace(data=sums.last.data, ranges=RANGES) == sums.last
    np.testing.assert_array_equal(again.power, sums.power)
    assert (again.sizes, again.counts, again.groups) == (sums.sizes, sums.counts, sums.groups)
    np.testing.assert_array_equal(again.plus(block(2)).power, sums.plus(block(2)).power)


def test_blocks_of_unequal_energy_count_less_by_their_spread():
    # Energies 1 and 4 by turns: mean 2.5, standard deviation 1.5.
    flat = FixedBlock(np.ones((4000, 1), dtype=np.complex128), 2, 20_000, 2.0, RANGES[1:])
    sums = BlockSums.of(flat)
    for i in range(1, 8):
        sums = sums.plus(flat._replace(data=(1.0 + i % 2) * flat.data))
    assert sums.gusts == pytest.approx(1.36, abs=0.001)
    assert BlockSums.of(flat).plus(flat).gusts == 1.0


def test_a_factor_has_the_products_of_all_blocks():
    power = BlockSums.of(block(0)).plus(block(1)).power
    Z = factored(power)
    np.testing.assert_allclose(Z @ np.conj(np.swapaxes(Z, 1, 2)), power, atol=1e-13)


def test_blocks_of_equal_time_repeat_a_share_of_the_one_before():
    blocks, rest = cut_blocks(1000, 300, 0.05)
    assert [(b.start, b.stop) for b in blocks] == [(0, 300), (285, 585), (570, 870)]
    assert rest == 855
    assert cut_blocks(900, 300) == ([slice(0, 300), slice(300, 600), slice(600, 900)], 900)
    assert cut_blocks(299, 300) == ([], 0)


def test_blocks_of_equal_turns_hold_as_many_turns_at_any_speed():
    time = np.arange(4000) / 50.0
    azimuth = -2.0 * np.pi * (0.5 * time + 0.002 * time**2)  # which way it turns does not matter
    blocks, rest = cut_turns(azimuth, 5, 0.05)
    turns = [abs(azimuth[b.stop - 1] - azimuth[b.start]) / (2.0 * np.pi) for b in blocks]
    assert len(blocks) > 5
    np.testing.assert_allclose(turns, 5.0, atol=0.02)
    assert abs(azimuth[-1] - azimuth[rest]) < 10.0 * np.pi
    lengths = np.diff([b.start for b in blocks])
    assert np.all(lengths < [b.stop - b.start for b in blocks[:-1]])
