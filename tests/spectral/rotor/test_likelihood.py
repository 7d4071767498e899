"""Whittle's likelihood, and the response of a tower, against products of matrices."""

import numpy as np
import pytest

from windsysid.spectral.rotor import likelihood as module
from windsysid.spectral.rotor.kernel_dense import elements_of, entries_at, places_of, spectra_dense
from windsysid.spectral.rotor.kernel_sparse import MAX_LOOP_ENTRIES
from windsysid.spectral.rotor.likelihood import (
    Ingredients,
    ModelSpectrum,
    spectrum_of_bins,
    times_sources,
    whittle,
    whittle_by_bins,
)
from windsysid.spectral.rotor.load_spectra import SourceSpectra
from windsysid.spectral.rotor.problem import Posed


@pytest.fixture(scope="module")
def ingredients(posed: Posed) -> Ingredients:
    return next(of for _, of in posed.model._ingredients(posed.start, 1, None, slopes=True))


def spectra_of(rng: np.random.Generator, e: int) -> np.ndarray:
    X = rng.normal(size=(5, e, e)) + 1j * rng.normal(size=(5, e, e))
    return X @ X.conj().swapaxes(1, 2) + np.eye(e)


@pytest.mark.parametrize("entries", [3, MAX_LOOP_ENTRIES + 2])
def test_value_gradient_and_information_are_whittles(entries: int):
    rng = np.random.default_rng(1)
    S, A = spectra_of(rng, entries), np.array([spectra_of(rng, entries) for _ in range(2)])
    data, counts = rng.normal(size=(5, entries, 2)) + 1j * rng.normal(size=(5, entries, 2)), np.full(5, 2.0)
    found = whittle(data, counts, ModelSpectrum(S, A, None))
    value, gradient, information = 0.0, np.zeros(2), np.zeros((2, 2))
    for s, a, y in zip(S, A.swapaxes(0, 1), data, strict=True):
        inverse = np.linalg.inv(s)
        value += 2.0 * np.linalg.slogdet(s)[1] + np.trace(y.conj().T @ inverse @ y).real
        gradient += [np.trace(inverse @ one @ (2.0 * np.eye(entries) - inverse @ y @ y.conj().T)).real for one in a]
        information += [[2.0 * np.trace(inverse @ one @ inverse @ other).real for other in a] for one in a]
    assert found.value == pytest.approx(value)
    np.testing.assert_allclose(found.gradient, gradient)
    np.testing.assert_allclose(found.information, information)
    gradients, informations = whittle_by_bins(data, counts, ModelSpectrum(S, A, None))
    np.testing.assert_allclose(gradients.sum(axis=0), gradient)
    np.testing.assert_allclose(informations.sum(axis=0), information)
    alone = whittle(data[1:2], counts[1:2], ModelSpectrum(S[1:2], np.ascontiguousarray(A[:, 1:2]), None))
    np.testing.assert_allclose(gradients[1], alone.gradient)


def test_loops_over_few_and_over_many_entries_are_products_of_matrices(ingredients: Ingredients):
    of = ingredients
    loops = spectrum_of_bins(of, whiten=False)
    products = module._respond(of)
    assert of.slopes is not None
    slopes = module._differentiate(of, of.slopes, products, None)
    S = np.empty_like(loops.spectrum)
    spectra_dense(module._many_entries(of), S)
    size = np.abs(products.spectrum).max()
    np.testing.assert_allclose(loops.spectrum, products.spectrum, rtol=1e-9, atol=1e-12 * size)
    np.testing.assert_allclose(np.tril(S), np.tril(products.spectrum), rtol=1e-9, atol=1e-12 * size)
    np.testing.assert_allclose(loops.slopes, slopes, rtol=1e-7, atol=1e-10 * np.abs(slopes).max())


def test_whitened_slopes_are_slopes_between_whiteners(ingredients: Ingredients):
    of, response = ingredients, module._respond(ingredients)
    assert of.slopes is not None
    L_inv = np.asarray(np.linalg.inv(np.linalg.cholesky(response.spectrum)), dtype=np.complex128)
    plain, whitened = (module._differentiate(of, of.slopes, response, by) for by in (None, L_inv))
    np.testing.assert_allclose(whitened, L_inv @ plain @ L_inv.conj().swapaxes(1, 2), atol=1e-9)


def test_sources_are_coherent_in_pairs():
    matrix = np.arange(6.0).reshape(1, 2, 3).astype(complex)
    sources = SourceSpectra(np.array([[1.0, 2.0, 3.0]]), np.array([[0.5]]))
    covariance = np.array([[1.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]])
    np.testing.assert_allclose(times_sources(matrix, sources)[0], matrix[0] @ covariance)


def test_places_of_elements_are_those_that_are_not_zero():
    U = np.array([[0.0, 2.0], [3.0, 0.0]], dtype=complex)
    where, values = places_of(U)
    assert all(U[row, source] == value for (source, row), value in zip(where, values, strict=True))
    np.testing.assert_array_equal(entries_at(np.array([0, 3]), 2, 2), [[0, -1], [-1, 1]])
    assert len(elements_of(np.zeros((3, 1, 7, 2, 2), dtype=complex))) == 0
