"""Separation of structural and aerodynamic damping, from records of one turbine in several states.

Each record tells the total c of a degree of freedom. Quasi-steady forces on blade sections are of second degree in
rotor speed Ω and wind speed V, so that what the air adds to c is of first degree in them. To first order of that,

    c = c₀ + a Ω/Ω* + b V/V*,        a parked rotor: c = c₀ + d V/V*,

with c₀ the structure's and Ω*, V* the largest of the records. In attached flow a is mostly lift, ½ ρ c C_lα Ω r across
the rotor's plane, and drag in it; b is what pitch and twist make of the wind; d is lift on feathered blades that move
in the plane, ½ ρ c C_lα V (Burton et al., Wind Energy Handbook; M. H. Hansen 2007, https://doi.org/10.1002/we.242).
Where parked records do not have winds far apart, d is not distinguished from c₀, and counts as structure.

The records' own estimates, priors taken out, are weighted by their variances, which are proportional to c for a mode
under broadband load (σ_c² = c²/(ζωT)) and therefore taken at the fitted c: at the estimated one, low estimates would
weigh too much. All intervals are then wider by one factor φ ≥ 1 of prior density ∝ φ⁻⁴ (beyond 2 in one case of eight),
learned from how far records scatter about the fits of all degrees of freedom. What the records do not determine,
because the row (1, 0, 0, 0) is no combination of theirs, is not given.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.monitoring.own_information import without_prior
from windsysid.monitoring.separation import DampingBand, DampingSplit, Separation, State
from windsysid.results.coercion import PosteriorLike, as_posterior
from windsysid.results.posterior import SIGMAS, Posterior

__all__ = ["separate_damping"]


MAX_PARKED_SPEED_SHARE = 0.1
"""Share of the fastest record's rotor speed below which a rotor counts as parked or idling."""

MAX_PARKED_SPEED = 0.05
"""Rotor speed below which it does in any case [rad/s]."""

MIN_WIND_RATIO = 1.5
"""Least ratio of the winds of parked records that determines the effect of wind on a parked rotor."""

DESIGN_TOLERANCE = 1e-6
"""Of the design, relative: below it a direction counts as not seen."""

SCATTER_PRIOR_POWER = 4
"""The prior density of φ falls with this power."""

VARIANCE_PASSES = 10
"""Times that the variances are taken at the fit."""

TARGET_RELATIVE_TWO_SIGMA = 0.5
"""A parked record is requested that would bring ±2σ of structural damping to this share of it."""

SCATTER_PROBABILITY = 0.01
"""Probability of so much scatter about the fits, were the records' own intervals all there is, below which it is
said."""

STRUCTURE = np.array([1.0, 0.0, 0.0, 0.0])
"""The row of the structure's part."""


def separate_damping(results: Sequence[PosteriorLike]) -> Separation:
    """Separate structural from aerodynamic damping, from results of one turbine in several states.

    Parameters
    ----------
    results : sequence of Identification, Posterior, str or Path
        Results, or the folders they were saved in, with the rotor speed and preferably the wind speed of their records
        (`Posterior.conditions`).

    Returns
    -------
    Separation
        Structural and aerodynamic part of each damping coefficient with 95 % intervals [N·s/m or N·m·s/rad], or the
        reason why the records do not separate them.

    Raises
    ------
    ConfigurationError
        If no result has a rotor speed, or they have no damping coefficient in common.

    See Also
    --------
    identify : Total damping from one record.

    References
    ----------
    - Burton et al., Wind Energy Handbook, 2nd ed., Wiley 2011.
    - M. H. Hansen, Wind Energy 10(6), 2007, doi:10.1002/we.242.

    Examples
    --------
    >>> import windsysid as ws
    >>> running = ws.load_turbine("tower")
    >>> parked = running.in_state("parked")
    >>> records = [ws.simulate(one, duration=600.0, rate=5.0, seed=2) for one in (running, parked)]
    >>> results = [ws.identify(record, running, formulation="spectral") for record in records]
    >>> _, fore_aft = ws.damping(results).splits
    >>> for part in (fore_aft.structural, fore_aft.aerodynamic[0]):
    ...     print(f"{part.value / 1e3:.0f} kN·s/m, 95 % interval {part.low / 1e3:.0f} … {part.high / 1e3:.0f}")
    19 kN·s/m, 95 % interval -11 … 48
    83 kN·s/m, 95 % interval -13 … 180
    """
    posteriors = [as_posterior(result) for result in results]
    known = [result for result in posteriors if result.conditions.rotor_speed is not None]
    if not known:
        got = ", ".join(map(_record, posteriors)) or "none"
        raise ConfigurationError(
            f"damping: expected results that say how fast the rotor turned, got {got}: record rotor_speed and identify"
            " again"
        )
    names = _common_damping(known)
    states = _states(known)
    design = _design(states)
    fits = [_Fit(design.rows, *_read_estimates(known, name)) for name in names]
    free, square = sum(fit.free for fit in fits), sum(fit.square for fit in fits)
    width = _half_width(free, square)
    pairs = zip(names, fits, strict=True)
    splits = tuple(_split(name, fit, width, known[0], states, design) for name, fit in pairs)
    lacking, notes = _lacking(states, splits), _notes(states, splits, design)
    doubts = [*_unusable(known, names), *_doubts(posteriors, free, square)]
    return Separation(states, design.parked_air, splits, tuple(lacking), tuple(notes), tuple(doubts))


