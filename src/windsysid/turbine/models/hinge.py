"""The equivalent hinge of a bending blade, and the support of its rotor (docs/nrel5mw.md).

A hinged blade of mass m, first moment S and inertia I about its hinge at the radius d has the lag angle q/ℓ for the tip
deflection q of the bending blade. Four numbers of the first edgewise mode determine ℓ, d, S and I:

    ∫φ² dm = I/ℓ²,   ∫φ_lag dm = S/ℓ,   ∫r φ_lag dm = (I + S d)/ℓ,   centrifugal stiffening = S d Ω²/ℓ².

The support has the tower's first side-side mode, and a spring and an inertia of roll of its own. These put the
collective edgewise mode and the tower's second mode where the machine has them.
"""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.machine import Blade, Machine, Top
from windsysid.turbine.models.motion import MachineModes, TowerMode
from windsysid.turbine.models.rotor_motion import TOP_SIZE, rotor_equations

__all__ = ["Hinge", "RotorSupport", "equivalent_hinge", "equivalent_rotor", "planar_frequencies"]


class Hinge(NamedTuple):
    """Hinge radius and lever of the tip [m], mass [kg], first moment [kg·m], inertia [kg·m²] about the hinge, spring
    [N·m/rad], damper [N·m·s/rad], distance of the tip from the hinge [m], slope of the tip [rad/rad]."""

    offset: float
    lever: float
    mass: float
    first_moment: float
    inertia: float
    stiffness: float
    damping: float
    tip: float
    slope: float


class RotorSupport(NamedTuple):
    """Hub mass [kg], k_x [N/m], c_x [N·s/m], κ [rad/m], roll inertia [kg·m²], k_roll [N·m/rad], c_roll [N·m·s/rad]."""

    hub_mass: float
    stiffness: float
    damping: float
    kappa: float
    roll_inertia: float
    roll_stiffness: float
    roll_damping: float


def equivalent_hinge(blade: Blade, top: Top, tower: TowerMode) -> Hinge:
    """The hinged blade that stands for a bending one on a tower with a first side-side mode.

    Raises
    ------
    ConfigurationError
        If the blade's first edgewise shape is not one: no part of it in plane.
    """
    e = blade.edge
    shape = blade.displacement[:, e]
    lag = shape[:, 1]
    mass = blade.mass
    square = float(np.sum(mass * np.sum(shape**2, axis=1)))
    rise = float(top.apex[2])
    plain = float(np.sum(mass * lag)) * (1.0 + tower.tilt * rise)
    moment = float(np.sum(mass * blade.radius * lag)) * math.cos(top.cone)
    stiffening = float(np.sum(mass * blade.radius * blade.shortening[:, e, e])) * math.cos(top.cone) ** 2
    stiffening -= float(np.sum(mass * lag**2))
    if plain <= 0.0 or stiffening <= 0.0:
        raise ConfigurationError("blade: expected an edgewise shape that moves in plane, got one that does not")
    lever = moment / (square + stiffening)
    offset = float(stiffening * lever / plain)
    tip = float(blade.radius[-1])
    return Hinge(
        offset, lever, float(mass.sum()), plain * lever, square * lever**2, float(blade.stiffness[e, e]) * lever**2,
        float(blade.damping[e, e]) * lever**2, tip - offset, blade.tip_slope * lever,
    )  # fmt: skip


