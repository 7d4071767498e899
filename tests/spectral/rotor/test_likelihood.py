"""Whittle's likelihood, and the response of a tower, against products of matrices."""

import numpy as np
import pytest

from tests.spectral.rotor.products import differentiate, respond, times_sources
from windsysid.spectral.rotor import likelihood as module
from windsysid.spectral.rotor.kernel_dense import elements_of, entries_at, places_of, spectra_dense
from windsysid.spectral.rotor.kernel_sparse import MAX_LOOP_ENTRIES
from windsysid.spectral.rotor.likelihood import (
    Ingredients,
    ModelSpectrum,
    spectrum_of_bins,
    whittle,
    whittle_by_bins,
    whittle_given,
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
    found = whittle(data, counts, ModelSpectrum(S, A))
    value, gradient, information = 0.0, np.zeros(2), np.zeros((2, 2))
    for s, a, y in zip(S, A.swapaxes(0, 1), data, strict=True):
        inverse = np.linalg.inv(s)
        value += 2.0 * np.linalg.slogdet(s)[1] + np.trace(y.conj().T @ inverse @ y).real
        gradient += [np.trace(inverse @ one @ (2.0 * np.eye(entries) - inverse @ y @ y.conj().T)).real for one in a]
        information += [[2.0 * np.trace(inverse @ one @ inverse @ other).real for other in a] for one in a]
    assert found.value == pytest.approx(value)
    np.testing.assert_allclose(found.gradient, gradient)
    np.testing.assert_allclose(found.information, information)
    gradients, informations = whittle_by_bins(data, counts, ModelSpectrum(S, A))
    np.testing.assert_allclose(gradients.sum(axis=0), gradient)
    np.testing.assert_allclose(informations.sum(axis=0), information)
    alone = whittle(data[1:2], counts[1:2], ModelSpectrum(S[1:2], np.ascontiguousarray(A[:, 1:2])))
    np.testing.assert_allclose(gradients[1], alone.gradient)


@pytest.mark.parametrize("real", [False, True])
def test_entries_given_others_say_what_all_say_less_what_the_others_say(real: bool):
    rng = np.random.default_rng(2)
    S, A = spectra_of(rng, 6)[0], np.array([spectra_of(rng, 6)[0] for _ in range(2)] + [np.zeros((6, 6))])
    S, A = (S.real, A.real) if real else (S, A)
    y = rng.normal(size=6) + 1j * rng.normal(size=6)
    whole, first, rest = (
        whittle_given(y[:n], S[:n, :n], np.ascontiguousarray(A[:, :n, :n]), given)
        for n, given in ((6, 0), (2, 0), (6, 2))
    )
    expected = whittle(y[None, :, None], np.ones(1), ModelSpectrum(S[None] + 0j, A[:, None] + 0j))
    assert whole.value == pytest.approx(expected.value)
    np.testing.assert_allclose(whole.gradient, expected.gradient)
    np.testing.assert_allclose(whole.information, expected.information)
    assert rest.value == pytest.approx(whole.value - first.value)
    np.testing.assert_allclose(rest.gradient, whole.gradient - first.gradient)
    n = 400_000  # the information of what is given is the variance of the score, and no difference
    L = np.linalg.cholesky(S)
    drawn = (rng.normal(size=(n, 6)) + 1j * rng.normal(size=(n, 6))) / np.sqrt(2.0) @ L.T
    inverse, before = np.linalg.inv(S), np.pad(np.linalg.inv(S[:2, :2]), ((0, 4), (0, 4)))
    scores = [
        np.einsum("ni,ij,nj->n", drawn.conj(), inverse @ a @ inverse - before @ a @ before, drawn).real for a in A[:2]
    ]
    np.testing.assert_allclose(np.cov(scores), rest.information[:2, :2], rtol=0.03)


@pytest.mark.parametrize("late", [0.0, 0.02])
def test_loops_over_few_and_over_many_entries_are_products_of_matrices(ingredients: Ingredients, late: float):
    bins, entries = ingredients.place.left_out.shape
    of = ingredients._replace(more=np.tile(0.1 * np.eye(entries) + 0j, (bins, 1, 1)))
    if late:
        of = of._replace(
            late=late * np.arange(1.0, 1.0 + entries), slopes=ingredients.slopes._replace(late=np.eye(entries))
        )
    loops = spectrum_of_bins(of)
    expected = respond(of)
    slopes = differentiate(of, of.slopes, expected)
    S = np.empty_like(loops.spectrum)
    spectra_dense(module._many_entries(of), S)
    size = np.abs(expected.spectrum).max()
    np.testing.assert_allclose(loops.spectrum, expected.spectrum, rtol=1e-9, atol=1e-12 * size)
    np.testing.assert_allclose(np.tril(S), np.tril(expected.spectrum), rtol=1e-9, atol=1e-12 * size)
    np.testing.assert_allclose(loops.slopes, slopes, rtol=1e-7, atol=1e-10 * np.abs(slopes).max())


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
