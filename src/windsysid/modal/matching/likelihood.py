"""Weights of a measured mode being a mode of a model, by frequency, damping and shape.

Each weight is the density of what was measured if it is the model's mode, over its density if the model lacks it. Both
errors, of the model and of the measurement, are in the scale of Student's t distributions of ln f and ln ζ. The
direction of a shape φ about that of the model, ψ, has Watson's distribution (Mardia and Jupp, Directional Statistics,
2000, section 10.4) or, with the probability ε, is a random one: the density over that of a random direction of n
channels is

    ε + (1 − ε) exp(λ MAC) / M(½, n/2, λ),        λ = (n − 1) / 2 (expected 1 − MAC),

M being Kummer's function; the errors of the model and of the shape add in the expected 1 − MAC.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.modal.matching import limits
from windsysid.modal.shapes import assurance
from windsysid.results.posterior import SIGMAS
from windsysid.spectral.modal_bands.scoring import DAMPING_PRIOR
from windsysid.spectral.oma.known_modes import KnownMode

__all__ = ["Assurance", "ModelMode", "assurance_interval", "pair_weights", "shape_assurance"]


MAX_CONCENTRATION = 700.0
"""Numerical: largest λ whose exponential is a number: that of 140 channels."""


class ModelMode(NamedTuple):
    """Mode of a model.

    Attributes
    ----------
    name
        Such as ``tower fore-aft``.
    frequency, frequency_std
        [Hz].
    damping, damping_std
        Ratio [1].
    shape
        Acceleration by channel, of any scale; empty if it is not known at the sensors.
    """

    name: str
    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    shape: Mapping[str, complex]


class Assurance(NamedTuple):
    """Modal assurance criterion [1] with its 95 % interval, the number of common channels, and the expected 1 − MAC of
    equal shapes by the uncertainty of the measured one."""

    value: float
    low: float
    high: float
    channels: int
    unsure: float


def shape_assurance(measured: KnownMode, model: ModelMode) -> Assurance | None:
    """MAC of a measured shape and the model's over the channels that both have; None if these are fewer than two."""
    names = [name for name in measured.shape if name in model.shape]
    shape = np.array([measured.shape[name] for name in names], dtype=np.complex128)
    other = np.array([model.shape[name] for name in names], dtype=np.complex128)
    if len(names) < 2 or not (np.abs(shape).max() > 0.0 and np.abs(other).max() > 0.0):
        return None
    std = np.array([measured.shape_std.get(name, 0.0) for name in names])
    low, high = assurance_interval(shape, std, other)
    unsure = float(2.0 * np.sum(std**2) / np.sum(np.abs(shape) ** 2))
    return Assurance(assurance(shape, other), low, high, len(names), min(unsure, 1.0))


def assurance_interval(shape: Complex, std: Array, other: Complex) -> tuple[float, float]:
    """Compute the 95 % interval of the MAC of an uncertain shape and an exact one.

    With the part a of φ along ψ and the rest p, MAC = 1 / (1 + r), r = |p|² / |a|². Of a Gaussian φ, r is about its
    true value + t, with the variance v + 4 r λ: t and v are those of a quadratic form of the covariance C of p / a, and
    λ is the variance along p. The interval has the true values for which the measured r is within two standard
    deviations, so noise alone does not make two equal shapes differ. Below a MAC of ½ the parts change places.

    Parameters
    ----------
    shape
        φ (n,).
    std
        Standard deviation (n,) of the real parts, and of the imaginary ones.
    other
        ψ (n,).

    Returns
    -------
    tuple of float
        Lower and upper end [1].

    Examples
    --------
    >>> low, high = assurance_interval(np.array([1.0, 0.1j]), np.array([0.0, 0.1]), np.array([1.0, 0.0j]))
    >>> round(low, 3), high
    (0.87, 1.0)
    """
    psi = other / np.linalg.norm(other)
    along = psi[:, None] @ np.conj(psi)[None]
    across = np.eye(len(psi)) - along
    alike = float(np.linalg.norm(across @ shape) <= np.linalg.norm(along @ shape))
    small, large = (across, along) if alike else (along, across)
    p, a = small @ shape, large @ shape
    size = float(np.linalg.norm(a))
    jacobian = (small - p[:, None] @ np.conj(a)[None] / size**2) / size
    C = (jacobian * std**2) @ np.conj(jacobian).T
    z = p / size
    r = float(np.sum(np.abs(z) ** 2))
    t, v = 2.0 * float(np.trace(C).real), 4.0 * float(np.sum(np.abs(C) ** 2))
    slope = float((np.conj(z) @ C @ z).real) / r if r > 0.0 else 0.0
    middle, k = r - t + 2.0 * SIGMAS**2 * slope, SIGMAS**2
    root = math.sqrt(max(middle**2 - (r - t) ** 2 + k * v, 0.0))
    low, high = max(middle - root, 0.0), max(middle + root, 0.0)
    ends = (1.0 / (1.0 + high), 1.0 / (1.0 + low))
    return ends if alike else (1.0 - ends[1], 1.0 - ends[0])


