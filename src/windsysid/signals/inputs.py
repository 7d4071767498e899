"""Known inputs of a mechanical model from a record: the meaning of each input's name is defined here only.

``rotor_azimuth``, ``rotor_speed``, ``rotor_acceleration``
    ψ, Ω and dΩ/dt. Where the equations need the azimuth a record must tell it (`rotor_inputs`); where only loads turn
    with the rotor, an azimuth that was not recorded is summed up from the speed (`tower_inputs`).
``nacelle_yaw``, ``yaw_rate``, ``yaw_acceleration``
    γ, γ̇ and γ̈, smoothed (`tower_inputs`); constant where no sensor needs them and none was recorded.
any other name
    The channel of that name.
"""

from collections.abc import Collection, Sequence

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.record import Record
from windsysid.signals.rotor import rotor_inputs
from windsysid.signals.yaw import tower_inputs

__all__ = ["TURNING", "read_inputs", "steady_inputs"]

TURNING = ("rotor_azimuth", "rotor_speed", "nacelle_yaw")
"""Channels that say how rotor and nacelle turned."""

_ROTOR = ("rotor_azimuth", "rotor_speed", "rotor_acceleration")
_TOWER = ("rotor_azimuth", "rotor_speed", "nacelle_yaw", "yaw_rate", "yaw_acceleration")


def read_inputs(record: Record, names: Sequence[str], rotor_speed: float, *, required: Collection[str] = ()) -> Array:
    """The inputs of these names (T, n_u) from a uniformly sampled record, SI.

    Parameters
    ----------
    names
        Of the model's inputs, in its order.
    rotor_speed
        The turbine's usual one [rad/s].
    required
        Inputs that the record must tell; others of the rotor and the nacelle may be taken as usual.

    Raises
    ------
    RecordError
        If a required input or a channel is missing, a unit is wrong, or a channel of the model's own has gaps.
    """
    columns: dict[str, Array] = {}
    known = {*_ROTOR, *_TOWER} & set(names)
    if known and ("rotor_azimuth" in required or "rotor_acceleration" in known):
        columns |= dict(zip(_ROTOR, rotor_inputs(record, rotor_speed).T, strict=True))
    if known - columns.keys():
        found = tower_inputs(record, rotor_speed, needs_yaw="nacelle_yaw" in required)
        columns = dict(zip(_TOWER, found.T, strict=True)) | columns
    for name in names:
        if name not in columns:
            columns[name] = record[name]
            missing = int(np.isnan(columns[name]).sum())
            if missing:
                raise RecordError(
                    f"channel '{name}' is an input of the model and lacks {missing} of {record.samples} samples: "
                    "expected all of them; choose a section without the gap, or fill it"
                )
    return np.column_stack([columns[name] for name in names]) if names else np.empty((record.samples, 0))


def steady_inputs(names: Sequence[str], rotor_speed: float, duration: float, rate: float) -> Array:
    """The inputs of these names (T, n_u) of a rotor that turns at constant speed from ψ = 0, all else at rest; T =
    duration · rate."""
    time = np.arange(round(duration * rate)) / rate
    steady = {"rotor_azimuth": rotor_speed * time, "rotor_speed": np.full_like(time, rotor_speed)}
    return np.array([steady.get(name, np.zeros_like(time)) for name in names]).reshape(len(names), len(time)).T.copy()
