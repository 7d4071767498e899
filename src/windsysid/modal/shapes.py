"""Measures of mode shapes: modal assurance criterion, phase collinearity and mean phase deviation.

A shape φ has n complex components. Of a normal mode, with proportional damping, all of them lie on one line through
the origin of the complex plane: they move in phase or in antiphase.
"""

import numpy as np

from windsysid._types import Array, Complex

__all__ = ["MIN_COLLINEAR_CHANNELS", "along_axis", "assurance", "assurance_matrix", "phase_collinearity",
    "phase_deviation"]  # fmt: skip

MIN_COLLINEAR_CHANNELS = 3
"""Size: number of channels for the phase collinearity; any two points lie on a line."""


def assurance(a: Complex, b: Complex) -> float:
    """Modal assurance criterion of two shapes over the sensors that both have.

        MAC = |aᴴ b|² / (aᴴ a · bᴴ b)        (Allemang, Sound and Vibration 37(8), 2003)

    Parameters
    ----------
    a, b
        (n,), NaN without a sensor.

    Returns
    -------
    float
        Between 0 and 1 [1]; NaN for fewer than two common sensors.

    Examples
    --------
    >>> a, b = np.array([1.0 + 0.0j, 2.0]), np.array([2.0 + 0.0j, -1.0])
    >>> assurance(a, 3j * a), assurance(a, b)
    (1.0, 0.0)
    """
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 2:
        return float("nan")
    a, b = a[both], b[both]
    size = float(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2))
    return float(np.abs(np.vdot(a, b)) ** 2 / size) if size > 0.0 else float("nan")


def assurance_matrix(a: Complex, b: Complex) -> Array:
    """Modal assurance criteria (r, s) of shapes (n, r) and others (n, s) of the same sensors, as in `assurance`."""
    return np.array([[assurance(one, other) for other in b.T] for one in a.T]).reshape(a.shape[1], b.shape[1])


def phase_collinearity(shape: Complex) -> float:
    """Modal phase collinearity (MPC) of a shape.

    With variances and the covariance of real and imaginary parts over the channels, and the eigenvalues λ of their
    matrix,

        MPC = ((λ₁ − λ₂) / (λ₁ + λ₂))²        (Pappa, Elliott & Schenk, J. Guidance 16(5), 1993, doi 10.2514/3.21092)

    Parameters
    ----------
    shape
        (n,).

    Returns
    -------
    float
        1 where all components lie on a line, 0 where they lie on a circle [1]; NaN for fewer than three channels.

    Examples
    --------
    >>> round(phase_collinearity(np.exp(0.3j) * np.array([1.0, -0.4, 0.2])), 9)
    1.0
    >>> round(phase_collinearity(np.exp(2j * np.pi * np.arange(3) / 3)), 9)
    0.0
    """
    if len(shape) < MIN_COLLINEAR_CHANNELS:
        return float("nan")
    centred = shape - shape.mean()
    xx, yy, xy = (float(v) for v in (centred.real @ centred.real, centred.imag @ centred.imag,
        centred.real @ centred.imag))  # fmt: skip
    total = xx + yy
    return ((xx - yy) ** 2 + 4.0 * xy**2) / total**2 if total > 0.0 else float("nan")


def phase_deviation(shape: Complex) -> float:
    """Mean phase deviation (MPD) of a shape: mean angle between its components and the line that fits them best.

    The line through the origin is the first right singular vector of [Re φ, Im φ], weights are |φ|
    (Reynders, Houbrechts & De Roeck, Mech. Syst. Signal Process. 29, 2012, doi 10.1016/j.ymssp.2012.01.007).

    Parameters
    ----------
    shape
        (n,).

    Returns
    -------
    float
        Between 0 and π/2 [rad]: 0 for a shape whose components lie on a line.

    Examples
    --------
    >>> round(phase_deviation(np.array([1.0, -1.0, 1j * 0.0])), 9)
    0.0
    """
    size = np.abs(shape)
    if not size.sum() > 0.0:
        return float("nan")
    turned = along_axis(shape)
    return float(size @ np.arctan2(np.abs(turned.imag), np.abs(turned.real)) / size.sum())


def along_axis(shape: Complex) -> Complex:
    """Turn a shape (n,), so that the line through the origin that fits its components best is the real axis.

    The squared imaginary parts have their smallest sum at the angle ½ arg Σ φ².

    Examples
    --------
    >>> np.round(along_axis(np.array([1j, -0.5j])).real, 9).tolist()
    [1.0, -0.5]
    """
    return np.asarray(shape * np.exp(-0.5j * np.angle(np.sum(shape**2))))