def _common_damping(known: Sequence[Posterior]) -> list[str]:
    """Damping coefficients that all results identified; ConfigurationError without any."""
    model = known[0].turbine.model
    damping = [name for name in model.coefficients if model.coefficient(name).kind == "damping"]
    names = [name for name in damping if all(_identified(result, name) for result in known)]
    if not names:
        raise ConfigurationError(
            f"{', '.join(map(_record, known))}: expected a damping coefficient that all of them identified, got none"
        )
    return names


def _unusable(known: Sequence[Posterior], names: Sequence[str]) -> list[str]:
    """One sentence for each result in which dampings have grade C."""
    bad = {result.record: [name for name in names if name in result.unusable] for result in known}
    return [f"{', '.join(some)} of {record} (grade C): see its report" for record, some in bad.items() if some]


def _doubts(posteriors: Sequence[Posterior], free: int, square: float) -> list[str]:
    """Why the separation is not to be trusted."""
    doubts = [
        f"{result.record} is left out: its rotor speed was not recorded"
        for result in posteriors
        if result.conditions.rotor_speed is None
    ]
    if _is_scatter_significant(free, square):
        doubts.append(
            f"records scatter about the fits by {math.sqrt(square / free):.2g} of their own σ: something else changed"
            " too, or their intervals are too narrow; the intervals given here include it"
        )
    return doubts


def _record(result: Posterior) -> str:
    return result.record


def _identified(result: Posterior, name: str) -> bool:
    return name in [q.name for q in result.parameters]


def _states(results: Sequence[Posterior]) -> tuple[State, ...]:
    """State of operation in each record."""
    speeds = [abs(result.conditions.rotor_speed or 0.0) for result in results]
    limit = max(MAX_PARKED_SPEED_SHARE * max(speeds), MAX_PARKED_SPEED)
    return tuple(
        State(result.record, speed, result.conditions.wind_speed, speed < limit)
        for result, speed in zip(results, speeds, strict=True)
    )


class _Design(NamedTuple):
    """Rows (T, 4) of the regression, V* [m/s], whether the wind counts in either state, and whether aerodynamic damping
    of parked rotors counts as structural.

    A running record has (1, Ω/Ω*, V/V*, 0), a parked one (1, 0, 0, V/V*).
    """

    rows: Array
    strongest: float
    running_wind: bool
    parked_wind: bool
    parked_air: bool


