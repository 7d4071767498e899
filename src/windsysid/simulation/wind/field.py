"""Wind speed where the blades are: Kaimal turbulence with IEC coherence, sampled on the turning rotor.

On a ring around the hub the IEC's coherence depends on the difference of two azimuths only, so the field is a Fourier
series in azimuth with independent coefficients, one set for each harmonic n,

    u(r, θ, t) = A_0(r, t) + Σ_n [A_n(r, t) cos nθ + B_n(r, t) sin nθ],
    S_n(r, r', f) = (2 − δ_n0)/M λ_n(r, r', f) S(f),

where λ_n is the discrete Fourier transform of the coherence over M = 2H + 1 points of the ring. Only the radii of one
harmonic have to be factorised together (Cholesky, as Veers does for all points), and a blade that passes reads the
series at its own azimuth: nothing is interpolated between grid points, and the spectrum at every fixed point is
Kaimal's exactly.

Sources: IEC 61400-1 ed. 4 (2019), 6.3 (wind conditions) and annex C (turbulence); Veers, SAND88-0152 (1988),
https://doi.org/10.2172/7102613; for the series in azimuth Sørensen, Hansen & Rosas (2002),
https://doi.org/10.1016/S0167-6105(02)00260-X.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import ConfigurationError

__all__ = [
    "WindConditions", "WindOnRotor", "coherence", "extreme_direction_change", "iec_turbulence_intensity",
    "kaimal_spectrum", "rotating_turbulence", "rotor_wind",
]  # fmt: skip


IEC_REFERENCE_INTENSITY = {"A+": 0.18, "A": 0.16, "B": 0.14, "C": 0.12}
"""I_ref of the turbulence categories (IEC 61400-1 ed. 4, basic parameters of the classes)."""

COHERENCE_DECAY = 12.0
"""Decay of the coherence with separation (IEC 61400-1 ed. 4, annex C)."""

RELATIVE_JITTER = 1e-10
"""Added to the diagonal before factorising, relative: harmonics of the hub point are exactly zero."""


@dataclass(frozen=True)
class WindConditions:
    """Wind that is stationary but for its direction.

    Attributes
    ----------
    speed
        Mean speed at hub height [m/s].
    hub_height
        [m]; sets the length scale of turbulence.
    turbulence_intensity
        Standard deviation of the longitudinal speed over `speed`; 0 for steady wind.
    shear_exponent
        Exponent of the power law of mean speed with height; 0.2 in the IEC's normal profile.
    tower_radius
        [m]; 0 leaves the tower's shadow out.
    tower_distance
        How far the rotor plane stands upwind of the tower's axis [m].
    """

    speed: float
    hub_height: float
    turbulence_intensity: float = 0.16
    shear_exponent: float = 0.2
    tower_radius: float = 0.0
    tower_distance: float = 0.0

    def __post_init__(self) -> None:
        _require("wind speed", self.speed, "a positive number of m/s", self.speed > 0.0)
        _require("hub height", self.hub_height, "a positive number of m", self.hub_height > 0.0)
        intensity, radius = self.turbulence_intensity, self.tower_radius
        _require("turbulence intensity", intensity, "a share of the mean speed, 0 to 1", 0.0 <= intensity <= 1.0)
        _require("shear exponent", self.shear_exponent, "a number from −1 to 1", abs(self.shear_exponent) <= 1.0)
        _require("tower radius", radius, "0 (no tower shadow) or a positive number of m", radius >= 0.0)
        if radius > 0.0:
            distance = self.tower_distance
            _require("tower distance", distance, f"more than the tower radius {radius:g} m", distance > radius)

    @property
    def length_scale(self) -> float:
        """L_1 = 8.1 Λ_1 [m], Λ_1 = 0.7 z up to 60 m and 42 m above (IEC 6.3 and annex C)."""
        return 8.1 * 0.7 * min(self.hub_height, 60.0)

    @property
    def std(self) -> float:
        """σ_1 [m/s]."""
        return self.turbulence_intensity * self.speed


class WindOnRotor(NamedTuple):
    """Longitudinal wind speed at the hub (T,) and at the stations of every blade (T, N, R), both [m/s]."""

    hub: Array
    blades: Array


def iec_turbulence_intensity(speed: float, category: str) -> float:
    """Turbulence intensity of the IEC's normal turbulence model, σ_1 / V = I_ref (0.75 + 5.6 / V).

    Raises
    ------
    ConfigurationError
        If the category is not one of A+, A, B, C, or the speed is not positive.
    """
    _require("wind speed", speed, "a positive number of m/s", speed > 0.0)
    if category not in IEC_REFERENCE_INTENSITY:
        raise ConfigurationError(
            f"turbulence category: expected one of {', '.join(IEC_REFERENCE_INTENSITY)}, got '{category}'"
        )
    return IEC_REFERENCE_INTENSITY[category] * (0.75 + 5.6 / speed)


def extreme_direction_change(conditions: WindConditions, diameter: float) -> float:
    """Size of the IEC's extreme direction change [rad]: 4 arctan(σ_1 / (V (1 + 0.1 D / Λ_1)))."""
    _require("rotor diameter", diameter, "a positive number of m", diameter > 0.0)
    scale = conditions.length_scale / 8.1
    return min(math.pi, 4.0 * math.atan(conditions.turbulence_intensity / (1.0 + 0.1 * diameter / scale)))


