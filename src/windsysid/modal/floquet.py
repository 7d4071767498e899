"""Floquet's theory: the modes of a linear system whose matrix repeats, ẋ = A(t) x with A(t + T) = A(t).

Its solutions are e^{λt} p(t) with p(t + T) = p(t). The multipliers e^{λT} are the eigenvalues of the monodromy matrix
X(T), Ẋ = A X, X(0) = 1, which Gauss's collocation of order 12 propagates, all steps at once. The imaginary part of λ is
known but for multiples of Ω = 2π/T, since a harmonic of p may be moved into the exponential; that multiple is taken
that leaves the largest harmonic of p standing still (`resolve`). A nonlinear system ẋ = f(t, x) is linearised about its
periodic solution (`about_periodic_motion`).

Source: Yakubovich & Starzhinskii, Linear Differential Equations with Periodic Coefficients (Wiley 1975); Skjoldan &
Hansen, J. Sound and Vibration 328 (2009), https://doi.org/10.1016/j.jsv.2009.07.023 (participation); Hairer, Lubich &
Wanner, Geometric Numerical Integration (2nd ed. 2006), ch. II.1.3 (collocation).
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError

__all__ = ["FloquetModes", "about_periodic_motion", "floquet", "interpolate", "resolve", "steps_needed"]


STAGES = 6
"""Of Gauss's collocation: order 12."""

MIN_STEPS = 24
"""In a period, however slow the system."""

MAX_STEPS = 4000
"""In a period: a turn that takes longer is too slow."""

MAX_STEP_EIGENVALUE = 1.0
"""Step times the largest eigenvalue of A: the error of a step is then about 2e-13."""

MIN_MULTIPLIER_RATIO = 1e-11
"""A multiplier that much smaller than the largest has drowned in rounding errors."""


class FloquetModes(NamedTuple):
    """Modes of a periodic system of n states: all of them, complex ones in conjugate pairs.

    Attributes
    ----------
    exponents
        λ (n,), imaginary parts within ±Ω/2.
    time
        (K,) [s], equally spaced over a period, the end left out.
    shapes
        p(t) (K, n, n): a column for each mode.
    """

    exponents: Complex
    time: Array
    shapes: Complex

    @property
    def rows(self) -> Complex:
        """The inverse of `shapes` (K, n, n): a row for each mode."""
        try:
            return np.asarray(np.linalg.inv(self.shapes))
        except np.linalg.LinAlgError:  # two modes that are one
            return np.asarray(np.linalg.pinv(self.shapes))

    def response(self, push: Array) -> Array:
        """Periodic solution (K, n, m) of ẋ = A(t) x + u for the input u (K, n, m).

        Each mode answers each harmonic by 1/(ikΩ − λ).
        """
        K = len(self.time)
        modal = np.fft.fft(self.rows @ push, axis=0)
        harmonic = np.fft.fftfreq(K, 1.0 / K) * 2.0 * math.pi / (K * (self.time[1] - self.time[0]))
        modal /= (1j * harmonic[:, None] - self.exponents)[:, :, None]
        return np.asarray((self.shapes @ np.fft.ifft(modal, axis=0)).real)


def floquet(system: Callable[[Array], Array], period: float, steps: int | None = None) -> FloquetModes:
    """Exponents and periodic shapes of ẋ = A(t) x.

    Parameters
    ----------
    system
        Gives A (K, n, n) at times (K,) [s].
    period
        T [s].
    steps
        K; as many as the largest eigenvalue of A requires by default.

    Raises
    ------
    ConfigurationError
        If a mode dies out within a period, so that nothing of it is left to see, or a period holds more than
        `MAX_STEPS` steps.
    """
    time, fundamental = _fundamental(system, period, steps or steps_needed(system, period))
    multipliers, vectors = np.linalg.eig(fundamental[-1])
    if np.abs(multipliers).min() < MIN_MULTIPLIER_RATIO * max(1.0, float(np.abs(multipliers).max())):
        raise ConfigurationError(
            f"a vibration dies out within a single turn of {period:.3g} s, too slow a turn for Floquet's theory: choose"
            " a higher rotor speed"
        )
    exponents = np.asarray(np.log(multipliers.astype(np.complex128)) / period, dtype=np.complex128)
    shapes = np.exp(-exponents * time[:, None, None]) * (fundamental[:-1] @ vectors)
    return FloquetModes(exponents, time, shapes)


