"""Equations of one's own, identified from the spectra of a stationary record.

The equations are linearised about a working point (`windsysid.spectral.lti.system`), the record becomes sums of
cross-spectra over blocks (`windsysid.spectral.transforms.cross_spectra`), and the mode of the posterior is found by
scoring (`windsysid.spectral.lti.fit`). A whole record is one block. Of pieces each is cut into blocks as long as the
first of them, so that the memory does not grow; what is left at a piece's end is not used.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError, WindsysidError
from windsysid.identification.condition.spectral_readings import read_bridged
from windsysid.identification.model.equations_problem import constant_loads, known_columns
from windsysid.inspection.health import Finding
from windsysid.inspection.screening import doubted, noted, screen
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.mechanics.model import Model
from windsysid.records.record import LOW_PASS, Record
from windsysid.spectral.lti.check import doubts_of, frequency_ranges, range_energies
from windsysid.spectral.lti.fit import LinearFit, fit_linear
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.rotor.load_filters import load_shapes
from windsysid.spectral.transforms.cross_spectra import CrossSpectra, cross_spectra
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import Unknowns

__all__ = ["EquationsQuestion", "SpectralFit", "fit_by_spectra"]

NYQUIST_SHARE = 0.8
"""Of half the sampling rate: no frequency above it is used."""

BEYOND = 2.0
"""Spectra are read from the lowest natural frequency that the priors allow, over this, to the highest, times this:
beyond they say nothing of the structure, and the shape of a load has to hold over a narrower range."""

LEAST_BINS = 30
"""Fewest bins of a block."""

VARIES = 1e-6
"""Standard deviation of an input, beside its size, from which it is no working point."""


class SpectralFit(NamedTuple):
    """What the spectra of a record say.

    Attributes
    ----------
    model
        Name of the equations.
    fit, unknowns
        Mode of the posterior of θ and η, and its covariance; names of the unknowns.
    last
        The record, or the last piece.
    begun, samples
        Its first time [s], and how many samples there were.
    notes, doubts
        What a reader must know, and what speaks against the bands.
    """

    model: str
    fit: LinearFit
    unknowns: Unknowns
    last: Record
    begun: float
    samples: int
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


class EquationsQuestion(NamedTuple):
    """Equations of one's own, and what is to be identified in them; arguments as of `windsysid.fit`.

    Attributes
    ----------
    mean
        Where the working point is looked for.
    known
        Values of the other parameters.
    levels
        Prior standard deviations of η.
    """

    model: Model
    parameters: Sequence[Parameter]
    sensors: Sequence[Any]
    mean: ArrayLike | None
    known: Mapping[str, float]
    loads: Sequence[LoadModel]
    channels: Mapping[str, str]
    levels: Array

    @property
    def names(self) -> list[str]:
        """The channels that are read."""
        return [sensor.channel for sensor in self.sensors]


def fit_by_spectra(question: EquationsQuestion, record: Record | Iterable[Record]) -> SpectralFit:
    """Identify parameters from the spectra of a record, or of its pieces.

    Raises
    ------
    RecordError, ConfigurationError, WindsysidError
        If the record has gaps, an input varies, a load turns, or no spectrum of the model is positive.
    """
    sums: _Sums | None = None
    for piece in [record] if isinstance(record, Record) else record:
        part = piece.on_uniform_grid()
        faults = screen(part, None, question.names, refuse=sums is None)
        notes: list[str] = []
        readings = read_bridged(part, question.names, notes)
        if sums is None:
            sums = _Sums(question, part, readings)
        sums.take_in(part, readings, faults, notes)
    if sums is None:
        raise RecordError("no pieces: expected at least one, got an empty record")
    return sums.conclude(halved=isinstance(record, Record))


class _Sums:
    """Sums over the blocks of a record, and what was met on the way.

    Attributes
    ----------
    last, readings
        The last piece, and what its sensors read.
    """

    def __init__(self, question: EquationsQuestion, part: Record, readings: Array) -> None:
        self.question, self.last, self.readings = question, part, readings
        self.linear = _linear_model(question, part)
        self.limits = _limits(self.linear, part)
        self.ranges = frequency_ranges(self.limits)
        self.total = _blank(readings, part.rate, self.limits)
        self.begun, self.samples = float(part.time[0]), 0
        self.energies: list[Array] = []
        self.faults: list[Finding] = []
        self.notes: list[str] = []

    def take_in(self, part: Record, readings: Array, faults: Sequence[Finding], notes: Sequence[str]) -> None:
        """Add the blocks of a piece."""
        total = self.total
        if abs(part.rate / total.rate - 1.0) > 0.01:
            raise RecordError(f"{part.name}: expected pieces of {total.rate:.6g} Hz, got one of {part.rate:.6g} Hz")
        for first in range(0, len(readings) - total.samples + 1, total.samples):
            block = cross_spectra(readings[first : first + total.samples], part.rate, self.limits)
            self.energies.append(range_energies(block, self.ranges))
            self.total = self.total + block
        self.samples += len(readings)
        self.last, self.readings = part, readings
        self.faults += faults
        self.notes += notes

    def conclude(self, *, halved: bool) -> SpectralFit:
        """Fit the sums; a record of one block is `halved` to see whether it is stationary."""
        total, energies = self.total, self.energies
        if halved:
            half = len(self.readings) // 2
            parts = self.readings[:half], self.readings[half : 2 * half]
            energies = [range_energies(cross_spectra(r, total.rate, self.limits), self.ranges) for r in parts]
        linear = self.linear._replace(blur=total.rate / total.samples)
        try:
            found = fit_linear(linear, total)
            doubts = doubts_of(linear, total, found, self.question.names, energies, self.ranges)
        except np.linalg.LinAlgError:
            raise WindsysidError(
                "no spectrum of this model is positive: expected a stable system, and loads, noise and priors of the "
                "size of the record's"
            ) from None
        seconds = total.samples / total.rate
        read = (
            f"read in {total.blocks:g} block{'s' * (total.blocks != 1)} of {seconds:.4g} s, at "
            f"{total.frequency[0]:.3g} … {total.frequency[-1]:.3g} Hz"
        )
        told, against = (*self.notes, read, *noted(self.faults)), (*doubted(self.faults), *doubts)
        return SpectralFit(
            linear.compiled.name, found, linear.unknowns, self.last, self.begun, self.samples, told, against
        )


def _linear_model(question: EquationsQuestion, part: Record) -> LinearModel:
    """The spectrum as a function of the unknowns, at the inputs of a record."""
    compiled = compile_model(question.model, question.sensors)
    values = _values(compiled, question)
    inputs, at = _working_point(compiled, question, part)
    if not question.loads:
        raise ConfigurationError("loads: expected models of what drives the structure for spectra, got none")
    start = np.zeros(len(compiled.states)) if question.mean is None else np.array(question.mean, dtype=np.float64)
    if start.shape != (len(compiled.states),):
        raise ConfigurationError(f"mean: expected {len(compiled.states)} states, got shape {start.shape}")
    noise, drift = (np.array([getattr(sensor, name) for sensor in question.sensors]) for name in ("noise", "drift"))
    return LinearModel(
        compiled, values, inputs, at, start, tuple(question.parameters), 2.0 * noise**2 / part.rate,
        2.0 * (drift / (2.0 * np.pi)) ** 2, load_shapes(question.loads, compiled.loads), question.levels,
    )  # fmt: skip


def _values(compiled: CompiledModel, question: EquationsQuestion) -> Array:
    """All parameters (n_p,), those that are identified at the centres of their priors."""
    values = {**question.known, **{q.name: q.centre for q in question.parameters}}
    missing = [name for name in compiled.parameters if name not in values]
    if missing:
        raise ConfigurationError(f"parameters without a value: expected it in `values` for {', '.join(missing)}")
    unknown = [q.name for q in question.parameters if q.name not in compiled.parameters]
    if unknown:
        raise ConfigurationError(f"parameters: expected some of {', '.join(compiled.parameters)}; got {unknown[0]}")
    return np.array([values[name] for name in compiled.parameters])


def _working_point(compiled: CompiledModel, question: EquationsQuestion, part: Record) -> tuple[Array, Array]:
    """The constant inputs (n_u,) and loads (n_w,) of a record."""
    constant = constant_loads(compiled.loads, part, question.channels, question.loads, question.known)
    columns = known_columns(compiled, part, question.channels, constant)
    size = np.abs(columns).max(axis=0, initial=0.0)
    varying = np.flatnonzero(columns.std(axis=0) > VARIES * size)
    if len(varying):
        name = (*compiled.inputs, *compiled.loads)[varying[0]]
        raise ConfigurationError(f"'{name}' varies: expected constant inputs for spectra; use formulation='joint'")
    mean = columns.mean(axis=0)
    return np.ascontiguousarray(mean[: len(compiled.inputs)]), np.ascontiguousarray(mean[len(compiled.inputs) :])


def _limits(linear: LinearModel, part: Record) -> tuple[float, float]:
    """Between which frequencies spectra are read [Hz]."""
    most = min(0.5 * part.rate, float(part.attributes.get(LOW_PASS, np.inf))) * NYQUIST_SHARE
    mean, std = linear.prior
    found = []
    for at in (mean + std, mean, mean - std):
        try:
            found.append(linear.natural_frequencies(at[None])[0])
        except ConfigurationError:
            continue
    hz = np.exp(np.concatenate(found)) / (2.0 * np.pi) if found else np.empty(0)
    if not len(hz):
        return 0.0, most
    creeps = len(linear.compiled.states) > 2 * len(found[-1])  # what does not oscillate says something down to 0
    return 0.0 if creeps else float(hz.min()) / BEYOND, min(most, BEYOND * float(hz.max()))


def _blank(readings: Array, rate: float, limits: tuple[float, float]) -> CrossSpectra:
    """Sums over no block yet, of blocks as long as the first readings."""
    like = cross_spectra(readings, rate, limits)
    if len(like.power) < LEAST_BINS:
        raise RecordError(
            f"expected {len(readings) / rate * LEAST_BINS / max(len(like.power), 1):.3g} s or more for spectra, got "
            f"{len(readings) / rate:.3g} s: choose a longer record"
        )
    return like._replace(power=np.zeros_like(like.power), blocks=0.0)
