"""The state of a turbine in a record, operating or parked, given or from rotor speed and pitch."""

import math

import numpy as np

from windsysid.inspection.channels import kinds
from windsysid.inspection.rotor import rotor_of
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.operation import operation_of
from windsysid.turbine.turbine import OPERATING, Turbine

__all__ = ["in_state"]

MIN_FEATHERED_PITCH = math.radians(45.0)
"""Setting: pitch angle [rad] above which blades are feathered; below 30° in operation, 80 to 90° at rest."""


def in_state(turbine: Turbine, record: Record, state: str) -> tuple[Turbine, tuple[Finding, ...]]:
    """Put a turbine in the given state, or for ``auto`` in that of the record, and note which one and why.

    Raises
    ------
    ConfigurationError
        If the turbine file does not have the state.
    """
    if state == "auto" and not turbine.states:
        return turbine, ()
    found = {"state": state, "why": "given"} if state != "auto" else _recorded_state(turbine, record)
    return turbine.in_state(str(found["state"])), (Finding("operating_state", "note", found),)


def _recorded_state(turbine: Turbine, record: Record) -> dict[str, str | float]:
    """State by pitch, where blades are feathered, else by rotor speed; operating where neither is recorded."""
    known = kinds(record)
    pitches = [name for name, kind in known.items() if kind == "pitch" and record.unit(name) == "rad"]
    pitch = max((float(np.nanmedian(record[name])) for name in pitches), default=0.0)
    if MIN_FEATHERED_PITCH < pitch < math.pi:
        return {"state": "parked", "why": "pitch"}
    rotor = rotor_of(record, set(known))
    if rotor is None:
        return {"state": OPERATING, "why": "unknown"}
    how = operation_of(rotor.speed, turbine.rotor_speed).state
    share = abs(float(rotor.mean)) / (turbine.rotor_speed or 1.0)
    return {"state": "parked" if how in ("parked", "idling") else OPERATING, "why": "speed", "share": share}
