"""Frequencies around which a turning rotor's modes are analysed, and start of the search for its stiffness.

The turbine file names the modes, and its prior says how far they may be from where it puts them. Peaks of the record
decide (`band_search`), group by group: one factor on the stiffness of all blades for both whirls, then one on the
spring of the roll for the mode in which the blades move together, then one on each spring of the support.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import NEGLIGIBLE_SHARE
from windsysid.results.finding import Finding
from windsysid.spectral.rotor_bands.channels import Combined
from windsysid.spectral.rotor_bands.limits import MIN_PEAK_LOG_ODDS
from windsysid.spectral.rotor_bands.peak_search import Trace, best_of, trace
from windsysid.spectral.transforms.rotating_frame import TurnedSpectra
from windsysid.statespace.parameter import Parameter

__all__ = ["ModeLocation", "ModeLocations", "find_places"]

WHIRLS = {"lag backward": 1, "lag collective": 0, "lag forward": -1}
"""Setting: modes of the blades, and the classes in which they show."""

SEARCH_SIGMAS = 3.0
"""Setting: standard deviations of the prior that are searched."""

FACTOR_STEP = 0.01
"""Setting: step between factors on a stiffness that are tried, in the logarithm."""

FACTOR_COUNT = 9
"""Setting: number of factors at which modes are computed; interpolated between."""

MAX_PEAK_DISTANCE = 0.012
"""Setting: relative distance of a peak from its frequency for the best factor."""


class ModeLocation(NamedTuple):
    """A mode and the frequency at which it is analysed.

    Attributes
    ----------
    name
        As `windsysid.modal` has it.
    shape
        The class p of the blades in which it shows; None for a mode of the support.
    frequency
        In the frame in which it is read [Hz].
    ratio
        Its damping ratio in the turbine file.
    """

    name: str
    shape: int | None
    frequency: float
    ratio: float


class ModeLocations(NamedTuple):
    """Modes that the search located, and start values.

    Attributes
    ----------
    places
        The modes that are read.
    start
        θ to begin with (n,).
    doubts
        What speaks against them: peaks that do not stand out, and others that might be meant.
    """

    places: tuple[ModeLocation, ...]
    start: Array
    doubts: tuple[Finding, ...]


class _Group(NamedTuple):
    """Parameters that are moved by one factor, and the modes that tell it."""

    members: tuple[Parameter, ...]
    modes: tuple[str, ...]

    @property
    def middle(self) -> float:
        """Geometric mean of the priors' centres."""
        return math.exp(float(np.mean([math.log(q.centre) for q in self.members])))

    @property
    def spread(self) -> float:
        """Prior standard deviation of the factor's logarithm: that of one, as if all were wrong alike."""
        return float(np.mean([q.spread for q in self.members]))


def find_places(
    frequencies: Callable[[Mapping[str, float]], dict[str, float]], ratios: Mapping[str, float],
    parameters: Sequence[Parameter], spectra: TurnedSpectra, combined: Sequence[Combined], blades: Sequence[str],
) -> ModeLocations | None:  # fmt: skip
    """The modes and where they are; None where they come so near each other within the priors' reach that the model's
    change their names.

    Parameters
    ----------
    frequencies
        Gives the fixed-frame frequency [Hz] of every mode for values of the parameters; others at the priors' centres.
    ratios
        The damping ratio of each in the turbine file.
    blades
        Names of the blades' lag angles.
    """
    values = {q.name: q.centre for q in parameters}
    there = frequencies(values)
    named = _read_modes(there, combined)
    found: dict[str, float] = {}
    doubts: list[Finding] = []

    def trace_of(name: str, low: float, high: float) -> Trace:
        return _trace(spectra, combined, name, len(blades), low, high)

    for group in _groups(frequencies, values, _springs(parameters, blades), named, there):
        scales = np.linspace(-SEARCH_SIGMAS * group.spread, SEARCH_SIGMAS * group.spread, FACTOR_COUNT)
        curves = _curves(frequencies, values, group, scales, spectra.rotor_hz)
        if len(curves) < len(group.modes):
            return None
        best, peaks, more = _search(group, scales, curves, trace_of)
        found |= peaks
        values |= {q.name: group.middle * math.exp(best) for q in group.members}
        doubts += more
    last = frequencies(values)
    if not set(named) <= set(last) & set(ratios):
        return None
    where = {name: _base(name, last[name], spectra.rotor_hz) for name in named} | found
    places = tuple(ModeLocation(name, WHIRLS.get(name), where[name], ratios[name]) for name in named)
    start = np.array([float(q.coordinate(values[q.name])) for q in parameters])
    return ModeLocations(places, start, tuple(doubts))


def _read_modes(modes: Iterable[str], combined: Sequence[Combined]) -> list[str]:
    """Those of the modes that some combination of readings shows: whirls where it turns, the support's where not."""
    turns = {combination.turns for combination in combined}
    return [name for name in modes if (name in WHIRLS and True in turns) or (_stands(name) and False in turns)]


