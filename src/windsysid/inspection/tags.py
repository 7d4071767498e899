"""Meaning of the name of a foreign channel: the tags of IEC 61400-25, and the words of loggers.

IEC 61400-25-2 names data by logical node and attribute, ``WROT`` and ``BlPthAngVal``; SCADA systems write
``WROT_BlPthAngVal1``, ``WTG07.WROT1.RotSpd.mag.f`` or ``WMET_HorWdSpd_Avg``. The standard leaves the unit to the
system, so that a tag gives a name and a quantity, and the unit follows from the values.
"""

import re
from dataclasses import dataclass

from windsysid.records.words import words_of

__all__ = ["Meaning", "meaning_of"]


@dataclass(frozen=True)
class Meaning:
    """Meaning of a name.

    Attributes
    ----------
    name : str or None
        The channel's name in windsysid; None where too little is said.
    source : str
        What says it, for a reader.
    doubts : tuple of str
        What is not said.
    axis : str
        Letter of an axis, where nothing else gives the direction.
    """

    name: str | None
    source: str
    doubts: tuple[str, ...] = ()
    axis: str = ""


_TAGS: dict[tuple[str, str], str] = {
    # logical node and data name, IEC 61400-25-2: ours; # stands for the blade
    ("WTUR", "W"): "power", ("WGEN", "W"): "power", ("WTUR", "TurSt"): "turbine_state",
    ("WROT", "RotSpd"): "rotor_speed", ("WTRM", "RotSpd"): "rotor_speed", ("WROT", "RotPos"): "rotor_azimuth",
    ("WROT", "BlPthAngVal"): "blade_#_pitch", ("WROT", "BlPthAng"): "blade_#_pitch",
    ("WGEN", "Spd"): "generator_speed", ("WGEN", "GnSpd"): "generator_speed", ("WGEN", "Trq"): "generator_torque",
    ("WTRM", "TrmTrq"): "shaft_torque", ("WMET", "HorWdSpd"): "wind_speed", ("WMET", "HorWdDir"): "wind_direction",
    ("WMET", "VerWdSpd"): "wind_vertical_speed", ("WMET", "EnvTmp"): "air_temperature",
    ("WMET", "EnvHum"): "air_humidity", ("WMET", "EnvPres"): "air_pressure", ("WMET", "AirDens"): "air_density",
    ("WNAC", "WdSpd"): "wind_speed", ("WNAC", "WdDir"): "wind_direction", ("WNAC", "Dir"): "nacelle_yaw",
    ("WNAC", "ExTmp"): "air_temperature", ("WYAW", "YwAng"): "nacelle_yaw", ("WYAW", "YwSpd"): "nacelle_yaw_rate",
    ("WNAC", "DispXdir"): "nacelle_z_displacement", ("WNAC", "DispYdir"): "nacelle_x_displacement",
    ("WTOW", "DispXdir"): "tower_z_displacement", ("WTOW", "DispYdir"): "tower_x_displacement",
}  # fmt: skip
_TAG = re.compile(r"(?:^|[._/\- ])(W[A-Z]{3})\d*[._/\- ]([A-Za-z]+?)_?(\d*)(?=$|[._/\- ])(.*)")
_STATISTICS = {
    "avg": "", "av": "", "mean": "", "min": "_min", "max": "_max", "sdv": "_std", "std": "_std", "stddev": "_std",
}  # fmt: skip
_DOWNWIND = "in IEC 61400-25 X may be fore-aft; in windsysid z is fore-aft and x to the side"

