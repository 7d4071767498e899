"""Information of a planned record in its spectra, as identification computes it.

Records of the planned kind are simulated and identified
(`windsysid.identification.estimate.spectral.frequency_domain`), with the usual priors about the values that they were
simulated with. The inverse of a posterior's covariance is information; without that of the priors it is the record's,
Whittle's sum over frequencies, and grows in proportion to time. Unlike the filters' bound it holds what is left out:
lines of the rotor, what lies between the bands of a rotor that is read in bands, and the levels that are learned in
each band. Source: Whittle, Ark. Mat. 2, 1953, https://doi.org/10.1007/BF02590998.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.estimate.spectral.frequency_domain import identify_by_spectrum
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.loads.statistics import to_logarithms
from windsysid.output.progress import Progress
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.tolerance import Tolerance
from windsysid.simulation.record import simulate_record
from windsysid.turbine.turbine import Turbine

__all__ = ["PlannedInformation", "PlannedRecord", "planned_spectra"]

RECORD_COUNT = 4
"""Setting: records that are simulated; their scatter tells the accuracy."""

MAX_ROUNDING_EIGENVALUE = 1e-7
"""Numerical: scaled eigenvalue up to which the information is rounding where the priors' is taken out."""


class PlannedRecord(NamedTuple):
    """A stationary record that is simulated: `length` [s] at `rate` [Hz], after `settling` [s] that are left out."""

    turbine: Turbine
    rate: float
    settling: float
    length: float
    seed: int
    loads: str = "random"

    def drawn(self, number: int = 0) -> Record:
        """The record of the seed, or of one of those after it."""
        seed, seconds = self.seed + number, self.settling + self.length
        record = simulate_record(self.turbine, duration=seconds, rate=self.rate, seed=seed, loads=self.loads)
        return record.section(self.settling, float(record.time[-1]))


class PlannedInformation(NamedTuple):
    """Information of simulated records of `length` [s] in all: names of the unknowns, tolerances last (n,), and
    information as in `windsysid.identification.planning.plan.Plan`, its growth by part (…, n, n); notes, and whether
    identification would leave it at that."""

    names: tuple[str, ...]
    start: Array
    growths: Array
    tolerances: tuple[Tolerance, ...]
    length: float
    notes: tuple[str, ...]
    fits: bool = True


def planned_spectra(planned: PlannedRecord, unknown: Sequence[str], progress: Progress) -> PlannedInformation:
    """Simulate records and identify them.

    Raises
    ------
    RecordError, ConfigurationError
        If spectra do not apply to such a record.
    """
    found = []
    turbine = planned.turbine
    for i in range(RECORD_COUNT):
        progress("identifying simulated records", i / RECORD_COUNT)
        found.append(identify_by_spectrum(planned.drawn(i), turbine, turbine.sensors, Prior(), unknown))
    tolerances = found[0].tolerances
    names = dict.fromkeys([*unknown, *(name for one in found for name in _names(one))])
    for one in tolerances:
        names[one.name] = names.pop(one.name)  # last
    places = {name: i for i, name in enumerate(names)}
    growths = np.zeros((RECORD_COUNT, len(names), len(names)))
    for growth, outcome in zip(growths, found, strict=True):
        at = [places[name] for name in _names(outcome)]
        growth[np.ix_(at, at)] = _information(outcome) / planned.length
    shifts = np.eye(len(names))  # a tolerance of a coefficient is only seen as that coefficient
    for i, k, spread in [(places[one.name], places[one.of], one.spread) for one in tolerances if one.of in places]:
        shifts[[i, k], i] = 0.0, spread
    growths = _of_what_is_seen(shifts.T @ growths @ shifts)
    doubts = tuple(f"such a record would not be trusted: {doubt}" for doubt in _shared_doubts(found))
    start = np.diag((np.arange(len(names)) >= len(names) - len(tolerances)).astype(np.float64))
    fits, length = not (found[0].turns or doubts), RECORD_COUNT * planned.length
    return PlannedInformation(tuple(names), start, growths, tolerances, length, doubts, fits)


def _names(found: Outcome) -> list[str]:
    """Of all unknowns of an outcome, in their order. A level says where in its record's spectrum it is; here it has a
    number, since the next record has another."""
    levels: list[str] = []
    for one in found.statistics:
        name = re.sub(r"_[\d.]+Hz$", "", one.name)
        levels.append(name if name == one.name else f"{name}_{1 + sum(x.startswith(name) for x in levels)}")
    return [*(q.name for q in found.model.parameters), *levels, *(one.name for one in found.tolerances)]


def _shared_doubts(found: Sequence[Outcome]) -> tuple[Finding, ...]:
    """Reasons of more than half of the results, whatever their numbers, as the first of them has them."""
    alike: dict[tuple[object, ...], list[Finding]] = {}
    for one in found:
        for key, doubt in {(d.code, d.channels, d.quantities): d for d in one.doubts}.items():
            alike.setdefault(key, []).append(doubt)
    return tuple(doubts[0] for doubts in alike.values() if len(doubts) > RECORD_COUNT // 2)


def _information(found: Outcome) -> Array:
    """That of the record about all unknowns (n, n), without the priors', in relative coordinates."""
    cov = found.cov if found.joint_cov is None else found.joint_cov
    size = np.sqrt(np.diag(cov))
    whole = np.linalg.inv(cov / np.outer(size, size)) / np.outer(size, size)
    parameters, statistics = found.model.parameters, found.statistics
    spreads = [q.prior[1] for q in parameters] + [s.spread for s in statistics] + [1.0] * len(found.tolerances)
    to_relative = np.eye(len(whole))  # ∂ unknowns / ∂ ln p
    values = found.theta.tolist()
    relative = [1.0 if q.logarithmic else value for q, value in zip(parameters, values, strict=True)]
    theta, eta = found.unknowns.of("parameters"), found.unknowns.of("statistics")
    to_relative[theta, theta] = np.diag(relative)
    to_relative[eta, eta] = np.linalg.inv(to_logarithms(statistics))
    return np.asarray(to_relative.T @ (whole - np.diag(np.array(spreads) ** -2.0)) @ to_relative)


def _of_what_is_seen(growths: Array) -> Array:
    """The information (RECORDS, n, n) without that on directions of which no record says anything. Each is linearised
    at its own estimates, which gives their mean stray information: as many are left out as the best leaves open."""
    every = np.concatenate([growths, growths.mean(axis=0, keepdims=True)])
    scale = np.sqrt(np.abs(np.diagonal(every, axis1=1, axis2=2)))
    size = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(every / (size[:, :, None] * size[:, None, :]))
    lacking = (scale == 0.0).sum(axis=1)
    blind = (values <= MAX_ROUNDING_EIGENVALUE).sum(axis=1) - lacking
    seen = vectors[-1][:, lacking[-1] + max(blind[-1], blind[:-1].min()) :]
    project = seen @ seen.T * np.outer(1.0 / size[-1], size[-1])
    return np.asarray(project.T @ growths @ project)
