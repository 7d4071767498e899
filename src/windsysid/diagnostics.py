"""Diagnostics: is this result to be trusted, and if not, why not.

Where the model explains the record, its whitened innovations z are white noise of variance 1 (Bar-Shalom, Li & Kirubarajan 2001,
§5.4). What may be wrong is seen in three ways, each against what white noise of that length would show:

    normalised innovation squared   Σ z² over N readings is χ² with N degrees of freedom
    autocorrelation                 N Σ r_k² over L lags is χ² with L degrees of freedom (Box & Pierce 1970)
    spectrum                        by Welch's method, 1 everywhere for white noise

A long record makes any test reject, so a departure counts only if it is significant and large, and large is measured in what a
reader relies on. The score of the likelihood is a sum of innovations weighted by what they say of a coefficient, and a
coefficient of a vibration listens around its natural frequency: where the spectrum is S there, the score varies by √S more than the bands hold.
Colour out of reach of every natural frequency does little harm, as ``python -m windsysid.study.trust`` shows; it is a remark and no reason.

Estimates are held against their priors: before the record was seen, estimate and centre of the prior were expected to
differ by √(σ₀² − σ²) (the prior predictive check of Box, J. R. Statist. Soc. A 143, 1980, https://doi.org/10.2307/2982063).

Sources: Box & Pierce, J. Am. Statist. Ass. 65, 1970, https://doi.org/10.1080/01621459.1970.10481180; Welch, IEEE Trans. AU-15(2), 1967,
https://doi.org/10.1109/TAU.1967.1161901, for the degrees of freedom too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.filters import Info
from windsysid.identifiability import describe_directions
from windsysid.statespace import Parameter

__all__ = ["ChannelCheck", "CoefficientCheck", "Diagnosis", "Whiteness", "diagnose", "examine"]

Array = NDArray[np.float64]
Band = tuple[float, float, float]
"""Value, and ±2σ around it: low, high."""

CHANCE = 1e-3
"""A departure that noise alone would show in one record out of so many is no reason: for each kind of test, all channels and
frequencies together."""

PEAK = 3.0
"""Level of the spectrum from which a peak within reach of a natural frequency condemns a result: bands are √3 too narrow for what
answers there. Peaks from `NOTABLE` on are remarked."""

NOTABLE = 2.0

REACH = (0.4, 2.5)
"""How far below the lowest and above the highest natural frequency a peak still matters, as factors."""

NEAR = 1.3
"""Within this factor of a natural frequency the spectrum is averaged, and condemns a result from `LEVEL` on: bands √2 too narrow."""

LEVEL = 2.0

COLOURED = 0.02
"""Sum of squared autocorrelations from which colour is remarked: what a correlation of 0.14 from sample to sample gives."""

OFF = 1.25
"""Factor on normalised innovation squared beyond which all bands are off by more than a tenth; `CHANNEL_OFF` for one channel alone."""

CHANNEL_OFF = 2.0

FAR, FAR_OFF = 5.0, 3
"""Standard deviations beyond which an innovation is an outlier, one in two million of normal ones, and how many are remarked."""

OUTLYING = 0.1
"""Share of a channel's squared innovations that outliers may carry before the result hangs on a few readings."""

GATED = 0.05
"""Share of a channel's readings that a gate may leave out before it hides a wrong model rather than outliers."""

CONFLICT = 4.0
"""Standard deviations between estimate and prior beyond which one of the two is wrong: one in 16 000."""

SEGMENTS = 16
"""Lengths that a record is cut into for its spectrum; overlapping by half, one less than twice as many segments."""

SHORTEST = 16
"""Samples in such a segment, below which there is no spectrum."""

MOST_LAGS = 200