def _design(states: Sequence[State]) -> _Design:
    """The rows of the records; a wind that is not known, or the same for all parked rotors, has a column of zeros."""
    parked = np.array([state.parked for state in states])
    wind = np.array([math.nan if state.wind_speed is None else state.wind_speed for state in states])
    running_wind = not parked.all() and bool(np.isfinite(wind[~parked]).all())
    blowing = wind[parked]
    parked_wind = len(blowing) > 1 and bool(blowing.max() > MIN_WIND_RATIO * blowing.min())  # False with a NaN
    speed = np.array([state.rotor_speed for state in states])
    fastest = speed[~parked].max() if not parked.all() else 1.0
    strongest = float(np.nan_to_num(wind).max(initial=0.0)) or 1.0
    share = np.nan_to_num(wind) / strongest
    running = ~parked
    rows = [
        np.ones(len(states)),
        running * speed / fastest,
        running * share * running_wind,
        parked * share * parked_wind,
    ]
    return _Design(np.column_stack(rows), strongest, running_wind, parked_wind, bool(parked.any()) and not parked_wind)


class _Fit:
    """Weighted least squares of the records' information on their states, where they determine these."""

    def __init__(self, rows: Array, value: Array, std: Array) -> None:
        _, sizes, directions = np.linalg.svd(rows)
        self.seen = directions[: int((sizes > DESIGN_TOLERANCE * sizes[0]).sum())]  # (rank, 4)
        design = rows @ self.seen.T
        fitted = value
        for _ in range(VARIANCE_PASSES):
            s = std * np.sqrt(_stretch(fitted, value))
            self.cov = np.linalg.inv((design / s[:, None] ** 2).T @ design)
            self.mean = self.cov @ (design.T @ (value / s**2))
            fitted = design @ self.mean
        self.value, self.std = value, std
        self.free = len(value) - len(self.seen)
        self.square = float((((value - fitted) / s) ** 2).sum())

    def at(self, row: Array, width: float) -> DampingBand | None:
        """The combination `row` of c₀, a, b and d with its interval; None where the records do not determine it."""
        along = self.seen @ row
        if np.linalg.norm(row - along @ self.seen) > DESIGN_TOLERANCE * np.linalg.norm(row):
            return None
        value, half = float(along @ self.mean), width * math.sqrt(along @ self.cov @ along)
        return DampingBand(value, value - half, value + half)


def _stretch(fitted: Array, value: Array) -> Array:
    """Variance at the fit over variance at the estimate: both are proportional to c, within reason."""
    ratio = fitted / np.maximum(value, 0.25 * np.abs(fitted) + 1e-300)
    return np.where(fitted > 0.0, ratio.clip(0.25, 4.0), 1.0)


def _half_width(free: int, square: float) -> float:
    """Half-width of a 95.45 % interval [standard deviations].

    φ is averaged over what `free` squares that add up to `square` give.
    """
    from scipy.optimize import brentq
    from scipy.special import erfc

    factor = np.geomspace(1.0, 1e3, 4000)
    log_weight = (1.0 - SCATTER_PRIOR_POWER - free) * np.log(factor) - 0.5 * square / factor**2
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    outside = math.erfc(SIGMAS / math.sqrt(2.0))
    return float(brentq(lambda h: weight @ erfc(h / factor / math.sqrt(2.0)) - outside, 1.0, 1e5))


def _is_scatter_significant(free: int, square: float) -> bool:
    """Test whether `free` squares add up to more than by chance."""
    from scipy.special import gammaincc

    return free > 0 and bool(gammaincc(0.5 * free, 0.5 * square) < SCATTER_PROBABILITY)


def _split(
    name: str, fit: _Fit, width: float, frame: Posterior, states: Sequence[State], design: _Design
) -> DampingSplit:
    """One coefficient, taken apart."""
    known = frame.turbine.model.coefficient(name)
    coordinate = known.part
    frequency = frame.turbine.natural_frequency(coordinate)
    running = np.array([not state.parked for state in states])
    structural = fit.at(STRUCTURE, width)
    air = [
        structural and fit.at(row - STRUCTURE, width) if design.parked_wind or not state.parked else None
        for row, state in zip(design.rows, states, strict=True)
    ]
    own = zip(fit.value.tolist(), (SIGMAS * fit.std).tolist(), strict=True)
    return DampingSplit(
        name=name,
        unit=known.unit,
        critical=2.0 * frame.turbine.inertia(coordinate) * frequency,
        frequency=frequency,
        measured=tuple(DampingBand(value, value - half, value + half) for value, half in own),
        structural=structural,
        aerodynamic=tuple(air),
        calm=fit.at(np.array([1.0, design.rows[running, 1].mean(), 0.0, 0.0]), width) if design.running_wind else None,
        per_wind=fit.at(np.array([0.0, 0.0, 1.0, 0.0]) / design.strongest, width),
        scatter=math.sqrt(fit.square / fit.free) if fit.free else math.nan,
    )


