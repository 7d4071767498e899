"""Measures of shapes against the formulas as published, written independently."""

import numpy as np
import pytest

from windsysid._types import Complex
from windsysid.modal.shapes import along_axis, assurance, assurance_matrix, phase_collinearity, phase_deviation

SHAPES = [np.random.default_rng(seed).normal(size=(2, 6)) @ np.eye(6) for seed in range(5)]


def shape_of(parts: np.ndarray) -> Complex:
    return np.asarray(parts[0] + 0.4j * parts[1])


@pytest.mark.parametrize("parts", SHAPES)
def test_collinearity_is_that_of_heylens_formula(parts: np.ndarray):
    """Heylen, Lammens & Sas, Modal Analysis Theory and Testing, A.3.6: the same value from another formula."""
    shape = shape_of(parts)
    re, im = (shape - shape.mean()).real, (shape - shape.mean()).imag
    e = (im @ im - re @ re) / (2.0 * re @ im)
    theta = np.arctan(abs(e) + np.sign(e) * np.sqrt(1.0 + e**2))
    share = (re @ re + re @ im / e * (2.0 * (e**2 + 1.0) * np.sin(theta) ** 2 - 1.0)) / (re @ re + im @ im)
    eigenvalues = np.linalg.eigvalsh(np.cov(shape.real, shape.imag))  # pyOMA-2's definition
    expected = ((eigenvalues[0] - eigenvalues[1]) / eigenvalues.sum()) ** 2
    assert phase_collinearity(shape) == pytest.approx(expected)
    assert max(share, 1.0 - share) == pytest.approx(eigenvalues[1] / eigenvalues.sum())


@pytest.mark.parametrize("parts", SHAPES)
def test_mean_phase_deviation_is_that_of_reynders(parts: np.ndarray):
    shape = shape_of(parts)
    v = np.linalg.svd(np.column_stack([shape.real, shape.imag]))[2].T
    size = np.abs(shape)
    cosine = np.abs(shape.real * v[1, 1] - shape.imag * v[0, 1]) / (np.hypot(v[0, 1], v[1, 1]) * size)
    assert phase_deviation(shape) == pytest.approx(float(size @ np.arccos(np.minimum(cosine, 1.0)) / size.sum()))


@pytest.mark.parametrize("parts", SHAPES)
def test_a_scale_and_a_phase_of_the_whole_shape_change_nothing(parts: np.ndarray):
    shape = shape_of(parts)
    other = (2.0 - 1.3j) * shape
    assert phase_collinearity(other) == pytest.approx(phase_collinearity(shape))
    assert phase_deviation(other) == pytest.approx(phase_deviation(shape))
    assert assurance(shape, other) == pytest.approx(1.0)
    assert np.abs(along_axis(other).imag).sum() == pytest.approx(
        np.abs(2.0 - 1.3j) * np.abs(along_axis(shape).imag).sum()
    )


def test_two_channels_have_no_collinearity():
    assert np.isnan(phase_collinearity(np.array([1.0, 1.0j])))
    assert phase_deviation(np.array([1.0, 1.0j])) == pytest.approx(np.pi / 4)


def test_the_matrix_has_a_criterion_for_each_pair():
    a = np.array([[1.0, 1.0], [1.0, -1.0]], dtype=complex)
    np.testing.assert_allclose(assurance_matrix(a, a), np.eye(2))