class ChannelCheck(NamedTuple):
    """What the innovations of one channel look like.

    Attributes
    ----------
    name
        The channel.
    used
        Readings that the filter took in.
    nis, nis_low, nis_high
        Mean square of the whitened innovations and the interval in which chance holds it (95.45 %); 1 is expected.
    offset
        Their mean, in standard deviations of one innovation.
    colour
        Sum of their squared autocorrelations, less what chance gives: half the mean square departure of the spectrum from 1 (Parseval).
    kurtosis
        Excess kurtosis; 0 is expected.
    outliers, outlying
        How many innovations are more than five of their own standard deviations off, and their share of the squares.
    missing, gated
        Shares of the samples without a reading, and with one that the filter left out as an outlier.
    peak_hz, peak
        Frequency [Hz] and level of the highest peak of the spectrum (1: their variance spread evenly) within reach of the natural frequencies; NaN for too short a record.
    far_hz, far
        The same out of reach.
    near_hz, near
        The natural frequency [Hz] around which the spectrum is highest on average, and that average.
    """

    name: str
    used: int
    nis: float
    nis_low: float
    nis_high: float
    offset: float
    colour: float
    kurtosis: float
    outliers: int
    outlying: float
    missing: float
    gated: float
    peak_hz: float
    peak: float
    far_hz: float
    far: float
    near_hz: float
    near: float


class Whiteness(NamedTuple):
    """Innovations against white noise.

    Attributes
    ----------
    used, nis, nis_low, nis_high
        Readings of all channels together, their normalised innovation squared, and the interval in which chance holds it (95.45 %).
    channels
        One `ChannelCheck` each.
    lags, autocorrelation, autocorrelation_bound
        (L,) [s], (L, m), and what 95.45 % of white noise stays inside.
    frequency, spectrum, spectrum_bound
        (F,) [Hz], (F, m), white noise being 1, and what all frequencies and channels of white noise stay below, but for one record in 1000.
    colour_bound
        What the colour of white noise stays below, but for one record in 1000.
    """

    used: int
    nis: float
    nis_low: float
    nis_high: float
    channels: tuple[ChannelCheck, ...]
    lags: Array
    autocorrelation: Array
    autocorrelation_bound: float
    frequency: Array
    spectrum: Array
    spectrum_bound: float
    colour_bound: float


class CoefficientCheck(NamedTuple):
    """An estimate against its prior: share of the information from the data, and distance from the prior's centre in the
    standard deviations that were to be expected.
    """

    name: str
    informed_by_data: float
    shift: float


@dataclass(frozen=True)
class Diagnosis:
    """What to think of a result.

    Attributes
    ----------
    reasons
        Why it should not be trusted, in sentences; empty where it may be.
    remarks
        What a reader should know though it does not condemn the result.
    whiteness
        The innovations against white noise; None where they are not expected to be white.
    coefficients
        The estimates against their priors.
    rotor_hz, blades
        1P, the mean rotor speed [Hz], and the number N of blades; 0 where nothing turns.
    reach
        Frequencies [Hz] between which an unexplained peak matters.
    """

    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    whiteness: Whiteness | None
    coefficients: tuple[CoefficientCheck, ...]
    rotor_hz: float
    blades: int
    reach: tuple[float, float]

    @property
    def trusted(self) -> bool:
        """Whether nothing speaks against the result."""
        return not self.reasons

    def __str__(self) -> str:
        return "trust: yes" if self.trusted else "trust: NO: because " + "; and because ".join(self.reasons)

    def summary(self) -> dict[str, Any]:
        """As plain values, for ``summary.json``."""
        w = self.whiteness
        innovations = None if w is None else {
            "nis": w.nis, "nis_interval": [w.nis_low, w.nis_high], "channels": {c.name: c._asdict() for c in w.channels}
        }  # fmt: skip
        return {
            "trusted": self.trusted,
            "reasons": list(self.reasons),
            "remarks": list(self.remarks),
            "innovations": innovations,
            "prior_against_data": {c.name: c._asdict() for c in self.coefficients},
        }


