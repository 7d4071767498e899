"""Quantity of a channel from its name, and units in which its values are plausible.

A name never gives a unit: ``rotor_speed`` may be in rpm as well as in rad/s. Where a file says no unit, windsysid
refuses the channel, and the message names the units in which the values could be, so that the user can write the right
one.
"""

import re
from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.words import in_english, words_of
from windsysid.units import si_unit, to_si, unit_text

__all__ = ["check_quantity", "implied_unit", "missing_units", "plausible_units"]


_GRAVITY = 9.80665
_FULL_CIRCLE = 6.35  # rad, and a little for an encoder that reads 360.0 or slightly more

_CANDIDATES: dict[str, tuple[tuple[str, ...], float, float]] = {
    # quantity: (units that loggers use, least and greatest plausible largest value in SI)
    "rotor speed": (("rpm", "rad/s", "deg/s"), 0.3, 10.0),
    "wind speed": (("m/s", "km/h"), 0.1, 60.0),
    "rad": (("rad", "deg"), 1e-6, _FULL_CIRCLE),
    "rad/s": (("rad/s", "deg/s"), 1e-6, 20.0),
    "rad/s^2": (("rad/s^2", "deg/s^2"), 1e-5, 300.0),
    "m": (("m", "cm", "mm"), 1e-6, 10.0),
    "m/s": (("m/s", "mm/s"), 1e-6, 10.0),
    "m/s^2": (("m/s^2", "g", "mg", "mm/s^2"), 1e-3, 30.0),
    "N": (("N", "kN", "MN"), 1.0, 1e8),
    "N*m": (("N*m", "kN*m", "MN*m"), 10.0, 1e9),
    "W": (("W", "kW", "MW"), 50.0, 3e7),
    "1": (("strain", "microstrain", "V/V", "mV/V"), 1e-8, 2e-2),
}


_ACCELERATION = ("acceleration", "accelerometer", "accel", "acc")
_OTHER_QUANTITIES = frozenset(
    ("velocity", "speed", "displacement", "position", "angle", "tilt", "force", "load", "moment", "mass", "power")
)
_OTHER_UNITS = frozenset(("kg", "N", "N*m", "m", "m/s", "rad", "rad/s", "W"))
"""SI units that no acceleration has, raw or converted; the pressure of an accumulator is often called acc, too."""


def implied_unit(channel: str) -> str | None:
    """The SI unit of the quantity that a channel's name says; None where it says none.

    Lag and roll are angles (``blade_1_lag_displacement`` [rad]); motion of a blade's tip is a length
    (``blade_1_tip_lag_acceleration`` [m/s²]).
    """
    words = _words(channel)
    turns = "tip" not in words and any(word in words for word in ("lag", "roll", "angular", "rotor"))
    length = "rad" if turns else "m"
    angles = ("azimuth", "pitch", "roll", "yaw", "angle", "direction")
    for words_of_quantity, unit in (
        (_ACCELERATION, f"{length}/s^2"),
        (("velocity", "speed"), f"{length}/s"),
        (("displacement", "deflection"), length),
        (("strain", "gauge"), "1"),
        (("moment", "torque"), "N*m"),
        (("force", "load"), "N"),
        (angles, "rad/s" if "rate" in words else "rad"),
        (("power",), "W"),
    ):
        if any(word in words for word in words_of_quantity):
            return unit
    return None


def check_quantity(channel: str, unit: str) -> None:
    """Refuse an acceleration in the unit of another mechanical quantity; volts and ratios may be raw readings.

    Raises
    ------
    RecordError
        With the units that are accepted, and how to name the right one.
    """
    words = words_of(channel)
    if not set(_ACCELERATION) & set(words) or _OTHER_QUANTITIES & set(words) or si_unit(unit) not in _OTHER_UNITS:
        return
    raise RecordError(
        f"channel '{channel}': expected a unit of acceleration ({', '.join(_CANDIDATES['m/s^2'][0])}), got {unit}; "
        f'correct it, or name it in a mapping: [channels."{channel}"] unit = "g"'
    )


def plausible_units(channel: str, values: Array) -> tuple[str, ...]:
    """Units in which the values of a channel without a unit are plausible; empty if there are none.

    Parameters
    ----------
    channel : str
        Its name, which says a quantity.
    values : array (n,)
        Some of its values, as the file has them.
    """
    si, known = implied_unit(channel), values[np.isfinite(values)]
    if si is None or not known.any():
        return ()
    words, largest = _words(channel), float(np.abs(known).max())
    if "azimuth" in words:
        return _units_of_azimuth(known, largest)
    units, low, high = _CANDIDATES[_quantity(words, si)]
    mean = abs(float(np.mean(known)))  # an accelerometer that stands upright reads gravity
    upright = tuple(unit for unit in units if si == "m/s^2" and abs(to_si(mean, unit) / _GRAVITY - 1.0) < 0.03)
    return upright or tuple(unit for unit in units if low <= to_si(largest, unit) <= high)


def _quantity(words: list[str], si: str) -> str:
    if "rotor" in words and si == "rad/s":
        return "rotor speed"
    return "wind speed" if words[0] == "wind" and si == "m/s" else si


def _units_of_azimuth(known: Array, largest: float) -> tuple[str, ...]:
    if largest <= _FULL_CIRCLE and np.ptp(known) > 0.5 * _FULL_CIRCLE:
        return ("rad",)
    return ("deg",) if _FULL_CIRCLE < largest <= np.rad2deg(_FULL_CIRCLE) else ("rad", "deg")


def missing_units(channels: Sequence[tuple[str, Array]], how: str) -> str:
    """One line that refuses channels without a unit.

    `channels` are names with some values each; `how` says where to write the unit, with ``{}`` for name and unit.
    """
    name, values = channels[0]
    units = plausible_units(name, values)
    text = f"channel '{name}' has no unit" + _what_values_show(values[np.isfinite(values)], units)
    usual = units or _CANDIDATES[implied_unit(name) or "1"][0]
    text += f"; {how.format(f'{name} [{usual[0]}]' if len(usual) == 1 else f'{name} [unit]')}"
    others = [other for other, _ in channels[1:]]
    if others:
        more = f" and {len(others) - 5} more" if len(others) > 5 else ""
        text += f"; without a unit too: {', '.join(others[:5])}{more}"
    return text


def _what_values_show(known: Array, units: Sequence[str]) -> str:
    if not known.size:
        return ""
    span = f"{known.min():.4g} … {known.max():.4g}" if np.ptp(known) else f"{known[0]:.4g}"
    shown = " or ".join(unit_text(unit) for unit in units)
    return f"; its values ({span}) " + (f"are plausible in {shown}" if shown else "do not show which one is meant")


def _words(channel: str) -> list[str]:
    return re.split(r"[^a-z0-9]+", in_english(channel).strip().lower())
