"""Sentences of faults, by kind, with advice; nothing else writes, reads or changes them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from windsysid._types import Array
from windsysid.inspection.limits import MAX_FAULT_SHARE
from windsysid.units import unit_text

__all__ = ["STATEMENTS", "advice", "joined", "percent", "statement"]

Data = Mapping[str, Any]
Statement = Callable[[int, Array, Data], str]


def statement(kind: str, count: int, spans: Array, data: Data) -> str:
    """Statement of a fault and its amount; arguments as for `windsysid.inspection.fault.Fault`."""
    return STATEMENTS[data.get("evidence", kind)](count, spans, data)


def advice(kind: str, severity: str, data: Data) -> str:
    """Advice on a fault; empty if nothing is to be done."""
    known = ADVICE.get(data.get("evidence", kind), "")
    return known(severity, data) if callable(known) else known


def joined(parts: Sequence[str]) -> str:
    """``a, b and c``."""
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1]


def _when(spans: Array, most: int = 4) -> str:
    """Times of the places, in words: ``at 12.3, 45 and 60 s (and 3 more places)``."""
    if not len(spans):
        return "everywhere"
    listed = [f"{a:.6g}" if b - a < 0.05 else f"{a:.6g}–{b:.6g}" for a, b in spans[:most]]
    more = len(spans) - most
    return f"at {joined(listed)} s" + (f" and {_count(more, 'more place')}" if more > 0 else "")


def _count(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _amount(numbers: Sequence[float], digits: int, unit: str) -> str:
    """Numbers and their unit; pure numbers have none."""
    return f"{joined([f'{number:.{digits}g}' for number in numbers])} {unit_text(unit)}".removesuffix(" 1")


def percent(share: float) -> str:
    """Share in percent, with two significant digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def _irregular(count: int, _: Array, d: Data) -> str:
    off = f", {_count(count, 'step')} more than 10 % off" if count else ""
    return f"steps of {d['step']:.4g} s vary by {percent(d['spread'])} rms, {percent(d['worst'])} at most{off}"


def _missing(count: int, spans: Array, d: Data) -> str:
    if d["share"] == 1.0:
        return "holds no number at all"
    where = f"in {_count(len(spans), 'place')}, the longest {d['longest']:.3g} s, {_when(spans)}"
    return f"{_count(count, 'sample')} missing ({percent(d['share'])}) {where}"


def _spikes(count: int, spans: Array, d: Data) -> str:
    relative = f", {d['relative']:.2g} × the usual rms" if d["relative"] is not None else ""
    size = f"up to {_amount([d['largest']], 3, d['unit'])} off the median{relative}"
    return f"{_count(len(spans), 'spike')} ({_count(count, 'sample')}) {size}, {_when(spans)}"


def _at_ends(count: int, spans: Array, d: Data) -> str:
    ends = _amount(d["ends"], 4, d["unit"])
    return f"{_count(count, 'sample')} ({percent(d['share'])}) are at {ends}, {_when(spans)}"


def _frozen(count: int, spans: Array, d: Data) -> str:
    length = f"repeats one value for up to {d['longest']:.3g} s"
    return f"frozen: {length}, {_count(count, 'sample')} ({percent(d['share'])}), {_when(spans)}"


def _silent(count: int, spans: Array, d: Data) -> str:
    length = f"only noise for up to {d['longest']:.3g} s"
    share = f"{_count(count, 'sample')} ({100.0 * d['share']:.2g} %)"
    return f"dead channel: {length}, {share}, {_when(spans)}, while other channels vibrate"


def _contradiction(_: int, __: Array, d: Data) -> str:
    return f"turns at {d['azimuth']:.4g} rad/s, but rotor_speed says {d['speed']:.4g} ({d['ratio']:.4g} times as fast)"


