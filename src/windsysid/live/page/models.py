"""Models of the answers of the API. Moments are milliseconds since 1970, UTC; whatever is not known is null."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

__all__ = [
    "Acknowledgement", "AlarmSeen", "BudgetShare", "ChannelHealth", "ChannelStatistics", "Configuration", "Detail",
    "Excitation", "FoundMode", "Health", "JournalChanges", "Levels", "LoadTrack", "ModeTrack", "PageOverview",
    "RequestProblem", "Results", "SeriesHistory", "Service", "SourceStateName", "SourceStatus", "TurbinePage",
    "TurbineSummary", "Verdict", "WindowHealth",
]  # fmt: skip

Verdict = Literal["moved", "sensor", "silent", "unsure", "learning", "waiting", "steady"]
"""Verdicts on a turbine, worst first.

``moved``: a structural change was found. ``sensor``: a sensor has a fault. ``silent``: nothing comes, or too late.
``unsure``: the newest window has no coefficient of grade A or B. ``learning``: the watch does not know yet what is
usual. ``waiting``: no window has ended yet. ``steady``: no change.
"""

Numbers = list[float | None]

Grade = Annotated[str, Field(description="A, B or C: docs/grades.md; empty where there is none")]


class RequestProblem(BaseModel):
    """Why a request was not answered."""

    detail: str


SourceStateName = Literal["waiting", "running", "trying", "failed", "ended"]


class Health(BaseModel):
    """That the service answers."""

    status: Annotated[
        Literal["ok", "degraded", "failed"],
        Field(description="degraded: a source failed or cannot be reached; failed: the store accepts no blocks"),
    ]
    version: str
    sources: Annotated[dict[str, int], Field(description="how many sources are in which state")] = {}


class ChannelHealth(BaseModel):
    """Current state of a channel."""

    channel: str
    state: Annotated[str, Field(description="good, or the kind of fault")]
    since: float
    text: Annotated[str, Field(description="what it is and what to do")]


class AlarmSeen(BaseModel):
    """An alarm."""

    key: str
    turbine: str
    kind: Literal["structure", "sensor", "data"]
    severity: Literal["notice", "warning", "alarm"]
    about: Annotated[str, Field(description="the series or the channel; empty for the stream")]
    title: Annotated[str, Field(description="the series or the channel in words")]
    opened: float
    earliest: Annotated[float, Field(description="it happened between this moment and `latest`")]
    latest: float
    ended: float | None
    text: str
    acknowledged: float | None
    by: str
    remark: str


class TurbineSummary(BaseModel):
    """One line of the overview."""

    name: str
    verdict: Verdict
    answer: Annotated[str, Field(description="the verdict in a sentence")]
    state: Annotated[str, Field(description="of the rotor or of the stream: running, parked, silent …")]
    rotor_speed: Annotated[float | None, Field(description="rad/s")]
    stream: Annotated[float | None, Field(description="when the newest sample was taken")]
    received: Annotated[float | None, Field(description="when it came")]
    window: Annotated[float | None, Field(description="begin of the newest window that has a result")]
    until: Annotated[float | None, Field(description="its end")]
    trusted: Annotated[bool | None, Field(description="of the newest result; null where there is none")]
    grades: Annotated[dict[str, Grade], Field(description="of its coefficients, frequencies and damping ratios")] = {}
    reasons: Annotated[list[str], Field(description="why it is not trusted, or why there is no estimate")]
    windows_waiting: Annotated[int | None, Field(description="windows that ended and have no result yet")]
    behind: Annotated[float | None, Field(description="seconds since the oldest of them ended; 0 where none waits")]
    alarms: Annotated[list[AlarmSeen], Field(description="that are open, the worst first")]
    faults: Annotated[list[ChannelHealth], Field(description="channels that are not good")]


class Service(BaseModel):
    """State of the service; null if no engine runs."""

    blocks_per_second: float | None
    cost_per_sample: Annotated[float | None, Field(description="µs of processor time")]
    compiling: Annotated[bool, Field(description="a turbine's equations are being compiled: the estimate waits")]


class SourceStatus(BaseModel):
    """State of a source of samples."""

    name: Annotated[str, Field(description="what it reads from, without secrets")]
    state: Annotated[SourceStateName, Field(description="trying: what it reads from cannot be reached")]
    text: Annotated[str, Field(description="why it does not run; empty where it does")]
    blocks: int
    refused: int
    refusal: Annotated[str, Field(description="why the last one was refused; empty if none was")] = ""


class PageOverview(BaseModel):
    """All turbines, the worst first."""

    at: Annotated[float, Field(description="the service's clock")]
    event: Annotated[int, Field(description="of the journal, when this was read: follow /api/events after it")]
    role: Literal["reader", "operator"]
    login: Annotated[bool, Field(description="whether tokens are asked for")]
    version: str
    note: Annotated[str, Field(description="what the service wants its readers to know")] = ""
    store: Annotated[str, Field(description="why the store accepts no blocks; empty if it does")] = ""
    turbines: list[TurbineSummary]
    service: Service | None
    sources: list[SourceStatus] = []


class FoundMode(BaseModel):
    """Mode of the newest estimate, ±2σ, and its distance from rotor harmonics."""

    name: str
    frequency: Annotated[float | None, Field(description="Hz")]
    frequency_low: float | None
    frequency_high: float | None
    frequency_grade: Grade
    damping_ratio: Annotated[float | None, Field(description="1")]
    damping_ratio_low: float | None
    damping_ratio_high: float | None
    damping_ratio_grade: Grade
    nearest: Annotated[str | None, Field(description="1P, or a multiple of the blades: 3P, 6P …")]
    distance: Annotated[float | None, Field(description="to it, as a share of the mode's frequency; negative below it")]


class Excitation(BaseModel):
    """A multiple of the rotor speed."""

    name: str
    frequency: Annotated[float, Field(description="Hz")]


class BudgetShare(BaseModel):
    """Shares of the sources of uncertainty in a coefficient's variance."""

    name: str
    title: str
    unit: str
    estimate: float | None
    low: float | None
    high: float | None
    grade: Grade
    informed: Annotated[float | None, Field(description="share of the prior's variance that the data removed")]
    loads: Annotated[float | None, Field(description="share of the variance that knowing loads and noise would remove")]
    instruments: Annotated[
        float | None, Field(description="share that knowing gains, alignment, clocks and masses would remove")
    ]
    rest: Annotated[float | None, Field(description="share that is left: the window's length, and the prior")]