def _read_estimates(results: Sequence[Posterior], name: str) -> tuple[Array, Array]:
    """Information of the records on one coefficient: values and standard deviations (T,), SI."""
    frame = results[0]
    scale = next(q.reference for q in frame.parameters if q.name == name)
    found = []
    for result in results:
        known = [q for q in frame.parameters if _identified(result, q.name)]
        mean, cov = without_prior(result, known)
        i = [q.name for q in known].index(name)
        found.append((scale * mean[i], scale * math.sqrt(cov[i, i])))
    value, std = np.array(found).T
    return value, std


def _lacking(states: Sequence[State], splits: Sequence[DampingSplit]) -> list[str]:
    """Undetermined quantities, the reason, and a remedy."""
    parked = [state.parked for state in states]
    if all(parked):
        return [
            "no record is of a running rotor, so nothing is known of aerodynamic damping: identify a record of the"
            " running machine too"
        ]
    wanted = [split for split in splits if not split.resolved]
    if not wanted:
        return []
    minutes = max(map(_minutes, wanted))
    help_ = (
        f"record {minutes:.0f} min with the rotor parked or idling in weak wind for"
        f" ±{100 * TARGET_RELATIVE_TWO_SIGMA:.0f} %, or a stop with the decay after it (windsysid inspect finds it)"
    )
    if splits[0].structural is None:
        why = (
            "one record gives the sum of structural and aerodynamic damping" if len(states) == 1
            else "no rotor is parked, and rotor speeds and winds are too alike to extrapolate to standstill"
        )  # fmt: skip
        return [f"{why}: {help_}"]
    names = ", ".join(split.name for split in wanted)
    how = "the parked records are too short" if any(parked) else "standstill is too far from the records"
    return [f"the structural part of {names} cannot be distinguished from zero, because {how}: {help_}"]


def _minutes(split: DampingSplit) -> float:
    """Length of a parked record that brings structural damping to `TARGET_RELATIVE_TWO_SIGMA`: σ_c/c = 1/√(ζωT)."""
    seen = [split.structural.value] if split.structural is not None else [band.value for band in split.measured]
    ratio = max(min(seen) / split.critical, 1e-3)
    return math.ceil((SIGMAS / TARGET_RELATIVE_TWO_SIGMA) ** 2 / (ratio * split.frequency) / 60.0)


def _notes(states: Sequence[State], splits: Sequence[DampingSplit], design: _Design) -> list[str]:
    """Notes for the reader."""
    notes = []
    parked = [state for state in states if state.parked]
    if parked:
        notes.append(_parked_note(parked, design))
    elif splits[0].structural is not None:
        notes.append(
            "no rotor is parked: the structural part is a linear fit in rotor speed and wind, extrapolated to"
            " standstill"
        )
    if not design.running_wind and len(states) - len(parked) > 1:
        notes.append(
            "some running records have no wind speed (channel wind_speed): what the wind changes counts as scatter"
        )
    if math.isnan(splits[0].scatter) and splits[0].structural is not None:
        notes.append("no more records than unknowns: intervals cannot be checked, so they are widened by default")
    return notes


def _parked_note(parked: Sequence[State], design: _Design) -> str:
    """Note on whether the structural part includes the aerodynamic damping of a parked rotor."""
    if design.parked_wind:
        return "the structural part is that of the parked records, extrapolated to no wind"
    blowing = [f"{state.wind_speed:.3g}" for state in parked if state.wind_speed is not None]
    at = f" ({', '.join(blowing)} m/s)" if blowing else ""
    return (
        f"aerodynamic damping of a parked or idling rotor{at} counts as structure: parked records in winds"
        f" {MIN_WIND_RATIO:g} times apart separate them (docs/damping.md)"
    )
