"""Instruments and masses as unknowns: their errors, and a model with them.

Each tolerance is an unknown τ in standard deviations of its prior, in addition to θ and η. Gains, axes and masses are
numbers of the model (`windsysid.mechanics.sensors.instrument_parameters`); clocks act on the readings
(`windsysid.identification.estimate.clock_lag`). A body's mass and moments are wrong together. Those of different bodies
are half wrong together, as they were weighed on one scale, or computed from one drawing and one density.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import MAX_DISAGREEMENT_SIGMAS
from windsysid.mechanics.sensors import TOWER_LOGGER, Sensor, instrument_parameters
from windsysid.results.finding import Finding
from windsysid.results.tolerance import SHARED, Tolerance
from windsysid.spectral.rotor.model import Inexact
from windsysid.statespace.unknowns import Unknowns
from windsysid.turbine.turbine import Turbine

__all__ = [
    "doubt_tolerances", "in_numbers", "learned_tolerances", "note_tolerances", "places_of_shared", "seconds_late",
    "tolerances_of", "with_tolerances",
]  # fmt: skip


ALL_BODIES = "all bodies"

SHARED_VARIANCE_SHARE = 0.5
"""Setting: share of the variance of a body's mass that all have together; half is its own."""


def tolerances_of(turbine: Turbine, sensors: Sequence[Sensor], identified: Sequence[str]) -> tuple[Tolerance, ...]:
    """The tolerances that matter: gains, axes, masses and aerodynamics, then clocks. What is `identified` has no other
    tolerance than aerodynamics."""
    found = [Tolerance("gain", s.channel, s.gain_tolerance) for s in sensors]
    found += [Tolerance("alignment", s.channel, s.alignment) for s in sensors]
    bodies = [body for body in turbine.model.bodies() if _masses(turbine, body, identified)]
    shared = SHARED_VARIANCE_SHARE if len(bodies) > 1 else 0.0
    found += [Tolerance("masses", body, math.sqrt(1.0 - shared) * turbine.mass_tolerance) for body in bodies]
    found.append(Tolerance("masses", ALL_BODIES, math.sqrt(shared) * turbine.mass_tolerance))
    if "k_fore_aft" in turbine.model.coefficients:
        found.append(Tolerance("aerodynamics", "k_fore_aft", turbine.aerodynamic_tolerance))
    spreads = dict[str, float]()
    for s in sensors:
        spreads[s.sampled_by] = max(s.clock_tolerance, spreads.get(s.sampled_by, 0.0))
    spreads.pop(TOWER_LOGGER, None)
    found += [Tolerance("clock", logger, spread) for logger, spread in spreads.items()]
    return tuple(one for one in found if one.spread > 0.0)


def _masses(turbine: Turbine, body: str, identified: Sequence[str]) -> tuple[str, ...]:
    """The inertias of a body, or of all, that are known and not zero."""
    bodies = turbine.model.bodies()
    names = bodies[body] if body != ALL_BODIES else [name for names in bodies.values() for name in names]
    return tuple(name for name in names if name not in identified and turbine.values[name] != 0.0)


def with_tolerances(
    p: Array, names: Sequence[str], tolerances: Sequence[Tolerance], tau: Array, turbine: Turbine,
    sensors: Sequence[Sensor], identified: Sequence[str],
) -> Array:  # fmt: skip
    """The parameters p (n_p,) of the names given, with tolerances τ (n_τ,) [standard deviations of their priors]."""
    p = p.copy()
    channels = [sensor.channel for sensor in sensors]
    for one, value in zip(tolerances, tau, strict=True):
        off = value * one.spread
        if one.group == "masses":
            p[[names.index(name) for name in _masses(turbine, one.of, identified)]] *= 1.0 + off
        elif one.group == "aerodynamics":
            p[names.index(one.of)] *= 1.0 + off
        elif one.group != "clock":
            gain, turn = instrument_parameters(channels.index(one.of))
            p[names.index(gain if one.group == "gain" else turn)] = off
    return p


def places_of_shared(unknowns: Unknowns, tolerances: Sequence[Tolerance]) -> tuple[int, ...]:
    """Indices of the unknowns that are masses or aerodynamics."""
    places = unknowns.places("tolerances", "clocks").tolist()
    return tuple(at for at, one in zip(places, tolerances, strict=True) if one.group in SHARED)


def seconds_late(tolerances: Sequence[Tolerance], tau: Array, sensors: Sequence[Sensor]) -> Array:
    """By how much the clock of each reading is late (m,) [s]."""
    late = {one.of: value * one.spread for one, value in zip(tolerances, tau, strict=True) if one.group == "clock"}
    return np.array([late.get(sensor.sampled_by, 0.0) for sensor in sensors])


def in_numbers(
    tolerances: Sequence[Tolerance], names: Sequence[str], turbine: Turbine, sensors: Sequence[Sensor],
    identified: Sequence[str],
) -> Inexact:  # fmt: skip
    """Shift by each tolerance at one standard deviation: parameters of the names given, and readings in time."""
    at = np.array([turbine.values.get(name, 0.0) for name in names])
    each = np.eye(len(tolerances))
    moved = [with_tolerances(at, names, tolerances, tau, turbine, sensors, identified) - at for tau in each]
    late = np.array([seconds_late(tolerances, tau, sensors) for tau in each])
    return Inexact(np.array(moved), late, tuple(one.name for one in tolerances))


def note_tolerances(tolerances: Sequence[Tolerance]) -> tuple[Finding, ...]:
    """Tolerances that a record shows to be off, which the estimates include."""
    return tuple(
        Finding("tolerance_off", "note", _data(one) | {"contradicted": one.contradicted})
        for one in tolerances
        if one.off
    )


def doubt_tolerances(tolerances: Sequence[Tolerance]) -> tuple[Finding, ...]:
    """Tolerances with little information in a record, and yet far off."""
    return tuple(
        Finding("tolerance_conflict", "reason", _data(one) | {"factor": MAX_DISAGREEMENT_SIGMAS})
        for one in tolerances
        if one.contradicted and not one.informed
    )


def _data(one: Tolerance) -> dict[str, Any]:
    return {"group": one.group, "of": one.of, "estimate": one.estimate, "std": one.std}


def learned_tolerances(tolerances: Sequence[Tolerance], tau: Array, cov: Array) -> tuple[Tolerance, ...]:
    """Tolerances with the information of the record, from τ (n_τ,) and its covariance (n_τ, n_τ)."""
    std = np.sqrt(np.diag(cov))
    return tuple(
        replace(one, estimate=float(value * one.spread), std=float(e * one.spread))
        for one, value, e in zip(tolerances, tau, std, strict=True)
    )