_PLACES = ("tower", "nacelle", "hub", "foundation", "mast")
_AXES = (
    (("side", "sideside", "lateral", "transverse", "ss"), "x", ()),
    (("foreaft", "fore", "aft", "longitudinal", "fa"), "z", ()),
    (("vertical", "vert"), "y", ()),
    (("x",), "x", ("is X to the side? In windsysid x is to the side, z fore-aft (name … = tower_z_acceleration)",)),
    (("y",), "x", ("is Y to the side, as where X is downwind? In windsysid x is to the side, y up",)),
    (("z",), "y", ("is Z up? In windsysid y is up, z fore-aft",)),
)
_WORDS: tuple[tuple[tuple[str, ...], str], ...] = (
    # all of these words: ours
    (("wind", "direction"), "wind_direction"), (("wind", "dir"), "wind_direction"), (("wind", "speed"), "wind_speed"),
    (("windspeed",), "wind_speed"), (("winddirection",), "wind_direction"), (("wind", "vel"), "wind_speed"),
    (("anemometer",), "wind_speed"), (("rotor", "azimuth"), "rotor_azimuth"), (("azimuth",), "rotor_azimuth"),
    (("rotor", "position"), "rotor_azimuth"), (("rotor", "speed"), "rotor_speed"), (("rotorspeed",), "rotor_speed"),
    (("rot", "speed"), "rotor_speed"), (("rot", "spd"), "rotor_speed"), (("rotor", "rpm"), "rotor_speed"),
    (("lss", "speed"), "rotor_speed"),
    (("generator", "speed"), "generator_speed"), (("gen", "speed"), "generator_speed"),
    (("gen", "spd"), "generator_speed"), (("generator", "rpm"), "generator_speed"), (("power",), "power"),
    (("gen", "rpm"), "generator_speed"), (("rpm",), "rotor_speed"),
    (("pitch",), "blade_#_pitch"), (("nacelle", "direction"), "nacelle_yaw"), (("nacelle", "position"), "nacelle_yaw"),
    (("yaw",), "nacelle_yaw"), (("temperature",), "air_temperature"),
)  # fmt: skip
_OURS = re.compile(rf"({'|'.join(_PLACES)}|blade_\d+)_([a-z]+_)*(acceleration|velocity|displacement)")
_SHORT = re.compile(r"^a[ _]?([xyz])$", re.IGNORECASE)
_ACCELERATION = ("acceleration", "accelerometer", "accel", "acc", "accelerations")


def meaning_of(name: str) -> Meaning | None:
    """Meaning of a channel's name, None if windsysid does not know it."""
    if _OURS.fullmatch(name):
        return Meaning(name, "a name of windsysid")
    return _tag(name) or _words(name)


def _tag(name: str) -> Meaning | None:
    found = _TAG.search(name)
    if found is None:
        return None
    node, data, number, rest = found.groups()
    ours = _TAGS.get((node, data))
    if ours is None:
        return Meaning(None, f"{node}.{data} of IEC 61400-25, which windsysid does not use")
    doubts: list[str] = []
    if "#" in ours:
        ours = ours.replace("#", number or "1")
        if not number:
            doubts.append("of which blade? the tag has no number")
    if "displacement" in ours:
        doubts.append(_DOWNWIND)
    ending = next((_STATISTICS[word] for word in words_of(rest) if word in _STATISTICS), "")
    return Meaning(ours + ending, f"{node}.{data} of IEC 61400-25", tuple(doubts))


def _words(name: str) -> Meaning | None:
    words = words_of(_SHORT.sub(r"acc \1", name))
    joined = " ".join(words)
    if not set(_ACCELERATION).isdisjoint(words):
        return _acceleration(words)
    for wanted, ours in _WORDS:
        if set(wanted) <= set(words):
            number = next((word for word in words if word.isdecimal()), "")
            doubts = () if "#" not in ours or number else ("of which blade? the name has no number",)
            return Meaning(ours.replace("#", number or "1"), f"the words '{joined}'", doubts)
    return None


def _acceleration(words: list[str]) -> Meaning:
    said = f"the words '{' '.join(words)}'"
    if "blade" in words:
        return _blade_acceleration(words, said)
    place = next((word for word in _PLACES if any(part.startswith(word[:3]) for part in words)), None)
    for listed, axis, notes in _AXES:
        if any(word in words for word in listed):
            doubts = notes if place else (*notes, "where is it mounted? The name does not say")
            letter = "".join({"x", "y"} & set(listed))
            return Meaning(f"{place or 'tower'}_{axis}_acceleration", said, doubts, letter)
    return Meaning(None, said, ("along which axis, and where is it mounted?",))


def _blade_acceleration(words: list[str], said: str) -> Meaning:
    number = next((word for word in words if word.isdecimal()), "1")
    axis = next((word for word in ("lag", "edge", "flap") if any(part.startswith(word) for part in words)), "")
    name = f"blade_{number}_tip_{'flap' if axis == 'flap' else 'lag'}_acceleration"
    doubts = () if axis else ("along the rotor's plane (lag) or across it (flap)?",)
    return Meaning(name, said, (*doubts, "at the tip? If not, name its place"))
