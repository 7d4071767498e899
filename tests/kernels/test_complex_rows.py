"""Complex matrices as rows of vectors do what NumPy's do, at sizes that do not fill their vectors."""

import numba
import numpy as np
import pytest

from windsysid.kernels.complex_rows import gram, imaginary, products, split, turn
from windsysid.kernels.complex_solve import factor, solve, solve_turned, whiten
from windsysid.kernels.rows import padded


@numba.njit
def begin_of_imaginary(rows):
    return imaginary(rows)


@numba.njit
def multiplied(left, right, count, out):
    products(left, right, count, out)


@numba.njit
def transposed(rows, out):
    turn(rows, out)


@numba.njit
def all_products(rows, weight, out):
    gram(rows, weight, out)


@numba.njit
def solved(apart, order, D, turned, rows, across):
    factor(apart, order, D, turned)
    solve(apart, order, D, rows)
    solve_turned(apart, order, turned, across)


@numba.njit
def whitened(S, weights, whitener, data):
    return whiten(S, weights, whitener, data)


def as_rows(matrix):
    rows = split(*matrix.shape)
    half = (rows.shape[1] - 8) // 2
    rows[:, : matrix.shape[1]], rows[:, half : half + matrix.shape[1]] = matrix.real, matrix.imag
    return rows


def as_complex(rows, columns):
    half = (rows.shape[1] - 8) // 2
    return rows[:, :columns] + 1j * rows[:, half : half + columns]


def drawn(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def test_the_imaginary_part_begins_behind_the_padded_real_one():
    assert [begin_of_imaginary(split(1, n)) for n in (1, 8, 9, 16)] == [8, 8, 16, 16]


@pytest.mark.parametrize("size", [1, 7, 8, 9, 21])
def test_products_are_right_on_the_diagonal_and_to_its_right(size):
    rng = np.random.default_rng(size)
    left, right, out = drawn(rng, 5, size), drawn(rng, 5, size), split(size, size)
    multiplied(as_rows(left), as_rows(right), 4, out)
    np.testing.assert_allclose(
        np.triu(as_complex(out, size)), np.triu(left[:4].T @ right[:4]), atol=1e-13
    )  # the fifth row is not asked for


def test_rows_turn_to_columns():
    matrix, out = drawn(np.random.default_rng(1), 5, 11), split(11, 5)
    transposed(as_rows(matrix), out)
    np.testing.assert_array_equal(as_complex(out, 5), matrix.T)


@pytest.mark.parametrize("length", [3, 64, 1200])
def test_products_of_all_rows_are_added_up(length):
    rows = padded(8, length)
    rows[:, :length] = np.random.default_rng(2).standard_normal((8, length))
    out = np.ones((8, 8))
    all_products(rows, 0.5, out)
    np.testing.assert_allclose(np.tril(out), np.tril(1.0 + 0.5 * rows @ rows.T), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("size", "apart"), [(1, 0), (9, 2), (30, 4), (13, 12)])
def test_a_band_is_solved_with_its_pivots_exchanged(size, apart):
    rng = np.random.default_rng(size)
    i, j = np.indices((size, size))
    D = np.where(np.abs(i - j) <= apart, drawn(rng, size, size), 0.0)
    D[i == j] *= 1e-3  # no step can go without an exchange
    D += (apart == 0) * np.eye(size)
    given = drawn(rng, size, 11)
    rows, across = as_rows(given), as_rows(given)
    solved(apart, np.empty(size, dtype=np.int64), D.copy(), np.empty_like(D), rows, across)
    np.testing.assert_allclose(as_complex(rows, 11), np.linalg.solve(D, given), rtol=1e-9)
    np.testing.assert_allclose(as_complex(across, 11), np.linalg.solve(D.T, given), rtol=1e-9)


def test_whitening_is_by_the_inverse_of_choleskys_factor():
    rng = np.random.default_rng(3)
    A, data = drawn(rng, 13, 20), drawn(rng, 13, 3)
    S = A @ A.conj().T
    whitener, rows = as_rows(np.eye(13)), as_rows(data)
    logarithm = whitened(as_rows(np.triu(S)), np.empty_like(S), whitener, rows)
    L = np.linalg.cholesky(S)
    assert logarithm == pytest.approx(np.linalg.slogdet(S)[1], rel=1e-12)
    np.testing.assert_allclose(as_complex(whitener, 13), np.linalg.inv(L), atol=1e-12)
    np.testing.assert_allclose(as_complex(rows, 3), np.linalg.solve(L, data), atol=1e-12)


@pytest.mark.parametrize("bad", [-1.0, 0.0, np.nan])
def test_what_is_not_positive_has_no_whitener(bad):
    S = np.eye(4, dtype=np.complex128)
    S[2, 2] = bad
    assert np.isnan(whitened(as_rows(S), np.empty_like(S), as_rows(np.eye(4)), split(4, 1)))
