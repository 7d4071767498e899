"""The checks that every identification runs before it reads a record, and what becomes of their findings.

A unit that is evidently wrong and a channel that is dead make every estimate wrong: the record is refused. Readings
that were copied or lost, and converters that ran over, make estimates or their bands wrong: no such result is trusted.
Spikes, clipping, gaps and stuck stretches make it worse by an amount that the data do not tell: they are noted.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from windsysid.errors import RecordError
from windsysid.inspection.channels import VIBRATION, Kind, kinds
from windsysid.inspection.continuity import copied_channels, copied_passages, lost_samples, overrun
from windsysid.inspection.health import SEVERITIES, Finding, channel_faults, clock_faults
from windsysid.inspection.plausibility import MIN_ROTOR_SPEED, TIME, Rotor, implausible, rotor_of
from windsysid.inspection.silence import silent_stretches
from windsysid.records.record import Record
from windsysid.signals.inputs import TURNING

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["doubted", "examine", "findings_of", "noted", "read_besides", "screen"]

_DEAD = ("constant", "frozen")
_FALSE = frozenset({"copied passage", "copy", "lost samples", "overrun"})
"""Kinds of findings that make estimates or their bands wrong."""
_JUMPING = frozenset({"clipping", "frozen", "held", "interpolated", "missing", "overrun", "silent", "spikes"})
"""Kinds of findings that jumps of a channel come from."""
_MAX_VALUE = 1e100
_OFFSET_SIGMAS = 3.0
"""A mean is expected where a sensor's offset has a prior standard deviation of a third of it."""


def examine(record: Record, turbine: "Turbine | None") -> tuple[list[Finding], dict[str, Kind], Rotor | None]:
    """Everything that is wrong with a record, the worst first; its usable channels with their kinds; how the rotor
    turned.

    Raises
    ------
    RecordError
        If a value is so large that its square could overflow.
    """
    known = kinds(record)
    size = np.nanmax(np.abs(record.values), axis=0, initial=0.0)
    if np.any(size > _MAX_VALUE):
        k = int(np.argmax(size))
        raise RecordError(
            f"{record.name}: channel '{record.channels[k]}' reaches {size[k]:.3g}: expected less than {_MAX_VALUE:g}; "
            "leave those cells empty, or write NaN"
        )
    standing = "rotor_speed" in record and bool(
        np.nanmin(np.abs(record["rotor_speed"]), initial=np.inf) < MIN_ROTOR_SPEED
    )
    findings = clock_faults(record)
    for channel, kind in known.items():
        ran_over = overrun(record, channel) if kind in VIBRATION else []
        faults = channel_faults(record, channel, kind, standing)
        findings += ran_over + [fault for fault in faults if not (ran_over and fault.kind == "spikes")]
    broken = {finding.channel for finding in findings if finding.severity == "unusable"}
    usable = {channel: kind for channel, kind in known.items() if channel not in broken}
    moving = [channel for channel, kind in usable.items() if kind in VIBRATION]
    findings += copied_passages(record, moving)
    findings += silent_stretches(record, moving)
    jumping = {finding.channel for finding in findings if finding.kind in _JUMPING}
    if not any(finding.kind in ("gaps", "short gaps", "repeated rows") for finding in findings):
        findings += lost_samples(record, [channel for channel in moving if channel not in jumping])
    rotor = rotor_of(record, set(usable))
    findings += implausible(record, usable, rotor, turbine)
    findings.sort(key=lambda f: (SEVERITIES.index(f.severity), f.channel != ""))
    return findings, usable, rotor


def findings_of(record: Record, channels: Iterable[str], turbine: "Turbine | None") -> Sequence[Finding]:
    """What `examine` finds in these channels; remembered as long as the record lives, since several parts of a program
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


_FOUND: "WeakKeyDictionary[Record, dict[object, tuple[Finding, ...]]]" = WeakKeyDictionary()


def read_besides(record: Record, turbine: "Turbine") -> list[str]:
    """Channels of a record that an identification reads beside those of its sensors: how the rotor turned, wind,
    loads."""
    return [name for name in (*TURNING, "wind_speed", *turbine.model.loads) if name in record]


def screen(
    record: Record, turbine: "Turbine | None", sensors: Iterable[str], *,
    others: Iterable[str] = (), offsets: Mapping[str, float] | None = None, refuse: bool = True,
) -> list[Finding]:  # fmt: skip
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
    list of Finding
        What a reader of the result must know, the worst first.

    Raises
    ------
    RecordError
        If a unit is evidently wrong, or a sensor's channel does not move.
    """
    measured = list(sensors)
    read = [*measured, *(channel for channel in others if channel in record)]
    findings = [*findings_of(record, read, turbine), *copied_channels(record, measured)]
    known = kinds(record)
    for finding in findings if refuse else ():
        channel = finding.channel
        dead = finding.kind in _DEAD and finding.severity == "unusable" and channel in measured
        if dead and known[channel] in VIBRATION:
            constant = finding.kind == "constant"
            what = finding.text.split(": ")[0] if constant else "repeats one value in most of the record"
            raise RecordError(
                f"{record.name}: channel '{channel}' {what}: disconnected? "
                "leave it out of the sensors, or choose another section"
            )
        if channel == TIME and finding.kind == "unit":
            raise RecordError(f"{record.name}: time: {finding.text}")
        if finding.kind != "unit" or finding.severity != "warning" or known[channel] == "wind speed":
            continue
        offset = (offsets or {}).get(channel, 0.0)
        if not offset or abs(float(np.nanmean(record[channel]))) > _OFFSET_SIGMAS * offset:
            way_out = ", or leave it out of the sensors" if channel in measured else ""
            raise RecordError(f"{record.name}: channel '{channel}': {finding.text} Correct its unit{way_out}")
    return [finding for finding in findings if finding.severity != "note"]


def noted(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Findings as notes of a result; channels of which the same is said share a note, and so do pieces of a record."""
    return _told(finding for finding in findings if finding.kind not in _FALSE)


def doubted(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Findings that no result is to be trusted with, as `noted` tells the others."""
    return _told(finding for finding in findings if finding.kind in _FALSE)


def _told(findings: Iterable[Finding]) -> tuple[str, ...]:
    pieces: dict[tuple[str, str], list[str]] = {}
    for finding in findings:
        pieces.setdefault((finding.channel, finding.kind), []).append(finding.text)
    groups: dict[str, list[str]] = {}
    for (channel, kind), texts in pieces.items():
        text = texts[0] if len(texts) == 1 else f"{kind} in {len(texts)} pieces; the first: {texts[0]}"
        groups.setdefault(text, []).append(channel)
    return tuple(f"{', '.join(filter(None, names)) or 'record'}: {text}" for text, names in groups.items())
