r"""Acceleration to velocity and displacement without drift, by four named methods with one meaning of `cutoff`.

An accelerometer knows nothing below some frequency: what it reads there is bias, drift, tilt and noise, and dividing
by −ω² makes that large. Every method but the first therefore gives the motion above a cut-off f_c, all with the
zero-phase gain of a fourth-order Butterworth high-pass run both ways, (f/f_c)⁸ / (1 + (f/f_c)⁸).

``cumulative``
    the trapezoidal rule twice, the mean taken out; the thing to beat.
``high-pass``
    the trapezoidal rule, each time followed by a Butterworth high-pass forward and backward.
``frequency``
    division by iω of the record continued by its odd reflection. Exact inside; at the ends the reflection makes an
    acceleration that jumps, and that rings for some periods of f_c.
``kalman`` (the default)
    the smoother of the chain p⁗ = a. The measured acceleration drives it, with white noise of density q; that the
    second integral p of the displacement stays at zero is measured all the time, with white noise of density r. Its
    stationary answer minimises ∫ (p⁗ − a)²/q + p²/r dt, that is

        p̂(ω) (ω⁸/q + 1/r) = ω⁴ â(ω)/q,     x̂ = p̈:   x̂(ω) = −â/ω² · ω⁸/(ω⁸ + q/r),

    the same gain with q/r = ω_c⁸. At the ends and at gaps no continuation is made up: initial state, bias and
    slope of the accelerometer are unknowns, solved for. That velocity and displacement drift unless something is
    said about displacement, and the pseudo-measurement that says it, are from Chatzi & Fuggini 2015,
    doi:10.12989/sss.2015.16.2.295 (there on x, here two integrals deeper, for a steeper cut-off); the smoother in the
    form of Bryson & Frazier, the unknowns by generalised least squares on the innovations (Rosenberg 1973; de Jong
    1991, doi:10.1214/aos/1176348139).
"""

from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.signals.band import bridged, check_cutoff, high_pass_gain, through

__all__ = ["GRAVITY", "METHODS", "Method", "Motion", "integrate"]

Method = Literal["cumulative", "high-pass", "frequency", "kalman"]

METHODS: tuple[Method, ...] = get_args(Method)

GRAVITY = 9.80665  # m/s²

_ORDER = 4  # integrations from acceleration to p
_DIFFUSE = 1e4  # prior variance of what is unknown, against a posterior near 1
_QUIET = 0.05  # noise of a sample as a share of the signal, where the caller names none


class Motion(NamedTuple):
    """Velocity and displacement of one channel, about zero.

    Attributes
    ----------
    velocity
        (T,) [m/s or rad/s].
    displacement
        (T,) [m or rad].
    """

    velocity: Array
    displacement: Array


