"""The hypotheses that come with the package, and how one is chosen by its name or tried on a record."""

import math
from collections.abc import Sequence

from windsysid.errors import ConfigurationError
from windsysid.loads.hypothesis import HYPOTHESES, LoadHypothesis, SupposedLoads, Values, register_loads
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.rotor_wind import RotorWind
from windsysid.loads.statistics import Statistic, load_groups, moved_loads
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.process import load_on, second_order
from windsysid.turbine.turbine import Turbine

__all__ = ["Broadband", "candidates", "hypothesis"]


def hypothesis(name: str, turbine: Turbine, loads: Sequence[GaussMarkov]) -> SupposedLoads:
    """Load model of the hypothesis of that name for a turbine, `loads` being those of its file that are states.

    Raises
    ------
    ConfigurationError
        If there is none of that name, or it makes no sense for this turbine.
    """
    if name not in HYPOTHESES:
        raise ConfigurationError(f"load model: expected auto, {', '.join(HYPOTHESES)}; got '{name}'")
    return HYPOTHESES[name].suppose(turbine, loads)


def candidates(turbine: Turbine, loads: Sequence[GaussMarkov]) -> tuple[str, ...]:
    """The hypotheses to choose from for a turbine: the simplest, and of those that apply the last, which says most of
    its loads."""
    applying = [name for name, one in HYPOTHESES.items() if one.applies_to(turbine)]
    simplest = next(iter(HYPOTHESES))
    return (simplest,) if not loads else tuple(dict.fromkeys((simplest, applying[-1])))


@register_loads
class Broadband(LoadHypothesis):
    """The loads of the turbine file."""

    name = "broadband"
    text = "first-order Gauss–Markov"

    def suppose(self, turbine: Turbine, loads: Sequence[GaussMarkov]) -> SupposedLoads:
        """A process on each degree of freedom as the file lists them, and harmonics of the rotor."""
        statistics = load_groups(loads, turbine.model)

        def blocks(values: Values) -> tuple[LoadModel, ...]:
            return moved_loads(statistics, values, loads, turbine.model)

        return SupposedLoads(self.name, self.text, turbine, statistics, blocks)


@register_loads
class SecondOrder(LoadHypothesis):
    """Processes whose spectrum may have a peak and falls twice as fast."""

    name = "second-order"
    text = "second-order processes"

    def suppose(self, turbine: Turbine, loads: Sequence[GaussMarkov]) -> SupposedLoads:
        """One process on each degree of freedom; their rms as in the file, frequency and damping ratio common."""
        slowest = min(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)
        plain = [load for load in loads if not load.harmonic]
        levels = tuple(s for s in load_groups(plain, turbine.model) if s.kind == "level")
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

        return SupposedLoads(self.name, self.text, turbine, statistics, blocks)


register_loads(NarrowBand)
register_loads(RotorWind)
