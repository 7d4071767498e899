"""Sentences about estimates: priors, damping, correlation, tolerances, convergence."""

import math
from collections.abc import Mapping
from typing import Final

from windsysid.checks.limits import MAX_WIDENING
from windsysid.results.sentences.template import LIKELY_MACHINE, Data, Sentence
from windsysid.units import engineering

__all__ = ["ESTIMATES", "TOLERANCE_UNITS"]

TOLERANCE_UNITS = {
    "gain": (100.0, "%"), "alignment": (180.0 / math.pi, "°"), "clock": (1e3, "ms"), "masses": (100.0, "%"),
    "aerodynamics": (100.0, "%"),
}  # fmt: skip
"""Setting: factor and unit in which a tolerance of each group is shown."""


def _damping_not_positive(d: Data) -> str:
    def sure(certain: bool) -> str:
        return " (negative over its whole interval)" if certain else ""

    lost = []
    for name, value, certain, *unit in d["coefficients"]:  # results of version 0.2 have no unit
        lost.append(f"{name} is {' '.join(engineering(*unit or [''], value, digits=3)).strip()}{sure(certain)}")
    lost += [f"{name} has {100.0 * ratio:.2g} %{sure(certain)}" for name, ratio, certain in d["modes"]]
    return (
        f"damping is not positive: {', '.join(lost)}. If the motion grew, stop and check the turbine; if not, try"
        " a longer or calmer section or another load model"
    )


def _all(d: Data) -> str:
    *most, last = d["quantities"]
    return f"{', '.join(most)} and {last}"


def _two_sigma(std: float) -> str:
    return f"±{float(f'{200.0 * std:.2g}'):g} %"


def _each(d: Data) -> str:
    """Two standard deviations of each quantity."""
    return _two_sigma(d["low"]) + (f" … {_two_sigma(d['high'])}" if d["high"] >= 1.1 * d["low"] else "")


def _prior_dominates(d: Data) -> str:
    share = f"{100.0 * d['share']:.0f} % from the data"
    if d["seen"]:
        return f"{_all(d)}: the data determine only {d['seen']}; the rest comes from the prior ({share})"
    if len(d["quantities"]) > 1:
        return f"{d['direction']} together: {share}, the rest from the prior"
    return f"{d['quantity']}: {share}, its interval comes mostly from the prior"


def _tolerance(d: Data) -> str:
    """Statement of a tolerance that is off, and its size."""
    factor, unit = TOLERANCE_UNITS[d["group"]]
    value, std = factor * d["estimate"], factor * d["std"]
    digits = max(0, 1 - math.floor(math.log10(std))) if 0.0 < std < math.inf else 3
    size = f"{abs(value):.{digits}f} ± {std:.{digits}f} {unit}"
    if d["group"] == "clock":
        return f"the logger {d['of']} is {size} {'late' if value >= 0.0 else 'early'}"
    if d["group"] == "alignment":
        return f"{d['of']} is rotated by {value:+.{digits}f} ± {std:.{digits}f}{unit}"
    whats = {"gain": "the gain of ", "masses": "the mass of ", "aerodynamics": "with its aerodynamics, "}
    what = whats[d["group"]] + d["of"]
    return f"{what} is {size} {'larger' if value >= 0.0 else 'smaller'} than its file says"


def _tolerance_off(d: Data) -> str:
    taken = "the estimates take it into account"
    if not d["contradicted"]:
        return f"{_tolerance(d)}: {taken}"
    return f"{_tolerance(d)}, according to the model: {taken}; correct its file, or look for a coupling"


def _wider_intervals(d: Data) -> str:
    why = {
        "explanations": "rival explanations of the record are possible",
        "frequency": f"readings around {d['at']:.3g} Hz contradict the fit to the others",
        "level": "readings scatter more about the fit than the model says, or unevenly over time",
        "time": f"segments of the record contradict each other, most at {d['at']:.0f} s",
    }
    more = f" and {len(d['names']) - 3} more" if len(d["names"]) > 3 else ""
    wide = f"intervals are up to {d['factor']:.1f} times as wide ({', '.join(d['names'][:3])}{more})"
    usable = d.get("usable", d["factor"] <= MAX_WIDENING)
    advice = "" if usable else "; choose another section or load model"
    return f"{why[d['over']]}: {wide}{advice}"


ESTIMATES: Final[Mapping[str, Sentence]] = {
    "prior_conflict": (
        "{quantity} and its prior contradict each other: they are {sigmas:|.1f|} standard deviations apart; the turbine"
        " file, a unit or the model is wrong"
    ),
    "prior_decides": (
        "{quantity} is {share:.0f %} from the data; a wider prior (probability {chance:.0f %}) shifts it by"
        " {sigmas:|.1f|} σ and multiplies σ by {wider:.1f}: check the turbine file"
    ),
    "prior_widened": (
        "the data put {quantity} {sigmas:|.1f|} standard deviations from its prior: the prior was made "
        "{factor:.0f} times as wide"
    ),
    "damping_not_positive": _damping_not_positive,
    "damping_may_be_negative": "damping may be zero or negative within its interval: {names}; choose a longer record",
    "prior_dominates": _prior_dominates,
    "unseen": "{quantity} is not determined by the data at all",
    "unseen_combination": lambda d: f"{_all(d)}: only {d['seen']} is determined",
    "unseen_direction": "{direction} together: no effect on the readings",
    "hard_to_tell_apart": lambda d: (
        f"{_all(d)} are hard to distinguish: {d['seen']} is known to {_two_sigma(d['std'])}, each alone to {_each(d)}"
        " (95 % interval)"
    ),
    "direction_hardly_seen": lambda d: (
        f"{_all(d)} are hard to distinguish: {d['direction']} together is poorly determined (each to {_each(d)})"
    ),
    "correlated_estimates": lambda d: f"{' and '.join(d['quantities'])} are correlated by {d['correlation']:+.2f}",
    "wider_intervals": _wider_intervals,
    "tolerance_off": _tolerance_off,
    "tolerance_conflict": lambda d: (
        f"{_tolerance(d)}: more than {d['factor']:g} times its tolerance; correct it, or the turbine file"
    ),
    "line_influence": ("without {frequency:.3g} Hz {quantity} would change by {sigmas:.1f} σ", LIKELY_MACHINE),
    "tone_influence": (
        "without the power left around {frequency:.3g} Hz {quantity} would change by {sigmas:.1f} σ",
        LIKELY_MACHINE,
    ),
    "search_not_converged": (
        "the likelihood still rose after {steps} steps: choose a longer or steadier section, or priors nearer to the"
        " structure"
    ),
    "search_exhausted": (
        "the likelihood still rose after {steps} steps, and further steps on a record of this size cost too much: "
        "choose a shorter section, or a lower rate"
    ),
    "fit_not_converged": (
        "the likelihood still rose when the search ended: choose a longer record, identify fewer parameters, or give"
        " narrower priors"
    ),
    "steps_too_long": (
        "steps are too long at {frequency:.3g} Hz: the integration adds {damping:.2g %} of damping, which the estimate"
        " lacks; give {rate:.3g} Hz, with gaps between"
    ),
    "no_history": "there are no online estimates: the online search did not converge",
}  # fmt: skip
"""For each code its sentence: one part, or a statement and its likely cause with what to do."""
