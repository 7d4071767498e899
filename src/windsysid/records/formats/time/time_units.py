"""Unit of a time column that has none: seconds if no other unit is plausible, otherwise an error.

A step h may be h seconds, h milliseconds, h minutes, … or h counts. Seconds are accepted only if

- 20 µs ≤ h ≤ 0.1: no counter has such a step, 10 Hz to 50 kHz is a sampling rate, and in milliseconds it would be
  10 kHz or more; and
- in minutes, hours and days h is no usual step of a record (1 s … 1 h) and no usual rate: 0.01 min would be 1.67 Hz.
  1/(60 h) is a usual rate only where 1/h has a factor of three: 60 Hz in seconds is 1 Hz in minutes, and is refused;

or if the first value is a time of the years 2000 to 2036 in seconds since 1970, with steps of 1 s or less. All other
columns, integers above all, are refused, because a wrong unit would scale every frequency by a factor of 1000.
"""

import itertools

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.stamps import usual_step
from windsysid.units import to_si

__all__ = ["MAX_RATE_HZ", "RECENT_SECONDS", "confirmed_unit"]

MAX_RATE_HZ = 5e4
"""Highest plausible sampling rate of a turbine [Hz]."""

MAX_STEP_SECONDS = 0.1
"""Largest step that is accepted as seconds: in milliseconds it would be a rate of 10 kHz."""

RECENT_SECONDS = (946_684_800, 2_082_758_400)
"""The years 2000 to 2036 [s since 1970]."""

MAX_STEP_DEVIATION = 0.01
"""Largest relative deviation from a usual step; usual steps in seconds and in minutes differ by 4 %."""

MAX_LOST_SHARE = 0.2
"""Largest share of multiple steps that counts as lost rows; more of them come from rounded times."""

_DAY_NUMBERS = ((30_000.0, 80_000.0), (693_960.0, 760_000.0))
_STEPS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1200, 1800, 3600)  # s
_RATES = (1, 1.024, 1.25, 1.28, 1.6, 2, 2.048, 2.5, 2.56, 3.125, 3.2, 4, 4.096, 5, 5.12, 6.25, 6.4, 8, 8.192, 10)
_HOW = "write 'time [s]' or 'time [ms]' in the header, or [time] unit or rate = … [Hz] into a mapping file"


def confirmed_unit(numbers: Array) -> str:
    """Determine the unit of a time column that has none from its first values (n,).

    Returns
    -------
    str
        ``s``; ``d`` for day numbers of Excel and MATLAB whose step in seconds would be below 20 µs.

    Raises
    ------
    RecordError
        If other units are plausible too.
    """
    if len(numbers) < 2 or np.any(np.diff(numbers) < 0.0):
        return "s"  # the check of the rows names the fault
    first, step = float(numbers[0]), usual_step(numbers)
    if 0.0 < step * MAX_RATE_HZ < 1.0 and any(low <= first < high for low, high in _DAY_NUMBERS):
        return "d"
    if step == 0.0:
        raise RecordError(f"the time has no unit, and its first values are all equal; {_HOW}")
    if step * MAX_RATE_HZ >= 1.0 - MAX_STEP_DEVIATION and _are_seconds(numbers, first, step):
        return "s"
    raise RecordError(
        f"the time has no unit: steps of {step:.4g} mean {1.0 / step:.4g} Hz in s, {1e3 / step:.4g} Hz in ms, or a"
        f" count; {_HOW}"
    )


def _are_seconds(numbers: Array, first: float, step: float) -> bool:
    """Test whether numbers are seconds since 1970, or have steps that are unusual in other units."""
    if RECENT_SECONDS[0] <= first < RECENT_SECONDS[1] and step <= 1.0 + MAX_STEP_DEVIATION:
        return True
    return step <= MAX_STEP_SECONDS * (1.0 + MAX_STEP_DEVIATION) and not _is_usual_elsewhere(numbers, step)


def _is_usual_elsewhere(numbers: Array, step: float) -> bool:
    """Test whether the step or the mean step is a usual one in minutes, hours or days, within rounding."""
    steps = np.diff(numbers)
    off = steps - step * np.maximum(np.rint(steps / step), 1.0)  # lost rows make multiples of a step
    rounded = np.any(steps == 0.0) or np.mean(steps > 1.5 * step) > MAX_LOST_SHARE
    rounding = float(max(np.ptp(off), np.min(steps[steps > 0.0]) if rounded else 0.0))
    mean = float(np.mean(steps)) if rounding > MAX_STEP_DEVIATION * step else step
    for one, unit in itertools.product((step, mean), ("min", "h", "d")):
        seconds, tolerance = one * to_si(1.0, unit), MAX_STEP_DEVIATION + rounding / float(np.sum(steps))
        usual = np.array(_STEPS) if seconds > 1.0 else 1.0 / (np.array(_RATES) * 10.0 ** np.floor(-np.log10(seconds)))
        if np.any(np.abs(seconds / usual - 1.0) < tolerance):
            return True
    return False