def integrate(
    acceleration: ArrayLike,
    rate: float,
    *,
    cutoff: float,
    method: Method = "kalman",
    noise: float | None = None,
    roll_per_metre: float = 0.0,
) -> Motion:
    """Integrate acceleration to velocity and displacement without drift, with zero phase.

    Parameters
    ----------
    acceleration : array_like
        (T,) [m/s² or rad/s²]; NaN = missing, bridged for the others and missing in the result.
    rate : float
        Sampling rate [Hz].
    cutoff : float
        Frequency [Hz] below which motion is removed (half the amplitude at the cut-off). Half of the lowest frequency
        of interest, rotor or mode, is a good choice. ``cumulative`` does not use it.
    method : {"kalman", "frequency", "high-pass", "cumulative"}, default "kalman"
        Kalman smoother, division by iω, trapezoidal rule with a high-pass, or trapezoidal rule alone. The default is
        the most accurate in the table of docs/signals.md.
    noise : float, optional
        Standard deviation of one sample [m/s²], used by ``kalman`` only, for the weight of missing samples; a twentieth
        of the signal by default.
    roll_per_metre : float, default 0
        κ [rad/m] of an accelerometer that is sensitive to gravity and rolls with the tower's top by κ per metre of
        displacement: it reads a + g κ x. Only ``frequency`` and ``kalman`` can correct that. −0.0209 rad/m for the NREL
        5 MW tower, where it is 5 % of the displacement.

    Returns
    -------
    Motion
        Velocity and displacement (T,) each.

    Raises
    ------
    RecordError
        If the channel holds no numbers, the cut-off lies outside 0 … rate / 2, or an option is out of range.

    See Also
    --------
    causal_integrator : Integration of a stream.

    References
    ----------
    Chatzi & Fuggini, Smart Structures and Systems 16(2), 2015, doi:10.12989/sss.2015.16.2.295 (``kalman``).

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 60.0, 0.05)
    >>> acceleration = np.sin(2.0 * np.pi * 0.5 * time) + 0.3  # with a bias
    >>> motion = ws.signals.integrate(acceleration, rate=20.0, cutoff=0.1)
    >>> round(float(motion.displacement[400:800].max()), 4)  # 1 / (2π 0.5)² = 0.1013 m
    0.1013
    """
    check_cutoff(cutoff, rate)
    acceleration = np.asarray(acceleration, dtype=np.float64)
    if acceleration.ndim != 1 or len(acceleration) < 2:
        raise RecordError(f"acceleration: expected (T,) with T ≥ 2, got {acceleration.shape}")
    _check_options(method, cutoff, noise, roll_per_metre)
    missing = ~np.isfinite(acceleration)
    whole = bridged(acceleration, "of acceleration")
    whole = whole - whole.mean()
    if not whole.any():
        motion = Motion(np.zeros_like(whole), np.zeros_like(whole))
    elif method == "kalman":
        motion = _by_kalman(whole, missing, rate, cutoff, noise, roll_per_metre)
    elif method == "frequency":
        motion = _by_frequency(whole, rate, cutoff, roll_per_metre)
    elif method == "high-pass":
        motion = _by_high_pass(whole, rate, cutoff)
    else:
        motion = _by_trapezoids(whole, rate)
    for values in motion:
        values[missing] = np.nan
    return motion


def _check_options(method: str, cutoff: float, noise: float | None, roll_per_metre: float) -> None:
    if noise is not None and not (np.isfinite(noise) and noise > 0.0):
        raise RecordError(f"noise of the accelerometer: expected a positive number, got {noise:g} m/s²")
    if method not in METHODS:
        raise RecordError(f"method of integration: expected one of {', '.join(METHODS)}, got '{method}'")
    if roll_per_metre != 0.0 and method not in ("frequency", "kalman"):
        raise RecordError(f"roll_per_metre: the method '{method}' cannot undo gravity; use 'kalman' or 'frequency'")
    if not roll_per_metre * GRAVITY < 0.5 * (2.0 * np.pi * cutoff) ** 2:
        raise RecordError(
            f"roll_per_metre: at {cutoff:g} Hz gravity outweighs the acceleration; expected its sign as in the turbine"
            " file (kappa), or a higher cut-off"
        )


def _by_trapezoids(acceleration: Array, rate: float) -> Motion:
    velocity = _trapezoid(acceleration, rate)
    velocity = velocity - velocity.mean()
    displacement = _trapezoid(velocity, rate)
    return Motion(velocity, displacement - displacement.mean())


def _trapezoid(values: Array, rate: float) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) / rate


def _by_high_pass(acceleration: Array, rate: float, cutoff: float) -> Motion:
    from scipy.signal import butter, detrend, sosfiltfilt

    sos = butter(4, cutoff, "highpass", fs=rate, output="sos")
    pad = min(len(acceleration) - 1, int(2.0 * rate / cutoff))

    def passed(values: Array) -> Array:
        return np.asarray(sosfiltfilt(sos, detrend(values), padlen=pad), dtype=np.float64)

    velocity = passed(_trapezoid(detrend(acceleration), rate))
    return Motion(velocity, passed(_trapezoid(velocity, rate)))