def steps_needed(system: Callable[[Array], Array], period: float) -> int:
    """Steps for an error of about 1e-12 in a period.

    Raises
    ------
    ConfigurationError
        If they are more than `MAX_STEPS`.
    """
    samples = system(np.arange(8.0) * (period / 8.0))
    fastest = max(float(np.abs(np.linalg.eigvals(A)).max()) for A in samples)
    if fastest * period > MAX_STEPS * MAX_STEP_EIGENVALUE:
        raise ConfigurationError(
            f"a turn of {period:.3g} s holds {fastest * period / (2.0 * math.pi):.3g} vibrations, too slow a turn for"
            " Floquet's theory: choose a higher rotor speed"
        )
    return max(MIN_STEPS, math.ceil(fastest * period / MAX_STEP_EIGENVALUE))


def about_periodic_motion(
    rates: Callable[[Array, Array], tuple[Array, Array]], period: float, states: int
) -> tuple[Array, FloquetModes]:
    """The periodic solution x (K, n) of ẋ = f(t, x) near zero, and the modes about it.

    Newton's method whose matrix is renewed only where it converges slowly: the modes about zero already tell how the
    system answers a push.

    Parameters
    ----------
    rates
        Gives f (K, n) and ∂f/∂x (K, n, n) at times (K,) [s] and states (K, n).
    period
        T [s].
    states
        n.

    Raises
    ------
    ConfigurationError
        If there is none to be found: at an undamped resonance with its own forcing, for instance. As `floquet`.
    """

    def along(x: Array) -> Callable[[Array], Array]:
        return lambda time: rates(time, interpolate(x, 2.0 * math.pi / period * time))[1]

    x = np.zeros((1, states))
    least = steps_needed(along(x), period)
    for steps in (least, 2 * least, 4 * least, 8 * least):
        x = interpolate(x, 2.0 * math.pi / steps * np.arange(float(steps)))
        found = _iterate_periodic_motion(rates, along, x, period)
        if found is None:
            break
        x, modes, resolved = found
        if resolved:
            return x, modes
    raise ConfigurationError(
        "no periodic motion of the rotor was found: gravity meets an undamped mode, or deflections are too large;"
        " choose another rotor speed, or check the damping"
    )


