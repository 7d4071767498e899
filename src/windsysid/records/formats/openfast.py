r"""Records from OpenFAST: ``.out`` (text) and ``.outb`` (packed binary), under our names, signs and units.

OpenFAST has x downwind, y to the left looking downwind, z up; we look upwind, with x to the right, y up and
angles counter-clockwise, which is the way the rotor turns. So our x is +y of OpenFAST, our y its z, our z its x, a
rotation about its x axis keeps its sign, and an in-plane blade motion changes it, because OpenFAST counts lag
against the rotation:

    psi = Azimuth + 90 deg                 azimuth of blade 1 from +x; blade b sits at psi + 2 pi (b - 1) / N
    lag = -IPDefl, -TipALyb, -TipALgyb     positive with the rotation

What OpenFAST calls an acceleration "with gravity" is what an accelerometer reads: the specific force, that is
the acceleration plus g upwards, along axes that turn with the instrument. With our signs, the roll theta of
the tower top, the tilt tau of the shaft and psi_b = psi + 2 pi (b - 1) / N,

    YawBrTAgyp = YawBrTAyp + g sin(theta)                               tower_x_acceleration
    TipALgyb   = TipALyb + g cos(tau) cos(psi_b + theta + alpha_b)      blade_b_tip_lag_acceleration

where alpha_b is the slope of the bent blade at its tip (0.0282 rad per metre of lag for the NREL 5 MW blade):
the tip's axes turn with it, in TipALyb too. Blade axes also turn with the pitch, which is left as it is: at
zero pitch TipALyb and RootMxb are in the rotor plane. An instrument at height h above the tower top reads
NcIMUTAgys = YawBrTAgyp - h times the roll acceleration. A root moment RootMx is what the outboard blade
exerts on its root about the downwind axis. It is positive with the rotation already: a blade bent forward
(lag > 0) shows a positive moment.

A channel that `CHANNELS` does not list keeps OpenFAST's own name and sign, in SI; of two names of one channel
(`ALIASES`) the first in the file gets windsysid's. The nacelle's sensor has the axes of the tilted shaft:
``nacelle_z`` is along it. A yaw angle is positive counter-clockwise from above in OpenFAST, clockwise in windsysid.

The date in the header says when the simulation was run, not when the wind blew: it stays in the description, and the
record has no start but the one that a mapping gives it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.access.packed import open_packed
from windsysid.records.formats.contents.columns import Cell, plan_columns
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping, TimeRule
from windsysid.records.formats.contents.source import FileSource, indexed_source
from windsysid.records.formats.text.openfast_text import read_text_output
from windsysid.records.formats.time.clock import start_of
from windsysid.records.record import AS_WRITTEN, Array
from windsysid.units import canonical

__all__ = ["ALIASES", "CHANNELS", "FORMAT", "known_channel"]


CHANNELS: dict[str, tuple[str, float]] = {
    # OpenFAST, # stands for the blade: (our name, sign)
    "Azimuth": ("rotor_azimuth", 1.0),  # and a quarter turn, see _azimuth
    "RotSpeed": ("rotor_speed", 1.0),
    "TTDspSS": ("tower_x_displacement", 1.0),
    "YawBrTVyp": ("tower_x_velocity", 1.0),
    "YawBrTAyp": ("tower_x_acceleration_kinematic", 1.0),
    "YawBrTAgyp": ("tower_x_acceleration", 1.0),
    "TTDspFA": ("tower_z_displacement", 1.0),
    "YawBrTVxp": ("tower_z_velocity", 1.0),
    "YawBrTAxp": ("tower_z_acceleration_kinematic", 1.0),
    "YawBrTAgxp": ("tower_z_acceleration", 1.0),
    "YawBrRDxt": ("tower_roll", 1.0),
    "NcIMUTVys": ("nacelle_x_velocity", 1.0),
    "NcIMUTAys": ("nacelle_x_acceleration_kinematic", 1.0),
    "NcIMUTAgys": ("nacelle_x_acceleration", 1.0),
    "NcIMUTVzs": ("nacelle_y_velocity", 1.0),
    "NcIMUTAzs": ("nacelle_y_acceleration_kinematic", 1.0),
    "NcIMUTAgzs": ("nacelle_y_acceleration", 1.0),
    "NcIMUTVxs": ("nacelle_z_velocity", 1.0),
    "NcIMUTAxs": ("nacelle_z_acceleration_kinematic", 1.0),
    "NcIMUTAgxs": ("nacelle_z_acceleration", 1.0),
    "NacYaw": ("nacelle_yaw", -1.0),
    "BldPitch#": ("blade_#_pitch", 1.0),
    "TipALyb#": ("blade_#_tip_lag_acceleration_kinematic", -1.0),
    "TipALgyb#": ("blade_#_tip_lag_acceleration", -1.0),
    "IPDefl#": ("blade_#_tip_lag_deflection", -1.0),
    "RootMxb#": ("blade_#_root_lag_moment", 1.0),
    "RootMxc#": ("blade_#_root_inplane_moment", 1.0),
    "Wind1VelX": ("wind_speed", 1.0),
    "Wave1Elev": ("wave_elevation", 1.0),
}
"""OpenFAST's channels that have a name of ours, with the sign that turns the one into the other."""

