"""Odds that a spectral peak is that of a load, such as waves or a machine, and not a mode.

A load with a peak drives the structure at a frequency where it has no mode: with the shape of a neighbouring mode, a
combination of two, or the static deflection, which resembles one. The odds of a load against a mode are the product of

- prior odds, of waves in their range of frequencies and of machines at any;
- the ratio of the densities of the half-width: of a sea or of a machine of varying speed, and of structural damping;
- the ratio of the densities of variation (`check.variation`, `part_scores.wander_ratio`): of a machine, whose amplitude
  varies little, its phase more than its amplitude, and its frequency over time; and of random response, which a sea
  causes, too;
- the ratio of the densities of the modal assurance criterion (MAC) with another mode, or with the plane of the modes
  below and above: near 1 if a load excites these, and that of random directions for modes, in as many dimensions as
  channels move, unless the record's modes look alike to its sensors.

Of two modes with one shape, the one with the likelier width is taken for the mode, and both are doubtful if neither is:
two "modes" of a machine whose speed varies, or a tuned mass damper, which its sensors cannot tell from that.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from windsysid.spectral.modal_bands import limits
from windsysid.spectral.oma.mode import Doubt, OperationalMode

__all__ = ["shape_ratio", "with_comb_odds", "with_harmonic_odds", "with_load_odds"]


def with_load_odds(modes: Sequence[OperationalMode]) -> list[OperationalMode]:
    """Add a reason to each mode, by rising frequency, that may well be the peak of a load."""
    alone, equal = [_odds_alone(mode) for mode in modes], _equal_share(modes)
    clear = [k for k, mode in enumerate(modes) if all(ground.kind == "background" for ground in mode.grounds)]
    checked = []
    for i, mode in enumerate(modes):
        odds, why = _odds_of_shape(i, [k for k in clear if k != i], modes, alone, equal)
        if mode.steadiness > 1.0:
            why = f", it varies as a machine does and not as under random loads ({mode.steadiness:.2g} : 1){why}"
        text = f"its damping ratio would be {100 * mode.damping_ratio.estimate:.2g} %{why};"
        checked.append(_doubted(mode, odds, f"{text} odds of a load, such as waves or a machine, {odds:.2g} : 1"))
    return checked


def _odds_of_shape(
    i: int, clear: Sequence[int], modes: Sequence[OperationalMode], alone: list[float], equal: float
) -> tuple[float, str]:
    """Odds of a load against mode i by its shape, too, and the modes that it would excite, of `clear`, as a clause."""
    odds, why = alone[i], ""
    at = int(np.searchsorted(clear, i))
    for near in (*([k] for k in clear), clear[max(at - 1, 0) : at + 1]):
        ratio, mac = shape_ratio(modes[i], [modes[k] for k in near], equal)
        together = alone[i] * ratio / (1.0 + sum(alone[k] for k in near) * ratio)
        if together > odds:
            of = " and ".join(f"{modes[k].frequency.estimate:.4g} Hz" for k in near)
            odds, why = together, f", its shape that of {of} (MAC {mac:.3f})"
    return odds, why


def with_comb_odds(modes: Sequence[OperationalMode], turning: float) -> list[OperationalMode]:
    """Add a reason to each mode that may well be a harmonic of a rotor of unknown speed, given its odds of turning.

    Harmonics are at multiples of one frequency, which is a peak, too. One such comb is sought, any peak being as likely
    its first; each other multiple raises the odds of a harmonic.
    """
    combs = [_comb(modes, first) for first in modes]
    odds = [_comb_odds(comb, turning / len(modes)) for comb in combs]
    best = int(np.argmax(odds)) if odds else 0
    if not odds or len(combs[best]) < 2:
        return list(modes)
    base, comb = modes[best].frequency.estimate, combs[best]
    checked = []
    for mode in modes:
        order = max(round(mode.frequency.estimate / base), 1)
        own = comb[1] if mode is modes[best] else _harmonic_ratios(mode, order, base, _comb_spread(modes[best]))
        odds_here = _comb_odds({**comb, order: own}, turning / len(modes), order) * (order <= limits.MAX_COMB_ORDER)
        why = f"it is {order} times {base:.4g} Hz, as other peaks are: odds of a harmonic of a rotor"
        checked.append(_doubted(mode, odds_here, f"{why} without a speed channel, {odds_here:.2g} : 1"))
    return checked


def with_harmonic_odds(modes: Sequence[OperationalMode], speed: float, variation: float) -> list[OperationalMode]:
    """Add a reason to each mode that may well be a harmonic of a rotor whose speed [Hz] varies by some share."""
    checked = []
    for mode in modes:
        order = max(round(mode.frequency.estimate / speed), 1)
        odds = float(np.prod(_harmonic_ratios(mode, order, speed, variation * speed)))
        why = f"it is near {order}P, {order * speed:.4g} ± {order * variation * speed:.2g} Hz: odds of a harmonic,"
        checked.append(_doubted(mode, odds * (order <= 3 * limits.MAX_COMB_ORDER), f"{why} {odds:.2g} : 1"))
    return checked


def _doubted(mode: OperationalMode, odds: float, why: str) -> OperationalMode:
    """The mode with a reason if the odds of a load are too high."""
    if odds <= limits.MAX_LOAD_ODDS:
        return mode
    return replace(mode, grounds=(*mode.grounds, Doubt("load", f"load or mode: {why}")))


def _comb(modes: Sequence[OperationalMode], first: OperationalMode) -> dict[int, tuple[float, float]]:
    """Likelihood ratios of place and width of the likeliest peak at each multiple of a peak's frequency."""
    base, spread = first.frequency.estimate, _comb_spread(first)
    ratios = {1: (1.0, _width_ratio(first))}
    for peak in modes:
        order = round(peak.frequency.estimate / base)
        found = _harmonic_ratios(peak, order, base, spread)
        if 2 <= order <= limits.MAX_COMB_ORDER and np.prod(found) > np.prod(ratios.get(order, (1.0, 1.0))):
            ratios[order] = found
    return ratios