def diagnose(
    info: Info,
    *,
    readings: Sequence[str],
    rate: float,
    frequencies: Sequence[float],
    parameters: Sequence[Parameter],
    theta: Array,
    cov: Array,
    rotor_speed: float = 0.0,
    blades: int = 0,
    white: bool = True,
    doubts: Sequence[str] = (),
    damping: Sequence[tuple[str, Band]] = (),
) -> Diagnosis:
    """Judge a result by its innovations and its priors.

    Parameters
    ----------
    info
        What came out of the last pass over the record.
    readings
        Names of its m readings.
    rate
        Samples per second [Hz].
    frequencies
        Natural frequencies of what moves [Hz]; empty where they are not known, and every frequency matters.
    parameters, theta, cov
        The identified parameters with their priors, their estimates (n_θ,) and covariance (n_θ, n_θ), in filter coordinates.
    rotor_speed, blades
        Mean Ω [rad/s] and number of blades, to name frequencies as harmonics.
    white
        Whether the innovations are expected to be white; those of the force balance, which is band-passed, are not.
    doubts
        Why whoever made the result would not trust it.
    damping
        Of each mode, its name and its damping ratio with the ±2σ band.
    """
    rotor_hz = abs(rotor_speed) / (2.0 * math.pi)
    checks = tuple(
        _against_prior(q, float(t), float(v)) for q, t, v in zip(parameters, theta, np.diag(cov), strict=True)
    )
    reasons, remarks = list(doubts), []
    whiteness = None
    if white:
        w = whiteness = examine(info.whitened, names=readings, rate=rate, frequencies=frequencies, gated=info.gated)
        for verdict in (_judge_size(w), _judge_spectrum(w, rotor_hz), _judge_outliers(w)):
            reasons += verdict.reasons
            remarks += verdict.remarks
    for check in checks:
        if abs(check.shift) > CONFLICT:
            reasons.append(
                f"{check.name} and its prior contradict each other: they are {abs(check.shift):.1f} standard deviations apart; "
                "the turbine file, a unit or the model is wrong"
            )
    prior_cov = np.diag([q.prior[1] ** 2 for q in parameters])
    names, logarithmic = [q.name for q in parameters], [q.logarithmic for q in parameters]
    remarks += describe_directions(names, cov, prior_cov, logarithmic, theta) if names else []
    verdict = _judge_damping(_dampers(parameters, theta, cov), damping)
    reasons += verdict.reasons
    remarks += verdict.remarks
    return Diagnosis(tuple(reasons), tuple(remarks), whiteness, checks, rotor_hz, blades, _reach(frequencies))


def examine(
    whitened: Array,
    *,
    names: Sequence[str],
    rate: float,
    frequencies: Sequence[float],
    gated: NDArray[np.bool_] | None = None,
) -> Whiteness:
    """Hold whitened innovations (T, m), NaN where missing or gated, against white noise of variance 1.

    Parameters
    ----------
    names
        Of the m readings.
    rate
        [Hz].
    frequencies
        Natural frequencies [Hz], near which the spectrum matters.
    gated
        Where a reading was left out as an outlier (T, m).
    """
    gated = np.zeros(whitened.shape, dtype=np.bool_) if gated is None else gated
    rows = [_own_samples(seen) for seen in (np.isfinite(whitened) | gated).T]
    parts = {}
    for own in dict.fromkeys(rows):
        columns = [c for c, other in enumerate(rows) if other == own]
        first, step = own
        parts[tuple(columns)] = _examine_alike(
            whitened[first::step, columns],
            gated[first::step, columns],
            rate / step,
            [names[c] for c in columns],
            frequencies,
        )
    return _together(parts, len(rows))


def _own_samples(seen: NDArray[np.bool_]) -> tuple[int, int]:
    """First and step of the coarsest grid that holds all samples seen of a channel (T,)."""
    at = np.flatnonzero(seen)
    step = max(int(np.gcd.reduce(np.diff(at))), 1) if len(at) > 1 else 1
    return (int(at[0]) % step if len(at) else 0), step


