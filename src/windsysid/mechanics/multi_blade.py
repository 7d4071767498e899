"""Multi-blade coordinates of a rotor, and the names of its modes in them.

Linearised about its motion, a rotor's equations still turn with it. Multi-blade coordinates (Coleman & Feingold 1958)

    β_i = ξ_0 + Σ_n (ξ_nc cos nψ_i + ξ_ns sin nψ_i)  (+ (−1)^i ξ_d for even N),      q = T(ψ) ξ

make them constant for three or more equal blades at constant Ω without gravity in the rotor plane, about β = 0.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from windsysid._types import Array, Complex

__all__ = ["MultiBlade"]

MIN_WHIRL_ROUNDNESS = 0.8
"""Least ratio of axes of the support's orbit to be called a whirl: 1 is a circle, 0 a line."""


class BladedRotor(Protocol):
    """Rotor as multi-blade coordinates use it (`windsysid.mechanics.rotor.RotorModel`)."""

    @property
    def blades(self) -> int:
        """Number of blades N."""

    @property
    def blade_numbers(self) -> Sequence[int]:
        """Numbers of the blades, from 1."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the free degrees of freedom, the support's first."""

    @property
    def roll(self) -> str:
        """Roll of the support: locked, tied or free."""

    @property
    def lag(self) -> str:
        """The blades: free or locked."""

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """Part that moves with one degree of freedom."""


class MultiBlade(NamedTuple):
    """`windsysid.mechanics.model.ModalAxes` of a rotor."""

    rotor: BladedRotor

    @property
    def turns(self) -> bool:
        """Always true: without lag there may be roll or imbalance."""
        return True

    @property
    def hinged_blades(self) -> int:
        """Number of blades that lag by themselves."""
        return self.rotor.blades if self.rotor.lag == "free" else 0

    @property
    def averages(self) -> bool:
        """True if the remaining dependence on the azimuth may be averaged over a turn: not with two blades, whose
        equations turn as a whole."""
        return self.rotor.blades >= 3 or self.rotor.lag == "locked"

    def obstacles(self, values: Mapping[str, float]) -> list[str]:
        """Why the Coleman transform does not make this rotor's equations constant, a phrase each; empty where it
        does."""
        rotor = self.rotor
        if rotor.lag == "locked" and rotor.roll == "locked":
            return []
        found = []
        least = 3 if rotor.lag == "free" else 2
        if rotor.blades < least:
            found.append("one blade" if rotor.blades == 1 else f"{rotor.blades} blades")
        for name in ("blade_mass", "blade_first_moment", "blade_inertia", "k_beta", "c_beta"):
            each = [values[f"{name}_{i}"] for i in rotor.blade_numbers]
            if max(each) != min(each) and (rotor.lag == "free" or name.startswith("blade")):
                found.append(f"blades differ in {name}")
        if values["gravity"] != 0.0 and rotor.lag == "free":
            found.append("gravity in the rotor plane")
        if values["eccentricity"] != 0.0:
            found.append("an eccentric hub")
        return found

    def transform(self, psi: Array) -> Array:
        """T(ψ) with its first and second derivative to ψ (3, K, n, n), at azimuths (K,); the support's rows are the
        identity."""
        n = len(self.rotor.coordinates)
        T = np.zeros((3, len(psi), n, n))
        T[0] = np.eye(n)
        if N := self.hinged_blades:
            support = n - N
            T[0, :, support:, support:] = 0.0
            for b in range(N):
                row, angle = support + b, psi + 2.0 * math.pi * b / N
                T[0, :, row, support] = 1.0
                for k in range(1, (N - 1) // 2 + 1):
                    column = support + 2 * k - 1
                    c, s = np.cos(k * angle), np.sin(k * angle)
                    T[:, :, row, column] = c, -k * s, -k * k * c
                    T[:, :, row, column + 1] = s, k * c, -k * k * s
                if N % 2 == 0:
                    T[0, :, row, -1] = (-1.0) ** b
        return T

    def weights(self, values: Mapping[str, float]) -> Array:
        """Mass of each multi-blade coordinate (n,): masses, and inertia for the blades."""
        rotor, v = self.rotor, values
        blades = sum(v[f"blade_mass_{i}"] for i in rotor.blade_numbers)
        lag = sum(v[f"blade_inertia_{i}"] for i in rotor.blade_numbers)
        support = {"x": v["hub_mass_x"] + blades, "y": v["hub_mass_y"] + blades, "roll": rotor.inertia("roll", v)}
        weights = [support[name] for name in rotor.coordinates if name in support]
        if N := self.hinged_blades:
            weights += [lag, *([0.5 * lag] * (2 * ((N - 1) // 2))), *([lag] if N % 2 == 0 else [])]
        return np.array(weights)

    def name(self, shape: Complex) -> str:
        """From where the energy of a weighted shape (n,) sits and which way it whirls."""
        start, N = len(self.rotor.coordinates) - self.hinged_blades, self.hinged_blades
        support = {name: i for i, name in enumerate(self.rotor.coordinates[:start])}
        energy = {f"tower {name}": abs(shape[i]) ** 2 for name, i in support.items()}
        if {"x", "y"} <= set(support):
            whirl, roundness = _whirl(shape[support["x"]], shape[support["y"]])
            if roundness > MIN_WHIRL_ROUNDNESS:
                energy[f"tower {whirl}"] = energy.pop("tower x") + energy.pop("tower y")
        if N:
            energy["lag collective" if N > 1 else "lag"] = abs(shape[start]) ** 2
            for k in range(1, (N - 1) // 2 + 1):
                c, s = shape[start + 2 * k - 1], shape[start + 2 * k]
                energy[f"lag {_whirl(c, s)[0]}{'' if k == 1 else f' {k}'}"] = abs(c) ** 2 + abs(s) ** 2
            if N % 2 == 0:
                energy["lag differential"] = abs(shape[-1]) ** 2
        return max(energy, key=lambda key: energy[key])


def _whirl(c: complex, s: complex) -> tuple[str, float]:
    """Sense of rotation of the orbit Re (c, s) e^{iωt}, and its ratio of axes."""
    area, size = float((np.conj(c) * s).imag), abs(c) ** 2 + abs(s) ** 2
    return "forward" if area < 0.0 else "backward", 2.0 * abs(area) / size if size > 0.0 else 0.0
