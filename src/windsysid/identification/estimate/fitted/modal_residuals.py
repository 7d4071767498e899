"""Residuals near the modes: tonal components, blade passing; and dead channels."""

import math
from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.checks.blade_passing import find_passing
from windsysid.checks.dead_channel import find_still
from windsysid.checks.limits import HARMONIC_HALF_WIDTH_BINS, LINE_SEARCH_FACTOR, NEGLIGIBLE_SHARE
from windsysid.checks.lines import Line, find_line
from windsysid.errors import RecordError
from windsysid.identification.estimate.fitted.modes import modes_of
from windsysid.identification.model.fit import Outcome
from windsysid.loads.narrow_band import FREQUENCY, WIDTH
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.mode import Mode
from windsysid.signals.rotor import rotor_inputs
from windsysid.turbine.turbine import Turbine

__all__ = [
    "channel_of", "channels_of", "doubts_beside_modes", "line_of", "mode_of", "no_narrower", "ranges_of_narrow_band",
]  # fmt: skip


def doubts_beside_modes(
    outcome: Outcome, record: Record, modes: Sequence[Mode], speed: float, *, filtered: bool
) -> tuple[Finding, ...]:
    """Findings against the modes of a turbine with a mean rotor speed [rad/s]; more of them for filters."""
    if not record.is_uniform:
        return ()
    readings = np.column_stack([record[channel] for channel in outcome.channels])
    still = _still(outcome, readings, record.rate, speed, outcome.final.innovation if filtered else None)
    return (*still, *(_passed(outcome, record, readings, modes) if filtered else ()))


def line_of(outcome: Outcome, record: Record) -> Line | None:
    """Strongest line near a mode, except for a narrow-band load that was found; modes are not
    narrower than the file's: a line that was taken for one is."""
    at = modes_of(outcome)
    if not (at.modes and record.is_uniform):
        return None
    known = no_narrower(outcome.turbine, at.modes)
    readings = np.column_stack([record[channel] for channel in outcome.channels])
    rotor_hz = abs(at.speed) / (2.0 * math.pi)
    return find_line(
        readings, outcome.channels, rate=record.rate, modes=known, rotor_hz=rotor_hz,
        known=ranges_of_narrow_band(outcome, record, rotor_hz),
    )  # fmt: skip


def ranges_of_narrow_band(outcome: Outcome, record: Record, rotor_hz: float) -> list[tuple[float, float]]:
    """Frequency of a narrow-band load that was found [Hz], in the fixed and in the rotating frame; none if it
    is as narrow as a line."""
    known = {one.name: one.estimate for one in outcome.statistics}
    if FREQUENCY not in known:
        return []
    own, width = known[FREQUENCY], known[FREQUENCY] * known[WIDTH]
    if 2.0 * width * record.duration < 1.0:
        return []
    away = max(HARMONIC_HALF_WIDTH_BINS * width, HARMONIC_HALF_WIDTH_BINS / record.duration)
    return [(abs(seen) - away, abs(seen) + away) for seen in (own - rotor_hz, own, own + rotor_hz)]


def no_narrower(file: Turbine, modes: Sequence[Mode]) -> list[tuple[float, float]]:
    """Frequency [Hz] and damping ratio of modes, none narrower than the file's."""
    return [(m.frequency.estimate, max(m.damping_ratio.estimate, _usual_damping(file, m))) for m in modes]


def _usual_damping(file: Turbine, mode: Mode) -> float:
    """The file's damping ratio of a mode or, where it has none of that name, of the degree of freedom that vibrates
    most nearly as fast: a line may turn two modes of a tower into two that whirl."""
    if mode.damping_ratio.reference is not None:
        return mode.damping_ratio.reference
    known = [mode_of(file, name) for name in file.model.coordinates if file.natural_frequency(name) > 0.0]
    return min(((abs(math.log(f / mode.frequency.estimate)), ratio) for f, ratio in known), default=(0.0, 0.0))[1]