def equivalent_rotor(
    machine: Machine, hinge: Hinge, tower: list[TowerMode], modes: MachineModes
) -> tuple[Hinge, RotorSupport]:
    """The support and the spring of the hinge with which a rotor of hinged blades has the modes of the machine.

    k_x, roll inertia, k_roll and k_β are found from five frequencies with the rotor turning: first and second side-side
    mode of the tower, and the three edgewise modes. k_β comes out 1 to 4 % below the elastic one: blades bend out of
    plane, too, and the tower fore-aft (docs/richer.md).

    Raises
    ------
    ConfigurationError
        If the machine lacks one of these modes, or no support has them.
    """
    from scipy.optimize import least_squares

    if modes.collective is None or modes.second is None or modes.backward is None or modes.forward is None:
        raise ConfigurationError(
            f"{machine.name}: expected edgewise modes and a second side-side mode of the tower, found fewer; write the "
            "file with kind='tower'"
        )
    first, second = tower
    named = (modes.side_side, modes.backward, modes.collective, modes.forward, modes.second)
    targets = np.sort([mode.frequency for mode in named])
    about_hub = hinge.inertia + 2.0 * hinge.offset * hinge.first_moment + hinge.mass * hinge.offset**2
    blades = float(machine.blades)

    def blade(unknown: Array) -> Hinge:
        return hinge._replace(stiffness=hinge.stiffness * math.exp(unknown[3]))

    def support(unknown: Array) -> RotorSupport:
        stiffness, inertia, roll = (float(value) for value in np.exp(unknown[:3]))
        hub = first.mass - blades * hinge.mass - first.tilt**2 * (blades * about_hub + inertia)
        omega = 2.0 * math.pi * first.frequency
        return RotorSupport(
            hub, stiffness, 2.0 * first.damping * omega * first.mass, -first.tilt, inertia, roll,
            second.damping_time * roll,
        )  # fmt: skip

    def misfit(unknown: Array) -> Array:
        return np.asarray(np.log(planar_frequencies(machine, blade(unknown), support(unknown)) / targets))

    omega = 2.0 * math.pi * first.frequency
    start = np.log(
        [omega**2 * first.mass, blades * about_hub, (2.0 * math.pi * modes.second.frequency) ** 2 * about_hub, 1.0]
    )
    found = least_squares(misfit, start, x_scale=0.1, max_nfev=100)
    answer = support(found.x)
    if np.max(np.abs(found.fun)) > MAX_MISFIT or answer.hub_mass <= 0.0:
        raise ConfigurationError(
            f"{machine.name}: no support with a free roll has the modes {', '.join(f'{f:.4g}' for f in targets)} Hz; "
            "write the file with kind='tower'"
        )
    return blade(found.x), answer


MAX_MISFIT = 0.02
"""Size: largest relative error of a frequency of the equivalent rotor; four coefficients give five frequencies."""

MIN_FREQUENCY = 1e-6
"""Setting: frequency [rad/s] in place of that of a mode that does not vibrate, during the search."""


def planar_frequencies(machine: Machine, hinge: Hinge, support: RotorSupport) -> Array:
    """Frequencies (5,) [Hz] of a rotor of hinged blades on its support, ascending."""
    M, C, K = _planar(machine, hinge, support)
    lower = np.linalg.solve(M, np.hstack([-K, -C]))
    exponents = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((5, 5)), np.eye(5)]), lower]))
    return np.asarray(np.maximum(np.sort(exponents.imag)[5:], MIN_FREQUENCY) / (2.0 * math.pi))


def _planar(machine: Machine, hinge: Hinge, support: RotorSupport) -> tuple[Array, Array, Array]:
    """M, C, K (5, 5) of x, free roll, and collective, cosine and sine part of the lag of hinged blades."""
    far = hinge.inertia / hinge.first_moment
    heavy = hinge.first_moment**2 / hinge.inertia
    arms = np.array([0.0, far])
    blade = Blade(
        hinge.offset + arms, np.array([hinge.mass - heavy, heavy]),
        np.stack([0.0 * arms, arms / hinge.lever], axis=-1)[:, None, :], (arms / hinge.lever**2)[:, None, None],
        np.array([[hinge.stiffness]]) / hinge.lever**2, np.array([[hinge.damping]]) / hinge.lever**2, 0, 0.0,
    )  # fmt: skip
    flat = Top((), np.zeros((2, 2)), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    found = rotor_equations(blade, flat, machine.rotor_speed, 0.0)
    to_top = np.zeros((len(found.mass), 5))
    to_top[1, 0] = 1.0
    to_top[2, :2] = support.kappa, 1.0
    to_top[TOP_SIZE:, 2:] = np.eye(3)
    M, C, K = (to_top.T @ part @ to_top for part in found)
    lean = np.array([support.kappa, 1.0, 0.0, 0.0, 0.0])
    M += support.roll_inertia * np.outer(lean, lean)
    M[0, 0] += support.hub_mass
    K[0, 0] += support.stiffness
    K[1, 1] += support.roll_stiffness
    C[0, 0] += support.damping
    C[1, 1] += support.roll_damping
    return M, C, K
