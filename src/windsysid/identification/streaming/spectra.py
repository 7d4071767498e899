"""Spectra of records that come in pieces: blocks are added, and nothing else is kept.

A piece is cut into blocks as long as the first piece: of equal turns where the rotor's turns couple what moves, of
equal time elsewhere and where a rotor is read in bands. Of each block only the products Y Yᴴ are kept
(`windsysid.spectral.transforms.lifted_blocks`, `windsysid.spectral.transforms.rotating_frame`), and from their sums the
posterior is found as from a whole record (`windsysid.identification.estimate.frequency_domain`). Memory and the time of
the search do not depend on how long a record is, and records of one machine in one state add.

The taper takes little notice of a block's ends. So each begins before the one before it ends, by half of what the taper
takes to rise: then every sample counts nearly alike.
"""

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid._version import __version__
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.condition.readings import MAX_READING_OF_SPECTRA, check_length
from windsysid.identification.condition.spectral_readings import read_bridged
from windsysid.identification.estimate.frequency_domain import ask, identify_by_spectrum
from windsysid.identification.estimate.narrow_band import doubts_of_narrow_band
from windsysid.identification.estimate.narrow_band_alternative import narrow_band_beside
from windsysid.identification.estimate.online import another_call, check_call
from windsysid.identification.estimate.prior_conflict import note_wide_priors, with_wide_priors
from windsysid.identification.model.fit import known_inputs
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.identification.streaming.driver import take_in
from windsysid.identification.verdict.conclude import conclude
from windsysid.inspection.fault import Fault
from windsysid.mechanics.sensors import Sensor
from windsysid.output.files import claim_file
from windsysid.records.record import Record
from windsysid.results.finding import Finding, read_finding
from windsysid.results.identification import Identification
from windsysid.results.provenance import RecordHash, record_hash, sensor_tables, trace, turbine_hash
from windsysid.spectral.rotor.build import harmonics_of, turns_couple
from windsysid.spectral.rotor_bands.build import belongs_in_bands, highest_in_bands
from windsysid.spectral.rotor_bands.channels import turned_spectra
from windsysid.spectral.transforms.dft import TAPERED
from windsysid.spectral.transforms.lifted import FIRST_BIN, Lifted, lift
from windsysid.spectral.transforms.lifted_blocks import LiftedSums, sums_of
from windsysid.spectral.transforms.rotating_frame import TurnedSums
from windsysid.turbine.turbine import Turbine

__all__ = ["identify_spectra_of_pieces"]

_BEGINNING = 1000
"""Samples by which another record is told at once."""

LEAST_TURNS = 2 * FIRST_BIN + 1
"""Of a rotor in a block: with fewer there is no bin between its harmonics."""


def identify_spectra_of_pieces(
    pieces: Iterable[Record], turbine: Turbine, *, sensors: Sequence[Sensor] | None, prior: Prior,
    parameters: Sequence[str] | None, loads: str, memory: float | None, checkpoint: Path | None, keep_checkpoint: bool,
    progress: Callable[[float], None] | None, options: Mapping[str, Any],
) -> Identification:  # fmt: skip
    """What `windsysid.identify_pieces` finds from spectra; arguments as there.

    Raises
    ------
    RecordError, ConfigurationError
        If a piece does not hold what is needed, or the checkpoint belongs to another call.
    """
    started = time.perf_counter()

    def begin(first: Record, found: tuple[Sensor, ...]) -> _Run:
        return _Run(first, turbine, found, prior, parameters, loads, memory, checkpoint, options)

    return take_in(
        pieces, turbine, sensors, begin, started, checkpoint=checkpoint, keep_checkpoint=keep_checkpoint,
        progress=progress,
    )  # fmt: skip


