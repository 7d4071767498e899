"""Quantity of a channel, from its name and unit."""

import re
from collections.abc import Sequence
from typing import Literal

from windsysid.inspection.bodies import body_of
from windsysid.records.record import AS_WRITTEN, Record
from windsysid.records.words import words_of

__all__ = ["VIBRATION", "Kind", "is_position", "is_torque", "kind_of", "kinds", "most_telling"]

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


_OPERATION = frozenset(
    (
        "generator", "gen", "brake", "temperature", "humidity", "pressure", "density", "demand", "command", "cmd",
        "setpoint", "reference", "controller", "servo", "clearance", "clrnc", "wave", "waves", "elevation", "elev",
    )
)  # fmt: skip
"""Words of operational quantities, of the environment and of distances, which show no vibration of a structure."""

_DRIVE_TRAIN = frozenset(("speed", "rpm", "omega", "lss", "hss", "hs", "ls", "lssh", "shaft"))
"""Words that mark an angular velocity [rad/s] as that of a shaft."""

_MACHINES = frozenset(("wea", "wka", "wec", "wtg", "turbine"))
"""Words for a wind turbine, with which its number stands: Drehzahl_WEA1."""

_FLOATER = frozenset(("ptfm", "platform", "floater", "tower", "twr", "nacelle", "nac", "barge", "spar", "buoy"))
"""Words of bodies whose pitch and yaw are motions and not controlled angles; the yaw of a nacelle is controlled."""

_POSITION = frozenset(("position", "pos", "coordinate", "ptfm", "platform", "surge", "sway", "heave"))
"""Words of lengths that may be many metres: positions in a fixed frame, motions of a floater."""

_AIR = re.compile(r"^RtV|^(AB|B)\d+N\d+(V|Alpha|Phi|Theta|AxInd|TnInd)", re.IGNORECASE)
"""Names of AeroDyn's channels of air velocities and angles at the rotor."""


def kind_of(channel: str, unit: str) -> Kind:
    """Kind of a channel by its name and unit; ``other`` if it is unknown, or is no vibration."""
    words = _words(channel)
    return _kind_of_operation(channel, words, unit) or _kind_of_vibration(words, unit)


def _kind_of_operation(channel: str, words: set[str], unit: str) -> Kind | None:
    """Kind of a channel of the rotor, of the air or of a control; None if it is none."""
    if "azimuth" in words:
        return "azimuth"
    alone = set(filter(str.isalpha, words)) - _MACHINES == {"rpm"}
    if alone or (words & {"rotor", "rot"} and words & {"speed", "rpm"}):
        return "rotor speed"
    if "direction" in words:
        return "direction"
    if _of_the_air(channel, words, unit):
        return "wind speed" if channel.lower().startswith("wind") and "speed" in words else "other"
    return _kind_of_control(words, unit)


def _kind_of_control(words: set[str], unit: str) -> Kind | None:
    """Kind of a power, of a controlled angle or of another quantity of operation; None if it is none."""
    if words & {"power", "pwr"} and unit in ("rad", "W", "1"):
        return "power"
    angle = _set_angle(words) if unit in ("rad", "rad/s", "1", "W") else None
    if angle is not None:
        return "other" if unit == "rad/s" else angle
    return "other" if _is_operational(words, unit) else None


def _is_operational(words: set[str], unit: str) -> bool:
    """Test whether a channel is an operational or environmental quantity; accelerations are not."""
    if unit in ("m/s^2", "rad/s^2"):
        return False
    return bool(words & _OPERATION) or (unit == "rad/s" and bool(words & _DRIVE_TRAIN))


def _kind_of_vibration(words: set[str], unit: str) -> Kind:
    """Kind of a vibration by its unit, or by words of its name if the unit is unknown; else ``other``."""
    if unit in _BY_UNIT:
        return _BY_UNIT[unit]
    if unit == "1" or unit.startswith(AS_WRITTEN):
        for listed, kind in _BY_WORD:
            if any(word in words for word in listed):
                return kind
    return "other"


def _words(channel: str) -> set[str]:
    """Words of a name in lower case, split at punctuation, and also at capitals and digits."""
    return {*re.split(r"[^a-z0-9]+", channel.lower()), *words_of(channel)}


def _of_the_air(channel: str, words: set[str], unit: str) -> bool:
    """Test whether a channel is wind, or a velocity or angle of the air at a blade."""
    return channel.lower().startswith("wind") or ("wind" in words and unit == "m/s") or bool(_AIR.match(channel))


def _set_angle(words: set[str]) -> Kind | None:
    """``pitch`` or ``yaw`` for an angle that a drive controls; None for motions of a floater or a tower."""
    if "pitch" in words and not words & _FLOATER:
        return "pitch"
    if words & {"yaw", "yawpzn"} and not words & (_FLOATER - {"nacelle", "nac"}) and "br" not in words:
        return "yaw"
    return None


def is_torque(channel: str) -> bool:
    """Test whether a channel is a drive-train torque, which a controller limits."""
    return bool(_words(channel) & {"torque", "torq", "tq"})


def is_position(channel: str) -> bool:
    """Test whether a length may be many metres: a position in a fixed frame, or a motion of a floater."""
    return bool(_words(channel) & _POSITION)


def kinds(record: Record) -> dict[str, Kind]:
    """The kind of every channel."""
    return {name: kind_of(name, unit) for name, unit in zip(record.channels, record.units, strict=True)}


def most_telling(record: Record, first: Sequence[str] = ()) -> list[str]:
    """Sort vibration channels: those in `first`, accelerometers on tower, nacelle and blades, others; water, air and
    mooring lines come last."""
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
