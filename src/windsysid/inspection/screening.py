"""Checks that every identification runs before it reads a record, and the use of their findings.

A unit that is evidently wrong and a channel that is dead make every estimate wrong: the record is refused. Readings
that were copied or lost, and converters that ran over, make estimates or their intervals wrong: no such result is
trusted. Spikes, clipping, gaps and stuck stretches make it worse by an amount that the data do not tell: they are
noted.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from windsysid.checks.limits import CONFLICT_SIGMAS
from windsysid.errors import RecordError
from windsysid.inspection.channels import VIBRATION, Kind, kind_of, kinds
from windsysid.inspection.fault import SEVERITIES, Fault
from windsysid.inspection.faults.clock import clock_faults
from windsysid.inspection.faults.continuity import copied_channels, copied_passages, lost_samples, overrun
from windsysid.inspection.faults.health import channel_faults
from windsysid.inspection.faults.losses import lost_rows
from windsysid.inspection.faults.silence import silent_stretches
from windsysid.inspection.limits import MIN_ROTOR_SPEED
from windsysid.inspection.plausibility import TIME, implausible
from windsysid.inspection.rotor import Rotor, rotor_of
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.finding import Severity as FindingSeverity
from windsysid.signals.inputs import TURNING

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["doubted", "examine", "faults_of", "noted", "read_besides", "screen"]

_DEAD = ("constant", "frozen")
_FALSE = frozenset({"copied passage", "copy", "lost rows", "lost samples", "overrun"})
"""Kinds of findings that make estimates or their intervals wrong."""
_JUMPING = frozenset({"clipping", "frozen", "held", "interpolated", "missing", "overrun", "silent", "spikes"})
"""Kinds of findings that jumps of a channel come from."""
_MAX_VALUE = 1e100
"""Numerical: largest value whose square cannot overflow in sums."""


def examine(record: Record, turbine: "Turbine | None") -> tuple[list[Fault], dict[str, Kind], Rotor | None]:
    """Everything that is wrong with a record, the worst first; its usable channels with their kinds; how the rotor
    turned.

    Raises
    ------
    RecordError
        If a value is so large that its square could overflow.
    """
    known = kinds(record)
    _refuse_overflow(record)
    findings = [*clock_faults(record), *_faults_of_channels(record, known)]
    broken = {finding.channel for finding in findings if finding.severity == "unusable"}
    usable = {channel: kind for channel, kind in known.items() if channel not in broken}
    moving = [channel for channel, kind in usable.items() if kind in VIBRATION]
    findings += copied_passages(record, moving)
    findings += silent_stretches(record, moving)
    findings += _losses(record, moving, findings)
    rotor = rotor_of(record, set(usable))
    findings += implausible(record, usable, rotor, turbine)
    findings.sort(key=lambda f: (SEVERITIES.index(f.severity), f.channel != ""))
    return findings, usable, rotor


def _refuse_overflow(record: Record) -> None:
    """Refuse a record with a value whose square could overflow."""
    size = np.nanmax(np.abs(record.values), axis=0, initial=0.0)
    if np.any(size > _MAX_VALUE):
        k = int(np.argmax(size))
        raise RecordError(
            f"{record.name}: channel '{record.channels[k]}' reaches {size[k]:.3g}: expected less than {_MAX_VALUE:g}; "
            "leave those cells empty, or write NaN"
        )


def _faults_of_channels(record: Record, known: Mapping[str, Kind]) -> list[Fault]:
    """Faults of single channels; jumps of a converter that overran are no spikes."""
    standing = "rotor_speed" in record and bool(
        np.nanmin(np.abs(record["rotor_speed"]), initial=np.inf) < MIN_ROTOR_SPEED
    )
    found = list[Fault]()
    for channel, kind in known.items():
        ran_over = overrun(record, channel) if kind in VIBRATION else []
        faults = channel_faults(record, channel, kind, standing)
        found += ran_over + [fault for fault in faults if not (ran_over and fault.kind == "spikes")]
    return found


def _losses(record: Record, moving: Sequence[str], findings: Sequence[Fault]) -> list[Fault]:
    """Rows that were lost though the time goes on, unless `findings` have gaps, in channels that do not jump."""
    if any(finding.kind in ("gaps", "short gaps", "repeated rows") for finding in findings):
        return []
    jumping = {finding.channel for finding in findings if finding.kind in _JUMPING}
    whole = [channel for channel in moving if channel not in jumping]
    return lost_samples(record, whole) or lost_rows(record, whole)


def faults_of(record: Record, channels: Iterable[str], turbine: "Turbine | None") -> Sequence[Fault]:
    """Faults of these channels by `examine`; cached as long as the record lives, since several parts of a program
    ask the same of it.

    Raises
    ------
    RecordError
        As `examine`.
    """
    read = tuple(dict.fromkeys(channels))
    rotor_speed = None if turbine is None else (turbine.name, turbine.rotor_speed)
    known = _FOUND.setdefault(record, {})
    if (read, rotor_speed) not in known:
        known[read, rotor_speed] = tuple(examine(record.select(read), turbine)[0])
    return known[read, rotor_speed]


_FOUND: "WeakKeyDictionary[Record, dict[object, tuple[Fault, ...]]]" = WeakKeyDictionary()


def read_besides(record: Record, turbine: "Turbine") -> list[str]:
    """Channels of a record that an identification reads in addition to those of its sensors: how the rotor turned,
    wind, loads."""
    return [name for name in (*TURNING, "wind_speed", *turbine.model.loads) if name in record]


def screen(
    record: Record, turbine: "Turbine | None", sensors: Iterable[str], *,
    others: Iterable[str] = (), offsets: Mapping[str, float] | None = None, refuse: bool = True,
) -> list[Fault]:  # fmt: skip
    """Check the channels that an identification reads.

    Parameters
    ----------
    record
        The section that is identified from, as it was recorded.
    turbine
        Whose rotor speed is expected.
    sensors
        Channels whose vibration is read.
    others
        Channels that say how the rotor turned, and loads; those that the record does not have are left out.
    offsets
        Prior standard deviation of a sensor's offset, in the channel's unit: a mean of that size is no fault.
    refuse
        False to return what would be refused with the rest: for pieces of a record whose first one was accepted.

    Returns
    -------
    list of Fault
        What a reader of the result must know, the worst first.

    Raises
    ------
    RecordError
        If a unit is evidently wrong, or a sensor's channel does not move.
    """
    measured = tuple(sensors)
    read = [*measured, *(channel for channel in others if channel in record)]
    findings = [*faults_of(record, read, turbine), *copied_channels(record, measured)]
    for finding in findings if refuse else ():
        reason = _refusal(record, finding, measured, (offsets or {}).get(finding.channel, 0.0))
        if reason:
            raise RecordError(f"{record.name}: {reason}")
    return [finding for finding in findings if finding.severity != "note"]


def _refusal(record: Record, fault: Fault, sensors: Sequence[str], offset: float) -> str:
    """Why a record with this fault is refused, where its sensor's offset has this prior standard deviation; else ''."""
    channel = fault.channel
    if fault.kind in _DEAD and fault.severity == "unusable" and channel in sensors:
        return _dead(record, fault)
    if fault.kind != "unit":
        return ""
    if channel == TIME:
        return f"time: {fault.text}"
    allowed = offset and not abs(float(np.nanmean(record[channel]))) > CONFLICT_SIGMAS * offset
    if allowed or fault.severity != "warning" or kind_of(channel, record.unit(channel)) == "wind speed":
        return ""
    return f"channel '{channel}': {fault.text} Correct its unit" + ", or leave it out of the sensors" * (
        channel in sensors
    )


