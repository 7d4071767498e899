"""Posterior of a mode's coefficients under a narrow-band load that the spectra hardly show.

Where a load is faint or wide, its posterior is a ridge and no normal distribution: a stronger load takes more of the
mode's peak, and the mode is damped more. So frequency, width and level of a load on one degree of freedom are
integrated over their prior, by the points of a Kronecker sequence; at each point stiffness, damping and the level of
the broad loads have Laplace's approximation (integrated nested Laplace approximation).

With the dynamic stiffness D(ω) of the degree of freedom as found, and D + ΔD with other coefficients, what it does to a
reading is multiplied by |D / (D + ΔD)|², since ΔD has rank one: exact where the mode is not coupled to others.

Sources: Rue, Martino & Chopin, J. R. Statist. Soc. B 71, 2009, https://doi.org/10.1111/j.1467-9868.2008.00700.x;
Sherman & Morrison, Ann. Math. Statist. 21, 1950, https://doi.org/10.1214/aoms/1177729893.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, ndtri

from windsysid._types import Array
from windsysid.identification.model.prior_odds import odds_of
from windsysid.loads.narrow_band import FREQUENCY, WIDTH, narrow_band_statistics
from windsysid.loads.statistics import Statistic, coordinates_of
from windsysid.spectral.rotor.fit import RotorFit
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.narrow_band_spectra import narrow_density
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.spectral.transforms.lifted import Complex

__all__ = ["ShiftedPosterior", "SupportResponse", "responses", "shifted_by_narrow_band"]

POINTS, STEPS = 512, 6
"""Numerical: points of the integral over a load, and steps of the searches at each."""

NEGLIGIBLE_DECREMENT = 0.05
"""Numerical: squared step in standard deviations below which a search ends."""

MAX_STEP = 1.0
"""Numerical: longest step of a search, in standard deviations of the prior."""

MIN_DAMPING_FACTOR = 0.2
"""Numerical: smallest factor on damping in a step: spectra do not tell its sign."""

BROAD_LOG_POWER_STD, FIXED = 1.0, 1e-6
"""Setting: prior standard deviation of the logarithm of broad loads' power over that found, and of what is given."""

BROAD_DAMPING = 3.0
"""Setting: damping ratio of a load that is hardly narrow: it tells how the support answers at any frequency."""

ABSENT_LOG_LEVEL = -8.0
"""Setting: coordinate of the level of a load that is absent."""

MOVED_SIGMAS = 2.0
"""Setting: shift or added width of a coefficient from which on a load is another explanation; less is as chance."""


class SupportResponse(NamedTuple):
    """Answer of the channel that sees most of a degree of freedom of the support.

    Attributes
    ----------
    level, mode
        Statistic of the load's level there, and the natural frequency [Hz].
    frequency, spectrum, noise, answer, power
        Frequencies [Hz], spectrum as found, the part of it that is noise, response to a load of unit density, and
        power of the data, each (B, e).
    """

    level: Statistic
    mode: float
    frequency: Array
    spectrum: Array
    noise: Array
    answer: Array
    power: Array


class ShiftedPosterior(NamedTuple):
    """Part of a posterior under a narrow-band load in which coefficients of one degree of freedom differ.

    Attributes
    ----------
    log_odds, frequency
        Its log odds against broad loads alone, and the load's mean frequency [Hz].
    shifts, widths
        By name of the coefficient, mean shift in filter coordinates, and standard deviation over that without the load.
    """

    log_odds: float
    frequency: float
    shifts: dict[str, float]
    widths: dict[str, float]


