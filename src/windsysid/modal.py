"""Modes of a rotor on its support, in the fixed frame, from stiffness and damping.

Linearised at rest, the equations of motion still turn with the rotor. Multi-blade coordinates (Coleman & Feingold 1958)

    β_i = ξ_0 + Σ_n (ξ_nc cos nψ_i + ξ_ns sin nψ_i)  (+ (−1)^i ξ_d for even N),      q = T(ψ) ξ

make them constant for three or more equal blades; what is left of a slight inequality is averaged over a turn. The
bands follow from the covariance of the coefficients by the delta method.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.tower import TowerModel
from windsysid.statespace import Parameter

__all__ = ["Mode", "modes", "modes_with_bands"]

Array = NDArray[np.float64]

AZIMUTHS = 24
"""Azimuths over which a turn is averaged."""


class Mode(NamedTuple):
    """A mode in the fixed frame.

    Attributes
    ----------
    name
        Where its energy sits: ``tower x``, ``lag backward`` …
    frequency_hz, damping_ratio
        (value, low, high) [Hz], [1].
    reference
        Frequency and damping ratio that the reference coefficients give; None where they give no such mode.
    """

    name: str
    frequency_hz: tuple[float, float, float]
    damping_ratio: tuple[float, float, float]
    reference: tuple[float, float] | None = None

    def summary(self) -> dict[str, Any]:
        """As plain values, for ``summary.json``."""
        values: dict[str, Any] = {"name": self.name}
        for i, (key, triple) in enumerate((("frequency_hz", self.frequency_hz), ("damping_ratio", self.damping_ratio))):
            values[key] = dict(zip(("estimate", "low", "high"), triple, strict=True))
            if self.reference is not None:
                values[key]["reference"] = self.reference[i]
        return values

    def cells(self) -> tuple[str, str, str, str, str]:
        """Name, frequency [Hz] and damping ratio [%] with their bands, as text for a table."""
        f, z = self.frequency_hz, [100.0 * value for value in self.damping_ratio]
        return (self.name, f"{f[0]:.4f}", f"{f[1]:.4f} … {f[2]:.4f}", f"{z[0]:.3f}", f"{z[1]:.3f} … {z[2]:.3f}")

    def reference_cells(self) -> tuple[str, str]:
        """Reference frequency [Hz] and damping ratio [%] as text for a table."""
        return ("", "") if self.reference is None else (f"{self.reference[0]:.4f}", f"{100.0 * self.reference[1]:.3f}")


def modes(
    rotor: RotorModel | TowerModel, model: CompiledModel, p: Array, rotor_speed: float
) -> list[tuple[str, float, float]]:
    """Name, frequency [Hz] and damping ratio of every oscillating mode, by rising frequency.

    Parameters
    ----------
    rotor, model
        The rotor, or a tower under a rigid one, and the same compiled.
    p
        All its parameters (n_p,), SI.
    rotor_speed
        Ω [rad/s].

    Notes
    -----
    Empty for free blades of a rotor with fewer than three: no coordinates make its equations constant.
    """
    if isinstance(rotor, TowerModel):
        system = _at_rest(model, p, np.zeros(len(model.inputs)))
    elif rotor.lag == "free" and rotor.blades < 3:
        return []
    else:
        system = _fixed_frame(rotor, model, p, rotor_speed)
    eigenvalues, vectors = np.linalg.eig(system)
    order = [i for i in np.argsort(np.abs(eigenvalues)) if eigenvalues[i].imag > 1e-9 * np.abs(eigenvalues).max()]
    shapes = vectors[: len(rotor.coordinates), order]
    if isinstance(rotor, TowerModel):
        names = ["tower " + rotor.coordinates[int(np.argmax(np.abs(shape)))].replace("_", "-") for shape in shapes.T]
    else:
        names = _names(rotor, model, p, shapes)
    return [
        (name, float(abs(eigenvalues[i]) / (2.0 * math.pi)), float(-eigenvalues[i].real / abs(eigenvalues[i])))
        for name, i in zip(names, order, strict=True)
    ]


def modes_with_bands(
    rotor: RotorModel | TowerModel,
    model: CompiledModel,
    p: Array,
    rotor_speed: float,
    parameters: Sequence[Parameter],
    theta: Array,
    cov: Array,
    reference: Array,
) -> tuple[Mode, ...]:
    """Modes with ±2σ bands from the covariance of θ (n_θ, n_θ) around `theta` (n_θ,).

    `p` and `reference` (n_p,) are the identified and the reference values of all parameters.
    """
    chosen = [model.parameters.index(parameter.name) for parameter in parameters]

    def at(values: Array) -> list[tuple[str, float, float]]:
        physical = p.copy()
        physical[chosen] = [float(q.physical(t)) for q, t in zip(parameters, values, strict=True)]
        return modes(rotor, model, physical, rotor_speed)

    centre = at(theta)
    known = {name: (frequency, damping) for name, frequency, damping in modes(rotor, model, reference, rotor_speed)}
    slopes = np.zeros((len(centre), 2, len(theta)))
    for i in range(len(theta)):
        step = np.zeros(len(theta))
        step[i] = 0.1 * math.sqrt(cov[i, i]) if cov[i, i] > 0.0 else 1e-6
        above, below = at(theta + step), at(theta - step)
        if len(above) == len(below) == len(centre):
            either = [np.array([m[1:] for m in side]).reshape(-1, 2) for side in (above, below)]
            slopes[:, :, i] = (either[0] - either[1]) / (2.0 * step[i])
    found = []
    for (name, frequency, damping), slope in zip(centre, slopes, strict=True):
        half = [2.0 * math.sqrt(max(float(row @ cov @ row), 0.0)) for row in slope]
        found.append(
            Mode(
                name,
                (frequency, frequency - half[0], frequency + half[0]),
                (damping, damping - half[1], damping + half[1]),
                known.get(name),
            )
        )
    return tuple(found)


def _fixed_frame(rotor: RotorModel, model: CompiledModel, p: Array, rotor_speed: float) -> Array:
    """The constant system matrix (2n, 2n) in multi-blade coordinates, gravity off, averaged over a turn."""
    n = len(rotor.coordinates)
    p = p.copy()
    p[model.parameters.index("gravity")] = 0.0
    total = np.zeros((2 * n, 2 * n))
    total[:n, n:] = np.eye(n)
    for psi in np.arange(AZIMUTHS) * 2.0 * math.pi / AZIMUTHS:
        A = _at_rest(model, p, np.array([psi, rotor_speed, 0.0]))
        T, T1, T2 = _multi_blade(rotor, psi)
        first, second = rotor_speed * T1, rotor_speed**2 * T2
        position, velocity = A[n:, :n], A[n:, n:]
        total[n:, :n] += np.linalg.solve(T, position @ T + velocity @ first - second) / AZIMUTHS
        total[n:, n:] += np.linalg.solve(T, velocity @ T - 2.0 * first) / AZIMUTHS
    return total


def _at_rest(model: CompiledModel, p: Array, inputs: Array) -> Array:
    """∂ẋ/∂x (n_x, n_x) where nothing moves and nothing pushes."""
    n, loads = len(model.states), np.zeros(len(model.loads))
    A: Array = np.zeros((n, n))
    out = (np.empty(n), A, np.zeros((n, len(model.identified))), np.zeros((n, len(loads))))
    model.rates_jacobian(np.zeros(n), inputs, p, loads, *out)
    return A


def _multi_blade(rotor: RotorModel, psi: float) -> tuple[Array, Array, Array]:
    """T(ψ) with its first and second derivative to ψ; the support's rows are the identity."""
    support = len(rotor.coordinates) - (rotor.blades if rotor.lag == "free" else 0)
    T, T1, T2 = (np.zeros((len(rotor.coordinates),) * 2) for _ in range(3))
    T[:support, :support] = np.eye(support)
    if rotor.lag == "free":
        N = rotor.blades
        for b in range(N):
            angle = psi + 2.0 * math.pi * b / N
            T[support + b, support] = 1.0
            for k in range(1, (N - 1) // 2 + 1):
                column = support + 2 * k - 1
                c, s = math.cos(k * angle), math.sin(k * angle)
                T[support + b, column : column + 2] = c, s
                T1[support + b, column : column + 2] = -k * s, k * c
                T2[support + b, column : column + 2] = -k * k * c, -k * k * s
            if N % 2 == 0:
                T[support + b, -1] = (-1.0) ** b
    return T, T1, T2


def _names(rotor: RotorModel, model: CompiledModel, p: Array, shapes: NDArray[np.complex128]) -> list[str]:
    """A name for each mode shape (n, modes), from where its kinetic energy sits and which way it whirls."""
    support = [name for name in rotor.coordinates if not name.startswith("beta_")]
    inertia = dict(zip(model.parameters, p, strict=True))
    N = rotor.blades
    blades = sum(inertia[f"blade_mass_{i}"] for i in rotor.blade_numbers)
    lag = sum(inertia[f"blade_inertia_{i}"] for i in rotor.blade_numbers)
    weights = {"x": inertia["hub_mass_x"] + blades, "y": inertia["hub_mass_y"] + blades, "roll": lag}
    names: list[str] = []
    for shape in shapes.T:
        energy = {f"tower {name}": weights[name] * abs(shape[i]) ** 2 for i, name in enumerate(support)}
        if rotor.lag == "free":
            start = len(support)
            energy["lag collective"] = lag * abs(shape[start]) ** 2
            for k in range(1, (N - 1) // 2 + 1):
                c, s = shape[start + 2 * k - 1], shape[start + 2 * k]
                whirl = "forward" if (np.conj(c) * s).imag < 0.0 else "backward"
                order = "" if k == 1 else f" {k}"
                energy[f"lag {whirl}{order}"] = 0.5 * lag * (abs(c) ** 2 + abs(s) ** 2)
            if N % 2 == 0:
                energy["lag differential"] = lag * abs(shape[-1]) ** 2
        names.append(max(energy, key=lambda key: energy[key]))
    return [
        name if names.count(name) == 1 else f"{name} ({names[: i + 1].count(name)})" for i, name in enumerate(names)
    ]