def _search(
    group: _Group, scales: Array, curves: Mapping[str, Array], trace_of: Callable[[str, float, float], Trace]
) -> tuple[float, dict[str, float], list[Finding]]:
    """The logarithm of the group's factor that explains the peaks of its modes best, these peaks [Hz], and what speaks
    against them; `curves` as of `_curves` over logarithms of the factor (S,)."""
    fine = np.arange(scales[0], scales[-1] + FACTOR_STEP, FACTOR_STEP)
    score = -0.5 * (fine / group.spread) ** 2
    traces = {}
    for name in group.modes:
        low, high = float(np.exp(curves[name].min())), float(np.exp(curves[name].max()))
        traces[name] = trace_of(name, 0.97 * low, 1.03 * high)
        score += traces[name].widened(MAX_PEAK_DISTANCE).at(np.exp(np.interp(fine, scales, curves[name])))
    best, rivals = best_of(score, fine, np.interp(fine, scales, curves[group.modes[0]]))
    expected = {name: float(np.exp(np.interp(best, scales, curves[name]))) for name in group.modes}
    found = {name: traces[name].peak(place, MAX_PEAK_DISTANCE) for name, place in expected.items()}
    gain = max(
        float(traces[name].widened(MAX_PEAK_DISTANCE).at(np.array([place]))[0]) for name, place in expected.items()
    )
    mean_curve = np.mean([curves[name] for name in group.modes], axis=0)
    peaks = float(np.mean([math.log(place) for place in found.values()]))
    doubts = _doubts(group, found, max(gain, 0.0), rivals)
    return float(np.interp(peaks, mean_curve, scales)), found, doubts


def _stands(name: str) -> bool:
    """Test whether a mode is the support's and read there: not its roll, which stands for all that is faster."""
    return name.startswith("tower") and name != "tower roll"


def _base(name: str, frequency: float, rotor_hz: float) -> float:
    """Frequency at which a mode of that frequency in the fixed frame is read."""
    return frequency + WHIRLS.get(name, 0) * rotor_hz


def _groups(
    frequencies: Callable[[Mapping[str, float]], dict[str, float]], values: Mapping[str, float],
    springs: Mapping[str, list[Parameter]], named: Sequence[str], there: Mapping[str, float],
) -> list[_Group]:  # fmt: skip
    """The groups in the order in which they are searched, each with the modes that it moves most."""
    first: tuple[str, ...] = ("beta", "roll")
    order = [name for name in first if name in springs]
    order += [name for name in springs if name not in order]
    told: dict[str, list[str]] = {name: [] for name in order}
    moved = {name: frequencies({**values, **{q.name: 1.02 * values[q.name] for q in springs[name]}}) for name in order}
    for mode in named:
        slope = {name: math.log(moved[name].get(mode, there[mode]) / there[mode]) / math.log(1.02) for name in order}
        choices = [name for name in _springs_of(mode, slope) if name in springs]
        if choices:
            told[max(choices, key=slope.__getitem__)].append(mode)
    return [_Group(tuple(springs[name]), tuple(told[name])) for name in order if told[name]]


def _springs_of(mode: str, slope: Mapping[str, float]) -> list[str]:
    """The springs that may be searched by a mode, from its d ln f / d ln k for each, half of its share of the mode's
    energy."""
    if mode == "lag collective" and 2.0 * slope.get("roll", 0.0) > NEGLIGIBLE_SHARE:
        return ["roll"]
    if mode in WHIRLS:
        return ["beta"]
    return [name for name in slope if name not in ("beta", "roll")]


def _springs(parameters: Sequence[Parameter], blades: Sequence[str]) -> dict[str, list[Parameter]]:
    """The springs that are identified by the degree of freedom that they hold, those of all blades together."""
    springs: dict[str, list[Parameter]] = {}
    for q in parameters:
        if q.logarithmic and q.kind == "stiffness":
            springs.setdefault("beta" if q.part in blades else q.part, []).append(q)
    return springs


def _curves(
    frequencies: Callable[[Mapping[str, float]], dict[str, float]], values: Mapping[str, float], group: _Group,
    scales: Array, rotor_hz: float,
) -> dict[str, Array]:  # fmt: skip
    """ln of where each of the group's modes is read, for logarithms of the factor (S,), if any factor has it."""
    each = [
        frequencies({**values, **{q.name: group.middle * math.exp(s) for q in group.members}}) for s in scales.tolist()
    ]
    curves = {}
    for name in group.modes:
        known = [i for i, f in enumerate(each) if name in f]
        if not known:
            continue
        base = np.log([_base(name, each[i][name], rotor_hz) for i in known])
        curves[name] = np.maximum.accumulate(np.interp(scales, scales[known], base))
    return curves


def _trace(
    spectra: TurnedSpectra, combined: Sequence[Combined], name: str, blades: int, low: float, high: float
) -> Trace:
    """L(F) of the rows in which a mode shows."""
    shape = WHIRLS.get(name)
    if shape is None:
        rows = [spectra.combined(c.weights) for c in combined if not c.turns]
        return trace(spectra, rows, 0, blades, low, high)
    rows = [spectra.combined(c.weights) for c in combined if c.shape == shape]
    if rows:
        return trace(spectra, rows, shape, blades, low, high)
    return trace(spectra, [spectra.combined(c.weights) for c in combined if c.blade], 0, 1, low, high)


def _doubts(group: _Group, found: Mapping[str, float], gain: float, rivals: Sequence[float]) -> list[Finding]:
    """Findings against the peaks of a group."""
    data = {"modes": group.modes, "frequencies": [found[name] for name in group.modes]}
    if gain < MIN_PEAK_LOG_ODDS:
        return [Finding("faint_peak", "reason", data)]
    return [Finding("ambiguous_peak", "reason", data | {"others": rivals[:3]})] if rivals else []