def responses(question: RotorQuestion, model: LiftedModel, known: Array) -> Iterator[SupportResponse]:
    """Responses of the support's degrees of freedom to loads, with what is known of coefficients and broad loads."""
    narrow = narrow_band_statistics(question.turbine, question.loads)
    at = model.unknowns.of("statistics").stop - len(model.noise) - len(narrow)
    values = {q.name: float(q.physical(u)) for q, u in zip(question.parameters, known, strict=False)}
    turbine = question.turbine.with_values(values)
    order = model.place.orders[model.place.entries // len(model.combine)]
    frequency = np.abs(model.base[:, None] + model.place.rotor_hz * order)
    power = np.sum(np.abs(model.data) ** 2, axis=2) / model.counts[:, None]

    def expected(values: dict[str, float], noisier: float = 0.0) -> Array:
        eta = coordinates_of(narrow, values)
        eta[2:][[one.name not in values for one in narrow[2:]]] = ABSENT_LOG_LEVEL
        unknowns = np.insert(known, at, eta)
        unknowns[at + len(narrow) : model.unknowns.of("statistics").stop] += noisier
        return np.asarray(np.einsum("bee->be", model.spectrum(unknowns).spectrum).real)

    without = expected({})
    noise = (expected({}, 0.5 * math.log(2.0)) - without).clip(0.0, without)
    for level in narrow[2:]:
        mode = turbine.natural_frequency(level.of) / (2.0 * math.pi)
        added = expected({FREQUENCY: mode, WIDTH: BROAD_DAMPING, level.name: level.given}) - without
        added = np.maximum(added, np.finfo(float).eps * without)  # rounding makes it negative
        answer = added / (level.given**2 * narrow_density(frequency, mode, BROAD_DAMPING)[0])
        entry = int(np.argmax((answer / without).max(axis=0))) % len(model.combine)
        seen = model.place.entries % len(model.combine) == entry
        yield SupportResponse(level, mode, *(of[:, seen] for of in (frequency, without, noise, answer, power)))


def shifted_by_narrow_band(question: RotorQuestion, model: LiftedModel, found: RotorFit) -> list[ShiftedPosterior]:
    """Parts of the posterior in which a narrow-band load shifts coefficients from where a search with broad loads alone
    has ended; `model` has the narrow-band load."""
    model = model._replace(smear=found.model.smear, overlap=found.model.overlap)
    parts = (_shifted(question, model, found, response) for response in responses(question, model, found.unknowns))
    return [part for part in parts if part is not None]


def _shifted(
    question: RotorQuestion, model: LiftedModel, found: RotorFit, response: SupportResponse
) -> ShiftedPosterior | None:
    frequency, width, *_ = narrow_band_statistics(question.turbine, question.loads)
    own, damping, rms = (
        one.given * np.exp(one.spread * u)
        for one, u in zip((frequency, width, response.level), _points(3), strict=True)
    )
    damping = np.hypot(damping, 0.5 * float(np.median(np.diff(model.base))) / own)
    density = narrow_density(response.frequency, own[:, None, None], damping[:, None, None])[0]
    mode = _ModeUnderLoads.of(question, model, found, response)
    alone = mode.search(np.zeros((1, *response.answer.shape)))
    beside = mode.search(np.square(rms)[:, None, None] * density * response.answer)
    odds = [math.log(odds_of("narrow_band_load", question.turbine, f)) for f in own.tolist()]
    gains = beside.log_evidence - alone.log_evidence + odds
    known = np.flatnonzero(mode.places >= 0)
    std = np.sqrt(np.diag(alone.cov[0]))[known]
    shift = (beside.point - alone.point)[:, known] / std
    wide = np.sqrt(np.diagonal(beside.cov, axis1=1, axis2=2))[:, known] / std
    rival = (np.hypot(shift, wide) > math.hypot(MOVED_SIGMAS, 1.0)).any(axis=1)
    if not rival.any():
        return None
    log_odds = float(logsumexp(gains, b=rival)) - math.log(POINTS)
    weights = np.exp(gains - math.log(POINTS) - log_odds) * rival
    mean = weights @ shift
    spread = np.sqrt(weights @ (np.square(shift - mean) + np.square(wide)))
    names = [question.parameters[i].name for i in mode.places[known]]
    return ShiftedPosterior(
        log_odds, float(np.exp(weights @ np.log(own))), dict(zip(names, (mean * std).tolist(), strict=True)),
        dict(zip(names, spread.tolist(), strict=True)),
    )  # fmt: skip


def _points(dimensions: int) -> Array:
    """Standard normal points (d, P) of a Kronecker sequence, with the steps of Roberts's generalised golden ratio."""
    golden = 2.0
    for _ in range(50):
        golden = (1.0 + golden) ** (1.0 / (dimensions + 1))
    steps = golden ** -np.arange(1.0, dimensions + 1)
    return np.asarray(ndtri((0.5 + steps[:, None] * np.arange(1, POINTS + 1)) % 1.0))


class _Ends(NamedTuple):
    """Ends of searches (P, 3), their covariance (P, 3, 3) and log evidence (P,)."""

    point: Array
    cov: Array
    log_evidence: Array


class _ModeUnderLoads(NamedTuple):
    """A degree of freedom, whose unknowns are the logarithm of its stiffness over that found, its damping as the
    coefficient's coordinate, and the logarithm of the power of broad loads over that found.

    Attributes
    ----------
    response, counts
        Its channel, and how many values tell each of the spectra (B, 1).
    places
        Which of the coefficients the unknowns are (3,), -1 for none.
    start, mean, spread
        Of the search and of the prior (3,); what is no unknown has no width.
    stiffness, slope
        Dynamic stiffness over k as found (B, e), and that of one unit of the damping's coordinate.
    """

    response: SupportResponse
    counts: Array
    places: Array
    start: Array
    mean: Array
    spread: Array
    stiffness: Complex
    slope: Complex

    @classmethod
    def of(
        cls, question: RotorQuestion, model: LiftedModel, found: RotorFit, response: SupportResponse
    ) -> "_ModeUnderLoads":
        """The degree of freedom of a response."""
        of, wanted = response.level.of, (("stiffness", True), ("damping", False))
        values = {q.name: float(q.physical(u)) for q, u in zip(question.parameters, found.unknowns, strict=False)}
        turbine = question.turbine.with_values(values)
        critical, ratio = turbine.critical_damping(of), response.frequency / response.mode
        places, start, mean, spread = [-1] * 3, np.zeros(3), np.zeros(3), np.array([FIXED, FIXED, BROAD_LOG_POWER_STD])
        scale = critical
        for i, q in enumerate(question.parameters):
            if q.part == of and (q.kind, q.logarithmic) in wanted:
                at = wanted.index((q.kind, q.logarithmic))
                places[at], start[at] = i, found.unknowns[i]
                mean[at], spread[at] = (part[i] for part in found.model.prior)
                scale = q.scale if at else scale
        return cls(
            response, model.counts[:, None] / model.overlap, np.array(places), start, mean, spread,
            np.asarray(1.0 - ratio**2 + 2j * ratio * turbine.damping(of) / critical, dtype=np.complex128),
            np.asarray(2j * ratio * scale / critical, dtype=np.complex128),
        )  # fmt: skip

    def search(self, added: Array) -> _Ends:
        """Search from the start with what narrow-band loads add to the spectrum as found (P, B, e)."""
        point = np.tile(self.start, (len(added), 1))
        value, gradient, information = self._evaluate(point, added)
        damping, going = np.ones(len(added)), np.arange(len(added))
        for _ in range(STEPS):
            step = -np.linalg.solve(information[going], gradient[going, :, None])[:, :, 0]
            going, step = (
                part[-np.sum(step * gradient[going], axis=1) > NEGLIGIBLE_DECREMENT] for part in (going, step)
            )
            if not len(going):
                break
            tried = point[going] + damping[going, None] * step.clip(-MAX_STEP * self.spread, MAX_STEP * self.spread)
            tried[:, 1] = np.maximum(tried[:, 1], MIN_DAMPING_FACTOR * point[going, 1])
            found = self._evaluate(tried, added[going])
            better = found[0] < value[going]
            damping[going] = np.where(better, np.minimum(2.0 * damping[going], 1.0), 0.4 * damping[going])
            at = going[better]
            point[at] = tried[better]
            value[at], gradient[at], information[at] = (part[better] for part in found)
        evidence = -value - 0.5 * np.linalg.slogdet(information)[1]
        return _Ends(point, np.asarray(np.linalg.inv(information)), evidence)

    def _evaluate(self, point: Array, added: Array) -> tuple[Array, Array, Array]:
        """J, g and F of Whittle's likelihood with the prior (P, …) at points (P, 3)."""
        of, (log_k, c, log_power) = self.response, (point - self.start).T[:, :, None, None]
        stiffness = self.stiffness + np.expm1(log_k) + self.slope * c
        size = np.square(stiffness.real) + np.square(stiffness.imag)
        answer = (np.square(self.stiffness.real) + np.square(self.stiffness.imag)) / size
        broad = (of.spectrum - of.noise) * np.exp(log_power) * answer
        whole = broad + added * answer
        to_k = -2.0 * whole * stiffness.real * np.exp(log_k) / size
        to_c = -2.0 * whole * stiffness.imag * self.slope.imag / size
        spectrum = whole + of.noise
        slopes = np.stack([to_k, to_c, broad], axis=1) / spectrum[:, None]
        over = of.power / spectrum
        off = (point - self.mean) / self.spread
        value = np.sum(self.counts * (np.log(spectrum) + over), axis=(1, 2)) + 0.5 * np.sum(off**2, axis=1)
        gradient = np.einsum("pabe,pbe->pa", slopes, self.counts * (1.0 - over)) + off / self.spread
        flat = (slopes * np.sqrt(self.counts)).reshape(len(point), 3, -1)
        return value, gradient, flat @ np.swapaxes(flat, 1, 2) + np.diag(self.spread**-2.0)