class WindowHealth(BaseModel):
    """Finding of the inspection of a window's channel."""

    channel: str
    kind: str
    severity: str
    text: str


class ChannelStatistics(BaseModel):
    """Statistics of a channel in a window."""

    channel: str
    unit: str
    mean: float | None
    std: float | None
    missing: Annotated[float | None, Field(description="share of the samples")]


class Detail(BaseModel):
    """All results of one window."""

    window: float
    until: float
    status: str
    why: str
    trusted: bool | None
    reasons: list[str]
    remarks: list[str]
    notes: list[str]
    state: str
    rotor_speed: float | None
    rate: Annotated[float | None, Field(description="Hz")]
    samples: int | None
    formulation: str
    modes: list[FoundMode]
    excitations: list[Excitation]
    budget: list[BudgetShare]
    health: list[WindowHealth]
    channels: list[ChannelStatistics]


class Configuration(BaseModel):
    """Settings of a turbine, with the time from which they apply."""

    at: float
    settings: str


class TurbinePage(BaseModel):
    """Current state of one turbine."""

    at: float
    event: int
    summary: TurbineSummary
    counts: Annotated[dict[str, int], Field(description="since the first block: blocks, samples, late …")]
    channels: list[ChannelHealth]
    newest: Annotated[Detail | None, Field(description="the newest window that has a result")]
    window_length: Annotated[float | None, Field(description="of its windows [s]; null if not known")]
    configurations: list[Configuration]