STATEMENTS: Final[Mapping[str, Statement]] = {
    # the clock
    "short gaps": lambda n, _, d: (
        f"{_count(n, 'sample')} lost ({percent(d['share'])}) in {d['gaps']} short gaps, the longest "
        f"{d['longest']:.3g} s"
    ),
    "gaps": lambda n, spans, d: (
        f"{_count(len(spans), 'gap')} in the time, the longest {d['longest']:.3g} s, {_count(n, 'sample')} lost"
        f" ({percent(d['share'])}), {_when(spans)}"
    ),
    "irregular sampling": _irregular,
    "shared time stamps": lambda _, __, d: d["text"],
    "sampling rate": lambda _, __, d: d["text"],
    "repeated rows": lambda n, spans, d: (
        f"{_count(n, 'row')} repeat the row before in all {d['vibrating']} channels that vibrate, {_when(spans)}"
    ),
    "too short": lambda n, _, d: f"has {n} samples: identify needs at least {d['identify']}, oma {d['oma']}",
    # channels
    "missing": _missing,
    "slower rate": lambda _, __, d: f"has a value in every {d['every']}th row only ({d['rate']:.4g} Hz)",
    "unknown unit": lambda _, __, d: (
        "has no unit" if d["unit"] in ("", "unknown") else f"the unit '{d['unit']}' is not known"
    ),
    "constant": lambda _, __, d: f"is {_amount([d['value']], 5, d['unit'])} throughout",
    "motionless": lambda _, __, d: f"is {_amount([d['value']], 5, d['unit'])} from the first sample to the last",
    "spikes": _spikes,
    "clipping": _at_ends,
    "limit": _at_ends,
    "frozen": _frozen,
    "silent": _silent,
    "held": lambda _, __, d: f"changes only every {d['every']} samples ({d['rate']:.3g} Hz)",
    "interpolated": lambda _, __, d: f"is interpolated linearly between every {d['every']} samples"
    f" ({d['rate']:.3g} Hz)",
    "coarse steps": lambda _, __, d: (
        f"comes in steps of {d['step']:.3g} {unit_text(d['unit'])}, its rms is {d['levels']:.2g} of them"
    ),
    # continuity
    "copied passage": lambda n, spans, d: (
        f"{_count(n, 'row')} ({100.0 * d['share']:.2g} %) repeat earlier rows to the last digit, {_when(spans)}, as "
        f"from {d['origin']:.6g} s on"
    ),
    "copy": lambda _, __, d: f"is a copy of {d['of']}",
    "overrun": lambda n, spans, _: (
        f"jumps {_count(n, 'time')} from one end of its range to the other, {_when(spans)}"
    ),
    "lost samples": lambda n, spans, d: f"{n} breaks at multiples of {d['distance']:.6g} s, {_when(spans)}",
    "lost rows": lambda _, __, d: f"one row was lost after every {d['period']}, although the times are equidistant",
    # units and contradictions
    "pace": lambda _, __, d: f"accelerations are sampled every {d['step']:.3g} s",
    "no structure so slow": lambda _, __, d: f"accelerations every {d['step']:.3g} s are too slow for a"
    " structure's vibration",
    "no deflection so large": lambda _, __, d: f"rms {d['rms']:.3g} m is too large for a structure's deflection",
    "no wind so strong": lambda _, __, d: f"a mean wind of {d['mean']:.3g} m/s",
    "gravity in another unit": lambda _, __, d: f"the mean is {d['mean']:.3g} m/s² where gravity would be 9.81",
    "no support so shaken": lambda _, __, d: (
        f"rms {d['rms']:.3g} m/s² is {d['gravities']:.3g} g, too large for a support"
    ),
    "no structure swings so far": lambda _, __, d: (
        f"rms {d['rms']:.3g} m/s² means a motion of {d['swing']:.3g} m, too large for a structure"
    ),
    "gravity of three axes": lambda _, __, d: (
        f"the mean of three axes is {d['mean']:.3g} m/s² where gravity would be 9.81"
    ),
    "gravity once per turn": lambda _, __, d: (
        f"swings by {d['amplitude']:.3g} m/s² once per turn where gravity would give 9.81"
    ),
    "wraps elsewhere": lambda _, __, d: f"wraps at {d['at']:g} where radians would wrap at 6.28",
    "angle too large": lambda _, __, d: f"reaches {d['largest']:.3g} where radians would wrap at 6.28",
    "another usual speed": lambda _, __, d: f"{d['speed']:.4g} rad/s, where {d['turbine']} turns at {d['usual']:.4g}",
    "fast rotor": lambda _, __, d: f"{d['speed']:.4g} rad/s is {d['rpm']:.4g} rpm",
    "small rotor": lambda _, __, d: f"{d['speed']:.4g} rad/s is {d['rpm']:.4g} rpm, which only a small rotor does",
    "tilt": lambda _, __, d: (
        f"the mean {d['mean']:.3g} m/s² is gravity at a tilt of {d['degrees']:.2g}°, with {d['upright']}"
    ),
    "yawed axes": lambda _, __, d: (
        f"the nacelle is yawed by {d['degrees']:.3g}° about the axes of {d['channels']}, which do not yaw"
        + (": x is fore-aft and z is side-side" if d["degrees"] > 45.0 else "")
    ),
    "gravity": lambda _, __, d: f"contains gravity (mean {d['mean']:.4g} m/s²)",
    "backwards": lambda _, __, d: f"runs backwards ({d['azimuth']:.3g} rad/s)",
    "contradiction": _contradiction,
    "azimuth jumps": lambda n, spans, d: (
        f"jumps by up to {d['largest']:.2g} rad against rotor_speed in {n} places, {_when(spans)}"
    ),
    "azimuth scatter": lambda _, __, d: f"scatters by {d['degrees']:.2g}° about a smooth rotation",
}  # fmt: skip
"""Statement of each kind of fault, or of the evidence of one: of the number of samples, the places and the data."""


