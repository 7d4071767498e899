"""Odds that a spectral peak is that of a load, such as waves or a machine, and not a mode.

A load with a peak drives the structure at a frequency where it has no mode: with the shape of a neighbouring mode, or
of the static deflection, which resembles it. The odds of a load
against a mode are the product of

- prior odds, of waves in their range of frequencies and of machines at any;
- the ratio of the densities of the half-width: of a sea or of a machine of varying speed, and of structural damping;
- the ratio of the densities of the modal assurance criterion (MAC) with another mode: near 1 if a load excites that
  mode, and that of random directions for two modes, in as many dimensions as channels move. A single channel says
  nothing.

Of two modes with one shape, the one with the likelier width is taken for the mode, and both are doubtful if neither is:
two "modes" of a machine whose speed varies, or a tuned mass damper, which its sensors cannot tell from that.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array, Complex
from windsysid.spectral.modal_bands import limits
from windsysid.spectral.oma.mode import Doubt, OperationalMode

__all__ = ["shape_ratio", "with_comb_odds", "with_load_odds"]


def with_load_odds(modes: Sequence[OperationalMode]) -> list[OperationalMode]:
    """Add a reason to each mode that may well be the peak of a load."""
    alone = [_odds_of_width(mode) for mode in modes]
    checked = []
    for i, mode in enumerate(modes):
        odds, why = alone[i], ""
        for k, other in enumerate(modes):
            if k == i or other.grounds:
                continue
            ratio, mac = shape_ratio(mode, other)
            together = alone[i] * ratio / (1.0 + alone[k] * ratio)
            if together > odds:
                odds, why = together, f", its shape that of {other.frequency.estimate:.4g} Hz (MAC {mac:.3f})"
        if odds > limits.MAX_LOAD_ODDS:
            text = f"load or mode: its damping ratio would be {100 * mode.damping_ratio.estimate:.2g} %{why};"
            text = f"{text} odds of a load, such as waves or a machine, {odds:.2g} : 1"
            mode = replace(mode, grounds=(*mode.grounds, Doubt("load", text)))
        checked.append(mode)
    return checked


def with_comb_odds(modes: Sequence[OperationalMode], turning: float) -> list[OperationalMode]:
    """Add a reason to each mode that may well be a harmonic of a rotor of unknown speed, given its odds of turning.

    Harmonics are at multiples of one frequency, which is a peak, too, and as wide as the blades make turbulence. One
    such comb is sought, any peak being as likely its first; each other multiple raises the odds of a harmonic.
    """
    combs = [_comb(modes, first) for first in modes]
    odds = [turning / len(modes) * float(np.prod(list(ratios.values()))) for ratios in combs]
    if not odds or max(odds) < limits.MIN_COMB_ODDS:
        return list(modes)
    best = int(np.argmax(odds))
    base, spread = modes[best].frequency.estimate, _comb_spread(modes[best])
    checked = []
    for mode in modes:
        order = max(round(mode.frequency.estimate / base), 1)
        own = _width_ratio(mode) if mode is modes[best] else _harmonic_ratio(mode, order, base, spread)
        of_others = odds[best] / combs[best].get(order, 1.0)
        of_harmonic = own * of_others / (1.0 + of_others)
        if order <= limits.MAX_COMB_ORDER and of_harmonic > limits.MAX_LOAD_ODDS:
            text = f"load or mode: it is {order} times {base:.4g} Hz, as other peaks are: odds of a harmonic of a rotor"
            text = f"{text} without a speed channel, {of_harmonic:.2g} : 1"
            mode = replace(mode, grounds=(*mode.grounds, Doubt("load", text)))
        checked.append(mode)
    return checked


def _comb(modes: Sequence[OperationalMode], first: OperationalMode) -> dict[int, float]:
    """Likelihood ratio of each multiple of a peak's frequency, by the likeliest peak there, against modes."""
    base, spread = first.frequency.estimate, _comb_spread(first)
    ratios = {1: _width_ratio(first)}
    for peak in modes:
        order = round(peak.frequency.estimate / base)
        if 2 <= order <= limits.MAX_COMB_ORDER:
            ratios[order] = max(ratios.get(order, 1.0), _harmonic_ratio(peak, order, base, spread))
    return ratios


