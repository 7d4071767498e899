"""Load model of wind on a turning rotor, with its statistics.

``broadband``
    The turbine file's loads: a first-order Gauss–Markov process on each degree of freedom, independent of the others,
    and the rotor's harmonics where the file lists them.
``second-order``
    The same with a second-order process, whose spectrum may have a peak and falls twice as fast.
``rotor-wind``
    What wind does to a turning rotor. Turbulence over the disc is a series in azimuth whose terms are uncorrelated and
    slow; the blades cut through them, so that the force on each is

        F_i = A_0 + Σ_{m=1}^{2N+1} (A_m cos mψ_i + B_m sin mψ_i) + R_i,        ψ_i = ψ + 2π(i−1)/N,

    with R_i the small eddies that one blade meets alone. The same forces push the hub: a moment F about a blade's link
    is a force F/ℓ_m on the hub that turns with the blade, ℓ_m further out for smaller eddies. What a
    force has that the moment has not (eddies near the hub) is a series of its own in the terms on the hub, and
    small eddies of its own. Air that pushes hub and blades also damps them together: the coefficient ``c_hub_blade`` of
    `windsysid.mechanics.RotorModel` is identified with the others. So is ``mean_lag_angle``: the wind's mean torque
    holds the blades at a few milliradians, which no accelerometer sees, and which turns the coupling of hub and blades
    so that it looks like damping of the hub.

The spectra of A_m, B_m follow from frozen turbulence with exponential coherence (IEC 61400-1 ed. 4, annex C): what a
ring of radius r sees in its m-th term is S(f) x/(π(x² + m²)), x = 12 r f/V, for S ∝ f^{−5/3} flat below a corner near m
V/12r and steep above, and between two lines nP there is nothing but such skirts. Summed along a blade each is followed
by two poles and a zero, whose shape over f r/V is fixed (`TERMS`): a record tells one corner and one level for all.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from windsysid.errors import ConfigurationError
from windsysid.loads.hypothesis import LoadHypothesis, SupposedLoads, Values, with_level
from windsysid.loads.rotor_forces import BladeForces, blade_force, rotor_harmonic
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.rotor import COUPLING, MEAN_LAG, MEAN_LAG_STD
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import PlacedProcess, Process, first_order, load_on, rational, second_order
from windsysid.turbine.turbine import Turbine

__all__ = ["RotorWind"]

FIRST_POLE_RATIO = 0.091
"""Given value of the first pole of the term m = 1, over the rotor's frequency: at a tip speed ratio of 5."""


class _Term(NamedTuple):
    """One term of the series in azimuth, in units of the term m = 1.

    Attributes
    ----------
    poles, zero
        Over the first pole of the term m = 1.
    level
        Square root of the spectrum at zero frequency, over that of the term m = 1.
    lever
        ℓ_m / ℓ.
    own_pole, own_level
        Statistics of the loads on the hub alone, as a moment at that lever.
    """

    poles: tuple[float, float]
    zero: float
    level: float
    lever: float
    own_pole: float
    own_level: float


TERMS = (
    _Term((0.27, 3.58), 19.2, 3.73, 0.88, 0.97, 0.181),
    _Term((1.00, 5.84), 24.0, 1.00, 0.94, 1.63, 0.135),
    _Term((1.71, 8.04), 26.9, 0.457, 1.00, 2.34, 0.083),
    _Term((2.30, 10.7), 30.2, 0.277, 1.05, 3.07, 0.056),
    _Term((2.76, 14.2), 35.3, 0.192, 1.08, 3.77, 0.041),
    _Term((3.15, 19.4), 45.1, 0.144, 1.11, 4.44, 0.032),
    _Term((3.51, 28.5), 77.8, 0.113, 1.13, 5.09, 0.026),
    _Term((3.89, 36.5), 88.0, 0.092, 1.14, 5.68, 0.022),
    _Term((4.24, 46.0), 88.0, 0.077, 1.16, 6.24, 0.019),
    _Term((4.58, 57.0), 88.0, 0.066, 1.16, 6.75, 0.016),
)
"""The terms m = 0 … 9, fitted to sums over six stations of two blades (the scale model's and the NREL 5 MW turbine's)
in Kaimal's spectrum with the IEC's coherence, from 0.08 to 3 P. Higher terms are as the last."""