class SeriesHistory(BaseModel):
    """A watched series; all lists are as long as `Levels.windows`."""

    name: str
    title: str
    unit: str
    kind: Annotated[str, Field(description="k stiffness, c damping, f frequency, noise")]
    estimate: Annotated[Numbers, Field(description="of the window alone, without its prior")]
    low: Numbers
    high: Numbers
    grade: Annotated[list[Grade], Field(description="of the estimate: the level follows A and B")]
    level: Annotated[Numbers, Field(description="after the window")]
    level_low: Numbers
    level_high: Numbers
    statistic: Annotated[Numbers, Field(description="of the test for a jump; 0 while it learns")]
    limit: Annotated[Numbers, Field(description="beyond it the test alarms")]


class Levels(BaseModel):
    """Watched series of a turbine over time."""

    windows: Annotated[list[float], Field(description="begins of windows")]
    series: list[SeriesHistory]


class ModeTrack(BaseModel):
    """A mode over time, ±2σ; all lists are as long as `Results.windows`."""

    name: str
    frequency: Annotated[Numbers, Field(description="Hz")]
    frequency_low: Numbers
    frequency_high: Numbers
    frequency_grade: list[Grade]
    damping_ratio: Annotated[Numbers, Field(description="1")]
    damping_ratio_low: Numbers
    damping_ratio_high: Numbers
    damping_ratio_grade: list[Grade]


class LoadTrack(BaseModel):
    """A statistic of the loads over time, ±2σ; all lists are as long as `Results.windows`."""

    name: str
    title: str
    unit: str
    estimate: Numbers
    low: Numbers
    high: Numbers


class ConditionTrack(BaseModel):
    """Mean of a channel, or SCADA, over time; as long as `Results.windows`."""

    name: str
    title: str
    unit: str
    mean: Numbers


class Spectra(BaseModel):
    """Spectra of the channels of one window, with the model."""

    window: Annotated[float | None, Field(description="its start; null if no spectrum is stored")]
    plots: Annotated[list[dict[str, Any]], Field(description="curves over frequency, with intervals, modes and units")]


class Waterfall(BaseModel):
    """Spectrum of one channel over time, of the last window of each hour."""

    channel: str
    channels: list[str]
    unit: str
    windows: list[float]
    frequencies: Annotated[list[float], Field(description="Hz, of the newest spectrum")]
    modes: Annotated[dict[str, Numbers], Field(description="Hz, in the frame of the channel; null with grade C")]
    density: Annotated[list[Numbers], Field(description="decimal logarithm of the measured spectrum, by window")]


class Results(BaseModel):
    """Results of the windows of a turbine."""

    windows: list[float]
    until: list[float]
    status: Annotated[list[str], Field(description="ok, refused, failed")]
    trusted: list[bool | None]
    state: list[str]
    why: Annotated[list[str], Field(description="reason for a missing or untrusted estimate")]
    rotor_speed: Annotated[Numbers, Field(description="rad/s")]
    blades: Annotated[int | None, Field(description="number; the rotor excites at 1P and multiples of it")]
    modes: list[ModeTrack]
    loads: list[LoadTrack]
    conditions: list[ConditionTrack]


class Acknowledgement(BaseModel):
    """Name and remark of an acknowledgement."""

    model_config = {"extra": "forbid"}

    by: Annotated[str, Field(max_length=80, pattern=r"^[^\x00-\x20\x7f][^\x00-\x1f\x7f]*$")]
    remark: Annotated[str, Field(max_length=1000, pattern=r"^[^\x00-\x08\x0b-\x1f\x7f]*$")] = ""


class JournalChanges(BaseModel):
    """Changes since the last message, whose data a client requests again."""

    turbines: Annotated[list[str], Field(description="whose status, health or results changed")]
    results: Annotated[list[str], Field(description="that have a new result")]
    alarms: Annotated[list[str], Field(description="keys of alarms that opened, ended or were acknowledged")]
    all: Annotated[bool, Field(description="so much changed that everything must be read again")]