def _resample(_: str, d: Data) -> str:
    if not d["off"]:
        return ""
    smoother = "readings are smoother on a regular grid, and are taken so"
    return smoother if d["on_grid"] else "resample to a uniform rate first"


def _mistake(_: str, d: Data) -> str:
    return f"{d['mistake']}?" if d["mistake"] else "check the unit of both"


def _bridged(_: str, d: Data) -> str:
    """Advice on lost samples; a record with more of them than a section may have is never proposed as a whole."""
    few = d["share"] <= MAX_FAULT_SHARE
    return "few enough: identify and oma bridge them" if few else "choose a section without them"


ADVICE: Final[Mapping[str, str | Callable[[str, Data], str]]] = {
    "short gaps": "use the whole record; identify takes them as missing, oma fills them",
    "gaps": _bridged,
    "irregular sampling": _resample,
    "repeated rows": "the logger stalled or wrote twice; treat them as missing",
    "too short": "give a longer record",
    "missing": lambda severity, d: (
        "leave it out"
        if d["share"] == 1.0
        else {
            "unusable": "mostly missing: leave it out", "warning": _bridged(severity, d),
            "note": "short enough to be bridged",
        }[severity]
    ),
    "slower rate": "recorded by a slower logger",
    "unknown unit": "values are kept as in the file; windsysid start asks for it",
    "constant": lambda _, d: "the rotor stands still" if d["standing"] else "a set value rather than a measured one",
    "motionless": "disconnected, or a motion that the simulator fixes; leave it out",
    "spikes": lambda severity, _: (
        "if a sensor measures it, remove them (despike)"  # counters, states and solver outputs may jump
        if severity == "note"
        else "remove them (despike) before anything else"
    ),
    "clipping": (
        "the sensor or its amplifier saturates there; larger values are lost, so amplitudes and damping are "
        "out wrong"
    ),
    "limit": "an end stop, a controller's limit, or the end of the sensor's range",
    "frozen": "treat them as missing",
    "silent": "treat them as missing",
    "held": "sampled at a slower rate and held",
    "interpolated": "filled in",
    "coarse steps": lambda _, d: (
        "the resolution is too coarse for the motion; raise the gain"
        if d["levels"] < 2.0
        else f"quantisation adds {percent(0.2887 / d['levels'])} of noise"
    ),
    "copied passage": "a passage was written twice; leave the copies out",
    "copy": "one sensor is counted twice; leave it out",
    "overrun": "the converter overflowed; unwrap its values or leave it out",
    "lost samples": "samples were lost there, and damping is too large; choose a section without",
    "lost rows": lambda _, d: (
        f"frequencies are {100.0 / d['period']:.2g} % too high; write the time at which each row was taken"
    ),
    "pace": lambda _, d: (
        "if it is in milliseconds, write 'time [ms]' as its heading."
        if d["slow"]
        else "if it is in hours or days, write 'time [h]' or 'time [d]'."
    ),
    "no structure so slow": "is it in milliseconds? Then write its unit into its heading, as in 'time [ms]'.",
    "no deflection so large": "mm marked as m?",
    "no wind so strong": "km/h marked as m/s, or not calibrated?",
    "gravity in another unit": _mistake,
    "no support so shaken": "mg, mm/s² or raw counts?",
    "no structure swings so far": "mg, mm/s² or raw counts?",
    "gravity of three axes": _mistake,
    "gravity once per turn": _mistake,
    "wraps elsewhere": _mistake,
    "angle too large": "degrees marked as rad?",
    "another usual speed": _mistake,
    "fast rotor": "rpm marked as rad/s, or the generator's speed?",
    "small rotor": "make sure that it is not rpm",
    "tilt": "the axes are those of the tilted part",
    "yawed axes": (
        "turn them with windsysid.signals.with_nacelle_axes (docs/signals.md), or read fore-aft for side-side"
    ),
    "gravity": "remove it before integration",
    "backwards": "count it in the direction of rotation",
    "contradiction": _mistake,
    "azimuth jumps": "the encoder slipped; use a section between them",
    "azimuth scatter": "it is smoothed",
}  # fmt: skip
"""Advice of each kind, of the severity and the data."""