def _iterate_periodic_motion(
    rates: Callable[[Array, Array], tuple[Array, Array]],
    along: Callable[[Array], Callable[[Array], Array]],
    x: Array,
    period: float,
) -> tuple[Array, FloquetModes, bool] | None:
    """Newton's iteration on the grid of x (K, n); None where it does not converge.

    Returns the motion, its modes, and whether the grid resolves it.
    """
    steps = len(x)
    modes = floquet(along(x), period, steps)
    before = math.inf
    for _ in range(50):
        push = rates(modes.time, x)[0] - _rate(x, period)
        with np.errstate(all="ignore"):
            correction = _smooth(modes.response(push[:, :, None])[:, :, 0])
        size, reached = float(np.abs(correction).max()), float(np.abs(x).max())
        if size <= 1e-13 + 1e-11 * reached:
            resolved = (
                float(np.abs(np.fft.fft(x, axis=0)[steps // 3 - 1 : steps // 3 + 1]).max()) / steps
                <= 1e-13 + 1e-10 * reached
            )
            return x, modes if before == math.inf else floquet(along(x), period, steps), resolved
        if not size < 1e3:
            return None
        x = x + correction
        if size > 0.1 * before:
            modes = floquet(along(x), period, steps)
        before = size
    return None


def resolve(shapes: Complex, weights: Array) -> tuple[NDArray[np.int64], Complex]:
    """The multiple of Ω by which each exponent is to be raised, and the shape that is left.

    Parameters
    ----------
    shapes
        p(t) (K, n, m), equally spaced over a period.
    weights
        (n,): of |p|² in what a harmonic takes part; masses, for instance.

    Returns
    -------
    multiples, standing
        (m,); (n, m), the harmonic of largest participation.
    """
    harmonics = np.fft.fft(shapes, axis=0) / len(shapes)
    participation = np.einsum("knm,n->km", np.abs(harmonics) ** 2, weights)
    largest = np.argmax(participation, axis=0)
    multiples = np.rint(np.fft.fftfreq(len(shapes), 1.0 / len(shapes))).astype(np.int64)[largest]
    return multiples, harmonics[largest, :, np.arange(shapes.shape[2])].T


def interpolate(values: Array, phase: Array) -> Array:
    """The trigonometric polynomial through equally spaced values (K, n) of a turn, at phases (M,) [rad]: (M, n)."""
    K = len(values)
    harmonics, order = np.fft.fft(values, axis=0) / K, np.fft.fftfreq(K, 1.0 / K)
    size = np.abs(harmonics).max(axis=1)
    seen = size > 1e-17 * size.max()  # a smooth motion has few
    return np.asarray((np.exp(1j * np.outer(phase, order[seen])) @ harmonics[seen]).real)


def _rate(values: Array, period: float) -> Array:
    """Time derivative of the same polynomial at its points (K, n)."""
    K = len(values)
    order = np.fft.fftfreq(K, 1.0 / K)[:, None]
    order[np.abs(order) == K / 2] = 0.0
    return np.asarray(np.fft.ifft(2j * math.pi / period * order * np.fft.fft(values, axis=0), axis=0).real)


def _smooth(values: Array) -> Array:
    """Without the harmonics that products on the same points would alias into (K, n)."""
    K = len(values)
    order = np.fft.fftfreq(K, 1.0 / K)[:, None]
    return np.asarray(np.fft.ifft(np.where(np.abs(order) <= K / 3, np.fft.fft(values, axis=0), 0.0), axis=0).real)


def _fundamental(system: Callable[[Array], Array], period: float, steps: int) -> tuple[Array, Array]:
    """Times (K,) and X (K + 1, n, n) there and at the end of the period."""
    node, integral, weight = _gauss()
    h = period / steps
    time = h * np.arange(float(steps))
    A = system((time[:, None] + h * node).ravel())
    n = A.shape[-1]
    A = A.reshape(steps, STAGES, n, n)
    matrix = -h * np.einsum("ij,kiab->kiajb", integral, A).reshape(steps, STAGES * n, STAGES * n)
    matrix += np.eye(STAGES * n)
    slopes = np.linalg.solve(matrix, A.reshape(steps, STAGES * n, n)).reshape(steps, STAGES, n, n)
    propagators = np.eye(n) + h * np.einsum("i,kiab->kab", weight, slopes)
    X = np.empty((steps + 1, n, n))
    X[0] = np.eye(n)
    for k in range(steps):
        X[k + 1] = propagators[k] @ X[k]
    return time, X


@lru_cache(maxsize=1)
def _gauss() -> tuple[Array, Array, Array]:
    """Gauss's nodes on (0, 1), the integrals of their cardinal polynomials up to each node (s, s), and up to 1."""
    legendre = np.polynomial.legendre
    node, weight = legendre.leggauss(STAGES)
    values = legendre.legvander(node, STAGES - 1)
    integrals = np.column_stack([legendre.legval(node, legendre.legint(row, lbnd=-1)) for row in np.eye(STAGES)])
    return 0.5 * (node + 1.0), 0.5 * integrals @ np.linalg.inv(values), 0.5 * weight
