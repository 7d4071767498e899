"""Wind as stochastic processes, and its loads on a turning rotor.

`field` gives the wind speed at points of the blades, `direction` where it comes from, `blades` the generalised loads
that follow, `feedback` simulates with the aerodynamic damping in the loop, `packaged` holds the machines' numbers.
Every equation and its source: docs/wind.md.
"""

from windsysid.simulation.wind.blades import BladeAerodynamics, BladeLoads, blade_loads
from windsysid.simulation.wind.direction import Direction, DirectionChange, simulate_direction
from windsysid.simulation.wind.field import (
    WindConditions,
    coherence,
    extreme_direction_change,
    iec_turbulence_intensity,
    kaimal_spectrum,
    rotating_turbulence,
    rotor_wind,
)
from windsysid.simulation.wind.loads import SimulatedWindLoads, wind_loads
from windsysid.simulation.wind.packaged import packaged_wind

__all__ = [
    "BladeAerodynamics", "BladeLoads", "Direction", "DirectionChange", "SimulatedWindLoads", "WindConditions",
    "blade_loads", "coherence", "extreme_direction_change", "iec_turbulence_intensity", "kaimal_spectrum",
    "packaged_wind", "rotating_turbulence", "rotor_wind", "simulate_direction", "wind_loads",
]  # fmt: skip
