"""From wind to generalised loads: quasi-steady blade elements with linear lift, frozen wake, in the plane of the rotor.

Station s of blade i at the angle θ_i moves along the tangent t = (−sin θ, cos θ) by J q̇,

    J = [−sin θ (+ κ r where x leans the rotor), cos θ, r (roll), lever (β_i)],

and meets the air with V_n = u cos δ − a V across the rotor plane and W = r Ω + J q̇ + u sin δ sin θ in it. Then

    φ = arctan(V_n / W),  α = φ − twist − pitch,  C_l = C_lα (α − α_0),  C_d = C_d0 + k C_l²,
    f = ½ ρ c √(V_n² + W²) (C_l V_n − C_d W)   [N/m, positive with the rotation],
    Q = Σ Jᵀ f Δr,      C = −∂Q/∂q̇ = Σ Jᵀ (−∂f/∂W) J Δr.

The same J makes velocities of q̇ and generalised loads of forces (virtual work), so C is symmetric, and positive where
−∂f/∂W is. Sources: Burton et al., Wind Energy Handbook (blade elements, aerodynamic damping); M. O. L. Hansen,
Aerodynamics of Wind Turbines (blade elements); M. H. Hansen (2007), https://doi.org/10.1002/we.242 (damping of a blade
section).
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.simulation.wind.field import blade_angles

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["BladeAerodynamics", "BladeLoads", "blade_loads"]


@dataclass(frozen=True)
class BladeAerodynamics:
    """Blade elements of one blade; all blades are alike.

    Attributes
    ----------
    radii
        Distance of the stations from the hub's centre [m].
    widths
        Length of blade that each station stands for [m].
    chords
        [m].
    twists_deg
        Structural twist, positive towards feather [deg].
    pitch_deg
        Pitch angle, added to the twist [deg].
    lift_slope
        C_lα [1/rad].
    zero_lift_deg
        α_0 [deg].
    drag, drag_factor
        C_d0 and k of C_d = C_d0 + k C_l².
    induction
        a: the wake slows the axial wind by a V, V the mean speed, and stays as it is when the wind changes (frozen
        wake).
    density
        ρ [kg/m³].
    levers
        How far a station moves in the plane per unit lag angle [m]; r − d (rigid blade on its hinge) by default.
    assumed
        Values that are not published.
    """

    radii: tuple[float, ...]
    widths: tuple[float, ...]
    chords: tuple[float, ...]
    twists_deg: tuple[float, ...]
    pitch_deg: float = 0.0
    lift_slope: float = 6.0
    zero_lift_deg: float = -4.0
    drag: float = 0.01
    drag_factor: float = 0.01
    induction: float = 0.2
    density: float = 1.225
    levers: tuple[float, ...] | None = None
    assumed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("widths", "chords", "twists_deg", "levers"):
            column = getattr(self, name)
            if column is not None and len(column) != len(self.radii):
                raise ConfigurationError(
                    f"blade stations: expected {len(self.radii)} {name}, one per radius, got {len(column)}"
                )
        for name in ("radii", "widths", "chords", "density"):
            values = np.atleast_1d(getattr(self, name))
            if not values.size or not np.all(np.isfinite(values) & (values > 0.0)):
                raise ConfigurationError(f"blade {name}: expected positive numbers, got {getattr(self, name)}")
        numbers = (*self.twists_deg, *(self.levers or ()), self.pitch_deg, self.zero_lift_deg)
        if not all(map(math.isfinite, numbers)):
            raise ConfigurationError("blade twist, pitch, levers and zero-lift angle: expected finite numbers")
        for name, value in (("lift_slope", self.lift_slope), ("drag", self.drag), ("drag_factor", self.drag_factor)):
            if not 0.0 <= value < math.inf:
                raise ConfigurationError(f"blade {name}: expected 0 or more, got {value}")
        if not 0.0 <= self.induction < 0.5:
            raise ConfigurationError(
                f"induction: expected 0 to 0.5 (momentum theory ends there), got {self.induction}; 1/3 is Betz's"
            )


class BladeLoads(NamedTuple):
    """Loads on a rotor's degrees of freedom and how they fall with velocity.

    Attributes
    ----------
    loads
        Generalised loads (T, n) [N, N·m], in the order of `RotorModel.loads`.
    damping
        C (T, n, n) with ΔQ = −C q̇ [N·s/m, N·m·s/rad, …].
    torque
        Aerodynamic torque of the rotor (T,) [N·m].
    """

    loads: Array
    damping: Array
    torque: Array


def blade_loads(
    turbine: "Turbine",
    aerodynamics: BladeAerodynamics,
    wind: Array,
    rotor: Array,
    misalignment: Array | float = 0.0,
    *,
    mean_speed: float,
    velocity: Array | None = None,
) -> BladeLoads:
    """Generalised aerodynamic loads in the plane of the rotor.

    Parameters
    ----------
    wind
        Longitudinal wind speed at the stations (T, N, R) [m/s].
    rotor
        ψ [rad], Ω [rad/s], … (T, 2 or more).
    misalignment
        δ (T,) [rad], positive towards +x.
    mean_speed
        V of the frozen wake [m/s].
    velocity
        q̇ (T, n) of the free degrees of freedom; zero by default: loads without feedback.

    Raises
    ------
    ConfigurationError
        If an array does not fit.
    """
    model = turbine.rotor
    radii = np.array(aerodynamics.radii)
    samples, n = len(rotor), len(model.coordinates)
    if wind.shape != (samples, model.blades, len(radii)):
        raise ConfigurationError(
            f"blade loads: expected wind ({samples}, {model.blades}, {len(radii)}), got {wind.shape}"
        )
    if velocity is not None and velocity.shape != (samples, n):
        raise ConfigurationError(f"blade loads: expected velocity ({samples}, {n}), got {velocity.shape}")
    theta = blade_angles(rotor[:, 0], model.blades)[:, :, None]
    delta = np.broadcast_to(np.asarray(misalignment, dtype=np.float64), (samples,))[:, None, None]
    motion = _station_motion(turbine, aerodynamics, theta)
    across = wind * np.cos(delta) - aerodynamics.induction * mean_speed
    along = radii * rotor[:, 1, None, None] + wind * np.sin(delta) * np.sin(theta)
    if velocity is not None:
        along = along + sum(motion[j] * velocity[:, j, None, None] for j in range(n))
    force, slope = _tangential_force(aerodynamics, across, along)
    width = np.array(aerodynamics.widths)
    force, slope = force * width, slope * width
    loads = np.column_stack([(motion[j] * force).sum(axis=(1, 2)) for j in range(n)])
    damping = np.empty((samples, n, n))
    for i in range(n):
        weighted = motion[i] * slope
        for j in range(i + 1):
            damping[:, i, j] = damping[:, j, i] = (weighted * motion[j]).sum(axis=(1, 2))
    return BladeLoads(loads, damping, (force * radii).sum(axis=(1, 2)))


def _station_motion(turbine: "Turbine", aerodynamics: BladeAerodynamics, theta: Array) -> list[Array]:
    """J: motion of every station along its tangent per unit of each degree of freedom, (T, N, R) or what broadcasts to
    it."""
    model, radii = turbine.rotor, np.array(aerodynamics.radii)
    levers = radii - turbine.values["hinge_offset"] if aerodynamics.levers is None else np.array(aerodynamics.levers)
    columns = []
    for name in model.coordinates:
        if name == "x":
            columns.append(-np.sin(theta) + model.lean(turbine.values) * radii)
        elif name == "y":
            columns.append(np.cos(theta))
        elif name == "roll":
            columns.append(np.broadcast_to(radii, (1, 1, len(radii))))
        else:
            own = np.arange(1, model.blades + 1) == model.blade_of(name)
            columns.append(own[None, :, None] * levers)
    return columns


def _tangential_force(aerodynamics: BladeAerodynamics, across: Array, along: Array) -> tuple[Array, Array]:
    """f [N/m] with the rotation, and −∂f/∂W [N·s/m²], at V_n = `across` and W = `along`."""
    b = aerodynamics
    speed = np.hypot(across, along)
    twist = np.deg2rad(np.array(b.twists_deg) + b.pitch_deg + b.zero_lift_deg)
    lift = b.lift_slope * (np.arctan2(across, along) - twist)
    drag = b.drag + b.drag_factor * lift**2
    scale = 0.5 * b.density * np.array(b.chords)
    inside = lift * across - drag * along
    safe = np.where(speed > 0.0, speed, 1.0)
    lift_slope = -b.lift_slope * across / safe**2  # ∂φ/∂W = −V_n / (V_n² + W²)
    drag_slope = 2.0 * b.drag_factor * lift * lift_slope
    inside_slope = lift_slope * across - drag_slope * along - drag
    return scale * speed * inside, -scale * (along / safe * inside + speed * inside_slope)