def kaimal_spectrum(frequency: ArrayLike, conditions: WindConditions) -> Array:
    """One-sided spectrum of the longitudinal wind speed [m²/s² per Hz] at f ≥ 0 [Hz] (IEC annex C).

    S = 4 σ² (L/V) / (1 + 6 f L/V)^{5/3}; its integral over all frequencies is σ².
    """
    time = conditions.length_scale / conditions.speed
    f = np.asarray(frequency, dtype=np.float64)
    return np.asarray(4.0 * conditions.std**2 * time / (1.0 + 6.0 * f * time) ** (5.0 / 3.0))


def coherence(frequency: ArrayLike, separation: ArrayLike, conditions: WindConditions) -> Array:
    """Cross-spectrum over spectrum of two points `separation` [m] apart (IEC annex C), shapes broadcast.

    exp(−12 r √((f/V)² + (0.12/L)²)); the square of it is what signal processing calls magnitude-squared coherence.
    """
    decay = _decay_rate(np.asarray(frequency, dtype=np.float64), conditions)
    return np.asarray(np.exp(-decay * np.asarray(separation, dtype=np.float64)))


def rotor_wind(
    conditions: WindConditions,
    azimuth: ArrayLike,
    radii: Sequence[float],
    *,
    blades: int = 3,
    rate: float,
    seed: int | np.random.Generator = 0,
    harmonics: int = 16,
) -> WindOnRotor:
    """Wind speed at the blades: mean with shear, turbulence, tower shadow; reproducible for a seed.

    Parameters
    ----------
    azimuth
        ψ (T,) [rad]: blade i stands at θ_i = ψ + 2π (i−1)/N, 0 to the right looking upwind, π/2 up.
    radii
        Distance of the blade stations from the hub's centre [m], (R,).
    rate
        Samples per second [Hz].
    harmonics
        Azimuthal harmonics H; content at higher multiples of the rotor frequency is folded below H.

    Raises
    ------
    ConfigurationError
        If an option is out of range or a blade reaches the ground.
    """
    turbulence = rotating_turbulence(
        conditions, azimuth, radii, blades=blades, rate=rate, seed=seed, harmonics=harmonics
    )
    theta = blade_angles(azimuth, blades)[:, :, None]
    r = np.asarray(radii, dtype=np.float64)
    mean = conditions.speed * _shear(conditions, r * np.sin(theta))
    return WindOnRotor(
        conditions.speed + turbulence.hub, (mean + turbulence.blades) * tower_shadow(conditions, theta, r)
    )