ALIASES: dict[str, str] = {
    "LSSTipP": "Azimuth", "LSSTipPxa": "Azimuth", "LSSTipPxs": "Azimuth",
    "LSSTipV": "RotSpeed", "LSSTipVxa": "RotSpeed", "LSSTipVxs": "RotSpeed",
    "NacYawP": "NacYaw", "YawPzn": "NacYaw", "YawPzp": "NacYaw", "YawPos": "NacYaw",
    "YawBrTDyt": "TTDspSS", "YawBrTDxt": "TTDspFA", "TTDspRoll": "YawBrRDxt",
    "TipDyc#": "IPDefl#", "RootMEdg#": "RootMxb#", "RootMIP#": "RootMxc#",
    "BlPitch#": "BldPitch#", "PtchPMzc#": "BldPitch#", "PtchPMzb#": "BldPitch#",
    "WindVxi": "Wind1VelX", "uWind": "Wind1VelX", "WaveElev": "Wave1Elev",
}  # fmt: skip
"""Other names that FAST 6 to 8 and OpenFAST give to channels of `CHANNELS`.

Source: ElastoDyn's output parameters (OpenFAST, ``OutListParameters.xlsx``, column "Other Name(s)"), and FAST 7's.
"""


def open_openfast(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open OpenFAST output; a binary file is read as far as it is needed, a text file always whole."""
    found = open_packed(path) if path.suffix.lower() == ".outb" else read_text_output(path)
    names, units = found.names, found.units
    if not names or names[0].lower() != "time":
        raise RecordError("is not OpenFAST output, expected a first channel 'Time'; export it again")
    if replace(mapping.time, start=None, zone=None) != TimeRule():
        raise ConfigurationError(
            f"{mapping.place}: time: the time of OpenFAST output is known; leave only start and zone"
        )
    if len(names) < 2:
        raise RecordError("holds no channel but the time; ask OpenFAST for some in OutList")

    known = _known(names, mapping)
    cells = [Cell(name, one.name, _unit(unit)) for name, unit, one in zip(names, units, known, strict=True)]
    columns = plan_columns(
        cells, 0, mapping, lambda i: found.rows(0, found.samples)[:, i - 1], "let OpenFAST write its unit"
    )
    time = _without_rounding(found.time(0, found.samples))

    def rows(low: int, high: int) -> Array:
        raw = found.rows(low, high)
        return np.column_stack([_channel(known[c.index], c.values(raw[:, c.index - 1])) for c in columns])

    return replace(
        indexed_source(path.name, columns, time, rows, place=found.place),
        attributes={"source": "OpenFAST", "description": found.description, **found.notes},
        start=start_of(mapping.time, None),
    )


def known_channel(name: str) -> tuple[str, float]:
    """Look up windsysid's name and sign of a channel of OpenFAST; its own name and 1 for an unknown channel."""
    found = _ours(name)
    return found.name, found.sign


@dataclass(frozen=True)
class _KnownChannel:
    """Name of a column in windsysid, and the sign by which OpenFAST's values are multiplied."""

    name: str
    sign: float = 1.0


def _ours(name: str) -> _KnownChannel:
    blade = re.fullmatch(r"(.*[A-Za-z])(\d)", name)
    number = blade[2] if blade and {blade[1] + "#"} & {*CHANNELS, *ALIASES} else ""
    key = f"{blade[1]}#" if blade and number else name
    ours, sign = CHANNELS.get(ALIASES.get(key, key), (name, 1.0))
    return _KnownChannel(ours.replace("#", number), sign)


def _known(names: Sequence[str], mapping: Mapping) -> list[_KnownChannel]:
    """Names and signs of the columns: the file's own where a mapping lists one, or an earlier column has the name."""
    found: list[_KnownChannel] = []
    taken: dict[str, str] = {}
    for name in names:
        ours = _ours(name)
        own = mapping.rule_of(name) is not None or taken.setdefault(ours.name, name) != name
        found.append(_KnownChannel(name) if own else ours)
    return found


def _unit(unit: str) -> str:
    try:
        canonical(unit)
    except ConfigurationError:
        return AS_WRITTEN + unit
    return unit


def _channel(known: _KnownChannel, values: Array) -> Array:
    if known.name == "rotor_azimuth":
        values = _azimuth(values)
    return values if known.sign > 0.0 else -values


def _azimuth(values: Array) -> Array:
    turn = 2.0 * np.pi
    with np.errstate(invalid="ignore"):  # infinity is named by whoever checks the rows
        wrapped = np.mod(values + 0.5 * np.pi, turn)
    return np.where(wrapped == turn, 0.0, wrapped)  # the remainder of -1e-17 rounds up to a whole turn


def _without_rounding(time: Array) -> Array:
    """The uniform time that these times are a rounded copy of; the times themselves if they are none."""
    if time.size < 2:
        return time
    index = np.arange(time.size)
    step = (time[-1] - time[0]) / (time.size - 1)
    scatter = np.max(np.abs(time - time[0] - step * index))
    if scatter > 0.02 * step:  # four decimals of a 160 Hz record are 0.8 % of a step, at both ends
        return time
    allowed = max(2.0 * scatter, 4.0 * np.spacing(np.max(np.abs(time))))
    for digits in range(1, 13):  # a step has few digits: 0.01, 0.00625
        tidy = round(float(step), digits)
        if np.max(np.abs(time - time[0] - tidy * index)) <= allowed:
            return np.asarray(time[0] + tidy * index)
    return np.asarray(time[0] + step * index)


FORMAT = Format("OpenFAST output", (".outb", ".out"), open_openfast)
