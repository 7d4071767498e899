"""Contents of a store. All times are integers: nanoseconds since 1970, UTC."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

from windsysid.live.blocks.block import Block

__all__ = ["Alarm", "Commit", "Event", "Result", "SensorHealth", "SeriesLevel", "Severity", "Status", "StoredBlock"]

Severity = Literal["notice", "warning", "alarm"]


class StoredBlock(NamedTuple):
    """A block, and the window that it belongs to: they wait here until the window has its result.

    A block that reaches over a boundary is kept twice, once for each window: what a store holds it by is turbine,
    window, stream and sequence.

    Attributes
    ----------
    window
        Start of the window.
    """

    window: int
    block: Block


class Status(NamedTuple):
    """State of a turbine's stream; one row for each turbine, the newest.

    Attributes
    ----------
    sequences
        Of each stream, the highest up to which no block is missing that will still be used: publishers may forget up
        to here.
    stream
        Time of the newest sample.
    received
        When its block came, by the service's clock.
    state
        ``waiting`` (no block yet), ``running``, ``parked``, ``idling``, ``transient``, ``silent``.
    counts
        Since the first block, in plain words: ``blocks``, ``samples``, ``repeated``, ``late``, ``too late``, ``missing
        samples``, ``clock jumps``, ``refused`` …
    """

    turbine: str
    sequences: Mapping[str, int]
    stream: int
    received: int
    state: str
    rotor_speed: float | None
    counts: Mapping[str, int]


class SensorHealth(NamedTuple):
    """State of a channel; one row for each channel, the newest.

    Attributes
    ----------
    state
        ``good``, or the kind of fault: ``dead``, ``stuck``, ``spikes``, ``drift``, ``missing``, ``clipping`` …
    since
        When it became so.
    text
        What it is and what to do; empty where it is good.
    """

    turbine: str
    channel: str
    state: str
    since: int
    text: str


class SeriesLevel(NamedTuple):
    """One watched series after one window.

    Attributes
    ----------
    name, unit
        Of the coefficient, or ``noise_…`` of a sensor.
    kind
        ``k``, ``c``, ``f`` or ``noise``, as the watch has it.
    estimate, low, high
        Of the window alone, without its prior; ±2σ. None where the window says nothing of it.
    level, level_low, level_high
        As known after this window: what forgets.
    statistic, limit
        Of the test for a jump.
    grade
        Of the window's estimate, which the level does not follow if it is C; empty of noise, and of older windows.
    """

    name: str
    unit: str
    kind: str
    estimate: float | None
    low: float | None
    high: float | None
    level: float | None
    level_low: float | None
    level_high: float | None
    statistic: float
    limit: float
    grade: str = ""


class Result(NamedTuple):
    """Result of one window; one row for each turbine and window, never changed.

    Attributes
    ----------
    window, until
        Where it begins and ends.
    closed
        When the service closed it.
    row
        As `windsysid.fleet.rows` has it, for all of its columns.
    levels
        Of all series that are watched.
    checkpoint
        The turbine's watch after this window, in bytes: what it takes to go on.
    spectra
        Plots of the channels' spectra with the model, each as JSON (`windsysid.reports.interactive.plot.to_json`).
    """

    turbine: str
    window: int
    until: int
    closed: int
    row: Mapping[str, Any]
    levels: Sequence[SeriesLevel]
    checkpoint: bytes
    spectra: Sequence[str] = ()


class Alarm(NamedTuple):
    """Alarm of a turbine.

    Attributes
    ----------
    key
        What makes it one: turbine, series or channel, and when it was found. One that is there is replaced: it was
        measured again, put down to another cause, acknowledged, or it ended. A replacement that is not acknowledged
        leaves the acknowledgement that is there as it is.
    kind
        ``structure``, ``sensor`` or ``data``.
    about
        The series or the channel; empty for the stream.
    opened, ended
        When it was found, and when it was over; None while it lasts.
    earliest, latest
        Between these it happened.
    text
        What moved, by how much, since when, and what to do.
    acknowledged, by, remark
        When, by whom, and what they wrote; None and empty before.
    """

    key: str
    turbine: str
    kind: Literal["structure", "sensor", "data"]
    severity: Severity
    about: str
    opened: int
    earliest: int
    latest: int
    ended: int | None
    text: str
    acknowledged: int | None = None
    by: str = ""
    remark: str = ""


class Commit(NamedTuple):
    """Content of one transaction."""

    blocks: Sequence[StoredBlock] = ()
    statuses: Sequence[Status] = ()
    healths: Sequence[SensorHealth] = ()
    results: Sequence[Result] = ()
    alarms: Sequence[Alarm] = ()


class Event(NamedTuple):
    """A line of the store's journal: something changed that a page may show.

    Attributes
    ----------
    id
        Grows by every event.
    kind
        ``status``, ``health``, ``result``, ``alarm``.
    key
        Channel, window or alarm's key.
    """

    id: int
    at: int
    turbine: str
    kind: str
    key: str
