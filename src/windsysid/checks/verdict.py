"""Diagnostics: is this result to be trusted, and if not, why not.

Where the model explains the record, its whitened innovations z are white noise of variance 1 (Bar-Shalom, Li &
Kirubarajan 2001, §5.4). Each test is against what white noise of that length would show:

    normalised innovation squared   Σ z² over N readings is χ² with N degrees of freedom
    autocorrelation                 N Σ r_k² over L lags is χ² with L degrees of freedom (Box & Pierce 1970)
    spectrum                        by Welch's method, 1 everywhere for white noise
    line                            a point of the whole record's periodogram over the mean of its surroundings

A long record makes any test reject, so a departure counts only if it is significant and large, and large is measured in
what a reader relies on. The score of the likelihood is a sum of innovations weighted by what they say of a coefficient,
and a coefficient of a vibration listens around its natural frequency: where the spectrum is S there, the score varies
by √S more than the bands hold. Colour out of reach of every natural frequency does little harm; it is a remark and no
reason.

Limits of chance are such that each of some ten tests condemns one healthy record in 500; ``python -m
validation.adversary.calibrate`` prints every limit beside what healthy records show. Limits of size say what does harm.

Sources: Box & Pierce, J. Am. Statist. Ass. 65, 1970, https://doi.org/10.1080/01621459.1970.10481180; Welch, IEEE Trans.
AU-15(2), 1967, https://doi.org/10.1109/TAU.1967.1161901, for the degrees of freedom too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.constancy import Constancy, doubt_halves, doubt_scatter
from windsysid.checks.estimates import Band, CoefficientCheck, doubt_damping, doubt_priors, hold_against_priors
from windsysid.checks.identifiability import describe_directions
from windsysid.checks.innovation_sums import MIN_REMARKED_OUTLIERS, OUTLIER_SIGMAS, band_of_interest
from windsysid.checks.lines import Line
from windsysid.checks.nonlinearity import Bent, doubt_bending, doubt_bent
from windsysid.checks.stationarity import Late
from windsysid.checks.whiteness import FALSE_ALARM_CHANCE, ChannelCheck, Whiteness, chance_limit, examine
from windsysid.filters import Info
from windsysid.results.smoothed_loads import SmoothedLoads, doubt_correlated
from windsysid.statespace.parameter import Parameter

__all__ = ["Diagnosis", "diagnose", "found_line"]

PEAK_MAX_LEVEL = 2.0
"""Level of the spectrum from which a peak within reach of a natural frequency condemns a result, where it is beyond its
bound, too: bands are √2 too narrow for what answers there. One healthy record in 500 has 2.1."""

PLAIN_PEAK_LEVEL = 4.0
"""Level from which a peak tells more than what channels share because of it."""

FAR_REMARK_LEVEL = 3.0
"""Level from which a peak out of reach is remarked."""

NEAR_MAX_LEVEL = 1.6
"""The same of the average around a natural frequency, which one healthy record in 500 has."""

COLOUR_REMARK_LEVEL = 0.02
"""Least sum of squared autocorrelations that is remarked as colour: a correlation of 0.14 between samples."""

SIZE_MAX_FACTOR, CHANNEL_MAX_FACTOR = 1.1, 1.15
"""Greatest factor on normalised innovation squared, of all channels together and of one. Levels of loads and noise are
learned: healthy records scatter by 0.02, and one in 500 is 1.06 off in all and 1.14 in one channel."""

MAX_SIGMAS = 4.5
"""Standard deviations of chance beyond which level, tails, lateness and what channels share count, all but lateness
where they are large, too. One healthy record in 500 exceeds 4.2, 3.9, 4.2 and 4.5 of them."""

UNSTEADY_MAX, TAILS_MAX, SHARED_MAX = 0.25, 1.0, 0.06
"""What is large: variation of the level over the record, excess kurtosis, correlation of two channels."""

OUTLIER_MAX_SHARE = 0.1
"""Share of a channel's squared innovations that outliers may carry before the result hangs on a few readings."""

