"""Modes of a rotor on its support, in the fixed frame, from stiffness and damping.

Linearised about its motion, a rotor's equations still turn with it. Multi-blade coordinates
(`windsysid.mechanics.multi_blade`) make them constant for three or more equal blades at constant Ω without gravity in
the rotor plane, about β = 0. Everything else is Floquet's theory about the periodic motion that gravity and imbalance
force (`windsysid.modal.floquet`); the multiple of Ω that it leaves open is found in multi-blade coordinates. Bands
follow from the covariance of the coefficients by the delta method, with the exact derivatives

    dλ/dθ = ⟨qᵀ(t) dA(t)/dθ p(t)⟩,      p(t) e^{λt} a mode, qᵀ(t) its row of the inverse of all of them,

A being differentiated along the periodic motion, which θ moves too.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.model import MechanicalModel
from windsysid.modal.floquet import about_periodic_motion, resolve
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.mode import Mode
from windsysid.statespace.parameter import Parameter

__all__ = ["ModalSpectrum", "analyse", "analyse_unlocked", "modes", "modes_with_slopes"]


AVERAGED_AZIMUTHS = 24
"""Azimuths over which a turn is averaged."""

DIFFERENCE_STEP = 1e-4
"""Of the central differences in θ, of the order of 1: A is linear or nearly so in what is identified."""

LOCK_ASIDE_SHARES = (1e-3, 3e-3)
"""Shares of the rotor speed by which to step aside from a narrow lock, to either side."""


class ModalSpectrum(NamedTuple):
    """The modes at one rotor speed.

    Attributes
    ----------
    exponents
        λ (m,) [1/s] of the oscillating modes, imaginary parts positive, by rising magnitude.
    names
        Of the modes.
    shapes
        (m, n): displacements in multi-blade coordinates times the root of what they weigh, of unit length; of a
        periodic mode its largest harmonic.
    slopes
        dλ/dθ (m, n_θ).
    growth
        Largest real part [1/s] of all exponents, those that do not oscillate included.
    method
        ``Coleman``, ``Floquet``, or ``constant`` where nothing turns.
    locked
        Whether a mode stands at a multiple of Ω/2 that holds it: it is then two, of equal frequency, which coefficients
        do not move.
    """

    exponents: Complex
    names: tuple[str, ...]
    shapes: Complex
    slopes: Complex
    growth: float
    method: str
    locked: bool = False

    @property
    def frequency(self) -> Array:
        """|λ| / 2π (m,) [Hz]."""
        return np.asarray(np.abs(self.exponents) / (2.0 * math.pi))

    @property
    def damping(self) -> Array:
        """−Re λ / |λ| (m,)."""
        return np.asarray(-self.exponents.real / np.abs(self.exponents))

    def frequency_and_damping_slopes(self) -> tuple[Array, Array]:
        """Derivatives of `frequency` [Hz] and `damping` to θ, (m, n_θ) each."""
        size = np.abs(self.exponents)[:, None]
        along = (np.conj(self.exponents)[:, None] * self.slopes).real / size
        return along / (2.0 * math.pi), (-self.slopes.real + (self.exponents.real[:, None] / size) * along) / size


def analyse(
    rotor: MechanicalModel,
    model: CompiledModel,
    p: Array,
    rotor_speed: float,
    directions: Array | None = None,
    *,
    method: Literal["Coleman", "Floquet"] | None = None,
) -> ModalSpectrum:
    """The modes at one rotor speed, by Coleman's transform where it applies and by Floquet's theory otherwise.

    Parameters
    ----------
    rotor, model
        The rotor, or a tower under a rigid one, and the same compiled.
    p
        All its parameters (n_p,), SI.
    rotor_speed
        Ω [rad/s]; a standing rotor has blade 1 at azimuth 0.
    directions
        ∂p/∂θ (n_θ, n_p), for the slopes; none by default.
    method
        One of the two, by choice. Coleman's transform averages what is left of an inequality of three or more
        blades over a turn, gravity off: wrong by 1e-5 to 5e-4 of a frequency on the packaged turbines, which is many
        standard deviations of a free decay.

    Raises
    ------
    ConfigurationError
        If Floquet's theory has nothing to say here: no periodic motion, or a turn too slow.
    """
    if directions is None:
        directions = np.zeros((0, len(p)))
    axes = rotor.modes()
    if not axes.turns:
        return _constant(_Frame(rotor, model, p, 0.0), directions, np.zeros(1), "constant")
    values = dict(zip(model.parameters, (float(v) for v in p), strict=True))
    if method != "Floquet" and not axes.obstacles(values):
        return _constant(_Frame(rotor, model, p, rotor_speed), directions, np.zeros(1), "Coleman")
    if method == "Coleman" and axes.averages:
        p = p.copy()
        p[model.parameters.index("gravity")] = 0.0
        turn = np.arange(AVERAGED_AZIMUTHS) * 2.0 * math.pi / AVERAGED_AZIMUTHS
        return _constant(_Frame(rotor, model, p, rotor_speed), directions, turn, "Coleman")
    if rotor_speed == 0.0:
        return _standing(_Frame(rotor, model, p, 0.0), directions)
    return _turning(_Frame(rotor, model, p, rotor_speed), directions)


def analyse_unlocked(
    rotor: MechanicalModel, model: CompiledModel, p: Array, rotor_speed: float, directions: Array | None = None
) -> ModalSpectrum:
    """`analyse`, except where a mode is locked to the rotor so narrowly that its interval would vanish.

    There it returns the mean of the modes at speeds a hair below and above.
    """
    found = analyse(rotor, model, p, rotor_speed, directions)
    for share in LOCK_ASIDE_SHARES if found.locked else ():
        above, below = (analyse(rotor, model, p, (1.0 + s) * rotor_speed, directions) for s in (share, -share))
        if not (above.locked or below.locked) and above.names == below.names:
            exponents, slopes = 0.5 * (above.exponents + below.exponents), 0.5 * (above.slopes + below.slopes)
            return above._replace(exponents=exponents, slopes=slopes, growth=found.growth)
    return found


def _known(
    rotor: MechanicalModel, model: CompiledModel, p: Array, rotor_speed: float, directions: Array | None = None
) -> ModalSpectrum:
    """`unlocked`, and an average over the turn if Floquet's theory fails for a slow turn."""
    try:
        return analyse_unlocked(rotor, model, p, rotor_speed, directions)
    except ConfigurationError:
        return analyse(rotor, model, p, rotor_speed, directions, method="Coleman")


