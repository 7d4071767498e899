"""Wind to loads in one call: draw speed and direction, and let the blades make loads of them."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.simulation.wind.blades import BladeAerodynamics, blade_loads
from windsysid.simulation.wind.direction import Direction, simulate_direction
from windsysid.simulation.wind.field import WindConditions, rotor_wind

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["SimulatedWindLoads", "wind_loads"]


class SimulatedWindLoads(NamedTuple):
    """Effect of the wind on a turbine over T samples.

    Attributes
    ----------
    loads
        Generalised loads at rest (T, n) [N, N·m], in the order of `RotorModel.loads`: as `simulate.integrate` takes
        them.
    damping
        Aerodynamic damping C (T, n, n): with feedback the loads are ``loads − C q̇``.
    hub_speed
        Wind speed at the hub (T,) [m/s].
    misalignment
        δ (T,) [rad].
    blade_speed
        Wind speed at the blade stations (T, N, R) [m/s].
    torque
        Aerodynamic torque of the rotor (T,) [N·m].
    """

    loads: Array
    damping: Array
    hub_speed: Array
    misalignment: Array
    blade_speed: Array
    torque: Array


def wind_loads(
    turbine: "Turbine",
    conditions: WindConditions,
    aerodynamics: BladeAerodynamics,
    rotor: Array,
    *,
    rate: float,
    direction: Direction | None = None,
    seed: int = 0,
) -> SimulatedWindLoads:
    """Loads of turbulent wind on a turning rotor; reproducible for a seed.

    Parameters
    ----------
    rotor
        ψ [rad, unwrapped], Ω [rad/s], … (T, 2 or more): the inputs of the rotor model; Ω may vary.
    rate
        Samples per second [Hz].
    direction
        Along the rotor's axis by default. Speed is the same for the same seed, whatever the direction does.

    Raises
    ------
    ConfigurationError
        If an option is out of range or an array does not fit.
    """
    rotor = np.asarray(rotor, dtype=np.float64)
    if rotor.ndim != 2 or rotor.shape[1] < 2:
        raise ConfigurationError(f"rotor: expected columns azimuth and speed, (T, 2) or more, got {rotor.shape}")
    speed_seed, direction_seed = np.random.SeedSequence(seed).spawn(2)
    wind = rotor_wind(
        conditions, rotor[:, 0], aerodynamics.radii, blades=turbine.model.blades, rate=rate,
        seed=np.random.default_rng(speed_seed),
    )  # fmt: skip
    delta = simulate_direction(
        direction or Direction(), len(rotor), rate=rate, seed=np.random.default_rng(direction_seed)
    )
    made = blade_loads(turbine, aerodynamics, wind.blades, rotor, delta, mean_speed=conditions.speed)
    return SimulatedWindLoads(made.loads, made.damping, wind.hub, delta, wind.blades, made.torque)