class _Run:
    """One pass over the pieces."""

    def __init__(
        self, first: Record, turbine: Turbine, sensors: tuple[Sensor, ...], prior: Prior, chosen: Sequence[str] | None,
        loads: str, memory: float | None, checkpoint: Path | None, options: Mapping[str, Any],
    ) -> None:  # fmt: skip
        listed = None if chosen is None else list(chosen)
        beginning = replace(first, time=first.time[:_BEGINNING], values=first.values[:_BEGINNING])
        self.options = {
            "formulation": "spectral", "prior": asdict(prior), "parameters": listed, "loads": loads, "memory": memory,
            **options,
        }  # fmt: skip
        self.call = {
            "version": __version__, "turbine": turbine_hash(turbine), "sensors": sensor_tables(sensors),
            "length of pieces": first.on_uniform_grid().samples, "record": record_hash(beginning), **self.options,
        }  # fmt: skip
        self.checkpoint, self.first, self.turbine, self.sensors = checkpoint, first, turbine, sensors
        self.prior, self.chosen, self.loads = prior, chosen, loads
        self.notes: list[Finding] = []
        self.seen = seen_by(turbine, sensors, self.notes)
        part = first.on_uniform_grid()
        self.rate = part.rate
        check_length(part.name, part.duration, part.rate, turbine, MAX_READING_OF_SPECTRA)
        inputs, readings = self._columns(part)
        question = ask(part, self.seen, sensors, prior, chosen, inputs, readings, "broadband")
        coupled = turns_couple(question)
        self.bands = coupled and belongs_in_bands(question)
        self.coupled = coupled and not self.bands
        if self.bands:
            self.highest = math.ceil(highest_in_bands(question) * part.duration)
        self.harmonics = 0 if self.bands else harmonics_of(question)
        self.samples = part.samples
        self.turns = math.floor(abs(float(inputs[-1, 0] - inputs[0, 0])) / (2.0 * math.pi)) if self.coupled else 0
        if self.coupled and self.turns < LEAST_TURNS:
            raise RecordError(
                f"pieces: expected at least {LEAST_TURNS} turns of the rotor in the first, got {self.turns}: make them "
                f"longer"
            )
        self.memory = 1.0 if memory is None else math.exp(-part.duration / memory)
        self.sums: LiftedSums | TurnedSums | None = None
        self.speeds: list[float] = []
        self.last: Record | None = None
        self.wind, self.hash, self.taken = [0.0, 0.0], RecordHash(), 0
        self.stopped: dict[str, Any] = {"samples": 0, "taken": ""}
        if checkpoint is not None and checkpoint.exists():
            self.stopped = check_call(checkpoint, self.call)

    def _columns(self, part: Record) -> tuple[Array, Array]:
        readings = read_bridged(part, [sensor.channel for sensor in self.sensors], self.notes)
        return known_inputs(part, self.seen, self.sensors), readings

    def take(self, piece: Record) -> None:
        """The next piece as it was recorded."""
        self.hash.take(piece)
        self.taken += piece.samples
        known = int(self.stopped["samples"])
        if self.taken <= known:
            if self.taken == known:
                self._resume()
            return
        if self.taken - piece.samples < known:
            raise self._another("record")
        part = piece.on_uniform_grid()
        if abs(part.rate / self.rate - 1.0) > 0.01:
            raise RecordError(f"{part.name}: expected pieces of {self.rate:.6g} Hz, got one of {part.rate:.6g} Hz")
        if "wind_speed" in part:
            self.wind[0] += float(np.nansum(part["wind_speed"]))
            self.wind[1] += float(np.isfinite(part["wind_speed"]).sum())
        joined = _joined(self.last, part)
        inputs, readings = self._columns(joined)
        first = 0
        while (count := self._length(inputs[first:, 0])) is not None:
            self._add(inputs[first : first + count], readings[first : first + count])
            first += round((1.0 - 0.5 * TAPERED) * count)
        self.last = replace(joined, time=joined.time[first:], values=joined.values[first:])
        self._save()

    def _length(self, azimuth: Array) -> int | None:
        """How many samples the next block has; None if it is not all there."""
        if not self.coupled:
            return self.samples if len(azimuth) >= self.samples else None
        if len(azimuth) < 2:
            return None
        turned = np.abs(azimuth - azimuth[0])
        end = int(np.searchsorted(turned, 2.0 * math.pi * self.turns))
        return end + 1 if end < len(azimuth) else None

    def _add(self, inputs: Array, readings: Array) -> None:
        if self.bands:
            turned = turned_spectra(readings, inputs[:, 0], self.rate, 1)
            turned = turned._replace(data={k: Y[: self.highest + 1] for k, Y in turned.data.items()})
            support = np.array([not sensor.blade for sensor in self.sensors])
            before = self.sums
            assert not isinstance(before, LiftedSums)
            self.sums = TurnedSums.of(turned, support) if before is None else before.plus(turned, self.memory)
        else:
            block = lift(readings, inputs[:, 0], self.rate, self.harmonics)
            known = self.sums
            assert not isinstance(known, TurnedSums)
            self.sums = sums_of(block) if known is None else known.plus(block, self.memory)
        speed, varies = float(inputs[:, 1].mean()), float(inputs[:, 1].std())
        self.speeds += [speed - varies, speed + varies]  # which have the same mean and standard deviation
        self.inputs = inputs

    def _save(self) -> None:
        """Write what is known."""
        if self.checkpoint is None or self.last is None:
            return
        arrays: dict[str, Any] = {"time": self.last.time, "values": self.last.values, "speeds": np.array(self.speeds)}
        if isinstance(self.sums, TurnedSums):
            arrays |= {"inputs": self.inputs, **{f"turned_{name}": value for name, value in self.sums.stored().items()}}
        elif self.sums is not None:
            arrays |= {
                "power": self.sums.power, "blocks": np.asarray(self.sums.blocks), "energies": self.sums.energies,
                "inputs": self.inputs,
            }  # fmt: skip
            arrays |= {f"last_{name}": np.asarray(value) for name, value in self.sums.last._asdict().items()}
        progress = {
            "samples": self.taken,
            "taken": str(self.hash),
            "wind": self.wind,
            "notes": [note.summary() for note in self.notes],
        }
        progress |= {"channels": list(self.last.channels)}
        for name, told in (("call", self.call), ("progress", progress)):
            arrays[name] = np.asarray(json.dumps(told))
        with claim_file(self.checkpoint, overwrite=True) as write:
            write(lambda file: np.savez(file, **arrays))

    def _resume(self) -> None:
        """Take up what was known when the pieces so far had been taken in."""
        if str(self.hash) != self.stopped["taken"]:
            raise self._another("record")
        assert self.checkpoint is not None
        with np.load(self.checkpoint, allow_pickle=False) as archive:
            self.last = replace(self.first, time=archive["time"], values=archive["values"])
            self.speeds = archive["speeds"].tolist()
            if "turned_powers" in archive:
                names = [name for name in archive if name.startswith("turned_")]
                self.sums = TurnedSums.restored({name.removeprefix("turned_"): archive[name] for name in names})
                self.inputs = archive["inputs"]
            elif "power" in archive:
                last = {name: archive[f"last_{name}"] for name in Lifted._fields}
                numbers = {name: float(last[name]) for name in ("rotor_hz", "overlap", "duration", "rate")}
                block = Lifted(**{**last, **numbers})
                self.sums = LiftedSums(archive["power"], float(archive["blocks"]), block, archive["energies"])
                self.inputs = archive["inputs"]
        self.wind, self.notes = list(self.stopped["wind"]), list(map(read_finding, self.stopped["notes"]))

    def _another(self, what: str) -> ConfigurationError:
        assert self.checkpoint is not None
        return another_call(self.checkpoint, [what])

    def conclude(self, started: float, faults: Sequence[Fault]) -> Identification:
        """The result."""
        if self.taken < int(self.stopped["samples"]):
            raise self._another("record")
        if self.sums is None or self.last is None:
            raise RecordError(f"{self.first.name}: expected a whole block of turns, got less: choose longer pieces")
        begun, ended = float(self.first.time[0]), float(self.last.time[-1])
        inputs, sums = self.inputs, self.sums
        outcome, _ = with_wide_priors(
            lambda prior: identify_by_spectrum(
                self.first.on_uniform_grid(), self.turbine, self.sensors, prior, self.chosen, loads=self.loads,
                sums=sums, speeds=np.array(self.speeds),
            ),
            self.prior,
        )  # fmt: skip
        whole = self.first.on_uniform_grid()
        beside = narrow_band_beside(outcome, whole, self.turbine, self.sensors, sums)
        outcome = outcome._replace(doubts=(*outcome.doubts, *doubts_of_narrow_band(beside, asked=outcome.hypothesis)))
        data = {
            "blocks": len(sums.energies), "turns": self.turns, "duration": sums.last.duration,
            "weight": sums.blocks if self.memory < 1.0 else None,
        }  # fmt: skip
        blocks = Finding("blocks", "note", data)
        outcome = note_wide_priors(outcome)
        outcome = outcome._replace(
            rotor=inputs, notes=tuple(dict.fromkeys([*self.notes, *outcome.notes, blocks])),
            elapsed=time.perf_counter() - started,
        )  # fmt: skip
        read = replace(self.last, name=self.first.name, time=self.last.time[-2:], values=self.last.values[-2:])
        return conclude(
            outcome, read, "spectral", section=(begun, ended), samples=self.taken, history_time=np.array([ended]),
            wind_speed=self.wind[0] / self.wind[1] if self.wind[1] else None,
            provenance=trace(self.first, str(self.hash), self.turbine, self.sensors, self.options), faults=faults,
        )  # fmt: skip


def _joined(before: Record | None, piece: Record) -> Record:
    """A piece with what is left of those before it, where it goes on from there."""
    if before is None or not len(before.time):
        return piece
    step = 1.0 / piece.rate
    if abs(float(piece.time[0] - before.time[-1]) - step) > 0.5 * step or before.channels != piece.channels:
        return piece  # another record, or a gap
    return replace(
        piece, time=np.concatenate([before.time, piece.time]), values=np.vstack([before.values, piece.values])
    )
