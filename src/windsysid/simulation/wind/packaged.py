"""Wind and blade aerodynamics of the packaged turbines: published where it says so, assumed where not."""

from windsysid.errors import ConfigurationError
from windsysid.simulation.wind.blades import BladeAerodynamics
from windsysid.simulation.wind.field import WindConditions, iec_turbulence_intensity

__all__ = ["packaged_wind"]

KMH = 1.0 / 3.6


def packaged_wind(name: str) -> tuple[WindConditions, BladeAerodynamics]:
    """Wind conditions and blade elements of a packaged turbine.

    Raises
    ------
    ConfigurationError
        If there are none of that name.
    """
    if name not in _PACKAGED:
        raise ConfigurationError(
            f"no blade aerodynamics for turbine '{name}': expected one of {', '.join(_PACKAGED)}; "
            "for another turbine make a WindConditions and a BladeAerodynamics"
        )
    return _PACKAGED[name]


VERNE555 = BladeAerodynamics(
    radii=(0.825, 1.575, 2.325),  # three pieces of the 2.5 m blade that starts at 0.2 m, its root left out
    widths=(0.75, 0.75, 0.75),
    chords=(0.2, 0.2, 0.2),  # the plate's width
    twists_deg=(29.0, 15.0, 8.0),  # an angle of attack of 9° to 10° at 20 km/h: well loaded, a step from stall
    lift_slope=5.5,
    zero_lift_deg=0.0,
    drag=0.015,
    drag_factor=0.01,
    induction=0.1,
    assumed=("everything but the chord, which is the blade's width in verne555.toml",),
)

NREL5MW = BladeAerodynamics(
    radii=(
        15.85,
        28.15,
        40.45,
        52.75,
    ),  # 9.7 m to 58.9 m; left out are the round root and the last 4.1 m, where the tip loses
    widths=(12.3, 12.3, 12.3, 12.3),
    chords=(4.652, 4.007, 3.256, 2.518),
    twists_deg=(11.480, 7.795, 4.188, 1.526),
    pitch_deg=3.83,  # table 7-1 of the same report at 12 m/s
    lift_slope=6.0,
    zero_lift_deg=-4.0,
    drag=0.008,
    drag_factor=0.005,
    induction=0.16,
    levers=(2.52, 10.576, 24.16, 42.049),  # ℓ times the published edgewise mode at the stations (docs/nrel5mw.md)
    assumed=("lift_slope", "zero_lift_deg", "drag", "drag_factor", "induction"),
)

_NREL5MW_WIND = WindConditions(
    speed=12.0,
    hub_height=90.0,
    turbulence_intensity=0.167,
    shear_exponent=0.2,
    tower_radius=2.2,
    tower_distance=5.0,
)

_PACKAGED = {
    "verne555": (
        WindConditions(
            speed=20.0 * KMH,
            hub_height=6.0,
            turbulence_intensity=iec_turbulence_intensity(20.0 * KMH, "C"),
            shear_exponent=0.2,
            tower_radius=0.06,
            tower_distance=0.4,
        ),
        VERNE555,
    ),
    "nrel5mw": (_NREL5MW_WIND, NREL5MW),
    "nrel5mw_full": (_NREL5MW_WIND, NREL5MW),
}
