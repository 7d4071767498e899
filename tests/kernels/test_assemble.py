"""Assembled kernels do what Python does with the same source, for numbers and for vectors."""

import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.kernels.assemble import assembled
from windsysid.kernels.jit import JACOBIAN, LANE_JACOBIAN
from windsysid.kernels.simd import LANES, vectors

HEADER = """from math import atan2, copysign, cos, cosh, erf, exp, log, nan, pi, sin, sqrt, tan, tanh
from windsysid.kernels.assemble import where

def kernel(_x, _u, _p, _w, _value, _dx, _dp, _dw):
    a = _x[0]
    b = _x[1]
    number = _u[0]
"""

ARITHMETIC = """
    _value[0] = 2*a**3 - b/3.0 + 1
    _value[1] = abs(a)**b + max(abs(a), 0.1) + min(a, b) + (-b)**(-2) + a**0.0 + 2**a
    _value[2] = exp(a)*atan2(b, 2.0) + sqrt(abs(a)) + copysign(1, a) - (1/6)*pi*number
    t = log(abs(b)) + tanh(a)
    _value[3] = t + erf(a) + sin(number)*tan(a) + number**2*cosh(number) + cos(2**0.5)
    _value[4] = where((a > 0.0) & (b <= 1.0) | (a < -1), a, -b) + where(number > 1.0, 2.0, b)
    _value[5] = where((number > 1.0) & (a != b), nan, 1) + max(a, b, number, 0.0)
    _dx[0, 1] = a*b
    _dx[5, 0] = number
    _dw[2, 0] = 0.5
    return
"""

TURNED = """
    _value[0] = sin(a)
    _value[1] = cos(a)
    return
"""


def generated(folder: Path, text: str) -> tuple[ModuleType, str]:
    path = folder / "generated.py"
    path.write_text(HEADER + text)
    module = ModuleType(f"generated_{abs(hash(text))}")
    module.__file__ = str(path)
    exec(compile(HEADER + text, path, "exec"), module.__dict__)
    return module, HEADER + text


@numba.njit
def of_lanes(kernel, x, u, p, w, value, dx, dp, dw):
    kernel(vectors(x), u, vectors(p), vectors(w), vectors(value), vectors(dx), vectors(dp), vectors(dw))  # fmt: skip


def matrices(*more: int) -> list[Any]:
    return [np.zeros(shape + more) for shape in ((6,), (6, 2), (6, 0), (6, 1))]


def test_arithmetic_is_that_of_python(tmp_path: Path):
    module = generated(tmp_path, ARITHMETIC)
    kernel, kernel_of_lanes = (assembled(*module, "kernel", kind) for kind in (JACOBIAN, LANE_JACOBIAN))
    rng = np.random.default_rng(6)
    none, none_of_lanes = np.zeros(0), np.zeros((0, LANES))
    for number in np.repeat([0.3, 3.0], 50):
        x, u = rng.standard_normal((2, LANES)), np.array([number])
        together = matrices(LANES)
        of_lanes(kernel_of_lanes, x, u, none_of_lanes, none_of_lanes, *together)
        for lane in range(LANES):
            expected, found = matrices(), matrices()
            given = np.ascontiguousarray(x[:, lane]), u, none, none
            module[0].kernel(*given, *expected)
            kernel(*given, *found)
            for one, other, vector in zip(expected, found, together, strict=True):
                np.testing.assert_allclose(other, one, rtol=1e-13, atol=1e-13)
                np.testing.assert_allclose(vector[..., lane], one, rtol=1e-13, atol=1e-13)


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Any], Any]:
    kernel = assembled(*generated(tmp_path_factory.mktemp("turned"), TURNED), "kernel", LANE_JACOBIAN)
    u, none = np.zeros(1), np.zeros((0, LANES))

    def turned(a: Any) -> Any:
        out, x, together = np.zeros((len(a), 2, LANES)), np.zeros((2, LANES)), matrices(LANES)
        for found, angles in zip(out, a, strict=True):  # a loop that Numba compiles takes 7 s to compile
            x[0] = angles
            of_lanes(kernel, x, u, none, none, *together)
            found[:] = together[0][:2]
        return out

    return turned


@pytest.mark.parametrize("farthest", [1e-8, 1.0, 100.0, 1e5, 1e9])
def test_sine_and_cosine_are_numpys_to_two_units_in_the_last_place(turned: Callable[[Any], Any], farthest: float):
    rng = np.random.default_rng(7)
    quarters = np.round(
        rng.uniform(-farthest, farthest, (1000, LANES))
    )  # a sine there is what is left of a cancellation
    a = np.concatenate([rng.uniform(-farthest, farthest, (5000, LANES)), quarters * (math.pi / 2.0)])
    out = turned(a)
    for found, exact in ((out[:, 0], np.sin(a)), (out[:, 1], np.cos(a))):
        assert np.all(np.abs(found - exact) <= 2.0 * np.spacing(np.abs(exact)) + 1e-23)


def test_a_lane_that_is_no_number_leaves_the_others_alone(turned: Callable[[Any], Any]):
    a = np.array([[0.3, np.nan, np.inf, -2.0, 1e300, 0.0, -0.0, 5.0]])
    out = turned(a)
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(out[0], [np.sin(a[0]), np.cos(a[0])], rtol=1e-15)


@pytest.mark.parametrize("text", ["gamma(a)", "a.real", "a if a > b else b", "a // b", "open('x')"])
def test_what_is_no_arithmetic_is_refused(tmp_path: Path, text: str):
    module = generated(tmp_path, f"    _value[0] = {text}\n")
    with pytest.raises(ConfigurationError, match="cannot compile"):
        assembled(*module, "kernel", JACOBIAN)


def test_kernels_of_one_name_in_two_modules_stay_apart(tmp_path: Path):
    values = []
    for number in (1.0, 2.0):
        module = generated(tmp_path, f"    _value[0] = {number}*a\n")
        out = matrices()
        kernel = assembled(*module, "kernel", JACOBIAN)
        kernel(np.array([1.0, 0.0]), np.zeros(1), np.zeros(0), np.zeros(0), *out)
        values.append(out[0][0])
    assert values == [1.0, 2.0]