def pair_weights(measured: KnownMode, model: Sequence[ModelMode], macs: Sequence[Assurance | None]) -> Array:
    """Weights (n,) of a measured mode being each mode of a model, relative to one that the model lacks.

    That one has a random direction as its shape, or the shape of any of the model's modes.
    """
    shapes = np.array([_shape_ratio(mac) for mac in macs])
    equal = limits.EQUAL_SHAPE_PROBABILITY
    of_unlisted = 1.0 - equal + equal * float(np.mean(shapes)) if len(shapes) else 1.0
    return np.asarray(np.array([_weight(measured, one) for one in model]) * shapes / of_unlisted)


def _weight(measured: KnownMode, model: ModelMode) -> float:
    """Weight of a pair by frequency and damping."""
    off = measured.ln_frequency - math.log(model.frequency)
    std = math.hypot(measured.ln_frequency_std, model.frequency_std / model.frequency)
    by_frequency = _density(off, std, limits.MODEL_FREQUENCY_ERROR) / limits.UNLISTED_RATE
    odds = limits.SEEN_PROBABILITY / (1.0 - limits.SEEN_PROBABILITY)
    return odds * by_frequency * _damping_ratio(measured, model)


def _damping_ratio(measured: KnownMode, model: ModelMode) -> float:
    """Density of ln ζ by the model's, over that of any mode."""
    if not model.damping > limits.MIN_MODEL_DAMPING:
        return 1.0
    centre, spread = DAMPING_PRIOR
    std = math.hypot(measured.ln_damping_std, model.damping_std / model.damping)
    of_model = _density(measured.ln_damping - math.log(model.damping), std, limits.MODEL_DAMPING_ERROR)
    wide = math.hypot(spread, measured.ln_damping_std)
    of_any = math.exp(-0.5 * ((measured.ln_damping - centre) / wide) ** 2) / (wide * math.sqrt(2.0 * math.pi))
    return of_model / max(of_any, 1e-12)


def _shape_ratio(mac: Assurance | None) -> float:
    """Density of a shape about the model's, over that of a random direction."""
    if mac is None:
        return 1.0
    from scipy.special import hyp1f1

    n, other = mac.channels, limits.OTHER_SHAPE_PROBABILITY
    concentration = min(0.5 * (n - 1) / min(limits.MODEL_SHAPE_ERROR + mac.unsure, 1.0), MAX_CONCENTRATION)
    watson = math.exp(concentration * (mac.value - 1.0)) / float(hyp1f1(0.5 * (n - 1), 0.5 * n, -concentration))
    return other + (1.0 - other) * watson


def _density(off: float, std: float, error: float) -> float:
    """Density of Student's t distribution whose scale has the errors of measurement and model."""
    from scipy.stats import t

    return float(t.pdf(off, limits.ERROR_FREEDOM, scale=math.hypot(std, error)))
