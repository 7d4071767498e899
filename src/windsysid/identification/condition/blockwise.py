"""Block-wise conditioning: the samples that a filter reads of the segments of a record are those of the whole.

Resampling, and the smooth slopes of azimuth and yaw, look at samples before and after the one they are for. So pieces
are joined: the end of what has come is held back until the samples after it have come too, and what was handed out is
kept as long as later samples look at it.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.condition.readings import (
    check_readings,
    choose_rate,
    note_rate,
    note_steps,
    refine,
    slow_down,
    steps_per_reading,
)
from windsysid.identification.condition.segments import require_alike, steps_after
from windsysid.identification.model.fit import known_inputs, known_loads
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["BlockwiseConditioner", "ConditionedSamples"]

MAX_SMOOTHING_SECONDS = 8.0
"""Setting: seconds that the slopes of azimuth and yaw look ahead and back at most (`windsysid.signals.yaw`,
`windsysid.signals.rotor`)."""

MAX_RESAMPLING_SAMPLES = 50.0
"""Setting: samples of the lower rate that resampling looks ahead and back at most (`windsysid.signals.condition`)."""


class ConditionedSamples(NamedTuple):
    """Consecutive samples as the model takes them: the record at the model's rate, inputs (T, n_u + n_w), readings (T,
    m)."""

    record: Record
    inputs: Array
    readings: Array


class BlockwiseConditioner:
    """Pieces of a record, joined and brought to the model's rate.

    Attributes
    ----------
    steps
        Steps of the equations for each reading.
    rate
        Samples per second that the model takes, `steps` times as many as readings [Hz].
    notes
        What was done to the rate.
    """

    def __init__(self, first: Record, turbine: Turbine, sensors: Sequence[Sensor], rate: float | None) -> None:
        self._turbine, self._sensors = seen_by(turbine, sensors, []), tuple(sensors)
        self._recorded = first.rate
        self._slow = choose_rate(first.rate, math.inf, turbine, rate)
        if self._slow is None:
            check_readings(first.name, first.rate, turbine)
        readings = self._slow or first.rate
        self.steps = steps_per_reading(turbine, readings)
        self.rate = self.steps * readings
        self._margin = MAX_SMOOTHING_SECONDS + (
            MAX_RESAMPLING_SAMPLES / readings if self._slow or self.steps > 1 else 0.0
        )
        self.notes: tuple[Finding, ...] = ()
        if self._slow is not None:
            self.notes = note_rate(first.rate, self._slow, self.steps, turbine)
        elif self.steps > 1:
            self.notes = (note_steps(self.steps),)
        self._held: Record | None = None
        self._origin = float(first.time[0])
        self._reached = -math.inf
        self._azimuth = 0.0

    def take(self, piece: Record) -> ConditionedSamples | None:
        """The samples that are ready now that a piece has come; None where none are.

        Raises
        ------
        RecordError
            If the piece does not go on from the one before.
        """
        require_alike(piece, self._recorded, [sensor.channel for sensor in self._sensors])
        if self._held is None:
            self._held = piece
        else:
            before = self._held
            steps_after(before, piece, self._recorded)
            channels = [name for name in before.channels if name in piece]
            self._held = replace(
                piece.select(channels),
                time=np.concatenate([before.time, piece.time]),
                values=np.vstack([before.select(channels).values, piece.select(channels).values]),
            )
        return self._hand_out(float(self._held.time[-1]) - self._margin)

    def finish(self) -> ConditionedSamples | None:
        """The samples that were held back."""
        return None if self._held is None else self._hand_out(math.inf)

    def _hand_out(self, until: float) -> ConditionedSamples | None:
        """The samples after those handed out and before `until` [s]."""
        held = self._held
        if held is None or until <= self._reached or held.samples < 2:
            return None
        part = self._resampled(held.on_uniform_grid())
        new = (part.time > self._reached + 0.5 / self.rate) & (part.time < until)
        last = int(np.flatnonzero(new)[-1]) + 1 if new.any() else 0
        first = int(np.argmax(new))
        if math.isfinite(until):
            last -= (last - first) % self.steps
        if last <= first:
            return None
        inputs = np.hstack([known_inputs(part, self._turbine, self._sensors), known_loads(part, self._turbine)[0]])
        names = self._turbine.model.inputs
        if "rotor_azimuth" in names:
            azimuth = inputs[:, names.index("rotor_azimuth")]
            if math.isfinite(self._reached):
                azimuth += self._turns(part, azimuth)
            self._azimuth = float(azimuth[last - 1])
        self._reached = float(part.time[last - 1])
        new_rows = slice(first, last)
        kept = held.time >= self._reached - self._margin
        self._held = replace(held, time=held.time[kept], values=held.values[kept])
        record = replace(part, time=part.time[new_rows], values=part.values[new_rows])
        readings = np.column_stack([record[sensor.channel] for sensor in self._sensors])
        return ConditionedSamples(record, inputs[new_rows], readings)

    def _resampled(self, part: Record) -> Record:
        """A part of the record at the rate of the model."""
        read = tuple(sensor.channel for sensor in self._sensors)
        if self._slow is not None:
            start = self._origin + math.ceil((part.time[0] - self._origin) * self._slow - 1e-6) / self._slow
            return slow_down(part, read, self._slow, self.steps, start=start)
        return refine(part, read, self.steps) if self.steps > 1 else part

    def _turns(self, part: Record, azimuth: Array) -> float:
        """Whole turns to be added to the azimuth so that it continues."""
        row = int(np.argmin(np.abs(part.time - self._reached)))
        off = self._azimuth - float(azimuth[row])
        recorded = part["rotor_azimuth"] if "rotor_azimuth" in part else np.full(part.samples, np.nan)
        known = np.flatnonzero(np.isfinite(recorded))
        if known.size and abs(math.remainder(azimuth[known[-1]] - recorded[known[-1]], 2.0 * math.pi)) < 1e-6:
            return 2.0 * math.pi * round(off / (2.0 * math.pi))
        return off