def _by_frequency(acceleration: Array, rate: float, cutoff: float, roll_per_metre: float) -> Motion:
    """Division by iω is exact for sampled values; the trapezoidal rule loses (ω Δt)²/12 each time."""

    def displacement(f: Array) -> Any:
        squared = np.where(f > 0.0, 2.0 * np.pi * f, 1.0) ** 2  # at f = 0 the gain is 0 anyway
        return -high_pass_gain(f, cutoff) / (squared - GRAVITY * roll_per_metre) + 0j

    def velocity(f: Array) -> Any:
        return 2j * np.pi * f * displacement(f)

    pad = 2.0 / cutoff
    return Motion(through(acceleration, rate, velocity, pad), through(acceleration, rate, displacement, pad))


def _by_kalman(
    acceleration: Array, missing: NDArray[np.bool_], rate: float, cutoff: float, noise: float | None, kappa: float
) -> Motion:
    """The smoother, with time counted in 1/ω_c and acceleration in its own rms, so that q = r = 1."""
    omega = 2.0 * np.pi * cutoff
    scale = float(acceleration.std())
    step = omega / rate
    # Between samples the acceleration runs linearly, which loses (ω Δt)²/12; half of nothing is lost once that is put
    # back.
    curvature = np.zeros_like(acceleration)
    curvature[1:-1] = np.diff(acceleration, 2)
    inputs = np.column_stack(
        [
            (acceleration - curvature / 12.0) / scale,
            np.ones_like(acceleration),
            np.linspace(-1.0, 1.0, len(acceleration)),
        ]
    )
    transition, before, after, cov = _chain(step, GRAVITY * kappa / omega**2)
    worse = min((scale / noise if noise else 1.0 / _QUIET) ** 2, 1e8)
    inflation = 1.0 + 0.5 * worse * (missing[1:].astype(np.float64) + missing[:-1])
    samples = len(acceleration)
    smoothed = np.empty((samples, 2))
    _kernel()(inputs, inflation, transition, before, after, cov, 1.0 / step, _DIFFUSE, smoothed)
    return Motion(scale / omega * smoothed[:, 1], scale / omega**2 * smoothed[:, 0])


def _chain(step: float, gravity: float) -> tuple[Array, Array, Array, Array]:
    """p⁗ = a − γ p̈ over one step: Φ (4, 4), the gains of the acceleration before and after (4,) each, and Q (4, 4).

    The acceleration runs linearly over the step, its noise is white with density 1 (Van Loan 1978,
    doi:10.1109/TAC.1978.1101743, with the exponential written as its series, the step being short).
    """
    n = _ORDER
    chain = np.diag(np.ones(n - 1), 1)
    chain[n - 1, n - 2] = -gravity
    held = np.zeros((n + 2, n + 2))
    held[:n, :n] = chain
    held[n - 1, n] = held[n, n + 1] = 1.0
    held = _exponential(held * step)
    pair = np.zeros((2 * n, 2 * n))
    pair[:n, :n], pair[n:, n:] = -chain, chain.T
    pair[n - 1, 2 * n - 1] = 1.0
    pair = _exponential(pair * step)
    transition, after = held[:n, :n], held[:n, n + 1] / step
    cov = pair[n:, n:].T @ pair[:n, n:]
    return (
        np.ascontiguousarray(transition),
        held[:n, n] - after,
        np.ascontiguousarray(after),
        np.ascontiguousarray(0.5 * (cov + cov.T)),
    )


def _exponential(matrix: Array) -> Array:
    total = term = np.eye(len(matrix))
    for k in range(1, 60):
        term = term @ matrix / k
        total = total + term
    return total


@lru_cache(maxsize=1)
def _kernel() -> Any:
    from numba import types

    from windsysid.kernels.jit import compiled

    vector, matrix, real = types.float64[::1], types.float64[:, ::1], types.float64
    return compiled(_smooth, types.void(matrix, vector, matrix, vector, vector, matrix, real, real, matrix))