COUPLING_STD = 0.5
"""Prior standard deviation of c_hub_blade over the geometric mean of the damping of hub and blade."""


class RotorWind(LoadHypothesis):
    """Wind on a turning rotor."""

    name = "rotor-wind"
    text = "wind on the turning rotor"
    caution = (
        "under simulated turbulent wind ±2σ of this load model covered the true value in 88 % of cases, not 95 % "
        "(docs/calibration.md)"
    )
    """``python -m validation.mismatch`` prints how often."""

    def applies_to(self, turbine: Turbine) -> bool:
        """True if there is a rotor with blades that turns."""
        return turbine.model.rotor is not None and turbine.rotor_speed > 0.0

    def suppose(self, turbine: Turbine, loads: Sequence[GaussMarkov]) -> SupposedLoads:
        """A series in azimuth on blades and hub, small eddies, and the air that couples both."""
        rotor, v = turbine.model.rotor, turbine.values
        names = tuple(dict.fromkeys(load.load for load in loads))
        if turbine.rotor_speed == 0.0:
            raise ConfigurationError(
                "load model rotor-wind: expected a rotor that turns, got a parked one: choose broadband"
            )
        if rotor is None or not loads:
            raise ConfigurationError(
                "load model rotor-wind: expected a rotor with blades of its own and loads that are not all measured; "
                "choose broadband"
            )
        hub = tuple(name for name in names if name in ("load_x", "load_y"))
        both = bool(hub) and any(rotor.freedom(name).blade for name in names)
        to = BladeForces(names, rotor.blades, v["hinge_offset"], rotor.lean(v))
        statistics = _rotor_statistics(turbine, loads, blades=both or not hub, hub=bool(hub), both=both)
        given = {s.name: s.given for s in statistics} | {"load_lever": _lever(turbine)}

        def blocks(values: Values) -> tuple[LoadModel, ...]:
            return _rotor_blocks(to, given | dict(values), hub)

        if not both:
            return SupposedLoads(self.name, self.text, turbine, statistics, blocks)
        lag = v.get(MEAN_LAG, 0.0)
        in_wind = replace(rotor, air_couples=True, leads=True)
        coupled = replace(turbine, model=in_wind, values={**v, COUPLING: 0.0, MEAN_LAG: lag})
        scale = math.sqrt(max(turbine.damping(rotor.freedom(hub[0]).name) * turbine.damping("beta_1"), 1e-300))
        parameters = (
            Parameter(COUPLING, 0.0, COUPLING_STD * scale, False, scale, "damping", "air"),
            Parameter(MEAN_LAG, lag, MEAN_LAG_STD, False, MEAN_LAG_STD, "geometry", "blades"),
        )
        return SupposedLoads(self.name, self.text, coupled, statistics, blocks, parameters)

    def start_from(self, louder: Values, statistics: Sequence[Statistic]) -> dict[str, float]:
        """Ratio of loads on the hub alone to the strongest load on the support, and of all others to the strongest on a
        blade."""
        loudest = max(louder.values(), default=1.0)
        of_hub = [louder[name] for name in _LEVELS_OF_HUB if name in louder]
        of_blades = [factor for name, factor in louder.items() if name not in _LEVELS_OF_HUB]
        hub, blades = max(of_hub, default=loudest), max(of_blades, default=loudest)
        return {
            s.name: s.given * (hub if s.name == "load_rms_hub" else blades) for s in statistics if s.kind == "level"
        }


_LEVELS_OF_HUB = ("load_rms_x", "load_rms_y")


def _lever(turbine: Turbine) -> float:
    """Given value of ℓ [m]: the centre of percussion of the first blade."""
    return turbine.values["blade_inertia_1"] / turbine.values["blade_first_moment_1"]


