"""Motions that go together: an image has one line in its product with the mode, two random motions have none."""

import numpy as np

from windsysid.spectral.modal_bands.images import _go_together, _Motion


def motion(transform: np.ndarray, freedom: float) -> _Motion:
    return _Motion(transform, 0.0, 1.0, float(np.sum(np.abs(transform) ** 2)), freedom)


def test_an_image_goes_with_its_mode_and_another_mode_does_not():
    rng = np.random.default_rng(3)
    one, other = rng.normal(size=(2, 64)) + 1j * rng.normal(size=(2, 64))
    assert _go_together(motion(one, 40.0), motion(0.1 * one, 40.0))
    assert _go_together(motion(one, 40.0), motion(0.1 * one[::-1].conj(), 40.0))
    assert not _go_together(motion(one, 40.0), motion(other, 40.0))


def test_too_few_values_show_nothing():
    one = np.ones(64, dtype=complex)
    assert not _go_together(motion(one, 5.0), motion(one, 5.0))
