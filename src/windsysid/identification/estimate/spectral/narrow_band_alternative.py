"""Test for a narrow-band load as an alternative to the result of a search, of filters or of spectra."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import NEGLIGIBLE_SHARE
from windsysid.errors import WindsysidError
from windsysid.identification.condition.spectral_readings import SpectralSamples
from windsysid.identification.estimate.clock_lag import put_on_time
from windsysid.identification.estimate.spectral.frequency_domain import ask, inexact_of, tolerances_in
from windsysid.identification.estimate.spectral.narrow_band import NarrowBandFit, fit_narrow_band
from windsysid.identification.model.fit import Outcome, known_loads
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.tolerances import seconds_late
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.loads.family import Broadband
from windsysid.loads.narrow_band import NarrowBand, narrow_band_statistics
from windsysid.loads.rotor_wind import RotorWind
from windsysid.loads.statistics import coordinates_of
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.spectral.rotor.build import pose_lifted, turns_couple
from windsysid.spectral.rotor.fit import WHOLE, fit
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.spectral.rotor_bands.build import belongs_in_bands
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.turbine.turbine import Turbine

__all__ = ["heard_on_time", "narrow_band_beside", "told_before"]


RESTART_STAGES = ((0.2, 1), *WHOLE)
"""Setting: the stages of a search that begins where another one has ended, which knew loads by other statistics."""


def narrow_band_beside(
    near: Outcome, record: Record, turbine: Turbine, sensors: Sequence[Sensor],
    sums: BlockSums[Any] | None = None,
) -> NarrowBandFit | None:  # fmt: skip
    """Spectra with a narrow-band load as an alternative to broad ones, from the end of a search, of filters or of
    spectra; None where they do not apply, or such a load could push nothing, under wind, and where damping, a gain or a
    mass is nothing like what it should be. Other arguments as for `identify_by_spectrum`.

    Priors are those that were given. One that was made wider since the readings show more damping stays so: no
    narrow-band load makes a mode look damped more, and it would be held against what the prior does not explain.
    """
    if _is_far(near):
        return None
    turbine = seen_by(turbine, sensors, [])
    known = {
        q.name: q if float(theta) > q.prior[0] else given
        for q, given, theta in zip(near.model.parameters, near.priors, near.theta, strict=True)
    }
    try:
        record = heard_on_time(record, near, turbine, sensors)
        samples = SpectralSamples.of(record, turbine, sensors, [], sums)
        if not _may_be_there(samples, turbine):
            return None
        question = ask(samples, turbine, Prior(), [*known], Broadband.name)
        if turns_couple(question) and belongs_in_bands(question):
            return None
        question = question._replace(parameters=tuple(known[q.name] for q in question.parameters))
        question = _with_tolerances(question, near)
        posed = pose_lifted(question, Broadband.name)
        broad = fit(posed.model, *_where_it_ended(near, question, posed), posed.smoothed)
        return fit_narrow_band(question, posed, broad)
    except (WindsysidError, np.linalg.LinAlgError):
        return None


def _is_far(near: Outcome) -> bool:
    """Test whether no such load is searched for after a fit: under wind, with one, without damping, or with masses or
    gains that are not positive."""
    at = zip(near.model.parameters, near.theta, strict=True)
    undamped = any(q.kind == "damping" and theta <= 0.0 for q, theta in at)
    lost = sum(min(one.estimate, 0.0) for one in near.tolerances if one.group in ("gain", "masses"))
    return undamped or lost <= -1.0 or near.hypothesis in (NarrowBand.name, RotorWind.name)


def _may_be_there(samples: SpectralSamples, turbine: Turbine) -> bool:
    """Test whether such a load could act on the support, and spectra apply: no load is measured, and the yaw hardly
    varies, of which spectra know one value."""
    measured, loads = known_loads(samples.record, turbine)
    some_known = measured.any() or len({load.load for load in loads}) < len(turbine.model.loads)
    turned = np.ptp(samples.inputs[:, 2:], axis=0).max(initial=0.0) > NEGLIGIBLE_SHARE
    return not (some_known or turned) and bool(narrow_band_statistics(turbine, loads))


def heard_on_time(record: Record, near: Outcome, turbine: Turbine, sensors: Sequence[Sensor]) -> Record:
    """Record with the clock lags of a search corrected: blades with a lag of 2 ms look to spectra like loads of another
    kind."""
    tau = np.array([one.estimate / one.spread for one in near.tolerances])
    late = seconds_late(near.tolerances, tau, sensors).tolist()
    highest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    return put_on_time(record, dict(zip([sensor.channel for sensor in sensors], late, strict=True)), highest)


def told_before(near: Outcome, found: Outcome) -> Outcome:
    """Spectra of a record with the clock lags of `found` corrected, expressed for the record before: loggers are
    late by the corrected lag and the one that spectra find."""
    late = {one.name: one.estimate for one in found.tolerances if one.group == "clock"}
    tolerances = [replace(one, estimate=one.estimate + late.get(one.name, 0.0)) for one in near.tolerances]
    return near._replace(tolerances=tuple(tolerances))


def _with_tolerances(question: RotorQuestion, near: Outcome) -> RotorQuestion:
    """The question with instruments and masses where a search has put them: an axis that is off shows a mode of one
    direction in the other."""
    tolerances = tolerances_in(question)
    if not tolerances or [one.name for one in tolerances] != [one.name for one in near.tolerances]:
        return question
    moves = inexact_of(question, tolerances).parameters
    off = np.array([one.estimate / one.spread for one in near.tolerances])[: len(moves)] @ moves
    values = dict(question.turbine.values)
    for name, change in zip(question.compiled.parameters, off.tolist(), strict=True):
        if change:
            values[name] = values.get(name, 0.0) + change
    return question._replace(turbine=replace(question.turbine, values=values))


def _where_it_ended(near: Outcome, question: RotorQuestion, posed: Posed) -> tuple[Array, Sequence[tuple[float, int]]]:
    """The unknowns of spectra where a search has ended, as far as it knows them (n,), and the stages of a search from
    there."""
    found = {q.name: float(q.physical(t)) for q, t in zip(near.model.parameters, near.theta, strict=True)}
    start, statistics = posed.start.copy(), posed.model.statistics
    for i, q in enumerate(question.parameters):
        start[i] = q.coordinate(found[q.name])
    known = {one.name: one.estimate for one in near.statistics}
    if not all(one.name in known for one in statistics):
        return start, RESTART_STAGES
    start[posed.model.unknowns.of("statistics")] = coordinates_of(statistics, known)
    return start, WHOLE
