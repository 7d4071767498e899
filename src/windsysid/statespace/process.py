"""Stationary random processes with rational spectra, and their copies put somewhere."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError

__all__ = [
    "LoadBlock", "PlacedProcess", "Process", "discretise_block", "first_order", "load_on", "place_copies", "rational",
    "second_order",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class LoadBlock:
    """Stationary linear process that drives one or several loads.

    Attributes
    ----------
    states
        Names of its n states, different from those of other blocks.
    drift
        A (n, n) [1/s], all eigenvalues in the left half plane.
    cov
        Stationary covariance P (n, n).
    outputs
        For each load that it drives, the rows of H(ψ) (1 + 2K, n); see `LoadModel`.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> pole, rms = -2.0, 1e3  # [1/s], [N]
    >>> block = ws.models.LoadBlock(("gust",), np.array([[pole]]), np.array([[rms**2]]), {"load_x": np.ones((1, 1))})
    >>> block.discretise(0.5)[0].round(3).tolist()
    [[0.368]]
    """

    states: tuple[str, ...]
    drift: Array
    cov: Array
    outputs: Mapping[str, Array]

    def __post_init__(self) -> None:
        n, what = len(self.states), "/".join(self.states)
        for word, array in (("drift", self.drift), ("covariance", self.cov)):
            if np.shape(array) != (n, n) or not np.isfinite(array).all():
                raise ConfigurationError(f"load '{what}': expected a finite {word} {n} × {n}, got {np.shape(array)}")
        for load, rows in self.outputs.items():
            shape = np.shape(rows)
            if len(shape) != 2 or shape[1] != n or shape[0] % 2 == 0 or not np.isfinite(rows).all():
                raise ConfigurationError(
                    f"load '{what}' on '{load}': expected finite rows H₀, C₁, S₁ … of {n} numbers, got shape {shape}"
                )
        poles = self._poles
        if poles.size and poles.real.max() >= 0.0:
            raise ConfigurationError(f"load '{what}': expected a block that returns to its mean, got poles {poles}")

    @cached_property
    def _poles(self) -> NDArray[np.complex128]:
        return np.asarray(np.linalg.eigvals(self.drift), dtype=np.complex128)

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` [s], exact."""
        return discretise_block(np.asarray(self.drift, dtype=np.float64), self.cov, step)


class Process(NamedTuple):
    """A scalar stationary process v = c z, dz = A z dt + noise.

    Attributes
    ----------
    drift, cov
        A and the stationary covariance of z (n, n).
    value
        c (n,).
    """

    drift: Array
    cov: Array
    value: Array

    @property
    def variance(self) -> float:
        """Of v."""
        return float(self.value @ self.cov @ self.value)

    def times(self, factor: float) -> "Process":
        """The process times a factor."""
        return self._replace(cov=factor**2 * self.cov)

    def spectrum(self, frequency: ArrayLike) -> Array:
        """Two-sided power spectral density at frequencies [Hz]: its integral from −∞ to ∞ is the variance."""
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency, dtype=np.float64))
        resolvent = np.linalg.solve(s[:, None, None] * np.eye(len(self.value)) - self.drift, self.cov @ self.value)
        return np.asarray(2.0 * (resolvent @ self.value).real)


def first_order(rms: float, time_constant: float) -> Process:
    """Correlation rms² exp(−|t| / time_constant)."""
    return rational(rms, [-1.0 / time_constant])


def second_order(rms: float, frequency: float, damping: float) -> Process:
    """White noise through a second-order low-pass with natural frequency [Hz] and damping ratio.

    S(f) ∝ 1 / |1 − (f/f₀)² + 2iζ f/f₀|².
    """
    w = 2.0 * np.pi * frequency
    root = w * np.sqrt(complex(damping**2 - 1.0))
    return rational(rms, [-damping * w + root, -damping * w - root])


def rational(rms: float, poles: ArrayLike, zeros: ArrayLike = ()) -> Process:
    """A process with S(ω) ∝ Π|iω − zero|² / Π|iω − pole|².

    Parameters
    ----------
    rms
        Its standard deviation.
    poles, zeros
        [rad/s], fewer zeros than poles, all poles in the left half plane, complex ones in pairs.

    Raises
    ------
    ConfigurationError
        If poles or zeros are not as they must be, or the rms is not positive.

    Notes
    -----
    Companion form in units of the poles' geometric mean frequency; P from Lyapunov's equation.
    """
    given, of_zeros = (
        tuple(np.atleast_1d(np.asarray(roots, dtype=np.complex128)).tolist()) for roots in (poles, zeros)
    )
    shape = _shape(given, of_zeros)
    if shape is None or not (math.isfinite(rms) and rms > 0.0):
        raise ConfigurationError(
            "rational spectrum: expected a positive rms, poles in the left half plane and fewer zeros, in pairs,"
            f" got rms {rms}, poles {np.array(given)}, zeros {np.array(of_zeros)}"
        )
    return shape.times(rms / math.sqrt(shape.variance))


