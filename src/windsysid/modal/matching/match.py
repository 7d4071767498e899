"""Matching of measured modes to modes of a model: one-to-one assignment by frequency, damping and shape, with odds.

Modes that the model lacks, loads and rotor harmonics compete with its modes for each measured one
(`windsysid.modal.matching.likelihood`); probabilities are sums over all one-to-one assignments
(`windsysid.modal.matching.assignment`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.inspection.limits import MAX_RATE_MISMATCH
from windsysid.modal.campbell import Campbell, MeasuredMode
from windsysid.modal.linearisation.read import ENDING, read_linearisation
from windsysid.modal.linearisation.result import LinearisedModes
from windsysid.modal.matching import limits
from windsysid.modal.matching.assignment import best_assignment, pair_probabilities
from windsysid.modal.matching.likelihood import Assurance, ModelMode, pair_weights, shape_assurance
from windsysid.modal.matching.result import MatchedMode, ModeCandidate, ModeMatch, odds_text
from windsysid.modal.matching.sensor_shapes import linearised_shape, turbine_shapes
from windsysid.results.identification import Identification
from windsysid.spectral.oma.known_modes import KnownMode, KnownModes, as_modes
from windsysid.spectral.oma.limits import MAX_HARMONIC_HALF_WIDTHS
from windsysid.spectral.oma.mode import OperationalMode
from windsysid.spectral.oma.result import OperationalModes
from windsysid.turbine.coercion import as_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

__all__ = ["Measured", "ModelLike", "candidates_of", "match_modes", "on_diagram", "with_references"]

Measured: TypeAlias = "OperationalModes | Identification | KnownModes | str | Path"
ModelLike: TypeAlias = "Campbell | Turbine | str | Path | Sequence[str | Path]"

USUAL_BLADES = 3
"""Setting: number of blades of a model that does not have it."""


def match_modes(result: "Measured", modes: "ModelLike") -> ModeMatch:
    """Find which measured mode is which mode of a model, with odds.

    Parameters
    ----------
    result
        Measured modes: of `windsysid.oma`, `windsysid.free_decay` or `windsysid.identify`, or a folder of the first.
    modes
        Modes of the model: of `windsysid.read_linearisation` or `windsysid.modes`, ``.lin`` files, or a turbine, its
        packaged name or TOML file, which has shapes at its sensors, too.

    Returns
    -------
    ModeMatch
        Each measured mode with the modes that it may be, their probabilities and MACs; unmatched ones with their cause.

    Raises
    ------
    ConfigurationError
        If there are no measured modes, or the model has none.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> for mode in ws.match(ws.oma(record), "tower").modes:
    ...     print(f"{mode.frequency.estimate:.3f} Hz is {mode.best.name}")
    0.315 Hz is tower side-side
    """
    measured = _measured(result)
    if not measured.modes:
        raise ConfigurationError(f"match: expected measured modes, got none in {measured.record}")
    name, model, blades, notes = _model_modes(modes, measured)
    if not model:
        raise ConfigurationError(f"match: expected modes of a model, got none in {name}")
    seen, warnings = _with_model_axes(measured, model)
    found = candidates_of(seen, model, measured.rotor_speed / (2.0 * math.pi), blades)
    notes += [*warnings, *_not_measured(found, model)]
    return ModeMatch(measured.record, name, measured.rotor_speed, found, tuple(notes))


def _with_model_axes(measured: KnownModes, model: Sequence[ModelMode]) -> tuple[tuple[KnownMode, ...], list[str]]:
    """Measured modes with x and z of their sensors exchanged if they are so much likelier, and a warning of it."""
    swapped = tuple(
        m._replace(shape=_exchanged(m.shape), shape_std=_exchanged(m.shape_std)) for m in measured.modes
    )  # fmt: skip
    as_named, other = (
        sum(math.log1p(float(pair_weights(m, model, [shape_assurance(m, one) for one in model]).sum())) for m in each)
        for each in (measured.modes, swapped)
    )
    odds = math.exp(min(other - as_named, 50.0)) * limits.EXCHANGED_AXES_ODDS
    if odds < limits.MIN_EXCHANGED_ODDS:
        return measured.modes, []
    text = f"Warning: x and z of the sensors are exchanged, odds {odds_text(odds / (1.0 + odds))}: the nacelle is yawed"
    return swapped, [f"{text} by more than 45° over sensors that do not yaw, or the channels are named so"]


_Values = TypeVar("_Values", complex, float)


def _exchanged(by_channel: Mapping[str, _Values]) -> dict[str, _Values]:
    """Values by channel with x and z exchanged where a point has both."""
    other = {name: name.replace("_x_", "_#_").replace("_z_", "_x_").replace("_#_", "_z_") for name in by_channel}
    return {name: by_channel.get(other[name], value) for name, value in by_channel.items()}


def on_diagram(measured: KnownModes, modes: "ModelLike") -> list[MeasuredMode]:
    """Measured modes to be drawn on a diagram of a model, each with the mode that it is."""
    if not measured.modes:
        return []
    return [
        point._replace(
            candidate=mode.best.name, expected=mode.best.frequency, probability=mode.best.probability
        )
        for point, mode in zip(measured.measured(), match_modes(measured, modes).modes, strict=True)
    ]  # fmt: skip


def with_references(
    modes: list[OperationalMode], channels: Sequence[str], machine: Turbine | None, rotor_hz: float
) -> list[OperationalMode]:
    """Add the modes of the turbine file that the modes may be, with the names and frequencies of matched ones."""
    if machine is None:
        return modes
    expected = _turbine_modes(machine, 2.0 * np.pi * rotor_hz)
    known = [_known(mode, channels) for mode in modes]
    found = []
    for mode, match in zip(modes, candidates_of(known, expected, rotor_hz, _blades_of(machine)), strict=True):
        name = mode.name if match.reference[0] is None else match.best.name
        f, z = (
            replace(one, reference=reference)
            for (_, one), reference in zip(mode.quantities, match.reference, strict=True)
        )
        found.append(replace(mode, name=name, frequency=f, damping_ratio=z, candidates=match.candidates))
    return found


def _known(mode: OperationalMode, channels: Sequence[str]) -> KnownMode:
    """A mode of `windsysid.oma`, whose shape is that of some channels."""
    return KnownMode(
        mode.name, math.log(mode.frequency.estimate), mode.frequency.relative_std,
        math.log(mode.damping_ratio.estimate), mode.damping_ratio.relative_std,
        dict(zip(channels, mode.shape.tolist(), strict=True)), mode.trusted,
        dict(zip(channels, mode.shape_std.tolist(), strict=True)), tuple(doubt.kind for doubt in mode.grounds),
    )  # fmt: skip


def candidates_of(
    measured: Sequence[KnownMode], model: Sequence[ModelMode], rotor_hz: float, blades: int = USUAL_BLADES
) -> tuple[MatchedMode, ...]:
    """Match measured modes and a model's, at some turns of the rotor per second."""
    macs = [[shape_assurance(mode, other) for other in model] for mode in measured]
    rows = [pair_weights(mode, model, row) for mode, row in zip(measured, macs, strict=True)]
    weights = np.array(rows).reshape(len(measured), len(model))
    causes = [_other_causes(mode, rotor_hz, blades) for mode in measured]
    relative = weights / np.array([sum(each.values()) for each in causes])[:, None]
    probability, best = pair_probabilities(relative), best_assignment(relative)
    found = []
    for i, (mode, row) in enumerate(zip(measured, probability, strict=True)):
        pairs = [_candidate(*each) for each in zip(model, row.tolist(), macs[i], strict=True)]
        none = max(1.0 - float(row.sum()), 0.0) / sum(causes[i].values())
        others = [ModeCandidate(name, none * weight) for name, weight in causes[i].items()]
        k = best[i]
        found.append(_matched(mode, pairs[k] if k is not None else max(others, key=_probability), [*pairs, *others]))
    return tuple(found)