def modes(rotor: MechanicalModel, model: CompiledModel, p: Array, rotor_speed: float) -> list[tuple[str, float, float]]:
    """Name, frequency [Hz] and damping ratio of every oscillating mode, by rising frequency; slight inequality averaged
    (`analyse`): to label a spectrum."""
    return _rows(analyse(rotor, model, p, rotor_speed, method="Coleman"))


def _rows(found: ModalSpectrum) -> list[tuple[str, float, float]]:
    return [(n, float(f), float(z)) for n, f, z in zip(found.names, found.frequency, found.damping, strict=True)]


def modes_with_slopes(
    rotor: MechanicalModel,
    model: CompiledModel,
    reference: Array,
    rotor_speed: float,
    parameters: Sequence[Parameter],
    theta: Array,
    cov: Array,
) -> tuple[tuple[Mode, ...], Array]:
    """Modes with 95 % intervals from the covariance of θ (n_θ, n_θ) around `theta` (n_θ,), which
    `windsysid.modal.sweep.find_modes` gives at that speed; and the derivatives of frequencies [Hz] and damping ratios
    to θ (2, modes, n_θ).

    `reference` (n_p,) are the values of all parameters, before the identification. Empty where there are no modes to be
    had (two blades without a periodic motion).
    """
    p = reference.copy()
    p[[model.parameters.index(q.name) for q in parameters]] = [
        float(q.physical(t)) for q, t in zip(parameters, theta, strict=True)
    ]
    along = directions_of(model, parameters, theta)
    try:
        centre = _known(rotor, model, p, rotor_speed, along)
        known = {name: (f, z) for name, f, z in _rows(_known(rotor, model, reference, rotor_speed))}
    except ConfigurationError:
        return (), np.zeros((2, 0, len(theta)))
    slopes = centre.frequency_and_damping_slopes()
    stds = [np.sqrt(np.einsum("mi,ij,mj->m", slope, cov, slope).clip(0.0)) for slope in slopes]
    found = []
    for i, (name, *both) in enumerate(_rows(centre)):
        of_file = known.get(name, (None, None))
        f, z = (
            replace(IntervalEstimate.normal(value, float(std[i]), unit), reference=reference)
            for value, std, unit, reference in zip(both, stds, ("Hz", "1"), of_file, strict=True)
        )
        found.append(Mode(name, f, z))
    return tuple(found), np.array(slopes)


