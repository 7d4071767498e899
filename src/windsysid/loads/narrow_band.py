"""A narrow-band load on a support, in addition to the broad ones: a machine of varying speed, waves, a neighbour.

White noise through a second-order low-pass pushes every degree of freedom of the support that has a mode, at one
frequency and with one width, with a level of its own for each. Its frequency may be that of a mode: a peak next to
another, or on it.
"""

import math
from collections.abc import Sequence

from windsysid.errors import ConfigurationError
from windsysid.loads.hypothesis import LoadHypothesis, SupposedLoads, Values
from windsysid.loads.statistics import Statistic, load_groups, moved_loads
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.process import load_on, second_order
from windsysid.turbine.turbine import Turbine

__all__ = ["FREQUENCY", "LEVEL", "MEDIAN_DAMPING_RATIO", "WIDTH", "NarrowBand", "narrow_band_statistics"]

FREQUENCY, WIDTH, LEVEL = "narrow_band_frequency", "narrow_band_damping", "narrow_band_rms_"
"""Names of its statistics; the last is followed by the degree of freedom that it acts on."""

LOG_FREQUENCY_STD = 0.15
"""Prior standard deviation of the logarithm of its frequency over that of the support's modes."""

MEDIAN_DAMPING_RATIO, LOG_DAMPING_STD = 0.01, 1.2
"""Its damping ratio, and the prior standard deviation of the logarithm of that: from nearly a line to waves."""

MEDIAN_RMS_RATIO, LOG_RMS_RATIO_STD = 0.05, 2.0
"""Its rms relative to that of the broad load in the turbine file, and the prior standard deviation of the logarithm of
the ratio: it may act on one degree of freedom only."""


class NarrowBand(LoadHypothesis):
    """The loads of the turbine file and a narrow-band one on the support."""

    name = "narrow-band"
    text = "first-order Gauss–Markov, and a narrow-band process on the support"

    def applies_to(self, turbine: Turbine) -> bool:
        """Not by itself: it is tested where spectra show a peak."""
        return False

    def suppose(self, turbine: Turbine, loads: Sequence[GaussMarkov]) -> SupposedLoads:
        """A second-order process in addition to the load on every degree of freedom of the support."""
        broad, narrow = load_groups(loads, turbine.model), narrow_band_statistics(turbine, loads)
        if not narrow:
            raise ConfigurationError(
                "load model narrow-band: expected a support with a spring and a load that is not measured; choose "
                "broadband"
            )
        names = {one.name: one.load for one in turbine.model.freedoms}
        levels = [one for one in narrow if one.kind == "narrow-band level"]

        def blocks(values: Values) -> tuple[LoadModel, ...]:
            processes = [
                load_on(names[one.of], second_order(values[one.name], values[FREQUENCY], values[WIDTH]))
                for one in levels
            ]
            return (*moved_loads(broad, values, loads, turbine.model), *processes)

        return SupposedLoads(self.name, self.text, turbine, (*broad, *narrow), blocks)


def narrow_band_statistics(turbine: Turbine, loads: Sequence[GaussMarkov]) -> tuple[Statistic, ...]:
    """Statistics of a narrow-band load on a turbine whose file has these loads that are states; empty if it would act
    on no mode."""
    rms = {load.load: load.rms for load in loads if not load.harmonic}
    pushed = [
        one
        for one in turbine.model.freedoms
        if not one.blade and one.load in rms and turbine.natural_frequency(one.name) > 0.0
    ]
    if not pushed:
        return ()
    modes = [math.log(turbine.natural_frequency(one.name) / (2.0 * math.pi)) for one in pushed]
    low, high = min(modes), max(modes)
    return (
        Statistic(FREQUENCY, "Hz", math.exp(0.5 * (low + high)), spread=LOG_FREQUENCY_STD + 0.5 * (high - low)),
        Statistic(WIDTH, "1", MEDIAN_DAMPING_RATIO, spread=LOG_DAMPING_STD),
        *(
            Statistic(
                LEVEL + one.name,
                one.load_unit,
                MEDIAN_RMS_RATIO * rms[one.load],
                spread=LOG_RMS_RATIO_STD,
                kind="narrow-band level",
                of=one.name,
            )
            for one in pushed
        ),
    )
