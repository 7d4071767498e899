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
from windsysid.mechanics.compile import compile_model
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

__all__ = ["SpectralFit", "fit_by_spectra"]

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


def fit_by_spectra(
    model: Model, record: Record | Iterable[Record], parameters: Sequence[Parameter], sensors: Sequence[Any],
    mean: ArrayLike | None, known: Mapping[str, float], loads: Sequence[LoadModel], channels: Mapping[str, str],
    levels: Array,
) -> SpectralFit:  # fmt: skip
    """Identify parameters from spectra; arguments as of `windsysid.fit`.

    `mean` is where the working point is looked for, `levels` the prior standard deviations of η.

    Raises
    ------
    RecordError, ConfigurationError, WindsysidError
        If the record has gaps, an input varies, a load turns, or no spectrum of the model is positive.
    """
    posed: LinearModel | None = None
    total: CrossSpectra | None = None
    last: Record | None = None
    notes: list[str] = []
    energies: list[Array] = []
    samples, begun, limits = 0, 0.0, (0.0, 0.0)
    names = [sensor.channel for sensor in sensors]
    faults: list[Finding] = []
    for piece in [record] if isinstance(record, Record) else record:
        part = piece.on_uniform_grid()
        faults += screen(piece, None, names, refuse=last is None)
        readings = read_bridged(part, names, notes)
        if posed is None or total is None:
            posed = _pose(model, part, parameters, sensors, mean, known, loads, channels, levels)
            begun, limits = float(part.time[0]), _limits(posed, part)
            total = _blank(readings, part.rate, limits)
        elif abs(part.rate / total.rate - 1.0) > 0.01:
            raise RecordError(f"{part.name}: expected pieces of {total.rate:.6g} Hz, got one of {part.rate:.6g} Hz")
        ranges = frequency_ranges(limits)
        for first in range(0, len(readings) - total.samples + 1, total.samples):
            block = cross_spectra(readings[first : first + total.samples], part.rate, limits)
            energies.append(range_energies(block, ranges))
            total = total + block
        if isinstance(record, Record):  # one block is held against itself
            half = len(readings) // 2
            halves = [cross_spectra(r, part.rate, limits) for r in (readings[:half], readings[half : 2 * half])]
            energies = [range_energies(block, ranges) for block in halves]
        samples += len(readings)
        last = part
    if posed is None or total is None or last is None:
        raise RecordError("no pieces: expected at least one, got an empty record")
    posed = posed._replace(blur=total.rate / total.samples)
    try:
        found = fit_linear(posed, total)
        doubts = doubts_of(posed, total, found, names, energies, frequency_ranges(limits))
    except np.linalg.LinAlgError:
        raise WindsysidError(
            "no spectrum of this model is positive: expected a stable system, and loads, noise and priors of the size "
            "of the record's"
        ) from None
    seconds = total.samples / total.rate
    notes.append(
        f"read in {total.blocks:g} block{'s' * (total.blocks != 1)} of {seconds:.4g} s, at {total.frequency[0]:.3g} … "
        f"{total.frequency[-1]:.3g} Hz"
    )
    told, against = (*notes, *noted(faults)), (*doubted(faults), *doubts)
    return SpectralFit(posed.compiled.name, found, posed.unknowns, last, begun, samples, told, against)


def _pose(
    model: Model, part: Record, parameters: Sequence[Parameter], sensors: Sequence[Any], mean: ArrayLike | None,
    known: Mapping[str, float], loads: Sequence[LoadModel], channels: Mapping[str, str], levels: Array,
) -> LinearModel:  # fmt: skip
    """The spectrum as a function of the unknowns, at the inputs of a record."""
    compiled = compile_model(model, sensors)
    values = {**known, **{q.name: q.centre for q in parameters}}
    missing = [name for name in compiled.parameters if name not in values]
    if missing:
        raise ConfigurationError(f"parameters without a value: expected it in `values` for {', '.join(missing)}")
    unknown = [q.name for q in parameters if q.name not in compiled.parameters]
    if unknown:
        raise ConfigurationError(f"parameters: expected some of {', '.join(compiled.parameters)}; got {unknown[0]}")
    constant = constant_loads(compiled.loads, part, channels, loads, known)
    columns = known_columns(compiled, part, channels, constant)
    size = np.abs(columns).max(axis=0, initial=0.0)
    varying = np.flatnonzero(columns.std(axis=0) > VARIES * size)
    if len(varying):
        name = (*compiled.inputs, *compiled.loads)[varying[0]]
        raise ConfigurationError(f"'{name}' varies: expected constant inputs for spectra; use formulation='joint'")
    if not loads:
        raise ConfigurationError("loads: expected models of what drives the structure for spectra, got none")
    inputs, at = columns.mean(axis=0)[: len(compiled.inputs)], columns.mean(axis=0)[len(compiled.inputs) :]
    start = np.zeros(len(compiled.states)) if mean is None else np.array(mean, dtype=np.float64)
    if start.shape != (len(compiled.states),):
        raise ConfigurationError(f"mean: expected {len(compiled.states)} states, got shape {start.shape}")
    noise = 2.0 * np.array([sensor.noise for sensor in sensors]) ** 2 / part.rate
    drift = 2.0 * (np.array([sensor.drift for sensor in sensors]) / (2.0 * np.pi)) ** 2
    return LinearModel(
        compiled, np.array([values[name] for name in compiled.parameters]), np.ascontiguousarray(inputs),
        np.ascontiguousarray(at), start, tuple(parameters), noise, drift, load_shapes(loads, compiled.loads), levels,
    )  # fmt: skip


def _limits(posed: LinearModel, part: Record) -> tuple[float, float]:
    """Between which frequencies spectra are read [Hz]."""
    most = min(0.5 * part.rate, float(part.attributes.get(LOW_PASS, np.inf))) * NYQUIST_SHARE
    mean, std = posed.prior
    found = []
    for at in (mean + std, mean, mean - std):
        try:
            found.append(posed.natural_frequencies(at[None])[0])
        except ConfigurationError:
            continue
    hz = np.exp(np.concatenate(found)) / (2.0 * np.pi) if found else np.empty(0)
    if not len(hz):
        return 0.0, most
    creeps = len(posed.compiled.states) > 2 * len(found[-1])  # what does not oscillate says something down to 0
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