def directions_of(model: CompiledModel, parameters: Sequence[Parameter], theta: Array) -> Array:
    """∂p/∂θ (n_θ, n_p) at `theta` (n_θ,)."""
    along = np.zeros((len(parameters), len(model.parameters)))
    for row, q, t in zip(along, parameters, theta, strict=True):
        row[model.parameters.index(q.name)] = float(q.physical(t)) if q.logarithmic else q.scale
    return along


class _Frame:
    """A rotor at one speed: its Jacobians along a motion, and the way to multi-blade coordinates."""

    def __init__(self, rotor: MechanicalModel, model: CompiledModel, p: Array, rotor_speed: float) -> None:
        self.axes, self.model, self.p, self.speed = rotor.modes(), model, p, rotor_speed
        self.n = len(rotor.coordinates)
        self.values = dict(zip(model.parameters, (float(v) for v in p), strict=True))

    def rates(self, psi: Array, x: Array | None = None, p: Array | None = None) -> tuple[Array, Array]:
        """ẋ (K, 2n) and ∂ẋ/∂x (K, 2n, 2n) at azimuths ψ (K,) and states (K, 2n), at rest by default, under no loads."""
        model, size = self.model, (len(psi), 2 * self.n)
        x, p = np.zeros(size) if x is None else np.ascontiguousarray(x), self.p if p is None else p
        inputs = np.zeros((len(psi), len(model.inputs)))
        for name, known in (("rotor_azimuth", psi), ("rotor_speed", self.speed)):
            if name in model.inputs:
                inputs[:, model.inputs.index(name)] = known
        value, slope = np.empty(size), np.zeros((*size, 2 * self.n))
        w, B, G = (np.zeros(shape) for shape in (self.n, (2 * self.n, len(model.identified)), (2 * self.n, self.n)))
        for k in range(len(psi)):
            model.rates_jacobian(x[k], inputs[k], p, w, value[k], slope[k], B, G)
        return value, slope

    def moved(
        self, psi: Array, directions: Array, x: Array | None = None, dx: Array | None = None
    ) -> tuple[Array, Array]:
        """Derivatives of `rates` along ∂p/∂θ (n_θ, n_p), where the motion moves by dx (K, 2n, n_θ).

        Returns (K, 2n, n_θ) and (n_θ, K, 2n, 2n).
        """
        pushes, slopes = [np.zeros((len(psi), 2 * self.n, 0))], []
        for i, direction in enumerate(directions):
            shift = 0.0 if dx is None else DIFFERENCE_STEP * dx[:, :, i]
            base = np.zeros((len(psi), 2 * self.n)) if x is None else x
            above = self.rates(psi, base + shift, self.p + DIFFERENCE_STEP * direction)
            below = self.rates(psi, base - shift, self.p - DIFFERENCE_STEP * direction)
            pushes.append(((above[0] - below[0]) / (2.0 * DIFFERENCE_STEP))[:, :, None])
            slopes.append((above[1] - below[1]) / (2.0 * DIFFERENCE_STEP))
        return np.concatenate(pushes, axis=2), np.array(slopes).reshape(-1, len(psi), 2 * self.n, 2 * self.n)

    def multi_blade(self, psi: Array) -> tuple[Array, Array]:
        """S (K, 2n, 2n) of [q, q̇] = S [ξ, ξ̇], and Ṡ."""
        T, n = self.axes.transform(psi), self.n
        S, rate = np.zeros((2, len(psi), 2 * n, 2 * n))
        S[:, :n, :n] = S[:, n:, n:] = T[0]
        S[:, n:, :n] = rate[:, :n, :n] = rate[:, n:, n:] = self.speed * T[1]
        rate[:, n:, :n] = self.speed**2 * T[2]
        return S, rate

    def spectrum(
        self, exponents: Complex, shapes: Complex, slopes: Complex, growth: float, method: str, weights: Array
    ) -> ModalSpectrum:
        """The exponents (m,) that oscillate, with shapes (n, m) and slopes (m, n_θ), named, by rising magnitude."""
        lower = exponents.imag < 0.0
        exponents, shapes, slopes = (
            np.where(lower, np.conj(exponents), exponents),
            np.where(lower, np.conj(shapes), shapes),
            np.where(lower[:, None], np.conj(slopes), slopes),
        )
        size = np.abs(exponents)
        order = np.array([i for i in np.argsort(size) if exponents[i].imag > 1e-9 * size.max()], dtype=np.intp)
        weighted = np.sqrt(weights)[:, None] * shapes[:, order]
        weighted /= np.linalg.norm(weighted, axis=0)
        turned = np.conj(weighted) if self.speed < 0.0 else weighted
        names = _numbered([self.axes.name(shape) for shape in turned.T])
        return ModalSpectrum(exponents[order], tuple(names), weighted.T, slopes[order], growth, method)


