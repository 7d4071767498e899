"""A model's matrices as Fourier series in azimuth, and from them the transfer from loads to readings between all
harmonics.

About a working point the equations are M(ψ) q̈ + C(ψ) q̇ + K(ψ) q = w and the readings y = R^q q + R^v q̇ + R^a q̈,
with ψ = Ωt and every matrix X(ψ) = Σ_h X_h e^{ihψ}. The compiled kernels give ẋ, its derivatives ∂ẋ/∂x and ∂ẋ/∂w, and
those of the readings; with one load on every degree of freedom

    M = (∂q̈/∂w)⁻¹,  C = −M ∂q̈/∂q̇,  K = −M ∂q̈/∂q,      R^a = ∂y/∂w M,  R^v = ∂y/∂q̇ − R^a ∂q̈/∂q̇,  R^q = ∂y/∂q − R^a
    ∂q̈/∂q,

at `AZIMUTH_COUNT` azimuths, and the fast Fourier transform their harmonics. At the frequencies ω_k = ω + kΩ the motion
answers by

    D_jk = −ω_k² M_{j−k} + i ω_k C_{j−k} + K_{j−k},      R_jk likewise,      T = R D⁻¹.

Working point: every blade leads by the same mean lag angle, to which the mean torque of the wind drives it and which no
accelerometer sees; loads hold it there.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.kernels.jit import JACOBIAN, compiled, pasted
from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.model import Coordinate
from windsysid.spectral.transforms.lifted import Complex

__all__ = [
    "MIN_RELATIVE_CHANGE", "MatrixHarmonics", "affine_matrices", "coupled", "element_sizes", "equal_lag",
    "matrix_harmonics", "without_rounding",
]  # fmt: skip

AZIMUTH_COUNT = 8
"""Numerical: azimuths at which matrices are evaluated: harmonics up to `MAX_HARMONIC` are exact if there are none above
4."""

MAX_HARMONIC = 3
"""Numerical: highest harmonic |h| of a matrix; those of a rotor's equations and readings end at 2 and 3."""

MAX_RELATIVE_ROUNDING = 1e-13
"""Numerical: size of an element over that of the others of its matrix, below which it is rounding."""

MIN_RELATIVE_CHANGE = 1e-11
"""Numerical: change of an element over the size of the others of its matrix, below which it is constant."""


class MatrixHarmonics(NamedTuple):
    """Harmonics −`MAX_HARMONIC` … `MAX_HARMONIC` of a model's matrices, for V sets of parameters.

    Attributes
    ----------
    mechanics
        M, C and K (3, V, 7, n, n), complex.
    readings
        R^a, R^v and R^q (3, V, 7, m, n), complex.
    """

    mechanics: Complex
    readings: Complex


def matrix_harmonics(
    model: CompiledModel, parameters: Array, deflections: Array, rotor_speed: float, inputs: Array | None = None
) -> MatrixHarmonics:
    """The matrices of a model whose every degree of freedom has a load of its own.

    Parameters
    ----------
    parameters
        All parameters p, V sets (V, n_p).
    deflections
        Working points (V, n).
    rotor_speed
        Ω [rad/s].
    inputs
        The inputs u (n_u,) but for azimuth and speed; zeros by default.
    """
    n, m = len(model.states) // 2, model.readings
    sets = len(parameters)
    u = np.zeros(len(model.inputs)) if inputs is None else np.array(inputs, dtype=np.float64)
    where = -1
    if "rotor_azimuth" in model.inputs:
        where = model.inputs.index("rotor_azimuth")
        u[model.inputs.index("rotor_speed")] = rotor_speed
    points = AZIMUTH_COUNT if where >= 0 and rotor_speed != 0.0 else 1
    rates = np.zeros((sets, points, n, 2 * n)), np.zeros((sets, points, n, n))
    seen = np.zeros((sets, points, m, 2 * n)), np.zeros((sets, points, m, n))
    columns = 2 * n, len(model.identified), n
    _sweep()(
        _pointer(model.rates_jacobian), _pointer(model.reading_jacobian),
        np.ascontiguousarray(parameters, dtype=np.float64), np.ascontiguousarray(deflections, dtype=np.float64),
        u, where, *rates, *seen,
        *(np.zeros(size) for size in (2 * n, 2 * n, m, n, (n, n + 1))),
        *(np.zeros((rows, size)) for rows in (2 * n, m) for size in columns),
    )  # fmt: skip
    mass = np.linalg.inv(rates[1])
    by_state = -mass @ rates[0]
    by_acceleration = seen[1] @ mass
    direct = seen[0] - by_acceleration @ rates[0]
    mechanics = np.stack([mass, by_state[..., n:], by_state[..., :n]])
    readings = np.stack([by_acceleration, direct[..., n:], direct[..., :n]])
    found = MatrixHarmonics(_series(mechanics), _series(readings))
    sizes = element_sizes(MatrixHarmonics(found.mechanics[:, :1], found.readings[:, :1]))
    return MatrixHarmonics(
        *(without_rounding(X, MAX_RELATIVE_ROUNDING * size) for X, size in zip(found, sizes, strict=True))
    )


