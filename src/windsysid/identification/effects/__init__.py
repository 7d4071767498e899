"""Nuisance effects: everything in a record that is not the structure, one file each.

A new effect is a file here, with a class of `windsysid.identification.model.effect.Effect`, and its line in `EFFECTS`.
"""

from windsysid.identification.effects.bias import SensorBias, SmallBias
from windsysid.identification.effects.clock_drift import ClockDrift
from windsysid.identification.effects.lines import RotorHarmonic, Sinusoid
from windsysid.identification.effects.narrow_band_load import NarrowBandLoad
from windsysid.identification.effects.random_walk_bias import RandomWalkBias
from windsysid.identification.effects.regression import Regression
from windsysid.identification.effects.step import Step
from windsysid.identification.effects.trend import Trend
from windsysid.identification.model.effect import Effect

__all__ = ["ALTERNATIVES", "EFFECTS"]

EFFECTS: tuple[Effect, ...] = (
    SensorBias(),
    RandomWalkBias(),
    ClockDrift(),
    Sinusoid(),
    RotorHarmonic(),
    Regression([SmallBias(), Trend(), Step()]),
)
"""Effects that are regressors or directions in the model, in the order in which they correct a record."""

ALTERNATIVES: tuple[Effect, ...] = (NarrowBandLoad(),)
"""Other load models, whose evidence is computed where no effect of `EFFECTS` is warranted any more."""
