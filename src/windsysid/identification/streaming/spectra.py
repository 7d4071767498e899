"""Accumulator of the spectral formulation: sums over blocks, and nothing else.

Segments are cut into blocks as long as the first of them: of equal turns where the rotor's turns couple what moves, of
equal time otherwise and where a rotor is read in bands. Of each block only the products v vᴴ are kept
(`windsysid.spectral.transforms.block_sums`), and from their sums the posterior is found as from a whole record
(`windsysid.identification.estimate.spectral.frequency_domain`). Memory and the time of the search do not depend on how
long a record is, and records of one machine in one state add.

The taper gives little weight to a block's ends. So each begins before the one before it ends, by half of what the taper
takes to rise: then every sample counts nearly alike.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.identification.condition.readings import check_length
from windsysid.identification.condition.segments import require_alike
from windsysid.identification.condition.spectral_readings import SpectralSamples
from windsysid.identification.estimate.prior_conflict import note_wide_priors, with_wide_priors
from windsysid.identification.estimate.spectral.frequency_domain import SpectralBlocks, ask, identify_by_spectrum
from windsysid.identification.estimate.spectral.narrow_band import doubts_of_narrow_band
from windsysid.identification.estimate.spectral.narrow_band_alternative import narrow_band_beside
from windsysid.identification.limits import MAX_RADIANS_PER_SPECTRAL_READING
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.identification.streaming.run import SegmentsEstimate, StreamingJob
from windsysid.records.record import Record
from windsysid.results.finding import Finding, read_finding
from windsysid.spectral.rotor.build import harmonics_of, turns_couple
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.spectral.rotor_bands.build import belongs_in_bands, highest_in_bands
from windsysid.spectral.transforms.block_sums import BlockSums, cut_blocks, cut_turns
from windsysid.spectral.transforms.dft import TAPERED_SHARE
from windsysid.spectral.transforms.lifted import FIRST_BIN, Lifted, lift
from windsysid.spectral.transforms.rotating_frame import MAX_GROUPS, TurnedBlock, turned_block, turned_spectra

__all__ = ["BlockLayout", "SpectraAccumulator", "layout_of"]

OVERLAP_SHARE = 0.5 * TAPERED_SHARE
"""Setting: share of a block that the next one repeats."""


class BlockLayout(NamedTuple):
    """Block length of a record and transform of a block.

    Attributes
    ----------
    rate, samples, turns
        Of the readings [Hz], and what a block has: a number of samples or, unless it is 0, of turns of the rotor.
    harmonics
        K of the lifted spectrum.
    support, highest
        Which readings (m,) are not on blades, and the last bin that is read, of a rotor in bands; None of a lifted
        spectrum.
    """

    rate: float
    samples: int
    turns: int
    harmonics: int
    support: NDArray[np.bool_] | None
    highest: int

    def cut(self, azimuth: Array) -> tuple[list[slice], int]:
        """The whole blocks, and the sample with which the next one begins."""
        if self.turns:
            return cut_turns(azimuth, self.turns, OVERLAP_SHARE)
        return cut_blocks(len(azimuth), self.samples, OVERLAP_SHARE)

    def transform(self, readings: Array, azimuth: Array) -> Lifted | TurnedBlock:
        """The transforms of one block."""
        if self.support is None:
            return lift(readings, azimuth, self.rate, self.harmonics)
        return turned_block(turned_spectra(readings, azimuth, self.rate, 1), self.support, self.highest)

    @property
    def kind(self) -> type[Lifted] | type[TurnedBlock]:
        """The class of a block's transforms."""
        return Lifted if self.support is None else TurnedBlock


def layout_of(part: Record, question: RotorQuestion) -> BlockLayout:
    """Block length and transform of a record that begins with a segment; RecordError where the segment
    has too few turns of the rotor."""
    if not turns_couple(question):
        return BlockLayout(part.rate, part.samples, 0, harmonics_of(question), None, 0)
    if belongs_in_bands(question):
        support = np.array([not sensor.blade for sensor in question.sensors])
        highest = math.ceil(highest_in_bands(question) * part.duration)
        return BlockLayout(part.rate, part.samples, 0, 0, support, highest)
    turns = math.floor(abs(float(question.inputs[-1, 0] - question.inputs[0, 0])) / (2.0 * math.pi))
    least = 2 * FIRST_BIN + 1  # with fewer there is no bin between its harmonics
    if turns < least:
        raise RecordError(
            f"pieces: expected at least {least} turns of the rotor in the first, got {turns}: make them longer"
        )
    return BlockLayout(part.rate, part.samples, turns, harmonics_of(question), None, 0)