@lru_cache(maxsize=16)
def affine_matrices(
    model: CompiledModel, given: tuple[float, ...], steps: tuple[tuple[int, float], ...], rotor_speed: float,
    inputs: tuple[float, ...],
) -> tuple[Array, MatrixHarmonics, MatrixHarmonics] | None:  # fmt: skip
    """Coefficients (n,), the matrices there, one set, and their derivatives, n sets, from one step of each (place among
    all parameters, size); None where two steps of all together, up and down, each by another share of its size, show
    that they are not affine."""
    n, (places, sizes) = len(steps), (np.array(part) for part in zip(*steps, strict=True))
    shares = np.vstack([0.2 + np.sqrt(np.arange(2, n + 2)) % 0.7, -0.1 - np.sqrt(np.arange(3, n + 3)) % 0.7])
    points = np.tile(np.array(given), (n + 3, 1))
    points[1:, places] += np.vstack([np.eye(n), shares]) * sizes
    found = matrix_harmonics(model, points, np.zeros((n + 3, len(model.states) // 2)), rotor_speed, np.array(inputs))
    first, slopes = MatrixHarmonics(*(X[:, :1] for X in found)), []
    for X, size in zip(found, element_sizes(first), strict=True):
        change = without_rounding(X[:, 1:] - X[:, :1], MIN_RELATIVE_CHANGE * size)
        off = change[:, n:] - np.einsum("kn,xn...->xk...", shares, change[:, :n])
        if not (np.abs(off) <= 2.0 * MIN_RELATIVE_CHANGE * size).all():
            return None
        slopes.append(change[:, :n] / sizes[:, None, None, None])
    return points[0, places], first, MatrixHarmonics(*slopes)


def element_sizes(matrices: MatrixHarmonics) -> tuple[Array, Array]:
    """Size of an element relative to the largest of its matrix, or of its row of readings, in
    coordinates of unit mass: (3, V, 1, n, n) and (3, V, 1, m, n)."""
    mechanics, readings = np.abs(matrices.mechanics), np.abs(matrices.readings)
    unit = np.sqrt(np.einsum("vii->vi", mechanics[0, :, MAX_HARMONIC]))[None, :, None, None, :]
    both = unit * np.swapaxes(unit, -1, -2)
    of_matrix = (mechanics / both).max(axis=(2, 3, 4), keepdims=True) * both
    of_row = (readings / unit).max(axis=(2, 4), keepdims=True) * unit
    rates = (of_matrix / of_matrix[:1])[:, :, :, :1, :1]  # a reading of the acceleration holds C q̇ and K q, too
    return of_matrix, np.maximum(of_row, rates * of_row[:1])


def without_rounding(matrices: Complex, least: Array) -> Complex:
    """The matrices with elements smaller than `least` set to zero, so that they are not multiplied."""
    return np.asarray(np.where(np.abs(matrices) < least, 0.0, matrices))


def coupled(matrices: Complex, base: Array, orders: NDArray[np.intp], rotor_hz: float) -> Complex:
    """−ω² X_a + iω X_v + X_q of matrices X (3, 7, r, n) between all harmonics, (B, 2K+1, r, 2K+1, n), at base
    frequencies (B,) [Hz]."""
    rows, columns = matrices.shape[2:]
    out = np.zeros((len(base), len(orders), rows, len(orders), columns), dtype=np.complex128)
    frequency = 2.0 * np.pi * (base[:, None] + rotor_hz * orders)
    _coupler()(np.ascontiguousarray(matrices), frequency, out)
    return out


@lru_cache(maxsize=1)
def _coupler() -> Any:
    """The compiled loops of `coupled`."""
    return compiled(
        _couple, types.void(types.complex128[:, :, :, ::1], types.float64[:, ::1], types.complex128[:, :, :, :, ::1])
    )


def _couple(matrices: Any, frequency: Any, out: Any) -> None:
    bins, count = frequency.shape
    rows, columns = matrices.shape[2], matrices.shape[3]
    for h in range(matrices.shape[1]):
        shift = h - MAX_HARMONIC
        for i in range(rows):
            for j in range(columns):
                a, v, q = matrices[0, h, i, j], matrices[1, h, i, j], matrices[2, h, i, j]
                if a == 0.0 and v == 0.0 and q == 0.0:
                    continue
                for b in range(bins):
                    for k in range(max(0, -shift), min(count, count - shift)):
                        s = 1j * frequency[b, k]
                        out[b, k + shift, i, k, j] = (s * a + v) * s + q


def _series(values: Array) -> Complex:
    """Harmonics of matrices (…, P, r, c) over P azimuths: (…, 7, r, c)."""
    points = values.shape[-3]
    if points == 1:
        out = np.zeros((*values.shape[:-3], 2 * MAX_HARMONIC + 1, *values.shape[-2:]), dtype=np.complex128)
        out[..., MAX_HARMONIC, :, :] = values[..., 0, :, :]
        return out
    found = np.fft.fft(values, axis=-3) / points
    return np.asarray(np.take(found, np.arange(-MAX_HARMONIC, MAX_HARMONIC + 1) % points, axis=-3))


class _Pointer(types.WrapperAddressProtocol):  # type: ignore[misc]
    """A kernel as its address, which Numba otherwise looks up at every call, at the price of a hundred of them."""

    def __init__(self, kernel: Any) -> None:
        made = kernel.get_compile_result(JACOBIAN)
        self._kernel, self._address = kernel, made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)

    def __wrapper_address__(self) -> int:
        return int(self._address)

    def signature(self) -> Any:
        return JACOBIAN


@lru_cache(maxsize=64)
def _pointer(kernel: Any) -> _Pointer:
    import numba.experimental.function_type  # noqa: F401  # tells Numba what an address is

    return _Pointer(kernel)


@lru_cache(maxsize=1)
def _sweep() -> Any:
    """The compiled loop over parameters and azimuths, one for all models, called without Numba's search for the types
    of its arguments, which takes longer."""
    model, real4 = types.FunctionType(JACOBIAN), types.float64[:, :, :, ::1]
    vector, matrix = types.float64[::1], types.float64[:, ::1]
    signature = types.void(
        model, model, matrix, matrix, vector, types.int64, real4, real4, real4, real4,
        vector, vector, vector, vector, matrix, matrix, matrix, matrix, matrix, matrix, matrix,
    )  # fmt: skip
    return compiled(_sweep_azimuth, signature, borrows=True).get_compile_result(signature).entry_point


@pasted
def _solve(system: Any, out: Any) -> None:
    """out (n,) ← the solution of the equations whose matrix and right side are `system` (n, n+1), which it changes."""
    n = len(out)
    for i in range(n):
        pivot = i
        for row in range(i + 1, n):
            if abs(system[row, i]) > abs(system[pivot, i]):
                pivot = row
        for c in range(i, n + 1):
            system[i, c], system[pivot, c] = system[pivot, c], system[i, c]
        for row in range(i + 1, n):
            factor = system[row, i] / system[i, i]
            for c in range(i + 1, n + 1):
                system[row, c] -= factor * system[i, c]
    for i in range(n - 1, -1, -1):
        total = system[i, n]
        for c in range(i + 1, n):
            total -= system[i, c] * out[c]
        out[i] = total / system[i, i]


def _sweep_azimuth(
    rates: Any, reading: Any, parameters: Any, deflections: Any, u: Any, where: int,
    by_state: Any, by_load: Any, seen_state: Any, seen_load: Any,
    x: Any, value: Any, y: Any, w: Any, system: Any, A: Any, B: Any, G: Any, C: Any, D: Any, E: Any,
) -> None:  # fmt: skip
    sets, points, n, width = by_state.shape
    for v in range(sets):
        for i in range(n):
            x[i] = deflections[v, i]
        for point in range(points):
            if points > 1:
                u[where] = 2.0 * np.pi * point / points
            for i in range(n):
                w[i] = 0.0
            rates(x, u, parameters[v], w, value, A, B, G)
            for i in range(n):  # what holds the working point
                for j in range(n):
                    system[i, j] = G[n + i, j]
                system[i, n] = -value[n + i]
            _solve(system, w)
            rates(x, u, parameters[v], w, value, A, B, G)
            reading(x, u, parameters[v], w, y, C, D, E)
            for i in range(n):
                for j in range(width):
                    by_state[v, point, i, j] = A[n + i, j]
                for j in range(n):
                    by_load[v, point, i, j] = G[n + i, j]
            for i in range(seen_state.shape[2]):
                for j in range(width):
                    seen_state[v, point, i, j] = C[i, j]
                for j in range(n):
                    seen_load[v, point, i, j] = E[i, j]


def equal_lag(freedoms: Sequence[Coordinate], lag: float) -> Array:
    """The working point (n,) at which every blade leads by `lag` [rad]."""
    return np.array([lag if freedom.blade else 0.0 for freedom in freedoms])