def _smooth(
    inputs: Any, inflation: Any, transition: Any, before: Any, after: Any, cov: Any, r: float, diffuse: float,
    smoothed: Any,
) -> None:  # fmt: skip
    """Forward: covariance, gain, and innovations of three inputs: acceleration, bias, slope. Then the two unknowns by
    least squares, and Bryson & Frazier's recursion backward. Writes p̈ and p⃛ (T, 2)."""
    samples, n, columns = inputs.shape[0], 4, 3
    gain = np.empty((samples, n))
    variance = np.empty(samples)
    innovation = np.empty((samples, columns))
    predicted = np.empty((samples, columns, 2))
    spread = np.empty((samples, 2, n))
    x, moved = np.zeros((columns, n)), np.zeros((columns, n))
    P, half = np.zeros((n, n)), np.zeros((n, n))
    normal = np.zeros((columns, columns))
    for i in range(n):
        P[i, i] = diffuse
    for k in range(samples):
        if k > 0:
            for i in range(n):
                for j in range(n):
                    half[i, j] = 0.0
                    for m in range(n):
                        half[i, j] += transition[i, m] * P[m, j]
            for i in range(n):
                for j in range(i + 1):
                    total = inflation[k - 1] * cov[i, j]
                    for m in range(n):
                        total += half[i, m] * transition[j, m]
                    P[i, j] = P[j, i] = total
            for c in range(columns):
                for i in range(n):
                    moved[c, i] = before[i] * inputs[k - 1, c] + after[i] * inputs[k, c]
                    for m in range(n):
                        moved[c, i] += transition[i, m] * x[c, m]
                for i in range(n):
                    x[c, i] = moved[c, i]
        s = P[0, 0] + r
        variance[k] = s
        for i in range(n):
            gain[k, i] = P[i, 0] / s
            for a in range(2):
                spread[k, a, i] = P[2 + a, i]
        for c in range(columns):
            innovation[k, c] = -x[c, 0]
            for a in range(2):
                predicted[k, c, a] = x[c, 2 + a]
            for b in range(c + 1):
                normal[c, b] += innovation[k, c] * innovation[k, b] / s
        for c in range(columns):
            for i in range(n):
                x[c, i] += gain[k, i] * innovation[k, c]
        for i in range(n):
            for j in range(i + 1):
                P[i, j] -= gain[k, i] * P[j, 0] if j > 0 else 0.0
        for i in range(n):  # Joseph's form for a reading of the first state: column 0 shrinks by r / s
            P[i, 0] = gain[k, i] * r
            for j in range(i + 1):
                P[j, i] = P[i, j]
    # bias and slope, with a wide prior
    a11, a22, a12 = normal[1, 1] + 1.0 / diffuse, normal[2, 2] + 1.0 / diffuse, normal[2, 1]
    det = a11 * a22 - a12 * a12
    bias = (a22 * normal[1, 0] - a12 * normal[2, 0]) / det
    slope = (a11 * normal[2, 0] - a12 * normal[1, 0]) / det
    adjoint, pulled = np.zeros(n), np.zeros(n)
    for back in range(samples):
        k = samples - 1 - back
        for j in range(n):
            pulled[j] = 0.0
            if back > 0:
                for i in range(n):
                    pulled[j] += transition[i, j] * adjoint[i]
        along = 0.0
        for i in range(n):
            along += gain[k, i] * pulled[i]
            adjoint[i] = pulled[i]
        surprise = innovation[k, 0] - bias * innovation[k, 1] - slope * innovation[k, 2]
        adjoint[0] += surprise / variance[k] - along
        for a in range(2):
            total = predicted[k, 0, a] - bias * predicted[k, 1, a] - slope * predicted[k, 2, a]
            for i in range(n):
                total += spread[k, a, i] * adjoint[i]
            smoothed[k, a] = total