def _together(parts: dict[tuple[int, ...], Whiteness], m: int) -> Whiteness:
    """The innovations of all channels, from those of channels read at the same times, by their columns."""
    if len(parts) == 1:
        return next(iter(parts.values()))
    finest = max(parts.values(), key=lambda w: len(w.frequency))
    lags = np.unique(np.concatenate([w.lags for w in parts.values()]).round(9))
    correlation, spectrum = np.full((len(lags), m), np.nan), np.full((len(finest.frequency), m), np.nan)
    channels: list[ChannelCheck | None] = [None] * m
    for columns, w in parts.items():
        where = np.ix_(np.searchsorted(lags, w.lags.round(9)), np.array(columns, dtype=np.intp))
        correlation[where] = w.autocorrelation
        inside = finest.frequency <= w.frequency[-1:].max(initial=0.0) * (1.0 + 1e-9)
        for own, column in enumerate(columns):
            channels[column] = w.channels[own]
            if len(w.frequency):
                spectrum[inside, column] = np.interp(finest.frequency[inside], w.frequency, w.spectrum[:, own])
    total = sum(w.used for w in parts.values())
    low, high = _chi_square_interval(total)
    return Whiteness(
        used=total,
        nis=sum(w.nis * w.used for w in parts.values()) / max(total, 1),
        nis_low=low,
        nis_high=high,
        channels=tuple(c for c in channels if c is not None),
        lags=lags,
        autocorrelation=correlation,
        autocorrelation_bound=max(w.autocorrelation_bound for w in parts.values()),
        frequency=finest.frequency,
        spectrum=spectrum,
        spectrum_bound=max(w.spectrum_bound for w in parts.values()),
        colour_bound=max(w.colour_bound for w in parts.values()),
    )


