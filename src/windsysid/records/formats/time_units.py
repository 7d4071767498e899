"""The unit of a time column without one: seconds where no other unit is plausible, otherwise an error.

A step of h counts is h seconds, h milliseconds, h minutes, …, or one sample of a counter. Seconds are taken only if

- 20 µs ≤ h ≤ 0.1: no counter has such a step, 10 Hz to 50 kHz is a sampling rate, and in milliseconds it would be
  10 kHz or more; and
- in minutes, hours and days h is no usual step of a record (1 s … 1 h) and no usual rate: 0.01 min would be 1.67 Hz.
  1/(60 h) is a usual rate only where 1/h has a factor of three: 60 Hz in seconds is 1 Hz in minutes, and is refused;

or if the first value is a moment of the years 2000 to 2036 in seconds since 1970, with steps of 1 s or less. Everything
else (integers above all) is refused, because a factor of 1000 in the time is one of 1000 in every frequency.
"""

import itertools

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.units import to_si

__all__ = ["MAX_RATE", "RECENT", "confirmed_unit", "usual_step"]

MAX_RATE = 5e4
"""Sampling rate [Hz] beyond which nobody records a turbine."""

MAX_STEP = 0.1
"""Greatest step that is taken for seconds: in milliseconds, it is a rate of 10 kHz."""

RECENT = (946_684_800, 2_082_758_400)
"""The years 2000 to 2036 [s since 1970]."""

TOLERANCE = 0.01
"""Relative deviation within which a step is a usual one; usual steps in seconds and in minutes are 4 % apart."""

MAX_LOST_SHARE = 0.2
"""Share of steps of two and more above which times are rounded, and no rows are lost."""

_DAY_NUMBERS = ((30_000.0, 80_000.0), (693_960.0, 760_000.0))
_STEPS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1200, 1800, 3600)  # s
_RATES = (1, 1.024, 1.25, 1.28, 1.6, 2, 2.048, 2.5, 2.56, 3.125, 3.2, 4, 4.096, 5, 5.12, 6.25, 6.4, 8, 8.192, 10)
_HOW = "call it 'time [s]' or 'time [ms]', or write [time] unit or rate = … [Hz] into a mapping file"


def confirmed_unit(numbers: Array) -> str:
    """Unit of a time without one, from its first values (n,).

    Returns
    -------
    str
        ``s``; ``d`` for day numbers of Excel and MATLAB whose step in seconds would be below 20 µs.

    Raises
    ------
    RecordError
        If other units are plausible.
    """
    if len(numbers) < 2 or np.any(np.diff(numbers) < 0.0):
        return "s"  # no record, which the check of the rows tells better
    first, step = float(numbers[0]), usual_step(numbers)
    if 0.0 < step * MAX_RATE < 1.0 and any(low <= first < high for low, high in _DAY_NUMBERS):
        return "d"
    if step == 0.0:
        raise RecordError(f"the time has no unit, and its first rows show no step; {_HOW}")
    fast = step * MAX_RATE >= 1.0 - TOLERANCE
    if fast and RECENT[0] <= first < RECENT[1] and step <= 1.0 + TOLERANCE:
        return "s"
    if fast and step <= MAX_STEP * (1.0 + TOLERANCE) and not _is_usual_elsewhere(numbers, step):
        return "s"
    raise RecordError(
        f"the time has no unit: steps of {step:.4g} are {1.0 / step:.4g} Hz in s, {1e3 / step:.4g} Hz in ms, or a"
        f" count; {_HOW}"
    )


def usual_step(numbers: Array) -> float:
    """Mean of the steps that are within half the median step of it; of all steps where most times are repeated."""
    steps = np.diff(numbers)
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) <= 0.5 * median]
    return float(np.mean(near if median > 0.0 else steps))


def _is_usual_elsewhere(numbers: Array, step: float) -> bool:
    """Whether the step, or the mean of all steps, is a usual one in minutes, hours or days, to the rounding that the
    steps show."""
    steps = np.diff(numbers)
    off = steps - step * np.maximum(np.rint(steps / step), 1.0)  # lost rows make multiples of a step
    rounded = np.any(steps == 0.0) or np.mean(steps > 1.5 * step) > MAX_LOST_SHARE
    rounding = float(max(np.ptp(off), np.min(steps[steps > 0.0]) if rounded else 0.0))
    mean = float(np.mean(steps)) if rounding > TOLERANCE * step else step
    for one, unit in itertools.product((step, mean), ("min", "h", "d")):
        seconds, tolerance = one * to_si(1.0, unit), TOLERANCE + rounding / float(np.sum(steps))
        usual = np.array(_STEPS) if seconds > 1.0 else 1.0 / (np.array(_RATES) * 10.0 ** np.floor(-np.log10(seconds)))
        if np.any(np.abs(seconds / usual - 1.0) < tolerance):
            return True
    return False
