"""Findings against the bands of spectra, and comparison of the halves of a record."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from windsysid._types import Array
from windsysid.checks.blade_passing import find_passing
from windsysid.errors import RecordError
from windsysid.identification.estimate.spectral.drift_of_halves import drift_of_halves
from windsysid.identification.limits import MAX_RESONANCE_DOF, MIN_RESONANCE_DOF
from windsysid.identification.model.drift import Drift
from windsysid.inspection.limits import MIN_DEGREES_OF_FREEDOM
from windsysid.results.finding import Finding
from windsysid.results.tolerance import Tolerance
from windsysid.results.transient import find_burst
from windsysid.spectral.rotor.build import pose_lifted
from windsysid.spectral.rotor.check import RangePower, parts_of, unexplained, unsteady
from windsysid.spectral.rotor.fit import RotorFit
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.lifted import Lifted

__all__ = ["doubts_of_spectra", "drifts_of", "halves_of", "passed_by"]


def halves_of(question: RotorQuestion, posed: Posed, found: RotorFit, loads: str) -> list[Posed]:
    """Halves of a record with the unknowns of the fit; none of blocks, and if it is too short."""
    if question.sums is not None:
        return []
    try:
        return [_alike(pose_lifted(half, loads, posed.bands), found) for half in question.halves]
    except RecordError:
        return []


def drifts_of(
    question: RotorQuestion, halves: Sequence[Posed], unknowns: Array, tolerances: Sequence[Tolerance]
) -> tuple[Drift, ...]:
    """Clock drifts from the halves."""
    if not halves:
        return ()
    apart = 0.5 * len(question.readings) / question.rate
    loggers = [one.of for one in tolerances if one.group == "clock"]
    return tuple(drift_of_halves([half.model for half in halves], unknowns, loggers, apart))


def doubts_of_spectra(
    question: RotorQuestion, posed: Posed, found: RotorFit, loads: str, halves: Sequence[Posed]
) -> list[Finding]:
    """Findings against the bands: a search that did not converge, a record that the spectra do not explain or that is
    not stationary."""
    doubts = list[Finding]()
    if not found.settled:
        doubts.append(Finding("search_not_converged", "reason", {"steps": found.steps}))
    doubts += _unproven_length(question, posed, loads)
    doubts += unexplained(_parts(_alike(posed, found), posed, found.unknowns, question))[:3]
    if question.sums is not None:
        return doubts + _unsteady_blocks(question, question.sums, posed)
    burst = find_burst(question.readings, [sensor.channel for sensor in question.sensors], question.rate)
    if burst is not None:
        doubts.append(Finding("burst", "reason", burst.data))
    if not halves:
        return [*doubts, Finding("too_short_for_stationarity", "reason")]
    first, second = (_parts(half, posed, found.unknowns, question) for half in halves)
    return doubts + unsteady(first, second)[:2]


def _unproven_length(question: RotorQuestion, posed: Posed, loads: str) -> list[Finding]:
    """Test whether the narrowest resonance has too few degrees of freedom if bins are independent, or under wind too
    many."""
    doubts, least = list[Finding](), MIN_DEGREES_OF_FREEDOM if posed.smoothed is None else MIN_RESONANCE_DOF
    if posed.resonance < least and posed.model.joint is None:
        doubts.append(Finding("narrow_resonance", "reason", {"count": posed.resonance, "least": least}))
    if loads == "rotor-wind" and posed.resonance > MAX_RESONANCE_DOF:
        proven = len(question.readings) / question.rate * MAX_RESONANCE_DOF / posed.resonance
        doubts.append(Finding("long_record_under_wind", "reason", {"duration": proven}))
    return doubts


def passed_by(question: RotorQuestion, unknowns: Array, rotor_hz: float) -> list[Finding]:
    """Test whether blades pass close to a natural frequency of a structure without rotating parts: wind makes no line
    there, and spectra have no model of it."""
    values = {q.name: float(q.physical(u)) for q, u in zip(question.parameters, unknowns, strict=False)}
    found, blades = question.turbine.with_values(values), question.turbine.model.blades
    modes = [(name, found.natural_frequency(name) / (2.0 * math.pi), 0.0) for name in found.model.coordinates]
    passing = find_passing(modes, blades, rotor_hz)
    return [] if passing is None else [passing.finding(blades)]


def _unsteady_blocks(question: RotorQuestion, sums: BlockSums[Lifted], posed: Posed) -> list[Finding]:
    """Test whether the first half of the blocks is much stronger or weaker than the second, and whether a block is long
    enough."""
    blocks, doubts = len(sums.energies), list[Finding]()
    alone = posed.resonance / sums.blocks
    if posed.smoothed is not None and alone < MIN_RESONANCE_DOF:
        data = {"count": alone, "least": MIN_RESONANCE_DOF}
        doubts.append(Finding("narrow_resonance_in_pieces", "reason", data))
    if blocks < 2:
        return [*doubts, Finding("one_block", "reason")]
    low, high = posed.bands[0][0], posed.bands[-1][1]
    halves = [
        [
            RangePower(sensor.channel, low, high, 1.0, 1.0, float(energy), 0.5 * blocks * max(alone, 1.0))
            for sensor, energy in zip(question.sensors, part.mean(axis=0), strict=True)
        ]
        for part in (sums.energies[: blocks // 2], sums.energies[blocks // 2 :])
    ]
    return doubts + unsteady(*halves)[:2]


def _alike(posed: Posed, found: RotorFit) -> Posed:
    """Problem with the inexact quantities of the fit."""
    return posed._replace(model=posed.model._replace(inexact=found.model.inexact))


def _parts(posed: Posed, whole: Posed, unknowns: Array, question: RotorQuestion) -> list[RangePower]:
    """Mean squares of a record, or of a part of it, by channel and frequency."""
    measured = posed.model.powers(unknowns)
    channels = [sensor.channel for sensor in question.sensors]
    entries = posed.model.place.entries % len(channels)
    overlap = posed.model.overlap / posed.model.blocks
    parts = []
    for column, name in enumerate(channels):
        power, expected, frequency = (values[:, entries == column].ravel() for values in measured)
        parts += parts_of(power, expected, frequency, name, _ranges(whole), overlap, posed.resonance)
    return parts


def _ranges(posed: Posed) -> list[tuple[float, float]]:
    """Frequency ranges that are judged: between harmonics of the rotor, or thirds of the bands."""
    model = posed.model
    if len(model.place.orders) > 1:
        highest = round(posed.bands[0][1] / model.place.rotor_hz)
        return [(k * model.place.rotor_hz, (k + 1) * model.place.rotor_hz) for k in range(highest)]
    edges = [np.geomspace(low, high * 1.000001, 4) for low, high in posed.bands]
    return [(float(a), float(b)) for edge in edges for a, b in pairwise(edge)]
