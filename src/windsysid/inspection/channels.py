"""What a channel measures, told by its name and unit."""

import re
from collections.abc import Sequence
from typing import Literal

from windsysid.inspection.bodies import body_of
from windsysid.records.record import AS_WRITTEN, Record

__all__ = ["VIBRATION", "Kind", "kind_of", "kinds", "most_telling"]

Kind = Literal[
    "azimuth", "rotor speed", "wind speed", "direction", "yaw", "pitch", "power",
    "acceleration", "velocity", "displacement", "strain", "load", "other",
]  # fmt: skip

VIBRATION: tuple[Kind, ...] = ("acceleration", "strain", "load", "displacement", "velocity")
"""Kinds in which a structure's vibration shows, the most telling first."""

_BY_UNIT: dict[str, Kind] = {
    "m/s^2": "acceleration", "rad/s^2": "acceleration", "m/s": "velocity", "rad/s": "velocity", "m": "displacement",
    "rad": "displacement", "N": "load", "N*m": "load", "W": "power",
}  # fmt: skip

_BY_WORD: tuple[tuple[tuple[str, ...], Kind], ...] = (
    (("acceleration", "accelerometer", "accel", "acc"), "acceleration"),
    (("strain", "gauge"), "strain"),
    (("moment", "torque", "force", "load"), "load"),
    (("displacement", "deflection"), "displacement"),
    (("velocity",), "velocity"),
)


def kind_of(channel: str, unit: str) -> Kind:
    """The kind of one channel, ``other`` where neither name nor unit tells."""
    words = re.split(r"[^a-z0-9]+", channel.lower())
    if "azimuth" in words:
        return "azimuth"
    if "rotor" in words and ("speed" in words or "rpm" in words):
        return "rotor speed"
    if "direction" in words:
        return "direction"
    if words[0].startswith(("wind", "wave")):
        return "wind speed" if "speed" in words else "other"
    for word in ("yaw", "pitch", "power"):
        if word in words and unit in ("rad", "W", "1"):
            return word
    if any(word in words for word in ("generator", "temperature", "humidity", "pressure", "density")):
        return "other"
    if unit in _BY_UNIT:
        return _BY_UNIT[unit]
    if unit == "1" or unit.startswith(AS_WRITTEN):
        for listed, kind in _BY_WORD:
            if any(word in words for word in listed):
                return kind
    return "other"


def kinds(record: Record) -> dict[str, Kind]:
    """The kind of every channel."""
    return {name: kind_of(name, unit) for name, unit in zip(record.channels, record.units, strict=True)}


def most_telling(record: Record, first: Sequence[str] = ()) -> list[str]:
    """Vibration channels, those in `first` before the others, then accelerometers on tower, nacelle and blades; last
    what reads water, air or mooring lines."""
    known = kinds(record)
    order = {name: i for i, name in enumerate(first)}

    def rank(channel: str) -> tuple[int, bool, int, int, int]:
        ours = channel.startswith(("tower", "nacelle", "blade")) and "kinematic" not in channel
        return (
            order.get(channel, len(order)),
            body_of(channel) not in ("structure", "rotor"),
            VIBRATION.index(known[channel]),
            0 if ours else 1,
            record.channels.index(channel),
        )

    return sorted((name for name in record.channels if known[name] in VIBRATION), key=rank)
