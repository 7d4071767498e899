"""Signals: from recorded channels to the inputs of filters.

Condition the channels (`condition`), put several loggers on one clock (`align`), turn tower-fixed axes with the nacelle
(`yaw`), find the rotor (`rotor`, `harmonics`), integrate (`integration` for records, `causal` for streams) and filter
(`band`). NaN is a missing sample everywhere; nothing invents what a gap held.
"""

from windsysid._lazy import naming_arguments
from windsysid.signals.align import Aligned, ClockOffset, align, clock_offset
from windsysid.signals.band import band_pass
from windsysid.signals.causal import (
    CausalIntegrator,
    CausalState,
    causal_integrator,
    causal_response,
    integrate_causally,
)
from windsysid.signals.condition import (
    Despiked,
    LevelledPair,
    Unbiased,
    despike,
    remove_bias,
    remove_gravity_and_tilt,
    resample,
)
from windsysid.signals.harmonics import rotor_from_blades, rotor_from_tower
from windsysid.signals.integration import METHODS, Motion, integrate
from windsysid.signals.rotor import RotorMotion, rotor_from_encoder, rotor_from_pulses, rotor_inputs
from windsysid.signals.yaw import to_nacelle, tower_inputs, with_nacelle_axes

__all__ = [
    "METHODS", "Aligned", "CausalIntegrator", "CausalState", "ClockOffset", "Despiked", "LevelledPair", "Motion",
    "RotorMotion", "Unbiased", "align", "band_pass", "causal_integrator", "causal_response", "clock_offset", "despike",
    "integrate", "integrate_causally", "remove_bias", "remove_gravity_and_tilt", "resample", "rotor_from_blades",
    "rotor_from_encoder", "rotor_from_pulses", "rotor_from_tower", "rotor_inputs", "to_nacelle", "tower_inputs",
    "with_nacelle_axes",
]  # fmt: skip

globals().update({name: naming_arguments(name, globals()[name]) for name in __all__})