def _rotor_statistics(
    turbine: Turbine, loads: Sequence[GaussMarkov], *, blades: bool, hub: bool, both: bool
) -> tuple[Statistic, ...]:
    """Statistics of the wind's loads, with priors of the file's size."""
    turn = turbine.rotor_speed / (2.0 * math.pi)
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)
    of_blades = [load.rms for load in loads if turbine.model.freedom(load.load).blade]
    of_hub = [load.rms for load in loads if load.load in ("load_x", "load_y")]
    moment = of_blades[0] if of_blades else of_hub[0] * _lever(turbine)
    found = [
        Statistic("load_rms_wind", "N*m", moment, spread=1.5, kind="level"),
        Statistic("load_corner", "Hz", FIRST_POLE_RATIO * turn, spread=0.7),
    ]
    if both:
        found += [
            Statistic("load_lever", "m", _lever(turbine), spread=0.3),
            Statistic("load_hub_share", "1", 1.0, spread=0.7),
        ]
    if blades:
        found += [
            Statistic("load_rms_eddies", "N*m", 0.3 * moment, spread=1.5, kind="level"),
            Statistic("load_eddies_frequency", "Hz", 3.0 * fastest, spread=0.7),
            Statistic("load_eddies_damping", "1", 0.7, spread=0.7),
        ]
    if hub:
        found.append(Statistic("load_rms_hub", "N", 0.3 * of_hub[0], spread=1.5, kind="level"))
    if hub and not blades:
        found.append(Statistic("load_hub_time_constant", "s", 0.5 / (math.pi * fastest), spread=1.0))
    return tuple(found)


def _rotor_blocks(to: BladeForces, values: Values, hub: Sequence[str]) -> tuple[LoadModel, ...]:
    """The load states of wind on a turning rotor."""
    N = to.blades
    terms = range(2 * N + 2)
    corner = values["load_corner"]
    shapes = [_term(m, corner) for m in terms]
    size = values["load_rms_wind"] / math.sqrt(sum(shape.variance for shape in shapes))
    levers = [values["load_lever"] * _shape_of(m).lever for m in terms]
    blocks = [rotor_harmonic(shape.times(size), m, to, levers[m], f"wind_{m}P") for m, shape in enumerate(shapes)]
    if "load_hub_share" in values:
        blocks += _blocks_of_hub(to, values, levers, size)
    if "load_rms_eddies" in values:
        eddies = _eddies(values, "load_rms_eddies")
        blocks += [blade_force(eddies, i, to, levers[-1], f"eddies_{i}") for i in range(1, N + 1)]
    blocks += [load_on(name, _rest_of_hub(values)) for name in hub]
    return tuple(block for block in blocks if block.outputs)


def _blocks_of_hub(to: BladeForces, values: Values, levers: Sequence[float], size: float) -> list[PlacedProcess]:
    """Loads on the hub alone, at the harmonics that do not cancel between the blades."""
    each = [m for m in range(len(levers)) if (m + 1) % to.blades == 0 or (m - 1) % to.blades == 0]
    own = [_own(m, values["load_corner"]).times(size * values["load_hub_share"]) for m in each]
    return [rotor_harmonic(p, m, to, levers[m], f"hub_{m}P", moments=False) for m, p in zip(each, own, strict=True)]


def _eddies(values: Values, level: str) -> Process:
    """The process of small eddies, with the level of that name."""
    return second_order(values[level], values["load_eddies_frequency"], values["load_eddies_damping"])


def _rest_of_hub(values: Values) -> Process:
    """Other loads on the hub: eddies as on the blades, or a process of its own without loads on blades."""
    if "load_rms_eddies" in values:
        return _eddies(values, "load_rms_hub")
    return first_order(values["load_rms_hub"], values["load_hub_time_constant"])


def _shape_of(m: int) -> _Term:
    return TERMS[min(m, len(TERMS) - 1)]


@lru_cache(maxsize=1024)
def _term(m: int, corner_hz: float) -> Process:
    """The m-th term of the series in azimuth; the spectrum of the first is 1 at zero frequency."""
    shape, corner = _shape_of(m), 2.0 * math.pi * corner_hz
    return with_level(rational(1.0, [-corner * pole for pole in shape.poles], [-corner * shape.zero]), shape.level)


@lru_cache(maxsize=1024)
def _own(m: int, corner_hz: float) -> Process:
    """The m-th term of the loads on the hub alone."""
    shape = _shape_of(m)
    return with_level(first_order(1.0, 1.0 / (2.0 * math.pi * corner_hz * shape.own_pole)), shape.own_level)
