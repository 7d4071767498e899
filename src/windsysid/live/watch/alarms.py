"""Alarms of a watch: the change, its cause (structure or sensor), its severity, and its end.

Rules, in their order:

- **Drift.** What is said of a jump holds for a slow drift, which is a jump from what the level was weeks or months ago
  to what it is now. While it is open, its alarm is said anew where the drift became half as large again, or grave.
- **Cause.** A jump of a sensor's noise is the sensor's. A jump of anything else is put down to a sensor first where a
  noise jumped with it, where most estimates of it had grade A or B before and have not after, or where records have
  findings of their channels since. Otherwise it is the structure.
- **Severity.** ``alarm``: the structure lost, by the whole of its 95 % interval, at least `MIN_ALARM_LOSS_PERCENT`.
  ``warning``: any other jump. ``notice``: a jump that took back an earlier one.
- **End.** An alarm ends when the level has come back: when its 95 % interval lies nearer to the level before than half
  of the jump; or when it was measured again and there is none in its interval. It opens at the threshold of the test
  and ends at half of the jump, so that it does not flicker. Who has acknowledged it knows it; it lasts as long as the
  turbine is not what it was.
- **Nothing to watch.** Where no window could be taken in for `MIN_EMPTY_WINDOWS` windows, a notice says why; it ends
  with the first that is.
"""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Literal, NamedTuple

from windsysid.fleet.rows import Row, stored_grade
from windsysid.live.store.contents import Alarm, Severity
from windsysid.live.watch.series_words import said_with_name
from windsysid.live.watch.slow_drifts import Drifted
from windsysid.live.watch.watched import Watched
from windsysid.monitoring.levels.locating import Jump
from windsysid.monitoring.watch import HEARD, SENSOR, SOUND, UNEXPLAINED, UNWATCHED, percent_of, tell
from windsysid.results.posterior import SIGMAS

__all__ = [
    "MIN_EMPTY_WINDOWS", "AlarmCase", "Circumstances", "blind_alarm", "came_back", "drift_alarm", "jump_alarm",
    "why_blind",
]  # fmt: skip

MIN_ALARM_LOSS_PERCENT = {"k": 2.0, "f": 1.0, "c": 30.0}
"""Loss from which a jump of the structure is an alarm [%]: of stiffness, frequency, damping."""

MAX_REST_SHARE = 0.5
"""Share of a jump that may be left where it came back."""

MIN_EMPTY_WINDOWS = 36
"""Windows without a block before an alarm: six hours of 10 minutes."""

ADVICE = {
    "structure": "compare the records before and after (windsysid compare) and have the turbine inspected",
    "sensor": "check sensor, cable and logger before the turbine",
}


class AlarmCase(NamedTuple):
    """A jump and its report.

    Attributes
    ----------
    series
        Its name.
    jump
        In filter coordinates, by blocks.
    returns
        True if it reverses an earlier one.
    alarm
        As it was last said.
    drift
        Whether it is a slow drift: a jump from a reference to what was said last.
    """

    series: str
    jump: Jump
    returns: bool
    alarm: Alarm
    drift: bool = False


class Circumstances(NamedTuple):
    """Circumstances of a jump.

    Attributes
    ----------
    noisy
        Sensor noises that jumped at the same time.
    noise_watched
        True if any noise is watched.
    lost_grade, lost_health
        True if most estimates had grade A or B, or channels were without findings, before it and not after.
    changed
        True if the turbine's settings or the version of windsysid changed with it.
    """

    noisy: Sequence[str]
    noise_watched: bool
    lost_grade: bool
    lost_health: bool
    changed: bool


def jump_alarm(
    turbine: str, watched: Watched, jump: Jump, when: tuple[int, int, int, int], about: Circumstances, *, returns: bool
) -> Alarm:
    """A jump as an alarm.

    Parameters
    ----------
    when
        The earliest and the latest window that it may lie before, and the window that found it: their starts; and the
        end of the last [ns since 1970].
    returns
        True if it reverses an earlier one.
    """
    earliest, latest, found, opened = when
    kind, why = _cause(watched, about)
    percent = percent_of(jump.size, jump.std, jump.before, watched.logarithmic)
    between = date(earliest) if earliest == latest else f"{date(earliest)} … {date(latest)}"
    told = tell(said_with_name(watched.name), percent, between, f"{date(opened)} UTC", why)
    severity = "notice" if returns else _severity(watched.kind, kind, percent)
    return Alarm(
        f"{turbine}:{watched.name}:{found}", turbine, kind, severity, watched.name, opened, earliest, latest,
        opened if returns else None, told + _advice(kind, about, returns=returns),
    )  # fmt: skip