def _comb_odds(comb: dict[int, tuple[float, float]], turning: float, order: int = 1) -> float:
    """Odds of a rotor with a harmonic of some order against modes, which may be at multiples by their nature, and
    against a rotor without that harmonic."""
    places, widths = np.prod(list(comb.values()), axis=0)
    rest = np.prod([ratios for k, ratios in comb.items() if k != order]) if order > 1 else 0.0
    return float(turning * places * widths / (1.0 + limits.MULTIPLE_MODES * places + turning * rest))


def _harmonic_ratios(mode: OperationalMode, order: int, base: float, spread: float) -> tuple[float, float]:
    """Densities of the frequency and of the width of a peak if it is a harmonic of a frequency [Hz], over those of a
    mode."""
    scale = float(np.hypot(_comb_spread(mode), order * spread))
    off = (mode.frequency.estimate - order * base) / scale
    return float(np.exp(-0.5 * off**2) / (np.sqrt(2.0 * np.pi) * scale)) * base, _width_ratio(mode)


def _comb_spread(mode: OperationalMode) -> float:
    """Distance [Hz] of a peak from its multiple, as a standard deviation."""
    return float(np.hypot(mode.frequency.std, limits.COMB_SCATTER * mode.half_width))


def _width_ratio(mode: OperationalMode) -> float:
    """Density of the half-width of a peak if it is a harmonic of a rotor, over that of a mode."""
    return _mixture(mode, limits.HARMONIC_DAMPING) / _mixture(mode, limits.STRUCTURAL_DAMPING)


def _odds_alone(mode: OperationalMode) -> float:
    """Odds of a load against a mode by frequency, half-width and variation."""
    f = mode.frequency.estimate
    of_load = sum(
        prior * _density(mode, *width) * (1.0 + steady * (mode.steadiness - 1.0))
        for (prior, *width), (low, high), steady in limits.LOADS
        if low <= f <= high
    )
    return of_load / _mixture(mode, limits.STRUCTURAL_DAMPING)


def _mixture(mode: OperationalMode, widths: Sequence[tuple[float, float, float]]) -> float:
    """Density of the estimate of ln ζ under a mixture of log-normal distributions."""
    return sum(share * _density(mode, *width) for share, *width in widths)


def _density(mode: OperationalMode, centre: float, spread: float) -> float:
    """Density of the estimate of ln ζ under a log-normal distribution."""
    std = float(np.hypot(spread, mode.damping_ratio.relative_std))
    return float(np.exp(-0.5 * (np.log(mode.damping_ratio.estimate / centre) / std) ** 2) / std)


def _equal_share(modes: Sequence[OperationalMode]) -> float:
    """Share of pairs of modes that look alike to the sensors, by those of the record."""
    chance = limits.EQUAL_SHAPES[1]
    alike = [min(chance * shape_ratio(one, [other], chance)[0], 1.0) for one, other in combinations(modes, 2)]
    return (limits.PRIOR_PAIRS * chance + sum(alike)) / (limits.PRIOR_PAIRS + len(alike))


def shape_ratio(mode: OperationalMode, others: Sequence[OperationalMode], equal: float) -> tuple[float, float]:
    """Density of the MAC of a shape with the plane of others if it is of a load that excites their modes, over that of
    modes, and the MAC; `equal` is the share of modes apart that look alike to the sensors."""
    shapes = np.array([one.shape for one in (mode, *others)])
    moving = int(np.count_nonzero(np.abs(shapes).max(axis=0) > limits.MIN_MOTION))
    along = np.linalg.qr(shapes[1:].T)[0].conj().T @ shapes[0]
    mac = float(np.vdot(along, along).real / np.vdot(shapes[0], shapes[0]).real)
    if not others or moving <= len(others):
        return 1.0, mac
    unsure = sum(float(2.0 * np.sum(one.shape_std**2) / np.sum(np.abs(one.shape) ** 2)) for one in (mode, *others))
    off = max(1.0 - mac, unsure)
    scales = np.array(limits.SHAPE_DEVIATIONS) + unsure
    of_load = float(np.mean(np.exp(-off / scales) / scales))
    step = abs(np.log(mode.frequency.estimate / others[0].frequency.estimate))
    equal = limits.EQUAL_SHAPES[0] if len(others) == 1 and step < np.log(limits.MAX_CLOSE_RATIO) else equal
    return of_load / ((1.0 - equal) * _random_density(1.0 - off, len(others), moving) + equal * of_load), mac


def _random_density(mac: float, plane: int, dimensions: int) -> float:
    """Density of the squared cosine of a random direction with a plane of some dimensions in a space."""
    from scipy.special import beta

    a, b = 0.5 * plane, 0.5 * (dimensions - plane)
    mac = min(max(mac, 1e-6), 1.0 - 1e-6)
    return float(mac ** (a - 1.0) * (1.0 - mac) ** (b - 1.0) / beta(a, b))