def _matched(mode: KnownMode, best: ModeCandidate, candidates: Sequence[ModeCandidate]) -> MatchedMode:
    """A measured mode with its candidates, the best one first."""
    rest = sorted((one for one in candidates if one is not best), key=_probability, reverse=True)
    return MatchedMode(mode.name, *mode.values, mode.trusted, (best, *rest))


def _probability(candidate: ModeCandidate) -> float:
    return candidate.probability


def _not_measured(found: Sequence[MatchedMode], model: Sequence[ModelMode]) -> list[str]:
    """A note on modes of the model within the range of the measured ones that none of these is."""
    taken, measured = {mode.best.name for mode in found}, [mode.frequency.estimate for mode in found]
    rest = [one for one in model if one.name not in taken and min(measured) <= one.frequency <= max(measured)]
    listed = ", ".join(f"{one.name} ({one.frequency:.4g} Hz)" for one in rest[:6])
    return [f"modes of the model that were not measured: {listed}"] if rest else []


def _candidate(mode: ModelMode, probability: float, mac: Assurance | None) -> ModeCandidate:
    triple = None if mac is None else (mac.value, mac.low, mac.high)
    return ModeCandidate(mode.name, probability, mode.frequency, mode.damping, triple)


def _other_causes(mode: KnownMode, rotor_hz: float, blades: int) -> dict[str, float]:
    """Weights of causes that are no mode of the model: a mode that it lacks, a load, rotor harmonics nearby."""
    causes = {"unknown": 1.0}
    if {"load", "line"} & {*mode.doubts}:
        causes["load"] = limits.LOAD_ODDS
    f = math.exp(mode.ln_frequency)
    reach = max(MAX_RATE_MISMATCH, MAX_HARMONIC_HALF_WIDTHS * math.exp(mode.ln_damping))
    n = round(f / rotor_hz) if rotor_hz > 0.0 else 0
    if 0 < n <= limits.MAX_HARMONIC and abs(f / (n * rotor_hz) - 1.0) < reach:
        passes = n % blades == 0
        chance = limits.BLADE_PASSING_PROBABILITY if passes else limits.HARMONIC_PROBABILITY
        causes[f"{n}P, blade passing" if passes else f"{n}P"] = chance / (2.0 * reach * limits.UNLISTED_RATE)
    return causes