def drift_alarm(
    turbine: str, watched: Watched, drift: Drifted, when: tuple[int, int, int, int], about: Circumstances, *,
    returns: bool, weather: bool,
) -> Alarm:  # fmt: skip
    """A slow drift as an alarm; parameters as of `jump_alarm`.

    Parameters
    ----------
    weather
        True if the temperature is known, so that a seasonal effect is removed.
    """
    earliest, latest, found, opened = when
    kind, why = _cause(watched, about)
    jump = drift.jump
    percent = percent_of(jump.size, jump.std, jump.before, watched.logarithmic)
    verb = "rose" if percent[0] > 0.0 else "fell"
    alone = percent_of(SIGMAS * drift.wander, 0.0, jump.before, watched.logarithmic)[0]
    told = (
        f"{said_with_name(watched.name)} {verb} slowly, by {abs(percent[0]):.3g} %"
        f" ({percent[1]:+.3g} … {percent[2]:+.3g} %) from {date(earliest)} to {date(latest)}"
    )
    told += f", found on {date(opened)} UTC: its usual variation over such a time is {alone:.2g} % (2σ); {why}"
    if not weather and watched.kind != "noise":
        told += "; the temperature is not recorded, so a seasonal effect is possible"
    severity = "notice" if returns else _severity(watched.kind, kind, percent)
    return Alarm(
        f"{turbine}:{watched.name}:drift:{found}", turbine, kind, severity, watched.name, opened, earliest, latest,
        opened if returns else None, told + _advice(kind, about, returns=returns),
    )  # fmt: skip


def _advice(kind: Literal["structure", "sensor"], about: Circumstances, *, returns: bool) -> str:
    text = f"; {'it reverses an earlier change' if returns else ADVICE[kind]}"
    return f"{text}; settings or version changed at the same time: check these first" if about.changed else text


def _cause(watched: Watched, about: Circumstances) -> tuple[Literal["structure", "sensor"], str]:
    if watched.kind == "noise":
        return "sensor", HEARD
    if about.noisy:
        return "sensor", f"{SENSOR}: {' and '.join(map(said_with_name, about.noisy))} changed with it"
    if about.lost_grade:
        return "sensor", f"{SENSOR}: {UNEXPLAINED}"
    if about.lost_health:
        return "sensor", f"{SENSOR}: records have findings since"
    return "structure", SOUND if about.noise_watched else UNWATCHED


def _severity(series: str, cause: str, percent: tuple[float, float, float]) -> Severity:
    """`percent` is a change and its 95 % interval."""
    grave = cause == "structure" and percent[2] <= -MIN_ALARM_LOSS_PERCENT.get(series, math.inf)
    return "alarm" if grave else "warning"


def came_back(jump: Jump, level: float, std: float) -> bool:
    """Check whether a level with this standard deviation has returned to its value before a jump."""
    none = abs(jump.size) <= SIGMAS * jump.std
    return none or abs(level - jump.before) + SIGMAS * std <= MAX_REST_SHARE * abs(jump.size)


def takes_back(earlier: Jump, jump: Jump) -> bool:
    """Check whether a jump reverses an earlier one of the same series."""
    rest = abs(earlier.size + jump.size)
    return earlier.found < jump.found and earlier.size * jump.size < 0.0 and rest <= MAX_REST_SHARE * abs(earlier.size)


def blind_alarm(turbine: str, since: int, opened: int, ended: int | None, why: str) -> Alarm:
    """Alarm that no window has been usable since a time."""
    text = f"no usable window of {turbine} since {date(since)} UTC: {why}; a change shows in the next usable window"
    return Alarm(f"{turbine}::{since}", turbine, "data", "notice", "", opened, since, opened, ended, text)


def why_blind(row: Row | None) -> str:
    """Reason why a window is unusable; None stands for a missing one."""
    if row is None:
        return "no window received"
    if row["status"] != "ok":
        return f"windows are {row['status']}: {' '.join(str(row['why']).split())[:120]}"
    if row["state"] == "transient":
        return "the rotor starts or stops in every window"
    if row["parameters"] and all(stored_grade(row, one) == "C" for one in row["parameters"]):
        return f"all coefficients have grade C: {'; '.join(row['reasons'])[:120]}"
    return f"windows of a turbine that is {row['state']} lack SCADA, or there were too few of them to learn from"


def date(time: int) -> str:
    """[ns since 1970] as a date and minutes, UTC."""
    return datetime.fromtimestamp(time // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M")
