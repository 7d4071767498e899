"""The named hypotheses of what the loads are: the record chooses among them."""

import math
from collections.abc import Callable, Mapping, Sequence

from windsysid.errors import ConfigurationError
from windsysid.loads.hypothesis import LoadHypothesis, Values
from windsysid.loads.rotor_wind import rotor_wind
from windsysid.loads.statistics import Statistic, load_groups, moved_loads
from windsysid.mechanics.rotor import as_rotor
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.process import load_on, second_order
from windsysid.turbine.turbine import Turbine

__all__ = ["FAMILY", "hypothesis"]


def hypothesis(name: str, turbine: Turbine, loads: Sequence[GaussMarkov]) -> LoadHypothesis:
    """The load model of that name for a turbine, `loads` being those of its file that are states.

    Raises
    ------
    ConfigurationError
        If there is none of that name, or it makes no sense for this turbine.
    """
    if name not in FAMILY:
        raise ConfigurationError(f"load model: expected auto, {', '.join(FAMILY)}; got '{name}'")
    return FAMILY[name](turbine, loads)


def candidates(turbine: Turbine, loads: Sequence[GaussMarkov]) -> tuple[str, ...]:
    """The models to choose from for a turbine, the cheapest first: where there is a rotor, wind on it is what the others would have to imitate."""
    if not loads:
        return ("broadband",)
    turning = as_rotor(turbine.model) is not None and turbine.rotor_speed > 0.0
    return ("broadband", "rotor-wind" if turning else "second-order")


def _broadband(turbine: Turbine, loads: Sequence[GaussMarkov]) -> LoadHypothesis:
    """The loads of the turbine file."""
    statistics = load_groups(loads, turbine.model)

    def blocks(values: Values) -> tuple[LoadModel, ...]:
        return moved_loads(statistics, values, loads, turbine.model)

    return LoadHypothesis("broadband", "first-order Gauss–Markov", turbine, statistics, blocks)


def _second_order(turbine: Turbine, loads: Sequence[GaussMarkov]) -> LoadHypothesis:
    """One second-order process on each degree of freedom; their rms as in the file, frequency and damping ratio common."""
    slowest = min(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)
    plain = [load for load in loads if not load.harmonic]
    levels = tuple(s for s in load_groups(plain, turbine.model) if s.name.startswith("load_rms"))
    statistics = (
        *levels,
        Statistic("load_frequency", "Hz", 0.5 * slowest, spread=1.0),
        Statistic("load_damping", "1", 0.7, spread=0.7),
    )

    def blocks(values: Values) -> tuple[LoadModel, ...]:
        return tuple(
            load_on(load.load, second_order(load.rms, values["load_frequency"], values["load_damping"]))
            for load in moved_loads(levels, values, plain, turbine.model)
        )

    return LoadHypothesis("second-order", "second-order processes", turbine, statistics, blocks)


FAMILY: Mapping[str, Callable[[Turbine, Sequence[GaussMarkov]], LoadHypothesis]] = {
    "broadband": _broadband,
    "second-order": _second_order,
    "rotor-wind": rotor_wind,
}
"""The named load models, the cheapest first."""