def _numbered(names: Sequence[str]) -> list[str]:
    """Names that occur more than once with a number behind."""
    return [
        name if names.count(name) == 1 else f"{name} ({names[: i + 1].count(name)})" for i, name in enumerate(names)
    ]


def _constant(frame: _Frame, directions: Array, psi: Array, method: str) -> ModalSpectrum:
    """Modes at rest, from the system matrix in multi-blade coordinates, averaged over azimuths."""
    S, rate = frame.multi_blade(psi)
    system = np.linalg.solve(S, frame.rates(psi)[1] @ S - rate).mean(axis=0)
    moved = np.linalg.solve(S, frame.moved(psi, directions)[1] @ S).mean(axis=1)
    return _of_matrix(frame, system, moved, method)


def _standing(frame: _Frame, directions: Array) -> ModalSpectrum:
    """Modes of a standing rotor about its static equilibrium."""
    psi = np.zeros(1)
    x = np.zeros((1, 2 * frame.n))
    for _ in range(20):
        value, slope = frame.rates(psi, x)
        try:
            correction = np.asarray(np.linalg.solve(slope, value[:, :, None])[:, :, 0], dtype=np.float64)
        except np.linalg.LinAlgError:
            raise ConfigurationError(
                "the standing rotor has no equilibrium: give it stiffness, or choose a rotor speed"
            ) from None
        x -= correction
        if np.abs(correction).max() <= 1e-13 + 1e-11 * np.abs(x).max():
            break
    pushes, _ = frame.moved(psi, directions, x)
    dx = np.asarray(-np.linalg.solve(slope, pushes), dtype=np.float64)
    S, _ = frame.multi_blade(psi)
    system = np.linalg.solve(S, slope @ S)[0]
    moved = np.asarray(np.linalg.solve(S, frame.moved(psi, directions, x, dx)[1] @ S)[:, 0], dtype=np.float64)
    return _of_matrix(frame, system, moved, "constant")


def _of_matrix(frame: _Frame, system: Array, moved: Array, method: str) -> ModalSpectrum:
    """The spectrum of a constant system (2n, 2n) with derivatives (n_θ, 2n, 2n)."""
    exponents, vectors = (v.astype(np.complex128) for v in np.linalg.eig(system))
    upper = exponents.imag >= 0.0
    slopes = np.zeros((len(exponents), len(moved)), dtype=np.complex128)
    if len(moved):
        slopes = np.einsum("mi,tij,jm->mt", np.linalg.pinv(vectors), moved, vectors)
    shapes = vectors[: frame.n, upper]
    return frame.spectrum(
        exponents[upper], shapes, slopes[upper], float(exponents.real.max()), method, frame.axes.weights(frame.values)
    )


def _turning(frame: _Frame, directions: Array) -> ModalSpectrum:
    """Modes about the periodic motion of the turning rotor, by Floquet's theory."""
    speed, states = abs(frame.speed), 2 * frame.n
    period = 2.0 * math.pi / speed
    x, found = about_periodic_motion(lambda time, x: frame.rates(frame.speed * time, x), period, states)
    psi = frame.speed * found.time
    slopes = np.zeros((states, len(directions)), dtype=np.complex128)
    if len(directions):
        dx = found.response(frame.moved(psi, directions, x)[0])
        moved, rows = frame.moved(psi, directions, x, dx)[1], found.rows
        slopes = np.stack([np.einsum("kmi,kij,kjm->m", rows, each, found.shapes) / len(psi) for each in moved], axis=1)
    upper = found.exponents.imag >= 0.0
    shapes = np.asarray(
        np.linalg.solve(frame.axes.transform(psi)[0], found.shapes[:, : frame.n, upper]), dtype=np.complex128
    )
    weights = frame.axes.weights(frame.values)
    multiples, standing = resolve(shapes, weights)
    exponents = found.exponents[upper] + 1j * speed * multiples
    spectrum = frame.spectrum(exponents, standing, slopes[upper], float(found.exponents.real.max()), "Floquet", weights)
    halves = 2.0 * spectrum.exponents.imag / speed
    return spectrum._replace(locked=bool(np.any(np.abs(halves - np.rint(halves)) < 1e-12)))
