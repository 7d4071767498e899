"""Assignment of modes to tracks against the modal assurance criterion by hand and a search over all permutations."""

from itertools import permutations

import numpy as np
import pytest

from windsysid.modal.shapes import assurance
from windsysid.spectral.oma.mode_tracking import Seen, follow_modes


def test_the_assurance_criterion_is_that_of_allemang():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 4)) + 1j * rng.normal(size=(2, 4))
    by_hand = abs(np.vdot(a, b)) ** 2 / (np.vdot(a, a).real * np.vdot(b, b).real)
    assert assurance(a, b) == pytest.approx(by_hand)
    assert assurance(a, (2.0 - 3.0j) * a) == pytest.approx(1.0)


def test_only_common_sensors_count():
    a, b = np.array([1.0, 2.0, np.nan, 1.0], dtype=complex), np.array([1.0, 2.0, 9.0, np.nan], dtype=complex)
    assert assurance(a, b) == pytest.approx(1.0)
    assert np.isnan(assurance(a, np.array([1.0, np.nan, 1.0, np.nan], dtype=complex)))


@pytest.mark.parametrize("seed", range(5))
def test_tracks_have_the_least_sum_of_distances(seed: int):
    rng = np.random.default_rng(seed)
    shapes = np.array([[1.0, 0.3], [0.4, 1.0], [1.0, -0.5]], dtype=complex)
    frequencies = np.exp(rng.normal(scale=0.02, size=(2, 3)))
    first, second = ([Seen(float(f), s) for f, s in zip(row, shapes, strict=True)] for row in frequencies)
    order = rng.permutation(3)
    tracks = follow_modes([first, [second[i] for i in order]])

    def cost(pairs: tuple[int, ...]) -> float:
        steps = [np.log(second[order[j]].frequency / first[i].frequency) / 0.05 for i, j in enumerate(pairs)]
        alike = [assurance(first[i].shape, second[order[j]].shape) for i, j in enumerate(pairs)]
        return float(sum(s**2 for s in steps)) + sum((1.0 - mac) / 0.3 if mac > 0.4 else np.inf for mac in alike)

    best = min(permutations(range(3)), key=cost)
    assert {track[0]: track[1] for track in tracks} == dict(enumerate(best))


def test_a_mode_too_far_away_begins_a_track():
    shape = np.array([1.0, 0.5], dtype=complex)
    assert follow_modes([[Seen(1.0, shape)], [Seen(1.2, shape)]]) == [{0: 0}, {1: 0}]
