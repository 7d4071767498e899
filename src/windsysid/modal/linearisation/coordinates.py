"""Multi-blade coordinates of a linearised model: which states are a blade's, their transformation, and their names.

A quantity of three blades at the azimuths ψ_b = ψ + 2π(b − 1)/3 is

    q_b = a_0 + a_c cos ψ_b + a_s sin ψ_b,

a collective part and a pattern in the fixed frame that whirls forward, z_f = (a_c + i a_s)/√2, or backward,
z_b = (a_c − i a_s)/√2. With x = T(ψ) ξ and Ω constant, ξ̇ = T⁻¹ (A T − Ṫ) ξ; rows of rates have
q̇ = t ξ̇ + Ω t' ξ. The result is constant for three equal blades except for gravity and what else varies once per turn:
it is averaged over azimuths. Source: Bir, Multi-blade coordinate transformation and its application to wind turbine
analysis, NREL/CP-500-42553 (2008).
"""

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.modal.linearisation.lin_file import LinearisedModel, LinearisedState

__all__ = ["ModelCoordinates", "model_coordinates"]

BLADES = 3
"""Setting: number of blades of the transformation."""

_PATTERNS = ("collective", "forward", "backward")

_KINDS = (
    ("tower fore-aft", "tower fore-aft"), ("tower side-to-side", "tower side-side"), ("surge", "platform surge"),
    ("sway", "platform sway"), ("heave", "platform heave"), ("platform roll", "platform roll"),
    ("platform pitch", "platform pitch"), ("platform yaw", "platform yaw"), ("nacelle yaw", "nacelle yaw"),
    ("furl", "furl"), ("teeter", "teeter"), ("drivetrain", "drivetrain"), ("generator", "drivetrain"),
    ("flapwise", "flap"), ("edgewise", "edge"), ("translational displacement in x", "flap"),
    ("translational displacement in y", "edge"), ("translational displacement in z", "blade axial"),
    ("rotational displacement in x", "edge"), ("rotational displacement in y", "flap"),
    ("rotational displacement in z", "torsion"), ("craig-bampton", "substructure"),
)  # fmt: skip
"""Words of a description, and the kind of the degree of freedom; the first that is found counts."""


class _Freedom(NamedTuple):
    """States that are one degree of freedom, or the same of three blades: indices of displacements and of rates."""

    kind: str
    states: tuple[int, ...]
    rates: tuple[int, ...]
    structural: bool


class ModelCoordinates(NamedTuple):
    """Degrees of freedom of a linearised model.

    Attributes
    ----------
    groups
        Of the states.
    size
        Number of states n.
    """

    groups: tuple[_Freedom, ...]
    size: int

    @property
    def rotates(self) -> bool:
        """True if any belongs to the blades."""
        return any(len(group.states) == BLADES for group in self.groups)

    def transformed(self, found: LinearisedModel) -> Array:
        """T⁻¹ (A T − Ṫ) (n, n) of one file."""
        T, rate = np.eye(self.size), np.zeros((self.size, self.size))
        t, t1, t2 = _three_blades(found.azimuth, found.rotor_speed)
        for group in self.groups:
            if len(group.states) != BLADES:
                continue
            q = np.array(group.states)
            T[np.ix_(q, q)], rate[np.ix_(q, q)] = t, t1
            if group.rates:
                v = np.array(group.rates)
                T[np.ix_(v, v)], T[np.ix_(v, q)] = t, t1
                rate[np.ix_(v, v)], rate[np.ix_(v, q)] = t1, t2
        return np.asarray(np.linalg.solve(T, found.A @ T - rate))

    def whirls(self) -> Complex:
        """Unitary (n, n) that takes collective, cosine and sine parts to collective, forward and backward ones."""
        U: Complex = np.eye(self.size, dtype=complex)
        for group in self.groups:
            for one in (group.states, group.rates) if len(group.states) == BLADES else ():
                if one:
                    pair = np.ix_(one[1:], one[1:])
                    U[pair] = np.array([[1.0, 1.0j], [1.0, -1.0j]]) / math.sqrt(2.0)
        return U

    def shares(self, participation: Array) -> tuple[dict[str, float], float]:
        """Participation (n,) of whirl coordinates by kind, largest first, and the share of structural states."""
        found: dict[str, float] = {}
        structural = 0.0
        for group in self.groups:
            patterns = _PATTERNS if len(group.states) == BLADES else ("",)
            for i, pattern in enumerate(patterns):
                share = float(sum(participation[one[i]] for one in (group.states, group.rates) if one))
                name = f"{group.kind} {pattern}".strip()
                found[name] = found.get(name, 0.0) + share
                structural += share if group.structural else 0.0
        return dict(sorted(found.items(), key=lambda item: -item[1])), structural

    def motions(self, shapes: Complex) -> dict[str, Complex]:
        """Displacements (m,) by kind of m modes in whirl coordinates (n, m), as amplitudes of collective parts and of
        patterns a_c ± i a_s."""
        found: dict[str, Complex] = {}
        for group in self.groups:
            patterns = _PATTERNS if len(group.states) == BLADES else ("",)
            for i, pattern in enumerate(patterns):
                name = f"{group.kind} {pattern}".strip()
                moved = shapes[group.states[i]] * (math.sqrt(2.0) if i else 1.0)
                found[name] = found.get(name, np.zeros(shapes.shape[1], dtype=complex)) + moved
        return found

    @property
    def displacements(self) -> list[int]:
        """Indices of the states that are no rates."""
        return [i for group in self.groups for i in group.states]


