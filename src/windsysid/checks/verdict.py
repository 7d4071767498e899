"""Diagnostics: is this result to be trusted, and if not, why not.

Where the model explains the record, its whitened innovations z are white noise of variance 1 (Bar-Shalom, Li &
Kirubarajan 2001, §5.4). Each test is against what white noise of that length would show:

    normalised innovation squared   Σ z² over N readings is χ² with N degrees of freedom
    autocorrelation                 N Σ r_k² over L lags is χ² with L degrees of freedom (Box & Pierce 1970)
    spectrum                        by Welch's method, 1 everywhere for white noise
    line                            a point of the whole record's periodogram over the mean of its surroundings

A long record makes any test reject, so a departure counts only if it is significant and large, and large is measured in
what a reader relies on. The score of the likelihood is a sum of innovations weighted by their sensitivity to a
coefficient, and a coefficient of a vibration listens around its natural frequency: where the spectrum is S there, the
score varies by √S more than the intervals hold. Colour out of reach of every natural frequency does little harm; it is
a remark and no reason.

Limits of chance are such that each of some ten tests condemns one healthy record in 500; ``python -m
validation.adversary.calibrate`` prints every limit with values of healthy records. Limits of size follow from the harm.

Sources: Box & Pierce, J. Am. Statist. Ass. 65, 1970, https://doi.org/10.1080/01621459.1970.10481180; Welch, IEEE Trans.
AU-15(2), 1967, https://doi.org/10.1109/TAU.1967.1161901, for the degrees of freedom too.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.estimates import Band, CoefficientCheck, doubt_damping, doubt_priors, hold_against_priors
from windsysid.checks.identifiability import describe_directions
from windsysid.checks.innovation_sums import band_of_interest
from windsysid.checks.limits import (
    FALSE_ALARM_PROBABILITY,
    MAX_CHANCE_SIGMAS,
    MAX_COLOUR,
    MAX_FAR_PEAK_LEVEL,
    MAX_KURTOSIS,
    MAX_LEVEL_VARIATION,
    MAX_MISSING_SHARE,
    MAX_NEAR_MODE_LEVEL,
    MAX_PEAK_LEVEL,
    NEGLIGIBLE_SHARE,
    OUTLIER_SIGMAS,
)
from windsysid.checks.lines import Line
from windsysid.checks.nonlinearity import Bent, doubt_bending, doubt_bent
from windsysid.checks.stationarity import Late
from windsysid.checks.whiteness import ChannelCheck, Whiteness, chance_limit
from windsysid.results.finding import Finding, Severity
from windsysid.results.smoothed_loads import SmoothedLoads, doubt_correlated
from windsysid.statespace.parameter import Parameter

__all__ = ["Diagnosis", "FittedParameters", "RecordTests", "TurningRotor", "diagnose", "found_line"]


@dataclass(frozen=True)
class Diagnosis:
    """Verdict on a result.

    Attributes
    ----------
    findings
        What a reader must know: reasons not to trust it, the most telling first, remarks, and notes.
    whiteness
        The innovations against white noise; None where they are not expected to be white.
    coefficients
        The estimates against their priors.
    rotor_hz, blades
        1P, the mean rotor speed [Hz], and the number N of blades; 0 where nothing turns.
    reach
        Frequencies [Hz] between which an unexplained peak matters.
    line
        The channel and frequency [Hz] of a line near a mode that is a reason; None where none is.
    """

    findings: tuple[Finding, ...]
    whiteness: Whiteness | None
    coefficients: tuple[CoefficientCheck, ...]
    rotor_hz: float
    blades: int
    reach: tuple[float, float]
    line: tuple[str, float] | None = None

    @property
    def trusted(self) -> bool:
        """True if no finding speaks against the result."""
        return not any(finding.severity == "reason" for finding in self.findings)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it should not be trusted, in sentences; empty where it may be."""
        return self.sentences("reason")

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes and remarks that do not condemn the result, in sentences."""
        return self.sentences("remark")

    def sentences(self, severity: Severity) -> tuple[str, ...]:
        """The sentences of all findings of one severity."""
        return tuple(str(finding) for finding in self.findings if finding.severity == severity)

    def __str__(self) -> str:
        return "trust: yes" if self.trusted else "trust: NO, because " + "; and because ".join(self.reasons)

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


class FittedParameters(NamedTuple):
    """The identified parameters with their priors, their estimates (n_θ,) and covariance (n_θ, n_θ) in filter
    coordinates; of each mode its name and its damping ratio with the 95 % interval; units of parameters by name."""

    parameters: Sequence[Parameter]
    theta: Array
    cov: Array
    damping: Sequence[tuple[str, Band]] = ()
    units: Mapping[str, str] = {}


class TurningRotor(NamedTuple):
    """Mean speed [rad/s] and number of blades, to name frequencies as harmonics; and whether blades are degrees of
    freedom: only for them was it measured what a level of the innovations that goes with frequency does to estimates;
    otherwise it is a remark."""

    speed: float = 0.0
    blades: int = 0
    blades_move: bool = False


class RecordTests(NamedTuple):
    """Statistics of a record apart from the whiteness of its innovations, each None where it was not computed.

    Attributes
    ----------
    line
        What stands out most of the readings near a mode.
    late, bent, smoothed_loads
        How late the blades seem to be, what shows most that a spring or damper is no straight line, and what smoothed
        loads say.
    """

    line: Line | None = None
    late: Late | None = None
    bent: Bent | None = None
    smoothed_loads: SmoothedLoads | None = None


def diagnose(
    whiteness: Whiteness | None, fitted: FittedParameters, *, frequencies: Sequence[float],
    rotor: TurningRotor | None = None, tests: RecordTests | None = None, findings: Sequence[Finding] = (),
) -> Diagnosis:  # fmt: skip
    """Judge a result by its innovations and its priors.

    Parameters
    ----------
    whiteness
        The innovations against white noise; None where they are not expected to be white, as those of the force
        balance, which is band-passed.
    frequencies
        Natural frequencies of what moves [Hz]; empty where they are not known, and every frequency matters.
    rotor, tests
        Nothing turns, and nothing was tested, by default.
    findings
        What the estimation found out about its own result.
    """
    rotor, tests = rotor or TurningRotor(), tests or RecordTests()
    parameters, theta, cov, damping, units = fitted
    rotor_hz = abs(rotor.speed) / (2.0 * math.pi)
    checks = hold_against_priors(parameters, theta, cov)
    names, logarithmic = [q.name for q in parameters], [q.logarithmic for q in parameters]
    seen = found_line(whiteness, tests.line)
    of_readings = tests.line is not None and tests.line.ratio > tests.line.bound
    line, found = _judge_line(seen, rotor_hz, of_innovations=not of_readings), [*findings]
    found += line if whiteness is None else _judge_innovations(whiteness, tests, rotor, line)
    doubts = doubt_priors(checks)
    at = len(found) * (not _is_another_machine(doubts, parameters))
    found[at:at] = doubts
    prior_cov = np.diag([q.prior[1] ** 2 for q in parameters])
    found += describe_directions(names, cov, prior_cov, logarithmic, theta) if names else []
    found += doubt_damping(parameters, theta, cov, damping, units)
    return Diagnosis(tuple(found), whiteness, checks, rotor_hz, rotor.blades, band_of_interest(frequencies), seen)


def _is_another_machine(doubts: Sequence[Finding], parameters: Sequence[Parameter]) -> bool:
    """Test whether every stiffness contradicts its prior."""
    stiffnesses = {q.name for q in parameters if q.kind == "stiffness"}
    return bool(stiffnesses) and stiffnesses <= {name for one in doubts for name in one.quantities}


def _judge_innovations(w: Whiteness, tests: RecordTests, rotor: TurningRotor, line: list[Finding]) -> list[Finding]:
    """Findings of innovations and of a line, the most telling first."""
    spectrum = _judge_spectrum(w, abs(rotor.speed) / (2.0 * math.pi), rotor.blades_move)
    bending, together = tests.smoothed_loads or (None, None)
    loud = max(np.nan_to_num(c.peak) for c in w.channels) > MAX_FAR_PEAK_LEVEL
    return [
        *_judge_steadiness(w), *line, *(spectrum if loud else ()), *_judge_shared(w), *_judge_size(w),
        *_judge_lateness(tests.late), *doubt_correlated(together), *doubt_bent(tests.bent), *doubt_bending(bending),
        *(() if loud else spectrum), *_judge_outliers(w),
    ]  # fmt: skip


def _graded(code: str, data: Mapping[str, Any], *, large: bool) -> Finding:
    """A departure that is a reason where it is large, else a remark."""
    return Finding(code, "reason" if large else "remark", data)


def _judge_size(w: Whiteness) -> list[Finding]:
    found = list[Finding]()
    worst = max(w.channels, key=lambda c: abs(math.log(max(c.nis, 1e-9))) if c.used else 0.0)
    rest = w.used - worst.used
    others = (w.nis * w.used - worst.nis * worst.used) / rest if rest > 0 else math.inf
    if rest > 0 and _is_size_off(worst.nis, worst.used) and not _is_size_off(others, rest):
        found.append(Finding("channel_level", "reason", {"channel": worst.name, "ratio": math.sqrt(worst.nis)}))
    elif _is_size_off(w.nis, w.used):
        data = {"ratio": math.sqrt(w.nis), "mean_square": w.nis, "low": w.nis_low, "high": w.nis_high}
        found.append(Finding("innovation_level", "reason", data))
    for c in w.channels:
        if c.missing > 0.5:
            found.append(Finding("missing_samples", "remark", {"channel": c.name, "share": c.missing}))
        if abs(c.offset) > max(0.1, 5.0 / math.sqrt(max(c.used, 1))):
            found.append(Finding("constant_offset", "remark", {"channel": c.name, "sigmas": c.offset}))
    return found


def _is_size_off(nis: float, used: int) -> bool:
    """Test whether a mean square differs from 1 by more than is negligible for intervals, and by more than chance."""
    if used < 1 or abs(math.log(max(nis, 1e-300))) < 2.0 * math.log1p(NEGLIGIBLE_SHARE):
        return False
    return (
        not chance_limit(1.0 - 0.5 * FALSE_ALARM_PROBABILITY, used)
        < nis * used
        < chance_limit(0.5 * FALSE_ALARM_PROBABILITY, used)
    )


def _judge_spectrum(w: Whiteness, rotor_hz: float, blades_move: bool) -> list[Finding]:
    found = [*_judge_peak(w, rotor_hz), *_judge_colour(w, rotor_hz)]
    smooth = w.smooth
    if smooth is None or smooth.ratio <= 1.0 or any(one.severity == "reason" for one in found):
        return found
    data = {
        "low": smooth.low, "low_frequency": smooth.low_hz, "high": smooth.high, "high_frequency": smooth.high_hz,
        "rotor_frequency": rotor_hz,
    }  # fmt: skip
    return [*found, _graded("level_over_frequency", data, large=blades_move)]


def _judge_peak(w: Whiteness, rotor_hz: float) -> list[Finding]:
    over = sorted((c for c in w.channels if c.peak > max(MAX_PEAK_LEVEL, w.spectrum_bound)), key=lambda c: -c.peak)
    loud = max(w.channels, key=lambda c: np.nan_to_num(c.near))
    if over:
        where = {"channels": [c.name for c in over], "frequency": over[0].peak_hz, "rotor_frequency": rotor_hz}
        return [Finding("unexplained_peak", "reason", where | {"level": over[0].peak})]
    if loud.near > max(MAX_NEAR_MODE_LEVEL, w.spectrum_bound):
        where = {"channel": loud.name, "frequency": loud.near_hz, "rotor_frequency": rotor_hz}
        return [Finding("unexplained_level", "reason", where | {"level": loud.near})]
    return []


def _judge_colour(w: Whiteness, rotor_hz: float) -> list[Finding]:
    found = list[Finding]()
    far = max(w.channels, key=lambda c: np.nan_to_num(c.far))
    if far.far > max(MAX_FAR_PEAK_LEVEL, w.spectrum_bound):
        where = {"channel": far.name, "frequency": far.far_hz, "rotor_frequency": rotor_hz}
        found.append(Finding("far_peak", "remark", where | {"level": far.far}))
    worst = max(w.channels, key=lambda c: c.colour)
    if worst.colour > max(NEGLIGIBLE_SHARE**2, w.colour_bound):
        found.append(Finding("coloured_innovations", "remark", {"channel": worst.name, "colour": worst.colour}))
    return found


def found_line(w: Whiteness | None, line: Line | None) -> tuple[str, float] | None:
    """The channel and frequency of the line that counts, of those of readings and of innovations."""
    if line is not None and line.ratio > line.bound:
        return line.channel, line.frequency
    worst = max(w.channels, key=lambda c: c.line) if w is not None else None
    return (worst.name, worst.line_hz) if w is not None and worst is not None and worst.line > w.line_bound else None


def _judge_line(found: tuple[str, float] | None, rotor_hz: float, *, of_innovations: bool) -> list[Finding]:
    if found is None:
        return []
    data = {"channel": found[0], "frequency": found[1], "rotor_frequency": rotor_hz, "innovations": of_innovations}
    return [Finding("spectral_line", "reason", data)]


def _judge_lateness(late: Late | None) -> list[Finding]:
    if late is None or late.sigmas <= MAX_CHANCE_SIGMAS:
        return []
    return [Finding("late_blades", "reason", {"lag": late.lag, "sigmas": late.sigmas})]


def _judge_steadiness(w: Whiteness) -> list[Finding]:
    found = list[Finding]()
    judged = [channel for channel in w.channels if not _is_ruled_from_afar(channel, w)]
    if not judged:
        return found
    swelling = sorted(judged, key=lambda c: -c.unsteady_sigmas)
    first = swelling[0]
    if first.unsteady_sigmas > MAX_CHANCE_SIGMAS:
        alone = len(swelling) > 1 and swelling[1].unsteady < 0.5 * first.unsteady
        data = {"channel": first.name, "variation": first.unsteady, "alone": alone}
        found.append(_graded("nonstationary_level", data, large=first.unsteady > MAX_LEVEL_VARIATION))
    tailed = max(judged, key=lambda c: c.tails_sigmas)
    if tailed.tails_sigmas > MAX_CHANCE_SIGMAS:
        data = {"channel": tailed.name, "kurtosis": tailed.tails}
        found.append(_graded("heavy_tails", data, large=tailed.tails > MAX_KURTOSIS))
        if tailed.tails_sigmas > first.unsteady_sigmas:
            found.reverse()
    return found


def _is_ruled_from_afar(channel: ChannelCheck, w: Whiteness) -> bool:
    """Test whether frequencies away from all modes of the model dominate a channel's innovations: their variation over
    time is not the modes'."""
    return channel.far > max(MAX_FAR_PEAK_LEVEL, w.spectrum_bound)


def _judge_shared(w: Whiteness) -> list[Finding]:
    shared = w.shared
    if shared is None or shared.sigmas < MAX_CHANCE_SIGMAS or abs(shared.correlation) < MAX_COLOUR:
        return []
    first, second = w.channels[shared.first], w.channels[shared.second]
    data = {"channels": [first.name, second.name], "correlation": shared.correlation}
    from_afar = _is_ruled_from_afar(first, w) or _is_ruled_from_afar(second, w)
    return [_graded("correlated_innovations", data, large=not from_afar)]


def _judge_outliers(w: Whiteness) -> list[Finding]:
    found = list[Finding]()
    for c in w.channels:
        if c.gated > MAX_MISSING_SHARE:
            found.append(Finding("too_many_outliers", "reason", {"channel": c.name, "share": c.gated}))
        elif c.gated > 0.0:
            found.append(Finding("gated_readings", "remark", {"channel": c.name, "share": c.gated}))
        if c.outliers:
            data = {"channel": c.name, "count": c.outliers, "sigmas": OUTLIER_SIGMAS, "share": c.outlying}
            found.append(_graded("outlying_innovations", data, large=c.outlying > NEGLIGIBLE_SHARE))
    return found