def _dead(record: Record, fault: Fault) -> str:
    """Why a vibration channel that is constant or frozen is refused; '' for another one."""
    if kind_of(fault.channel, record.unit(fault.channel)) not in VIBRATION:
        return ""
    what = fault.statement if fault.kind == "constant" else "repeats one value in most of the record"
    advice = "disconnected? leave it out of the sensors, or choose another section"
    return f"channel '{fault.channel}' {what}: {advice}"


def noted(faults: Iterable[Fault]) -> tuple[Finding, ...]:
    """Notes on faults; channels with the same fault share a note, and so do pieces of a record."""
    return _as_findings((fault for fault in faults if fault.kind not in _FALSE), "note")


def doubted(faults: Iterable[Fault]) -> tuple[Finding, ...]:
    """Reasons for faults with which no result is trusted, grouped as by `noted`."""
    return _as_findings((fault for fault in faults if fault.kind in _FALSE), "reason")


def _as_findings(faults: Iterable[Fault], severity: FindingSeverity) -> tuple[Finding, ...]:
    pieces: dict[tuple[str, str], list[Fault]] = {}
    for fault in faults:
        pieces.setdefault((fault.channel, fault.kind), []).append(fault)
    groups: dict[tuple[str, int], list[Fault]] = {}
    for alike in pieces.values():
        groups.setdefault((alike[0].text, len(alike)), []).append(alike[0])
    found = []
    for (text, count), (first, *others) in groups.items():
        data = {
            "channels": [one.channel for one in (first, *others) if one.channel], "pieces": count, "text": text,
            "count": first.count, **first.data,
        }  # fmt: skip
        found.append(Finding(first.kind.replace(" ", "_"), severity, data))
    return tuple(found)