def _still(outcome: Outcome, readings: Array, rate: float, speed: float, errors: Array | None) -> tuple[Finding, ...]:
    """Finding on dead channels; the file's frequencies are used: the fit's may be anywhere then."""
    if errors is not None and errors.shape != readings.shape:
        errors = None
    natural = [mode_of(outcome.turbine, name)[0] for name in outcome.turbine.model.coordinates]
    measured = (channels_of(outcome) or {"": set(outcome.channels)}).values()
    sees = np.array([[channel in one for one in measured] for channel in outcome.channels], dtype=np.float64)
    still = find_still(
        readings, outcome.channels, rate=rate, frequencies=natural, rotor_hz=abs(speed) / (2.0 * math.pi),
        innovations=errors, apart=sees @ sees.T == 0.0,
    )  # fmt: skip
    return (Finding("dead_channel", "reason", {"channels": still}),) if still else ()


def _passed(outcome: Outcome, record: Record, readings: Array, modes: Sequence[Mode]) -> tuple[Finding, ...]:
    """That blades pass a support at a steady speed where it has a mode, as a doubt."""
    model = outcome.turbine.model
    if any(one.blade for one in model.freedoms) or "rotor_azimuth" not in record:
        return ()
    try:
        psi = rotor_inputs(record, abs(outcome.turbine.rotor_speed))[:, 0]
    except RecordError:  # an azimuth that was not needed
        return ()
    readings = np.nan_to_num(readings - np.nanmean(readings, axis=0))
    known = [("", *mode) for mode in no_narrower(outcome.turbine, modes)]
    found = find_passing(known, model.blades, readings=(readings, psi, record.rate))
    return () if found is None else (found.finding(model.blades),)


def mode_of(turbine: Turbine, name: str) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio of a degree of freedom by itself."""
    return turbine.natural_frequency(name) / (2.0 * math.pi), turbine.damping(name) / turbine.critical_damping(name)


def channel_of(outcome: Outcome, record: Record, name: str) -> str | None:
    """Channel in the fixed frame without gaps that shows a degree of freedom best, of those with hardly anything else
    near its frequency; None if there is none."""
    file = outcome.turbine
    hz = {other: file.natural_frequency(other) for other in file.model.coordinates}  # free ones have none
    low, high = hz[name] / LINE_SEARCH_FACTOR, hz[name] * LINE_SEARCH_FACTOR
    near = [low < hz[other] < high for other in hz if other != name]
    i = list(hz).index(name)
    seen, turned = (np.abs(_seen(outcome, turn)) for turn in (0.0, 1.0))
    own, rest = seen[:, i], np.delete(seen, i, axis=1)[:, near]
    stands = np.isclose(own, turned[:, i]) & (own > 0.0)
    values = np.column_stack([record[channel] for channel in outcome.channels])
    alone = stands & np.isfinite(values).all(axis=0) & (rest < NEGLIGIBLE_SHARE * own[:, None]).all(axis=1)
    if not alone.any():
        return None
    return outcome.channels[int(np.argmax(np.where(alone, own / np.maximum(values.std(axis=0), 1e-300), -1.0)))]


def channels_of(outcome: Outcome) -> dict[str, set[str]] | None:
    """For each degree of freedom the channels that measure it; None if blades move, which couple all of them."""
    model = outcome.turbine.model
    if any(freedom.blade for freedom in model.freedoms):
        return None
    seen = np.abs(_seen(outcome, 0.0))
    measures = seen >= NEGLIGIBLE_SHARE * seen.max(axis=1, keepdims=True)
    return {
        name: {channel for channel, own in zip(outcome.channels, column, strict=True) if own}
        for name, column in zip(model.coordinates, measures.T, strict=True)
    }


def _seen(outcome: Outcome, turn: float) -> Array:
    """Weights of each degree of freedom's displacement in the readings (m, n), at an azimuth [rad]."""
    file, compiled = outcome.turbine, outcome.model.compiled
    p, (n, m) = np.array([file.values[name] for name in compiled.parameters]), (len(compiled.states), compiled.readings)
    seen, loads, inputs = np.zeros((m, n)), len(compiled.loads), outcome.rotor.mean(axis=0)[: len(compiled.inputs)]
    inputs = np.where([name == "rotor_azimuth" for name in compiled.inputs], turn, inputs)
    others = np.zeros((m, len(compiled.identified))), np.zeros((m, loads))
    compiled.reading_jacobian(np.zeros(n), inputs, p, np.zeros(loads), np.zeros(m), seen, *others)
    return seen[:, : len(file.model.coordinates)]