class SpectraAccumulator:
    """Sums over the blocks of the segments, and the samples after the last whole block."""

    def __init__(self, first: Record, job: StreamingJob) -> None:
        self.first, self.job, self.sensors = first, job, tuple(job.sensors or ())
        self.notes: list[Finding] = []
        self.seen = seen_by(job.turbine, self.sensors, self.notes)
        part = first.on_uniform_grid()
        check_length(part.name, part.duration, part.rate, job.turbine, MAX_RADIANS_PER_SPECTRAL_READING)
        samples = self._samples(part)
        question = ask(samples, self.seen, job.prior, job.parameters, "broadband")
        self.layout = layout_of(part, question)
        self.memory = 1.0 if job.memory is None else math.exp(-part.duration / job.memory)
        self.sums: BlockSums[Any] | None = None
        self.speeds: list[float] = []
        self.last: Record | None = None
        self.inputs, self.taken = samples.inputs, 0

    def _samples(self, part: Record) -> SpectralSamples:
        return SpectralSamples.of(part, self.seen, self.sensors, self.notes)

    def replay(self, segment: Record) -> None:
        """Take a segment that a checkpoint knows: its sums are in there."""
        self.taken += segment.samples

    def take(self, segment: Record) -> Record:
        """Take the next segment as it was recorded."""
        self.taken += segment.samples
        part = segment.on_uniform_grid()
        require_alike(part, self.layout.rate)
        joined = _joined(self.last, part)
        samples = self._samples(joined)
        inputs, readings = samples.inputs, samples.readings
        blocks, first = self.layout.cut(inputs[:, 0])
        for block in blocks:
            self._add(inputs[block], readings[block])
        self.last = replace(joined, time=joined.time[first:], values=joined.values[first:])
        return part

    def _add(self, inputs: Array, readings: Array) -> None:
        block = self.layout.transform(readings, inputs[:, 0])
        if self.sums is None:
            self.sums = BlockSums.of(block, 1 if self.layout.support is None else MAX_GROUPS)
        else:
            self.sums = self.sums.plus(block, self.memory)
        speed, varies = float(inputs[:, 1].mean()), float(inputs[:, 1].std())
        self.speeds += [speed - varies, speed + varies]  # which have the same mean and standard deviation
        self.inputs = inputs

    def finish(self) -> None:
        """Nothing remains: an incomplete block is dropped."""

    def stored(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """The sums, the samples after the last block, the speeds; and the notes."""
        if self.last is None:
            return {}, {}
        arrays = {"time": self.last.time, "values": self.last.values, "speeds": np.array(self.speeds)}
        if self.sums is not None:
            arrays |= {"inputs": self.inputs, **self.sums.stored()}
        return arrays, {"notes": [note.summary() for note in self.notes]}

    def restore(self, arrays: Mapping[str, Any], progress: Mapping[str, Any]) -> None:
        """Restore from `stored`."""
        self.last = replace(self.first, time=arrays["time"], values=arrays["values"])
        self.speeds, self.notes = arrays["speeds"].tolist(), list(map(read_finding, progress["notes"]))
        if "powers" in arrays:
            self.sums, self.inputs = BlockSums.restored(arrays, self.layout.kind), arrays["inputs"]

    def estimate(self) -> SegmentsEstimate:
        """Find the mode of the posterior from the sums."""
        if self.sums is None or self.last is None:
            raise RecordError(f"{self.first.name}: expected a whole block of turns, got less: choose longer pieces")
        job, sums, whole = self.job, self.sums, self.first.on_uniform_grid()
        outcome, _ = with_wide_priors(
            lambda prior: identify_by_spectrum(
                whole, job.turbine, self.sensors, prior, job.parameters, loads=job.loads,
                blocks=SpectralBlocks(sums, np.array(self.speeds)),
            ),
            job.prior,
        )  # fmt: skip
        beside = narrow_band_beside(outcome, whole, job.turbine, self.sensors, sums)
        outcome = outcome._replace(doubts=(*outcome.doubts, *doubts_of_narrow_band(beside, asked=outcome.hypothesis)))
        outcome = note_wide_priors(outcome)
        notes = dict.fromkeys([*self.notes, *outcome.notes, self._describe_blocks(sums)])
        read = replace(self.last, name=self.first.name, time=self.last.time[-2:], values=self.last.values[-2:])
        outcome = outcome._replace(rotor=self.inputs, notes=tuple(notes), elapsed=0.0)
        return SegmentsEstimate(outcome, read, self.taken, read.time[-1:])

    def _describe_blocks(self, sums: BlockSums[Any]) -> Finding:
        """Number of blocks, their length, and their total weight."""
        data = {
            "blocks": len(sums.energies), "turns": self.layout.turns, "duration": sums.last.duration,
            "weight": sums.blocks if self.memory < 1.0 else None,
        }  # fmt: skip
        return Finding("blocks", "note", data)


def _joined(before: Record | None, segment: Record) -> Record:
    """A segment with the samples that are left of those before it, where it continues them."""
    if before is None or not len(before.time):
        return segment
    step = 1.0 / segment.rate
    if abs(float(segment.time[0] - before.time[-1]) - step) > 0.5 * step or before.channels != segment.channels:
        return segment  # another record, or a gap
    return replace(
        segment, time=np.concatenate([before.time, segment.time]), values=np.vstack([before.values, segment.values])
    )