GATED_MAX_SHARE = 0.05
"""Share of a channel's readings that a gate may leave out before it hides a wrong model rather than outliers."""


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
    line
        The channel and frequency [Hz] of a line beside a mode that is a reason; None where none is.
    """

    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    whiteness: Whiteness | None
    coefficients: tuple[CoefficientCheck, ...]
    rotor_hz: float
    blades: int
    reach: tuple[float, float]
    line: tuple[str, float] | None = None

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
    whiteness: Whiteness | None = None,
    doubts: Sequence[str] = (),
    damping: Sequence[tuple[str, Band]] = (),
    line: Line | None = None,
    late: Late | None = None,
    bent: Bent | None = None,
    smoothed_loads: SmoothedLoads | None = None,
    constancy: Constancy | None = None,
    blades_move: bool = False,
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
        The identified parameters with their priors, their estimates (n_θ,) and covariance (n_θ, n_θ), in filter
        coordinates.
    rotor_speed, blades
        Mean Ω [rad/s] and number of blades, to name frequencies as harmonics.
    white
        Whether the innovations are expected to be white; those of the force balance, which is band-passed, are not.
    whiteness
        The innovations against white noise, where they were examined already; those of `info` are by default.
    doubts
        Why whoever made the result would not trust it.
    damping
        Of each mode, its name and its damping ratio with the ±2σ band.
    line
        What stands out most of the readings beside a mode, where that was looked for.
    late, bent, smoothed_loads
        How late the blades seem to be, what shows most that a spring or damper is no straight line, and what smoothed
        loads say, where that was looked for.
    constancy
        What parts of the record say of the parameters, where they were asked.
    blades_move
        Whether blades are degrees of freedom. Only for them was it measured what a level of the innovations that goes
        with frequency does to estimates; elsewhere it is a remark.
    """
    rotor_hz = abs(rotor_speed) / (2.0 * math.pi)
    checks = hold_against_priors(parameters, theta, cov)
    names, logarithmic = [q.name for q in parameters], [q.logarithmic for q in parameters]
    reasons, remarks, seen = list(doubts), [], found_line(None, line)
    changed = doubt_halves(names, constancy)
    if white and whiteness is None:
        whiteness = examine(info.whitened, names=readings, rate=rate, frequencies=frequencies, gated=info.gated)
    if whiteness is not None:
        seen = found_line(whiteness, line)
        common, spectrum = _judge_shared(whiteness), _judge_spectrum(whiteness, rotor_hz, blades_move)
        bending, together = smoothed_loads or (None, None)
        loud = max(np.nan_to_num(c.peak) for c in whiteness.channels) > PLAIN_PEAK_LEVEL
        for verdict in (  # the most telling first
            _judge_steadiness(whiteness), _judge_line(seen, rotor_hz), _Verdict(changed, []),
            *((spectrum, common) if loud else (common,)), _judge_size(whiteness), _judge_lateness(late),
            _Verdict([*doubt_correlated(together), *doubt_bent(bent), *doubt_bending(bending)], []),
            *(() if loud else (spectrum,)), _judge_outliers(whiteness),
        ):  # fmt: skip
            reasons += verdict.reasons
            remarks += verdict.remarks
    else:
        reasons += _judge_line(seen, rotor_hz).reasons
    reasons += [*(changed if whiteness is None else ()), *doubt_scatter(names, constancy), *doubt_priors(checks)]
    prior_cov = np.diag([q.prior[1] ** 2 for q in parameters])
    remarks += describe_directions(names, cov, prior_cov, logarithmic, theta) if names else []
    doubts_of_damping, remarks_of_damping = doubt_damping(parameters, theta, cov, damping)
    reasons += doubts_of_damping
    remarks += remarks_of_damping
    return Diagnosis(
        tuple(reasons), tuple(remarks), whiteness, checks, rotor_hz, blades, band_of_interest(frequencies), seen
    )


class _Verdict(NamedTuple):
    reasons: list[str]
    remarks: list[str]


