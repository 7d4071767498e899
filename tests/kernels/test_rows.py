"""Row operations of the filters, against NumPy."""

from types import FunctionType

import numba
import numpy as np
import pytest

from windsysid.kernels import rows
from windsysid.kernels.jit import called
from windsysid.kernels.simd import LANES


def _product(four_vectors_fit: bool):
    """`multiply`, compiled as for a processor with many registers or with few."""
    python = vars(rows.multiply)["py_func"]
    surrounding = {**python.__globals__, "FOUR_VECTORS_FIT": four_vectors_fit}
    multiply = called(FunctionType(python.__code__, surrounding))
    return numba.njit(lambda *arguments: multiply(*arguments))


def _filled(random, count, columns):
    matrix = rows.padded(count, columns)
    matrix[:, :columns] = random.normal(size=(count, columns))
    return matrix


@pytest.mark.parametrize("four_vectors_fit", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_products_of_rows_are_right_on_processors_with_few_and_many_registers(four_vectors_fit):
    multiply, random = _product(four_vectors_fit), np.random.default_rng(11)
    for vectors in range(1, 8):
        columns = vectors * LANES - 3
        for first, last, begin, end in ((0, 4, 0, 5), (0, 5, 1, 4), (2, 3, 0, 5), (1, 4, 2, 2)):
            weights, matrix = _filled(random, 5, 5), _filled(random, 5, columns)
            for starts in (1, 5):
                start, out = _filled(random, starts, columns), _filled(random, 5, columns)
                expected = out.copy()
                added = weights[first:last, begin:end] @ matrix[begin:end]
                expected[first:last] = (start if starts == 1 else start[first:last]) + added
                multiply(start, weights, first, last, begin, end, matrix, out)
                np.testing.assert_allclose(out, expected, rtol=0.0, atol=1e-13)