def _examine_alike(
    whitened: Array, gated: NDArray[np.bool_], rate: float, names: Sequence[str], frequencies: Sequence[float]
) -> Whiteness:
    """`examine` for channels that are read at the same times."""
    samples, m = whitened.shape
    reach = _reach(frequencies)
    used = np.isfinite(whitened)
    number = used.sum(axis=0)
    z = np.where(used, whitened, 0.0)
    offset = z.sum(axis=0) / np.maximum(number, 1)
    centred = np.where(used, z - offset, 0.0)
    nis = np.square(z).sum(axis=0) / np.maximum(number, 1)
    variance = np.maximum(np.square(centred).sum(axis=0) / np.maximum(number, 1), 1e-300)
    scaled = centred / np.sqrt(variance)  # size is one question, colour and spikes are others

    beyond = np.abs(scaled) > FAR

    lags = int(np.clip(rate / max(reach[0], 1e-12), 10, max(10, min(MOST_LAGS, samples // 10))))
    correlation = _autocorrelation(scaled, used, lags)
    colour = np.square(correlation).sum(axis=0) - lags / np.maximum(number, 1)
    frequency, spectrum, freedom = _spectrum(scaled, used, rate)
    reached = (frequency >= reach[0]) & (frequency <= reach[1])
    checks = []
    for c, name in enumerate(names):
        low, high = _chi_square_interval(int(number[c]))
        own = frequency <= _highest(used[:, c] | gated[:, c], rate)
        checks.append(
            ChannelCheck(
                name=name,
                used=int(number[c]),
                nis=float(nis[c]),
                nis_low=low,
                nis_high=high,
                offset=float(offset[c]),
                colour=float(colour[c]),
                kurtosis=float((scaled[:, c] ** 4).sum() / max(number[c], 1) - 3.0),
                outliers=int(beyond[:, c].sum()),
                outlying=float(np.square(scaled[beyond[:, c], c]).sum() / max(number[c], 1)),
                missing=float(1.0 - (used[:, c] | gated[:, c]).mean()),
                gated=float(gated[:, c].mean()),
                **dict(zip(("peak_hz", "peak"), _peak(frequency, spectrum[:, c], reached & own), strict=True)),
                **dict(zip(("far_hz", "far"), _peak(frequency, spectrum[:, c], ~reached & own), strict=True)),
                **dict(zip(("near_hz", "near"), _near(frequency[own], spectrum[own, c], frequencies), strict=True)),
            )
        )
    total = int(number.sum())
    low, high = _chi_square_interval(total)
    fewest = max(int(number.min(initial=total)), 1)
    return Whiteness(
        used=total,
        nis=float(np.square(z).sum() / max(total, 1)),
        nis_low=low,
        nis_high=high,
        channels=tuple(checks),
        lags=np.arange(1, lags + 1) / rate,
        autocorrelation=correlation,
        autocorrelation_bound=2.0 / math.sqrt(fewest),
        frequency=frequency,
        spectrum=spectrum,
        spectrum_bound=_exceeded(CHANCE / max(spectrum.size, 1), freedom) / freedom,
        colour_bound=(_exceeded(CHANCE / m, lags) - lags) / fewest,
    )


def _highest(seen: NDArray[np.bool_], rate: float) -> float:
    """Half the rate at which a channel (T,) is mostly read [Hz]: what its spectrum has above is a mirror image."""
    gaps = np.diff(np.flatnonzero(seen))
    return 0.5 * rate / float(np.median(gaps)) if len(gaps) else 0.5 * rate


def _autocorrelation(z: Array, used: NDArray[np.bool_], lags: int) -> Array:
    """r_1 … r_L (L, m) of z (T, m) with variance 1, from the pairs that are there."""
    rows = []
    for k in range(1, lags + 1):
        pairs = (used[k:] & used[:-k]).sum(axis=0)
        rows.append((z[k:] * z[:-k]).sum(axis=0) / np.maximum(pairs, 1))
    return np.array(rows)


def _spectrum(z: Array, used: NDArray[np.bool_], rate: float) -> tuple[Array, Array, float]:
    """Frequencies (F,), spectra (F, m) by Welch's method, 1 for white noise of variance 1, and their degrees of freedom.

    Samples that are missing are zero, and the spectrum is divided by the share of the others. The lowest two and the last
    frequency are left out: there the window mixes in the mean and the mirror image.
    """
    samples, m = z.shape
    length = samples // SEGMENTS
    if length < SHORTEST:
        return np.empty(0), np.empty((0, m)), 1.0
    window = np.hanning(length + 1)[:-1]
    starts = np.arange(0, samples - length + 1, length // 2)
    total = np.zeros((length // 2 + 1, m))
    for start in starts:
        total += np.abs(np.fft.rfft(window[:, None] * z[start : start + length], axis=0)) ** 2
    share = np.maximum(used.mean(axis=0), 1e-12)
    spectrum = total / (len(starts) * np.square(window).sum() * share)
    overlap = (window[: length - length // 2] @ window[length // 2 :] / np.square(window).sum()) ** 2
    freedom = 2.0 * len(starts) / (1.0 + 2.0 * overlap * (1.0 - 1.0 / len(starts)))
    kept = slice(2, len(total) - 1)
    return np.arange(length // 2 + 1)[kept] * (rate / length), spectrum[kept], float(freedom)


def _peak(frequency: Array, spectrum: Array, among: NDArray[np.bool_]) -> tuple[float, float]:
    """Where a spectrum (F,) is highest among some of its frequencies, by a parabola through the neighbours if it is a peak, and how high."""
    if not among.any():
        return math.nan, math.nan
    i = int(np.argmax(np.where(among, spectrum, -math.inf)))
    at = float(frequency[i])
    if 0 < i < len(spectrum) - 1 and spectrum[i] >= max(spectrum[i - 1], spectrum[i + 1]):
        left, top, right = np.log(np.maximum(spectrum[i - 1 : i + 2], 1e-300))
        bend = left - 2.0 * top + right
        if bend < 0.0:
            at += 0.5 * float((left - right) / bend) * float(frequency[i + 1] - frequency[i])
    return at, float(spectrum[i])


def _near(frequency: Array, spectrum: Array, natural: Sequence[float]) -> tuple[float, float]:
    """The natural frequency [Hz] around which a spectrum (F,) is highest on average, and that average."""
    inside = [(f, (frequency > f / NEAR) & (frequency < f * NEAR)) for f in natural]
    levels = [(float(spectrum[band].mean()), f) for f, band in inside if band.any()]
    level, at = max(levels, default=(math.nan, math.nan))
    return at, level


def _reach(frequencies: Sequence[float]) -> tuple[float, float]:
    return REACH[0] * min(frequencies, default=0.0), REACH[1] * max(frequencies, default=math.inf)


def _chi_square_interval(n: int) -> tuple[float, float]:
    """What holds χ²_n / n with 95.45 %."""
    if n < 1:
        return 0.0, math.inf
    return _exceeded(0.97725, n) / n, _exceeded(0.02275, n) / n


def _exceeded(probability: float, freedom: float) -> float:
    """The value that χ² exceeds with that probability."""
    from scipy.special import gammainccinv

    return 2.0 * float(gammainccinv(0.5 * freedom, probability))


def _against_prior(q: Parameter, theta: float, variance: float) -> CoefficientCheck:
    mean, std = q.prior
    informed = float(np.clip(1.0 - variance / std**2, 0.0, 1.0))
    return CoefficientCheck(q.name, informed, (theta - mean) / (std * math.sqrt(informed)) if informed > 0.0 else 0.0)


def _dampers(parameters: Sequence[Parameter], theta: Array, cov: Array) -> list[tuple[str, Band]]:
    """Name and band of each damping coefficient that may be negative: linear, and expected above zero."""
    found = []
    for q, t, v in zip(parameters, theta, np.diag(cov), strict=True):
        if (q.name == "c" or q.name.startswith("c_")) and not q.logarithmic and q.centre > 0.0:
            value, low, high = (float(q.physical(t + k * math.sqrt(v))) for k in (0.0, -2.0, 2.0))
            found.append((q.name, (value, low, high)))
    return found


class _Verdict(NamedTuple):
    reasons: list[str]
    remarks: list[str]


def _judge_size(w: Whiteness) -> _Verdict:
    verdict = _Verdict([], [])
    if _beyond(w.nis, w.used, OFF):
        verdict.reasons.append(
            f"the innovations are {math.sqrt(w.nis):.2g} times as large as the model expects (normalised innovation squared {w.nis:.3g} "
            f"instead of {w.nis_low:.3f} … {w.nis_high:.3f}): noise and loads were not found, and all bands are too "
            f"{'narrow' if w.nis > 1.0 else 'wide'}"
        )
    for c in w.channels:
        if not verdict.reasons and _beyond(c.nis, c.used, CHANNEL_OFF):
            verdict.reasons.append(
                f"the innovations of {c.name} are {math.sqrt(c.nis):.2g} times as large as the model expects: its noise is not that of the other "
                "sensors of its kind, or its unit or gain is wrong"
            )
        if c.missing > 0.5:
            verdict.remarks.append(f"{c.name} is missing in {100.0 * c.missing:.0f} % of the samples")
        if abs(c.offset) > max(0.1, 5.0 / math.sqrt(max(c.used, 1))):
            verdict.remarks.append(
                f"{c.name} is off by a constant that the model does not have: give its sensor a bias"
            )
    return verdict


def _beyond(nis: float, used: int, factor: float) -> bool:
    """Whether a mean square is off by more than a factor, and by more than chance."""
    if used < 1 or 1.0 / factor < nis < factor:
        return False
    return not _exceeded(1.0 - 0.5 * CHANCE, used) < nis * used < _exceeded(0.5 * CHANCE, used)


def _judge_damping(dampers: Sequence[tuple[str, Band]], modes: Sequence[tuple[str, Band]]) -> _Verdict:
    verdict = _Verdict([], [])
    lost = [f"{name} is {value:.2g}{_surely(high)}" for name, (value, _, high) in dampers if value <= 0.0]
    lost += [f"{name} has {100.0 * value:.2g} %{_surely(high)}" for name, (value, _, high) in modes if value <= 0.0]
    if lost:
        verdict.reasons.append(
            f"damping is not positive: {', '.join(lost)}; left alone such a motion grows. If it did grow (a stalled blade can), the turbine is at risk and "
            "needs a look; if it did not, loads were taken for motion: try a longer or calmer section, or another load model"
        )
    doubtful = ", ".join(name for name, (value, low, _) in (*dampers, *modes) if low <= 0.0 < value)
    if doubtful:
        verdict.remarks.append(f"damping may be zero or negative within its band: {doubtful}; a longer record tells")
    return verdict


def _surely(high: float) -> str:
    return " (negative over its whole band)" if high < 0.0 else ""


def _judge_spectrum(w: Whiteness, rotor_hz: float) -> _Verdict:
    verdict = _Verdict([], [])
    kind = "the loads are not of the modelled kind, or motion is missing from the model"
    notable = max(NOTABLE, w.spectrum_bound)
    over = sorted((c for c in w.channels if c.peak > notable), key=lambda c: -c.peak)
    loud = max(w.channels, key=lambda c: np.nan_to_num(c.near))
    if over:
        worst, others = over[0], ", ".join(c.name for c in over[1:])
        sentence = (
            f"the model does not explain {worst.name} around {_named(worst.peak_hz, rotor_hz)}: its innovations are {worst.peak:.2g} times as strong there "
            f"as the model expects{f' (and too strong in {others})' if others else ''}, and the bands of what answers at that frequency are "
            f"{math.sqrt(worst.peak):.1f} times too narrow; {kind}"
        )
        (verdict.reasons if worst.peak > PEAK else verdict.remarks).append(sentence)
    if not verdict.reasons and loud.near > max(LEVEL, w.spectrum_bound):
        verdict.reasons.append(
            f"the innovations of {loud.name} are {loud.near:.2g} times as strong as the model expects all around {_named(loud.near_hz, rotor_hz)}, "
            f"where something answers, and its bands are {math.sqrt(loud.near):.1f} times too narrow; {kind}"
        )
    far = max(w.channels, key=lambda c: np.nan_to_num(c.far))
    if far.far > max(PEAK, w.spectrum_bound):
        verdict.remarks.append(
            f"{far.name} is {far.far:.2g} times as strong as the model expects around {_named(far.far_hz, rotor_hz)}, far from every natural frequency"
        )
    worst = max(w.channels, key=lambda c: c.colour)
    if worst.colour > max(COLOURED, w.colour_bound):
        verdict.remarks.append(
            f"the innovations of {worst.name} are not white (squared autocorrelations add up to {worst.colour:.2f})"
        )
    return verdict


def _judge_outliers(w: Whiteness) -> _Verdict:
    verdict = _Verdict([], [])
    for c in w.channels:
        if c.gated > GATED:
            verdict.reasons.append(
                f"{100.0 * c.gated:.0f} % of the readings of {c.name} were left out as outliers: so many are none, and the model is wrong"
            )
        elif c.gated > 0.0:
            verdict.remarks.append(f"{100.0 * c.gated:.2g} % of the readings of {c.name} were left out as outliers")
        if c.outliers >= FAR_OFF:
            (verdict.reasons if c.outlying > OUTLYING else verdict.remarks).append(
                f"{c.outliers} readings of {c.name} are more than {FAR:g} standard deviations from what the model expects, and make up "
                f"{100.0 * c.outlying:.0f} % of its squared innovations: take the spikes out"
            )
    return verdict


def _named(frequency: float, rotor_hz: float) -> str:
    """A frequency in words: ``3.48 Hz = 3.0P``."""
    harmonic = f" = {frequency / rotor_hz:.1f}P" if rotor_hz > 0.0 and frequency / rotor_hz > 0.05 else ""
    return f"{frequency:.3g} Hz{harmonic}"