def _judge_size(w: Whiteness) -> _Verdict:
    verdict = _Verdict([], [])
    worst = max(w.channels, key=lambda c: abs(math.log(max(c.nis, 1e-9))) if c.used else 0.0)
    rest = w.used - worst.used
    others = (w.nis * w.used - worst.nis * worst.used) / rest if rest > 0 else math.inf
    if (
        rest > 0
        and _is_size_off(worst.nis, worst.used, CHANNEL_MAX_FACTOR)
        and not _is_size_off(others, rest, SIZE_MAX_FACTOR)
    ):
        verdict.reasons.append(
            f"the innovations of {worst.name} are {math.sqrt(worst.nis):.3g} times as large as the model expects:"
            " likely an instrument (its noise, unit or gain); check it or leave it out"
        )
    elif _is_size_off(w.nis, w.used, SIZE_MAX_FACTOR):
        verdict.reasons.append(
            f"the innovations are {math.sqrt(w.nis):.2g} times as large as the model expects (mean square {w.nis:.3g},"
            f" expected {w.nis_low:.3f} … {w.nis_high:.3f}): all bands are too {'narrow' if w.nis > 1.0 else 'wide'}"
        )
    for c in w.channels:
        if c.missing > 0.5:
            verdict.remarks.append(f"{c.name} is missing in {100.0 * c.missing:.0f} % of the samples")
        if abs(c.offset) > max(0.1, 5.0 / math.sqrt(max(c.used, 1))):
            verdict.remarks.append(
                f"{c.name} is off by a constant that the model does not have: give its sensor a bias"
            )
    return verdict


def _is_size_off(nis: float, used: int, factor: float) -> bool:
    """Whether a mean square is off by more than a factor, and by more than chance."""
    if used < 1 or 1.0 / factor < nis < factor:
        return False
    return (
        not chance_limit(1.0 - 0.5 * FALSE_ALARM_CHANCE, used)
        < nis * used
        < chance_limit(0.5 * FALSE_ALARM_CHANCE, used)
    )


def _judge_spectrum(w: Whiteness, rotor_hz: float, blades_move: bool) -> _Verdict:
    verdict = _Verdict([], [])
    over = sorted((c for c in w.channels if c.peak > max(PEAK_MAX_LEVEL, w.spectrum_bound)), key=lambda c: -c.peak)
    loud = max(w.channels, key=lambda c: np.nan_to_num(c.near))
    if over:
        worst, others = over[0], ", ".join(c.name for c in over[1:])
        verdict.reasons.append(
            f"the model does not explain {worst.name} around {_name_frequency(worst.peak_hz, rotor_hz)}: its"
            f" innovations are {worst.peak:.2g} times too strong{f' (also {others})' if others else ''}; {LIKELY_LOADS}"
        )
    elif loud.near > max(NEAR_MAX_LEVEL, w.spectrum_bound):
        verdict.reasons.append(
            f"the innovations of {loud.name} are {loud.near:.2g} times as strong as the model expects all around"
            f" {_name_frequency(loud.near_hz, rotor_hz)}; {LIKELY_LOADS}"
        )
    far = max(w.channels, key=lambda c: np.nan_to_num(c.far))
    if far.far > max(FAR_REMARK_LEVEL, w.spectrum_bound):
        verdict.remarks.append(
            f"{far.name} is {far.far:.2g} times as strong as the model expects around"
            f" {_name_frequency(far.far_hz, rotor_hz)}, far from every natural frequency"
        )
    worst = max(w.channels, key=lambda c: c.colour)
    if worst.colour > max(COLOUR_REMARK_LEVEL, w.colour_bound):
        verdict.remarks.append(
            f"the innovations of {worst.name} are not white (squared autocorrelations add up to {worst.colour:.2f})"
        )
    smooth = w.smooth
    if not verdict.reasons and smooth is not None and smooth.ratio > 1.0:
        low, high = (_name_frequency(f, rotor_hz) for f in (smooth.low_hz, smooth.high_hz))
        (verdict.reasons if blades_move else verdict.remarks).append(
            f"the level of the innovations goes from {smooth.low:.2f} around {low} to {smooth.high:.2f} around {high};"
            f" {LIKELY_LOADS}"
        )
    return verdict


LIKELY_LOADS = "likely loads of another kind: try another load model or section"


def found_line(w: Whiteness | None, line: Line | None) -> tuple[str, float] | None:
    """The channel and frequency of the line that counts, of those of readings and of innovations."""
    if line is not None and line.ratio > line.bound:
        return line.channel, line.frequency
    worst = max(w.channels, key=lambda c: c.line) if w is not None else None
    return (worst.name, worst.line_hz) if w is not None and worst is not None and worst.line > w.line_bound else None


