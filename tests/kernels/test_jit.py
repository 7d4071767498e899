"""Kernels have their own copies of their helpers, so that the process that compiles rounds as all others do."""

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import types

from windsysid.kernels import jit
from windsysid.kernels.jit import called, compiled
from windsysid.kernels.parts import stays_a_function

VECTOR = types.float64[::1]


@called
def _power(x: Any, i: int, exponent: int) -> float:
    """One element to a power."""
    stays_a_function()
    total = 1.0
    for _ in range(exponent):
        total *= x[i]
    return total


def _polynomial(x: Any) -> float:
    total = 0.0
    for i in range(x.size):
        total += _power(x, 0, 2) + _power(x, i, 3) - 0.3 * _power(x, i, i)
    return total


def test_a_helper_is_compiled_once_and_is_no_machine_code_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    made = compiled(_polynomial, types.float64(VECTOR))
    (helper,) = vars(_power)["overloads"].values()  # not one more for each constant among its arguments
    with pytest.raises(RuntimeError, match="no compiled object"):
        helper.library._get_compiled_object()
    (kernel,) = made.overloads.values()
    copies = [function for function in kernel.library.get_defined_functions() if "_power" in function.name]
    assert [function.linkage.name for function in copies] == ["internal"]  # not the one that was loaded first
    x = np.linspace(0.1, 1.3, 7)
    read = compiled(_polynomial, types.float64(VECTOR))
    assert made(x) == read(x) == pytest.approx(sum(x[0] ** 2 + x**3 - 0.3 * x ** np.arange(7)))
    assert gc.isenabled()
    assert "_library_class" not in vars(made.targetctx.codegen())