def rotating_turbulence(
    conditions: WindConditions,
    azimuth: ArrayLike,
    radii: Sequence[float],
    *,
    blades: int = 3,
    rate: float,
    seed: int | np.random.Generator = 0,
    harmonics: int = 16,
) -> WindOnRotor:
    """The turbulence alone, with zero mean: the parameters and errors of `rotor_wind`.

    A Gaussian process. It is drawn for a time longer than T by five length scales, so that its end knows nothing of its
    beginning; what is slower than that time is not there, nor what is faster than half the rate.
    """
    psi = np.atleast_1d(np.asarray(azimuth, dtype=np.float64))
    _check(conditions, psi, radii, blades, rate, harmonics)
    rings = np.array([0.0, *radii])
    period = _period(len(psi), rate, conditions)
    frequency = np.asarray(np.fft.rfftfreq(period, 1.0 / rate), dtype=np.float64)
    amplitude = np.sqrt(0.5 * kaimal_spectrum(frequency, conditions) * rate * period)  # E|X|² = S Δf N² / 2
    amplitude[0] = 0.0  # the mean over the period is the mean speed
    rng = np.random.default_rng(seed)
    turn = np.exp(1j * blade_angles(psi, blades))
    turned = np.ones_like(turn)
    total = WindOnRotor(np.zeros(len(psi)), np.zeros((len(psi), blades, len(rings) - 1)))
    correlations = _ring_coherence(frequency, rings, conditions, harmonics)
    for n in range(harmonics + 1):
        factor = np.asarray(np.linalg.cholesky(_harmonic(correlations, n, len(rings))), dtype=np.float64)
        cosine = _draw(factor, amplitude, rng, period)[:, : len(psi)]
        total.blades[:] += turned.real[:, :, None] * cosine[1:].T[:, None, :]
        if n == 0:
            total.hub[:] = cosine[0]
        else:
            sine = _draw(factor, amplitude, rng, period)[:, : len(psi)]
            total.blades[:] += turned.imag[:, :, None] * sine[1:].T[:, None, :]
        turned = turned * turn
    return total


def blade_angles(azimuth: ArrayLike, blades: int) -> Array:
    """θ_i = ψ + 2π (i−1)/N of every blade, (T, N) [rad]."""
    psi = np.atleast_1d(np.asarray(azimuth, dtype=np.float64))
    return psi[:, None] + 2.0 * np.pi * np.arange(blades) / blades


def tower_shadow(conditions: WindConditions, angle: ArrayLike, radius: ArrayLike) -> Array:
    """Factor on the axial wind in front of the tower: potential flow past a cylinder of radius a, seen by a blade below
    the hub.

    1 − a² (z² − x²)/(z² + x²)², z upwind of the tower's axis, x next to it (Burton et al., Wind Energy Handbook;
    Hansen, Aerodynamics of Wind Turbines).
    """
    angle, radius = np.asarray(angle, dtype=np.float64), np.asarray(radius, dtype=np.float64)
    if conditions.tower_radius == 0.0:
        return np.ones(np.broadcast_shapes(angle.shape, radius.shape))
    x2, z2 = (radius * np.cos(angle)) ** 2, conditions.tower_distance**2
    dip = conditions.tower_radius**2 * (z2 - x2) / (z2 + x2) ** 2
    return np.where(np.sin(angle) < 0.0, 1.0 - dip, 1.0)


def _shear(conditions: WindConditions, height: Array) -> Array:
    """Mean speed at `height` above the hub, relative to the hub's: the power law (IEC's normal wind profile)."""
    return np.asarray((1.0 + height / conditions.hub_height) ** conditions.shear_exponent)