def _three_blades(psi: float, speed: float) -> tuple[Array, Array, Array]:
    """t, Ω t' and Ω² t'' (3, 3): of collective, cosine and sine parts of three blades."""
    angle = psi + 2.0 * math.pi * np.arange(BLADES) / BLADES
    one, c, s = np.ones(BLADES), np.cos(angle), np.sin(angle)
    first = speed * np.column_stack([0.0 * one, -s, c])
    return np.column_stack([one, c, s]), first, speed * speed * np.column_stack([0.0 * one, -c, -s])


def model_coordinates(found: LinearisedModel) -> ModelCoordinates:
    """Sort the states of a file into degrees of freedom, those of blades in threes.

    Raises
    ------
    ConfigurationError
        If a rotating state has no counterpart on each of three blades, or no rate although its equation has one.
    """
    rates = {(s.module, s.name): i for i, s in enumerate(found.states) if s.rate}
    displacements = {(s.module, s.name) for s in found.states if not s.rate}
    groups = []
    blades: dict[tuple[str, str], dict[int, int]] = defaultdict(dict)
    for i, state in enumerate(found.states):
        if state.rate and (state.module, state.name) in displacements:
            continue
        if state.rotating:
            _check_pair(found, state, rates)
            number, key = _blade(state)
            blades[key][number] = i
        else:
            groups.append(_group(found.states, (i,), rates))
    for key, each in blades.items():
        if sorted(each) != [1, 2, 3]:
            numbers = ", ".join(str(n) for n in sorted(each) if n) or "none"
            raise ConfigurationError(
                f"{found.path}: expected '{key[1][:50]}' of blades 1, 2 and 3, got {numbers}: "
                "the transformation is that of three-bladed rotors"
            )
        groups.append(_group(found.states, tuple(each[n] for n in (1, 2, 3)), rates))
    return ModelCoordinates(tuple(groups), len(found.states))


def _check_pair(found: LinearisedModel, state: LinearisedState, rates: Mapping[tuple[str, str], int]) -> None:
    """Refuse a state of a blade whose equation is of second order, without its rate or without its displacement."""
    if state.rate or (state.order == 2 and (state.module, state.name) not in rates):
        raise ConfigurationError(
            f"{found.path}: '{state.module} {state.name[:50]}' is of second order: expected the state and its "
            "'First time derivative of …', got one of them"
        )


def _group(
    states: Sequence[LinearisedState], indices: tuple[int, ...], rates: Mapping[tuple[str, str], int]
) -> _Freedom:
    """The degree of freedom of some states, with their rates where all have one."""
    partners = [rates.get((states[i].module, states[i].name)) for i in indices]
    first = states[indices[0]]
    second = tuple(partner for partner in partners if partner is not None)
    return _Freedom(_kind(first), indices, second if len(second) == len(indices) else (), first.order == 2)


def _blade(state: LinearisedState) -> tuple[int, tuple[str, str]]:
    """Number of the blade of a state, 0 if none is named, and the common name of this state of all blades."""
    module, _, instance = state.module.partition("_")
    number = re.search(r"blade (\d)", state.name, flags=re.IGNORECASE)
    named = int(number[1]) if number else int(instance) if instance.isdigit() and module == "BD" else 0
    return named, (module, re.sub(r"(blade) \d", r"\1", state.name, flags=re.IGNORECASE))


def _kind(state: LinearisedState) -> str:
    """The kind of a degree of freedom by its description, else by its module."""
    words = state.name.lower()
    modules = {"AD": "aerodynamics", "HD": "waves", "SD": "substructure", "BD": "blade", "SrvD": "controller"}
    module = state.module.partition("_")[0]
    return next((kind for word, kind in _KINDS if word in words), modules.get(module, f"{module} states"))