def _harmonic_ratio(mode: OperationalMode, order: int, base: float, spread: float) -> float:
    """Density of the frequency and width of a peak if it is a harmonic of a frequency [Hz], over that of a mode."""
    scale = float(np.hypot(_comb_spread(mode), order * spread))
    off = (mode.frequency.estimate - order * base) / scale
    return _width_ratio(mode) * float(np.exp(-0.5 * off**2) / (np.sqrt(2.0 * np.pi) * scale)) * base


def _comb_spread(mode: OperationalMode) -> float:
    """Distance [Hz] of a peak from its multiple, as a standard deviation."""
    return float(np.hypot(mode.frequency.std, limits.COMB_SCATTER * mode.half_width))


def _width_ratio(mode: OperationalMode) -> float:
    """Density of the half-width of a peak if it is a harmonic of a rotor, over that of a mode."""
    return _density(mode, *limits.HARMONIC_DAMPING) / _structural_density(mode)


def _odds_of_width(mode: OperationalMode) -> float:
    """Odds of a load against a mode by frequency and half-width."""
    f = mode.frequency.estimate
    of_load = sum(prior * _density(mode, *width) for (prior, *width), (low, high) in limits.LOADS if low <= f <= high)
    return of_load / _structural_density(mode)


def _structural_density(mode: OperationalMode) -> float:
    return sum(share * _density(mode, *width) for share, *width in limits.STRUCTURAL_DAMPING)


def _density(mode: OperationalMode, centre: float, spread: float) -> float:
    """Density of the estimate of ln ζ under a log-normal distribution."""
    std = float(np.hypot(spread, mode.damping_ratio.relative_std))
    return float(np.exp(-0.5 * (np.log(mode.damping_ratio.estimate / centre) / std) ** 2) / std)


def shape_ratio(mode: OperationalMode, other: OperationalMode) -> tuple[float, float]:
    """Density of the MAC of two shapes if one is of a load that excites the other's mode, over that of two modes, and
    the MAC. Modes that are far apart in frequency may look alike to few sensors."""
    one, two = mode.shape, other.shape
    moving = int(np.count_nonzero(np.maximum(np.abs(one), np.abs(two)) > limits.MIN_MOTION))
    mac = float(np.abs(np.vdot(one, two)) ** 2 / (np.vdot(one, one).real * np.vdot(two, two).real))
    if moving < 2:
        return 1.0, mac
    unsure = _relative_variance(one, mode.shape_std) + _relative_variance(two, other.shape_std)
    off = max(1.0 - mac, unsure)
    scales = np.array(limits.SHAPE_DEVIATIONS) + unsure
    of_load = float(np.mean(np.exp(-off / scales) / scales))
    equal = limits.EQUAL_SHAPES[
        int(abs(np.log(mode.frequency.estimate / other.frequency.estimate)) > np.log(limits.MAX_CLOSE_RATIO))
    ]
    return of_load / ((1.0 - equal) * _random_density(1.0 - off, moving) + equal * of_load), mac


def _relative_variance(shape: Complex, std: Array) -> float:
    return float(2.0 * np.sum(std**2) / np.sum(np.abs(shape) ** 2))


def _random_density(mac: float, dimensions: int) -> float:
    """Density of the squared cosine between random directions of a space."""
    from scipy.special import beta

    a, b = 0.5, 0.5 * (dimensions - 1)
    mac = min(max(mac, 1e-6), 1.0 - 1e-6)
    return float(mac ** (a - 1.0) * (1.0 - mac) ** (b - 1.0) / beta(a, b))