def _judge_line(found: tuple[str, float] | None, rotor_hz: float) -> _Verdict:
    if found is None:
        return _Verdict([], [])
    at = _name_frequency(found[1], rotor_hz)
    likely = "likely a machine or waves; choose a section without it"
    return _Verdict([f"{found[0]} has a line at {at}, beside a natural frequency: {likely}"], [])


def _judge_lateness(late: Late | None) -> _Verdict:
    if late is None or late.sigmas <= MAX_SIGMAS:
        return _Verdict([], [])
    seem = (
        f"blades seem {'later' if late.lag > 0 else 'earlier'} than the tower ({late.sigmas:.1f} standard deviations)"
    )
    return _Verdict([f"{seem}: likely an instrument (a late logger, a wrong azimuth); align the clocks"], [])


def _judge_steadiness(w: Whiteness) -> _Verdict:
    verdict = _Verdict([], [])
    judged = [channel for channel in w.channels if not _is_ruled_from_afar(channel, w)]
    if not judged:
        return verdict
    swelling = sorted(judged, key=lambda c: -c.unsteady_sigmas)
    first = swelling[0]
    if first.unsteady_sigmas > MAX_SIGMAS:
        alone = len(swelling) > 1 and swelling[1].unsteady < 0.5 * first.unsteady
        cause = "an instrument (dead, stuck or cut off for a while)" if alone else "loads that swell and fade"
        (verdict.reasons if first.unsteady > UNSTEADY_MAX else verdict.remarks).append(
            f"the level of the innovations of {first.name} varies by {100.0 * first.unsteady:.0f} % over the record:"
            f" likely {cause}; choose a steadier section"
        )
    tailed = max(judged, key=lambda c: c.tails_sigmas)
    if tailed.tails_sigmas > MAX_SIGMAS:
        (verdict.reasons if tailed.tails > TAILS_MAX else verdict.remarks).append(
            f"the innovations of {tailed.name} have tails (excess kurtosis {tailed.tails:.1f}): likely impacts, or an"
            " instrument that spikes; look at its largest readings"
        )
        if tailed.tails_sigmas > first.unsteady_sigmas:
            verdict.reasons.reverse()
    return verdict


def _is_ruled_from_afar(channel: ChannelCheck, w: Whiteness) -> bool:
    """Whether frequencies that no mode of the model answers to make most of a channel's innovations: what they do over
    time is not the modes'."""
    return channel.far > max(FAR_REMARK_LEVEL, w.spectrum_bound)


def _judge_shared(w: Whiteness) -> _Verdict:
    shared = w.shared
    if shared is None or shared.sigmas < MAX_SIGMAS or abs(shared.correlation) < SHARED_MAX:
        return _Verdict([], [])
    first, second = w.channels[shared.first], w.channels[shared.second]
    sentence = (
        f"what is not explained of {first.name} and {second.name} is correlated ({shared.correlation:.2f}): likely"
        " loads on both at once, a sensor off its axis or a late logger"
    )
    from_afar = _is_ruled_from_afar(first, w) or _is_ruled_from_afar(second, w)
    return _Verdict([], [sentence]) if from_afar else _Verdict([sentence], [])


def _judge_outliers(w: Whiteness) -> _Verdict:
    verdict = _Verdict([], [])
    for c in w.channels:
        if c.gated > GATED_MAX_SHARE:
            share = f"{100.0 * c.gated:.0f} % of the readings of {c.name}"
            verdict.reasons.append(f"{share} were left out as outliers: so many are none, and the model is wrong")
        elif c.gated > 0.0:
            verdict.remarks.append(f"{100.0 * c.gated:.2g} % of the readings of {c.name} were left out as outliers")
        if c.outliers >= MIN_REMARKED_OUTLIERS:
            (verdict.reasons if c.outlying > OUTLIER_MAX_SHARE else verdict.remarks).append(
                f"{c.outliers} readings of {c.name} are more than {OUTLIER_SIGMAS:g} standard deviations off and make"
                f" up {100.0 * c.outlying:.0f} % of its squared innovations: take the spikes out"
            )
    return verdict


def _name_frequency(frequency: float, rotor_hz: float) -> str:
    """A frequency in words: ``3.48 Hz = 3.0P``."""
    harmonic = f" = {frequency / rotor_hz:.1f}P" if rotor_hz > 0.0 and frequency / rotor_hz > 0.05 else ""
    return f"{frequency:.3g} Hz{harmonic}"
