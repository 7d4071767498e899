"""Modes of a fit of free decays: values with intervals, shapes, and reasons for doubt."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import MAX_WIDENING, NEGLIGIBLE_SHARE
from windsysid.modal.decays import limits
from windsysid.modal.decays.likelihood import Decay, DecayFit, part_scores, poles
from windsysid.modal.shape_merging import Ratios, merge_shapes
from windsysid.results.estimate import IntervalEstimate
from windsysid.spectral.modal_bands.check import shape_doubts
from windsysid.spectral.modal_bands.limits import MAX_RELIABLE_LOG_DAMPING_STD
from windsysid.spectral.modal_bands.part_scores import BandWidening, widening_of
from windsysid.spectral.oma.mode import Doubt, OperationalMode

__all__ = ["DescribedMode", "describe_modes", "driven_share", "mode_alone"]

LOCAL_HALF_WIDTHS, LOCAL_BINS = 10.0, 12
"""Setting: half-widths of a mode, and bins, within which the noise is that of the mode."""


class DescribedMode(NamedTuple):
    """Mode without a name, its number in the fit, and its shape in the channels of each record."""

    mode: OperationalMode
    number: int
    shapes: tuple[Complex, ...]


def describe_modes(
    fit: DecayFit,
    decays: Sequence[Decay],
    orders: Sequence[Sequence[int]],
    places: Sequence[NDArray[np.int64]],
    rotor_hz: float = 0.0,
) -> list[DescribedMode]:
    """Modes by rising frequency, from the derivative orders of each record's channels and their places among all, and
    the turns per second of a rotor."""
    scores, r = part_scores(fit, decays), len(fit.frequency)
    over = [widening_of(scores, i) for i in range(2 * r)]
    found = []
    for j in map(int, np.argsort(fit.frequency)):
        each = range(len(decays))
        ratios = [_ratios(fit, decays[s], s, j, np.array(orders[s]), places[s]) for s in each]
        merged = merge_shapes(ratios, 1 + max(int(place.max()) for place in places))
        local = _local_noise(fit, decays, j)
        mode = _mode(
            fit, j, (_over(over[j], local), _over(over[r + j], local)), (merged.shape, local**2 * merged.cov), local
        )
        mode = replace(mode, grounds=(*_doubts(fit, decays, j, rotor_hz), *mode.grounds))
        found.append(DescribedMode(mode, j, tuple(one.ratio for one in ratios)))
    return found


def driven_share(fit: DecayFit, found: Sequence[DescribedMode]) -> float:
    """Share of the power at the beginning in modes that do not decay clearly."""
    begun = _begun(fit)
    lasting = [one.number for one in found if one.mode.doubted_for("history", "line", "short")]
    return float(begun[lasting].sum() / max(begun.sum(), 1e-300))


def mode_alone(fit: DecayFit, j: int, shape: Complex) -> OperationalMode:
    """A mode as one record alone gives it, with a shape whose uncertainty is not given."""
    none = BandWidening()
    return _mode(fit, j, (none, none), (shape, np.zeros((2 * len(shape),) * 2)))


def _mode(
    fit: DecayFit, j: int, over: tuple[BandWidening, BandWidening], merged: tuple[Complex, Array], local: float = 1.0
) -> OperationalMode:
    """Mode j with the intervals of its local noise, wider by factors for frequency and damping ratio."""
    r = len(fit.frequency)
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    std_f, std_z = (local * float(np.sqrt(fit.cov[i, i])) * one.factor for i, one in zip((j, r + j), over, strict=True))
    shape, cov = merged[0], merged[1] * max(one.factor for one in over) ** 2
    variance, n = np.maximum(np.diagonal(cov), 0.0), len(shape)
    std = np.sqrt(0.5 * (variance[:n] + variance[n:]))
    grounds, remarks = [*shape_doubts(std)], list[Doubt]()
    for one, what in zip(over, ("frequency", "damping ratio"), strict=True):
        if one.factor > 1.0 + NEGLIGIBLE_SHARE:
            text = f"the interval of its {what} is {one.factor:.2g} times as wide as that of the model: {one.cause}"
            (grounds if one.factor > MAX_WIDENING else remarks).append(Doubt("scores", text, what))  # type: ignore[arg-type]
    half = max(10.0 * z * f, 3.0 / float(len(fit.records[0].residual)))
    return OperationalMode(
        name="", frequency=IntervalEstimate.normal(f, f * std_f, "Hz"),
        damping_ratio=IntervalEstimate.lognormal(z, std_z, "1"), shape=shape, shape_std=std, load=np.nan,
        ln_load_std=np.nan, band=(max(f - half, 0.0), f + half), grounds=tuple(grounds), shape_cov=cov,
        remarks=tuple(remarks), widening=(over[0].factor, over[1].factor),
    )  # fmt: skip


def _ratios(
    fit: DecayFit, decay: Decay, record: int, j: int, orders: NDArray[np.int64], place: NDArray[np.int64]
) -> Ratios:
    """Shape of mode j in one record, as accelerations, with its covariance."""
    projection = fit.records[record]
    r, n = projection.amplitude.shape
    back = np.linalg.inv(projection.triangle)[[j, r + j]]
    own = back @ back.T  # of one channel with unit noise
    moved = -(back @ (projection.basis.T @ _raw_slopes(fit, decay)))  # (2, 4 r)
    follow = np.einsum("ai,cik->ack", moved, projection.weights()).reshape(2 * n, 2 * r)
    cov = np.kron(own, np.diag(projection.noise)) + follow @ fit.cov @ follow.T
    scale = poles(fit.theta)[0][j] ** (2 - orders)
    a = projection.amplitude[j] * scale
    largest = int(np.argmax(np.abs(a)))
    slope = np.diag(scale / a[largest])
    slope[:, largest] -= a * scale[largest] / a[largest] ** 2
    both = np.block([[slope.real, -slope.imag], [slope.imag, slope.real]])
    return Ratios(place, a / a[largest], both @ cov @ both.T)


def _raw_slopes(fit: DecayFit, decay: Decay) -> Array:
    """(T, 4 r): Re and −Im of t λ exp(λt), and of t ∂λ/∂ln ζ exp(λt)."""
    t, (pole, slope) = decay.time[:, None], poles(fit.theta)
    waves = np.exp(pole * t)
    turned = np.hstack([waves * pole, waves * slope]) * t
    return np.stack([turned.real, -turned.imag], axis=2).reshape(len(t), -1)


def _doubts(fit: DecayFit, decays: Sequence[Decay], j: int, rotor_hz: float) -> list[Doubt]:
    """Reasons why a mode is not to be used: no decay, too short, as narrow as the line of a machine."""
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    std = float(np.sqrt(fit.cov[len(fit.frequency) + j, len(fit.frequency) + j]))
    doubts = []
    if (ratio := _decay_ratio(fit, decays, j))[0] < ratio[1]:
        doubts.append(Doubt("history", f"near {f:.4g} Hz half of the vibration does not decay: a load acts"))
    if std > MAX_RELIABLE_LOG_DAMPING_STD:
        doubts.append(Doubt("short", f"the decay is too short: damping known to a factor of {np.exp(2.0 * std):.2g}"))
    others = np.abs(fit.frequency - f) < limits.MIN_DISTANCE * z * f
    if np.any(others & (_begun(fit) > _begun(fit)[j])):
        text = "a stronger mode is within its half-width: it may be that mode's change with amplitude"
        doubts.append(Doubt("faint", text))
    if (pair := _combination(fit, j)) is not None:
        text = f"it is at the sum or difference of {pair[0]:.4g} and {pair[1]:.4g} Hz: a nonlinearity may cause it"
        doubts.append(Doubt("image", text))
    if (sideband := _sideband(fit, j, rotor_hz)) is not None:
        text = f"it is {sideband[1]:.4g} Hz from {sideband[0]:.4g} Hz and decays as that mode: the rotor may cause it"
        doubts.append(Doubt("image", text))
    if _is_line(fit, j):
        text = f"it hardly decays: a damping ratio of {100 * z:.2g} %, typical of machines, not of structures"
        doubts.append(Doubt("line", text))
    return doubts


def _is_line(fit: DecayFit, j: int) -> bool:
    """True if the whole interval of a damping ratio is below that of structures."""
    std = float(np.sqrt(fit.cov[len(fit.frequency) + j, len(fit.frequency) + j]))
    return bool(np.exp(2.0 * std) * fit.damping[j] < limits.MIN_STRUCTURE_DAMPING)


def _combination(fit: DecayFit, j: int) -> tuple[float, float] | None:
    """Frequencies [Hz] of two much stronger modes, or twice the same, whose sum or difference is that of mode j."""
    f, reach = fit.frequency, _reach(fit, j)
    for a in _much_stronger(fit, j):
        for b in _much_stronger(fit, j):
            if min(abs(f[a] + f[b] - f[j]), abs(f[a] - f[b] - f[j])) < reach:
                return float(f[a]), float(f[b])
    return None


def _sideband(fit: DecayFit, j: int, rotor_hz: float) -> tuple[float, float] | None:
    """Frequency [Hz] of a much stronger mode that decays as mode j, and that of a harmonic of the rotor, or of a line,
    by which they differ: coefficients that are periodic modulate a mode."""
    f, rate, r = fit.frequency, fit.frequency * fit.damping, len(fit.frequency)
    reach = limits.COMBINATION_SIGMAS * float(np.sqrt(fit.cov[r + j, r + j])) + limits.MAX_DECAY_DIFFERENCE
    for a in _much_stronger(fit, j):
        if abs(np.log(rate[j] / rate[a])) < reach:
            for shift in _periodic(fit, j, rotor_hz):
                if min(abs(abs(f[a] + sign * shift) - f[j]) for sign in (-1.0, 1.0)) < _reach(fit, j):
                    return float(f[a]), shift
    return None


def _periodic(fit: DecayFit, j: int, rotor_hz: float) -> list[float]:
    """Frequencies [Hz] with which coefficients may vary: harmonics of the rotor, and lines other than mode j."""
    harmonics = [n * rotor_hz for n in range(1, limits.MAX_SIDEBAND_ORDER + 1)] if rotor_hz else []
    lines = [i for i in range(len(fit.frequency)) if i != j and _is_line(fit, i)]
    return [*harmonics, *fit.frequency[lines].tolist()]


def _much_stronger(fit: DecayFit, j: int) -> list[int]:
    begun = _begun(fit)
    return [i for i in range(len(begun)) if begun[i] > begun[j] / NEGLIGIBLE_SHARE**2]


def _reach(fit: DecayFit, j: int) -> float:
    """Distance [Hz] from a combination up to which mode j may be one."""
    relative = limits.COMBINATION_SIGMAS * np.sqrt(fit.cov[j, j]) + limits.COMBINATION_DISTANCE
    return float(fit.frequency[j] * relative)


def _over(widening: BandWidening, local: float) -> BandWidening:
    """Part of a widening that the local noise does not explain."""
    return widening._replace(factor=max(1.0, widening.factor / local))


def _local_noise(fit: DecayFit, decays: Sequence[Decay], j: int) -> float:
    """Amplitude of the residual near a mode over that of white noise of the same variance, not below 1."""
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    level = weight = 0.0
    for one, decay in zip(fit.records, decays, strict=True):
        samples = len(one.residual)
        step = decay.rate / samples
        power = np.abs(np.fft.rfft(one.residual, axis=0)) ** 2 / (one.noise * samples)
        near = np.abs(np.arange(len(power)) * step - f) <= max(LOCAL_HALF_WIDTHS * z * f, LOCAL_BINS * step)
        inside = np.abs(fit.frequency - f) <= max(LOCAL_HALF_WIDTHS * z * f, LOCAL_BINS * step)
        own = np.abs(one.amplitude[j]) ** 2 / one.noise
        bins = max(int(np.count_nonzero(near)) - 2 * int(np.count_nonzero(inside)), 4)
        level += float(own @ power[near].sum(axis=0)) / bins
        weight += float(own.sum())
    return float(np.sqrt(max(level / weight, 1.0)))


def _begun(fit: DecayFit) -> Array:
    """Power (r,) of each mode at the beginning, over the noise, summed over channels and records."""
    each = [np.sum(0.5 * np.abs(one.amplitude) ** 2 / one.noise, axis=1) for one in fit.records]
    return np.asarray(np.sum(each, axis=0))


def _decay_ratio(fit: DecayFit, decays: Sequence[Decay], j: int) -> tuple[float, float]:
    """Power of a mode at the beginning over that of the residual near its frequency, and the ratio that ambient
    vibration exceeds by chance at one of its N instants: N (1 + x/(N − 1))^(1 − N) = p."""
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    begun, lasting, count = float(_begun(fit)[j]), 0.0, 0.0
    for one, decay in zip(fit.records, decays, strict=True):
        samples = len(one.residual)
        step, half = decay.rate / samples, max(2.0 * z * f, 2.0 * decay.rate / samples)
        power = np.abs(np.fft.rfft(one.residual, axis=0)) ** 2 / one.noise
        near = np.abs(np.arange(len(power)) * step - f) <= half
        lasting += 2.0 * float(np.sum(power[near])) / samples**2
        count += max(2.0 * np.pi * z * f * samples / decay.rate, 2.0)
    count = max(count, 2.0)
    bound = (count - 1.0) * ((count / limits.AMBIENT_PROBABILITY) ** (1.0 / (count - 1.0)) - 1.0)
    return begun / max(lasting, 1e-300), bound
