"""The algebra of roots against NumPy's, and where NumPy's gives up: singular covariances."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from windsysid.filters import roots
from windsysid.kernels.rows import padded


def from_python(helper: Any) -> Callable[..., Any]:
    """A helper inside a function of its own: by itself it is compiled as a part of kernels only."""
    return numba.njit(lambda *arguments: helper(*arguments))  # type: ignore[no-any-return]


absorb, factorise_rows, square_rows, triangularise_rows = map(
    from_python, (roots.absorb, roots.factorise, roots.square, roots.triangularise)
)


def in_vectors(matrix: np.ndarray) -> np.ndarray:
    """A matrix whose rows are padded to whole vectors."""
    rows = padded(*matrix.shape)
    rows[:, : matrix.shape[1]] = matrix
    return rows


def filled(function: Callable[..., None], matrix: np.ndarray) -> np.ndarray:
    """What a kernel makes of a square matrix in an array that held nothing."""
    n = len(matrix)
    out = padded(n, n)
    out[:, :n] = np.nan
    function(in_vectors(matrix), out)
    return out[:, :n]


def factorise(cov: np.ndarray) -> np.ndarray:
    return filled(factorise_rows, cov)


def square(root: np.ndarray) -> np.ndarray:
    return filled(square_rows, root)


def triangularise(matrix: np.ndarray) -> None:
    rows = in_vectors(matrix)
    triangularise_rows(rows, padded(1, matrix.shape[1]))
    matrix[:] = rows[:, : matrix.shape[1]]


def covariance(n: int, rank: int, seed: int) -> np.ndarray:
    """A covariance of the given rank, its scales ten decades apart."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, rank)) * 10.0 ** rng.uniform(-5, 5, (n, 1))
    return np.asarray(root @ root.T)


def unit(cov: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.asarray(cov / np.outer(scale, scale))


@pytest.mark.parametrize("n", [0, 1, 2, 7, 25])
def test_a_root_squared_is_the_covariance(n: int):
    cov = covariance(n, n, seed=n)
    root = factorise(cov)
    back = square(root)
    scale = np.sqrt(np.diag(cov))
    np.testing.assert_allclose(unit(back, scale), unit(cov, scale), atol=1e-14)
    np.testing.assert_array_equal(back, back.T)
    if n:
        lower = root.T / scale[:, None]
        np.testing.assert_allclose(lower, np.linalg.cholesky(unit(cov, scale)), rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("rank", [0, 1, 4, 9])
def test_a_singular_covariance_has_a_root_too(rank: int):
    # Some states are known exactly, some are copies of others: a Cholesky factorisation would fail.
    cov = covariance(10, 10, seed=5)
    chosen = np.zeros((10, 10))
    for i in range(10):
        chosen[i, i if i < rank else i - rank] = float(rank > 0 and (i < rank or i < 2 * rank))
    cov = chosen @ cov @ chosen.T
    root = factorise(cov)
    back = square(root)
    scale = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    np.testing.assert_allclose(unit(back, scale), unit(cov, scale), atol=1e-13)
    assert np.count_nonzero(np.diag(root)) == rank


@pytest.mark.parametrize(("n", "w"), [(1, 1), (3, 3), (4, 9), (9, 4), (25, 50)])
def test_rows_are_brought_to_triangular_form(n: int, w: int):
    rows = np.random.default_rng(n).standard_normal((n, w)) * 10.0 ** np.linspace(-4, 4, n)[:, None]
    expected, scale = rows @ rows.T, np.sqrt(np.sum(rows**2, axis=1))
    triangularise(rows)
    np.testing.assert_array_equal(np.triu(rows, 1), 0.0)
    assert np.all(np.diag(rows[:, :n]) >= 0.0)
    np.testing.assert_allclose(unit(rows @ rows.T, scale), unit(expected, scale), atol=1e-14)


def test_rows_that_are_zero_or_repeated_stay_so():
    rows = np.random.default_rng(3).standard_normal((6, 8))
    rows[2], rows[4] = 0.0, rows[1]
    expected = rows @ rows.T
    triangularise(rows)
    np.testing.assert_array_equal(rows[2], 0.0)
    np.testing.assert_allclose(rows @ rows.T, expected, atol=1e-14)


def test_a_root_is_precise_where_its_square_has_lost_everything():
    # 1 and 1 + 1e-12 as two rows: their difference is 1e-12 in L, where A Aᵀ would say 1e-24 ± 1e-16.
    rows = np.array([[1.0, 0.0], [1.0, 1e-12]])
    triangularise(rows)
    assert rows[1, 1] == pytest.approx(1e-12, rel=1e-3)


def test_readings_taken_in_one_by_one_are_the_gaussian_conditional():
    rng = np.random.default_rng(8)
    n, m = 7, 3
    cov = covariance(n, n, seed=9)
    root = factorise(cov)
    scale = np.sqrt(np.diag(cov))
    H = rng.standard_normal((m, n)) / scale
    mean, reading = scale * rng.standard_normal(n), rng.standard_normal(m)
    rows, centres, behind = (
        in_vectors(np.hstack([root @ H.T, root])),
        in_vectors(np.hstack([H @ mean - reading, mean])[None]),
        padded(1, m + n),
    )
    outcomes = [absorb(rows, centres, c, behind) for c in range(m)]
    directions, centre = rows[:, : m + n], centres[0, : m + n]
    S = H @ cov @ H.T + np.eye(m)
    gain = cov @ H.T @ np.linalg.inv(S)
    posterior = cov - gain @ S @ gain.T
    L = np.linalg.cholesky(S)
    np.testing.assert_allclose(centre[m:] / scale, (mean + gain @ (reading - H @ mean)) / scale, atol=1e-12)
    np.testing.assert_array_equal(np.tril(directions[:, m:], -1), 0.0)  # still a transposed lower triangle
    np.testing.assert_allclose(unit(directions[:, m:].T @ directions[:, m:], scale), unit(posterior, scale), atol=1e-13)
    np.testing.assert_allclose([std for _, std in outcomes], np.diag(L), rtol=1e-12)
    np.testing.assert_allclose([z for z, _ in outcomes], np.linalg.solve(L, reading - H @ mean), atol=1e-12)


def test_a_very_precise_reading_leaves_no_negative_variance():
    # Sixteen decades between prior and noise: the subtraction 1 − 1/(1 + 1e-16) is 0, Carlson's quotient is not.
    directions = in_vectors(np.array([[1e8, 1e8], [0.0, 1.0]]))
    absorb(directions, padded(1, 2), 0, padded(1, 2))
    assert directions[0, 1] == pytest.approx(1.0, rel=1e-12)