def _decay_rate(frequency: Array, conditions: WindConditions) -> Array:
    """Factor on the separation in the coherence's exponent [1/m]."""
    return COHERENCE_DECAY * np.hypot(frequency / conditions.speed, 0.12 / conditions.length_scale)


def _ring_coherence(frequency: Array, rings: Array, conditions: WindConditions, harmonics: int) -> Array:
    """Harmonics over M of the coherence between every two rings, (H + 1, K, pairs), pairs as in `np.tril_indices`."""
    points = 2 * harmonics + 1
    angle = 2.0 * np.pi * np.arange(harmonics + 1) / points
    first, second = np.tril_indices(len(rings))
    r, s = rings[first], rings[second]
    squared = (r - s) ** 2 + 4.0 * r * s * np.sin(0.5 * angle[:, None]) ** 2
    weight = (
        np.where(np.arange(harmonics + 1) > 0, 2.0, 1.0) / points
    )  # the ring is the same to the left and to the right
    transform = np.cos(np.outer(np.arange(harmonics + 1), angle)) * weight
    transform[1:] *= 2.0  # sine and cosine of one harmonic share ±n
    decay = _decay_rate(frequency, conditions)
    values = np.empty((harmonics + 1, len(frequency), len(first)))
    for pair in range(len(first)):
        values[:, :, pair] = transform @ np.exp(-np.outer(np.sqrt(squared[:, pair]), decay))
    return values


def _harmonic(correlations: Array, n: int, rings: int) -> Array:
    """The (K, rings, rings) matrices of one harmonic, ready for Cholesky."""
    lower = np.tril_indices(rings)
    matrix = np.zeros((correlations.shape[1], rings, rings))
    matrix[:, lower[0], lower[1]] = correlations[n]
    matrix[:, lower[1], lower[0]] = correlations[n]
    diagonal = np.arange(rings)
    matrix[:, diagonal, diagonal] = np.maximum(matrix[:, diagonal, diagonal], 0.0) + RELATIVE_JITTER
    return matrix


def _draw(factor: Array, amplitude: Array, rng: np.random.Generator, period: int) -> Array:
    """One realisation (rings, period) of processes whose spectra are the factor's times the amplitude's square."""
    size = (len(amplitude), factor.shape[1])
    white = (rng.standard_normal(size) + 1j * rng.standard_normal(size)) * math.sqrt(0.5)
    if period % 2 == 0:
        white[-1] = 0.0
    spectrum = np.einsum("kij,kj->ik", factor, white * amplitude[:, None])
    return np.asarray(np.fft.irfft(spectrum, period, axis=1))


def _period(samples: int, rate: float, conditions: WindConditions) -> int:
    """Samples of one period of the drawn field: a product of small primes, for fast Fourier transforms."""
    from scipy.fft import next_fast_len

    longer = 5.0 * conditions.length_scale / conditions.speed
    return int(next_fast_len(samples + math.ceil(longer * rate), real=True))


def _check(
    conditions: WindConditions, psi: Array, radii: Sequence[float], blades: int, rate: float, harmonics: int
) -> None:
    if psi.ndim != 1 or not np.isfinite(psi).all():
        raise ConfigurationError(f"azimuth: expected finite angles [rad] of shape (T,), got shape {psi.shape}")
    _require("sampling rate", rate, "a positive number of Hz", rate > 0.0)
    _require("number of blades", blades, "1 or more", blades >= 1)
    _require("azimuthal harmonics", harmonics, "1 to 100", 1 <= harmonics <= 100)
    if not radii:
        raise ConfigurationError("blade stations: expected at least one radius [m], got none")
    for radius in radii:
        within = 0.0 < radius < conditions.hub_height
        _require("radius of a blade station", radius, f"0 to the hub height {conditions.hub_height:g} m", within)


def _require(what: str, value: float, expected: str, holds: bool) -> None:
    if not (math.isfinite(value) and holds):
        raise ConfigurationError(f"{what}: expected {expected}, got {value:g}")