def _measured(result: "Measured") -> KnownModes:
    """Measured modes with their uncertainty, whatever found them."""
    if not isinstance(result, Identification):
        return as_modes(result)
    modes = []
    for one in result.modes:
        f, z = one.frequency, one.damping_ratio
        std = z.relative_std if z.estimate > 0.0 else math.inf
        logs = (math.log(f.estimate), f.relative_std, math.log(max(z.estimate, 1e-6)), min(std, 3.0))
        modes.append(KnownMode(one.name, *logs, {}, one.trusted))
    posterior = result.posterior
    start, section, hashed = posterior.start, posterior.section, posterior.record_hash
    return KnownModes(posterior.record, start, section, hashed, tuple(modes), True, posterior.turbine.rotor_speed)


def _model_modes(modes: "ModelLike", measured: KnownModes) -> tuple[str, list[ModelMode], int, list[str]]:
    """Name of a model, its modes at the rotor speed of a record, its number of blades, and notes."""
    paths = [modes] if isinstance(modes, str | Path) else modes if isinstance(modes, list | tuple) else []
    if any(Path(one).suffix.lower() == ENDING for one in paths):
        modes = read_linearisation(paths)
    if isinstance(modes, Campbell):
        return _diagram_modes(modes, measured)
    machine = as_turbine(modes)  # type: ignore[arg-type]
    return machine.name, _turbine_modes(machine, measured.rotor_speed), _blades_of(machine), []


def _blades_of(turbine: Turbine) -> int:
    """Number of blades; the usual one if its rotor is rigid."""
    return turbine.model.blades or USUAL_BLADES


def _turbine_modes(turbine: Turbine, rotor_speed: float) -> list[ModelMode]:
    """Modes of a turbine at a rotor speed [rad/s], with their shapes at its sensors."""
    found, shapes = turbine_shapes(turbine, rotor_speed)
    return [
        ModelMode(name, f, 0.0, z, 0.0, shape)
        for name, f, z, shape in zip(
            found.names, found.frequency.tolist(), found.damping.tolist(), shapes, strict=True
        )
    ]  # fmt: skip


def _diagram_modes(found: Campbell, measured: KnownModes) -> tuple[str, list[ModelMode], int, list[str]]:
    """Modes of a diagram at the rotor speed of a record; those of a linearisation with shapes."""
    speed = min(max(measured.rotor_speed, float(found.speeds[0])), float(found.speeds[-1]))
    notes, shapes = [], {}
    if abs(speed - measured.rotor_speed) > limits.MAX_SPEED_DIFFERENCE * max(speed, measured.rotor_speed):
        off = (
            f"{speed * RPM:.3g} rpm is the nearest speed of the model, the record has {measured.rotor_speed * RPM:.3g}"
        )
        notes = [f"Warning: {off}: blade modes change with the speed; give the model at that of the record"]
    if isinstance(found, LinearisedModes):
        i = int(np.argmin(np.abs(found.speeds - speed)))
        channels = list(measured.modes[0].shape)
        shapes = {c.name: linearised_shape(found.mode_of(c, i), float(found.speeds[i]), channels) for c in found.curves}
    modes = []
    for curve in found.curves:
        values = (curve.frequency, curve.frequency_std, curve.damping, curve.damping_std)
        f, f_std, z, z_std = (float(np.interp(speed, found.speeds, v)) for v in values)
        if math.isfinite(f) and f > 0.0:
            modes.append(ModelMode(curve.name, f, f_std, z, z_std, shapes.get(curve.name, {})))
    blades = found.orders[1] if len(found.orders) > 1 else USUAL_BLADES
    return found.turbine, modes, blades, notes