@lru_cache(maxsize=4096)
def _shape(given: tuple[complex, ...], of_zeros: tuple[complex, ...]) -> Process | None:
    """`rational` of whatever rms; None where poles or zeros are not as they must be.

    Kept, since the thousands of models of a search differ in levels and coefficients much more often than in
    poles and zeros.
    """
    poles, zeros = np.array(given, dtype=np.complex128), np.array(of_zeros, dtype=np.complex128)
    paired = all(
        abs(np.poly(roots).imag).max() <= 1e-9 * abs(np.poly(roots)).max() for roots in (poles, zeros) if roots.size
    )
    finite = bool(np.isfinite([*poles, *zeros]).all())
    if not (finite and paired and len(zeros) < len(poles) and (poles.real < 0.0).all()):
        return None
    n, unit = len(poles), float(np.exp(np.mean(np.log(np.abs(poles)))))
    denominator = np.poly(poles / unit).real
    drift = unit * np.eye(n, k=1)
    drift[-1] = -unit * denominator[:0:-1]
    cov = np.diag(denominator[-1] ** np.arange(n)) if n <= 2 else _stationary(drift)
    value = np.zeros(n)
    value[: len(zeros) + 1] = np.atleast_1d(np.poly(zeros / unit)).real[::-1]
    for array in (drift, cov, value):
        array.flags.writeable = False  # shared by all callers with this shape
    return Process(drift, cov, value)


@dataclass(frozen=True)
class PlacedProcess:
    """Independent copies of a process, and their loads.

    Attributes
    ----------
    states
        Names of its states, those of one copy after those of another.
    process
        The process.
    rows
        For each copy, the rows H₀, C₁, S₁ … (1 + 2K,) of what its value drives.
    """

    states: tuple[str, ...]
    process: Process
    rows: Sequence[Mapping[str, Array]]

    @property
    def cov(self) -> Array:
        """Stationary covariance (n, n)."""
        return self._copied(self.process.cov)

    @property
    def outputs(self) -> Mapping[str, Array]:
        """See `LoadModel`."""
        n, found = len(self.process.value), {}
        for load in dict.fromkeys(load for rows in self.rows for load in rows):
            found[load] = np.zeros((max(len(rows.get(load, ())) for rows in self.rows), len(self.states)))
            for k, rows in enumerate(self.rows):
                if load in rows:
                    found[load][: len(rows[load]), k * n : (k + 1) * n] = rows[load][:, None] * self.process.value
        return found

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` [s], exact."""
        transition, noise = discretise_block(self.process.drift, self.process.cov, step)
        return self._copied(transition), self._copied(noise)

    def _copied(self, matrix: Array) -> Array:
        n = len(matrix)
        whole = np.zeros((len(self.states),) * 2)
        for k in range(len(self.rows)):
            whole[k * n : (k + 1) * n, k * n : (k + 1) * n] = matrix
        return whole


def load_on(load: str, process: Process) -> PlacedProcess:
    """A process on one degree of freedom."""
    return place_copies(load, process, [{load: np.ones(1)}])


def place_copies(name: str, process: Process, rows: Sequence[Mapping[str, Array]]) -> PlacedProcess:
    """Copies of a process under a name."""
    order = ("",) if len(process.value) == 1 else tuple(f"_{k}" for k in range(len(process.value)))
    phases = ("", "_sine")[: len(rows)]
    return PlacedProcess(tuple(f"{name}{phase}{k}" for phase in phases for k in order), process, rows)


def discretise_block(drift: Array, cov: Array, step: float) -> tuple[Array, Array]:
    """exp(A h) and P − exp(A h) P exp(A h)ᵀ."""
    transition = _exponential(drift * step)
    noise = cov - transition @ cov @ transition.T
    return transition, 0.5 * (noise + noise.T)


def _exponential(A: Array) -> Array:
    """exp(A), kept like `_shape`."""
    return _exponential_of(np.ascontiguousarray(A).tobytes(), len(A))


@lru_cache(maxsize=4096)
def _exponential_of(content: bytes, n: int) -> Array:
    """exp(A) of a matrix (n, n), for two states by Cayley and Hamilton (`_exponential_of_two`)."""
    A = np.frombuffer(content).reshape(n, n)
    if n > 2:
        from scipy.linalg import expm

        found = np.asarray(expm(A), dtype=np.float64)
    else:
        found = np.asarray(np.exp(A) if n == 1 else _exponential_of_two(A), dtype=np.float64)
    found.flags.writeable = False
    return found


def _exponential_of_two(A: Array) -> Array:
    """exp(A) = e^μ (cosh δ I + sinh δ/δ (A − μ I)), μ = tr A/2, δ² = μ² − det A.

    The factors are formed from e^(μ + δ) and e^(μ − δ): with μ = −1000 and δ = 999, e^μ is zero and cosh δ infinite,
    but their product is not. Of real eigenvalues the smaller one is det A over the larger one, without cancellation.
    """
    mean = 0.5 * (A[0, 0] + A[1, 1])
    determinant = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    root = np.sqrt(complex(mean**2 - determinant))
    far = mean + (root if mean > 0.0 else -root)
    near = determinant / far if root.real > 0.0 and far != 0.0 else 2.0 * mean - far
    upper, lower = (far, near) if mean > 0.0 else (near, far)
    width = upper - lower
    slope = -np.exp(upper) * np.expm1(-width) / width if abs(root) > 1e-8 else np.exp(mean) + 0.0j
    even = 0.5 * (np.exp(upper) + np.exp(lower))
    return np.asarray(even.real * np.eye(2) + slope.real * (A - mean * np.eye(2)))


def _stationary(drift: Array) -> Array:
    """P of white noise that enters the last state."""
    from scipy.linalg import solve_continuous_lyapunov

    noise = np.zeros_like(drift)
    noise[-1, -1] = 1.0
    cov = np.asarray(solve_continuous_lyapunov(drift, -noise), dtype=np.float64)
    return np.asarray(0.5 * (cov + cov.T), dtype=np.float64)
