"""From a record's readings and a turbine to the lifted spectrum as a function of the unknowns: a turning rotor, or a
parked structure (`windsysid.spectral.rotor.build_parked`)."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.loads.narrow_band import NarrowBand
from windsysid.spectral.rotor.build_parked import pose_standing
from windsysid.spectral.rotor.harmonic_transfer import MAX_HARMONIC, matrix_harmonics
from windsysid.spectral.rotor.likelihood import SpectrumGrid
from windsysid.spectral.rotor.limits import MAX_HARMONICS, MIN_BINS, MIN_TURNS
from windsysid.spectral.rotor.load_spectra import BroadbandLoads, Sources, WindLoads, WindRotor
from windsysid.spectral.rotor.model import LiftedModel, finer_bins, taper_weights
from windsysid.spectral.rotor.problem import Posed, RotorQuestion, damped_start
from windsysid.spectral.transforms.block_sums import factored
from windsysid.spectral.transforms.lifted import Complex, Lifted
from windsysid.turbine.turbine import Turbine

__all__ = ["harmonics_of", "pose_lifted", "turns_couple"]

BINS_PER_POOL = 1.4
"""Setting: bins in half the half-power width of a mode for each bin of a pool; a pool has the mean of their spectra."""


def turns_couple(question: RotorQuestion) -> bool:
    """True if the azimuth is in the equations or the readings, and the rotor turns."""
    p, speed = question.centres, float(question.speed.mean())
    found = matrix_harmonics(question.compiled, p[None], np.zeros((1, question.size)), speed, question.inputs[0])
    others = np.arange(2 * MAX_HARMONIC + 1) != MAX_HARMONIC
    return bool(found.mechanics[:, :, others].any() or found.readings[:, :, others].any())


def pose_lifted(question: RotorQuestion, loads: str, bands: Sequence[tuple[float, float]] = ()) -> Posed:
    """The problem under a load model: ``"broadband"``, ``"narrow-band"``, or for a rotor whose turns couple its motion
    ``"rotor-wind"``.

    Where nothing turns, `bands` are found around the modes; or they are given, to look at a part of the record as at
    the whole.

    Raises
    ------
    RecordError, ConfigurationError
        If the record is too short, or the rotor turns too slowly compared with its modes.
    """
    if turns_couple(question):
        return _pose_turning(question, loads)
    if loads == "rotor-wind":
        raise ConfigurationError(
            "load model rotor-wind: expected a rotor that turns with blades that move, got neither: choose broadband"
        )
    return pose_standing(question, bands, narrow=loads == NarrowBand.name)


def harmonics_of(question: RotorQuestion) -> int:
    """K: every harmonic up to the blades' modes, and the next; 0 where nothing turns.

    Raises
    ------
    RecordError
        If the rotor turns too slowly compared with its modes, or the record is sampled too slowly.
    """
    if not turns_couple(question):
        return 0
    turbine, rate = question.turbine, question.rate
    rotor_hz = float(question.speed.mean()) / (2.0 * math.pi)
    fastest = _fastest(turbine)
    K = math.ceil(fastest / rotor_hz) + 2
    if K > MAX_HARMONICS:
        raise RecordError(
            f"the rotor turns at {rotor_hz:.3g} Hz, and modes reach {fastest:.3g} Hz: expected at most "
            f"{MAX_HARMONICS - 2} P; use formulation='joint'"
        )
    if (K + 0.5) * rotor_hz > 0.5 * rate:
        raise RecordError(
            f"sampling rate: expected {(2 * K + 1) * rotor_hz:.3g} Hz or more, got {rate:.4g}: sample faster, or use "
            f"formulation='joint'"
        )
    return K


def _fastest(turbine: Turbine) -> float:
    """Highest natural frequency of a degree of freedom [Hz]."""
    return max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)


def _pose_turning(question: RotorQuestion, loads: str) -> Posed:
    """A rotor whose turns couple its motion."""
    from scipy.sparse import csc_array

    turbine, K, sums = question.turbine, harmonics_of(question), question.sums
    lifted, blocks = question.lifted(K), 1.0 if sums is None else sums.blocks
    width = question.narrowest * lifted.duration
    bins, alike = len(lifted.base), max(1, int(width / BINS_PER_POOL))
    if bins < MIN_BINS * alike:
        turned = lifted.duration * lifted.rotor_hz
        raise RecordError(f"expected {MIN_TURNS} turns of the rotor or more, got {turned:.3g}: choose a longer record")
    pools = np.array_split(np.arange(bins), -(-bins // alike))
    base = np.array([lifted.base[pool].mean() for pool in pools])
    m = len(question.sensors)
    entries = np.flatnonzero(np.repeat(np.abs(lifted.harmonics) < K, m))  # motion beyond K is missing in those of K
    data = single = _pooled(lifted.data.reshape(bins, -1)[:, entries], pools)
    if sums is not None:
        power = sums.power[:, entries[:, None], entries]
        data = factored(np.array([power[pool].sum(axis=0) for pool in pools]))
    number = np.round(lifted.base * lifted.duration).astype(np.intp)
    fine = finer_bins(int(number[0]), int(number[-1])) / lifted.duration
    window = taper_weights(len(lifted.taper), number) ** 2
    smoothing = csc_array(np.column_stack([window[:, pool].mean(axis=1) for pool in pools]))

    def model_at(where: Array, weights: Any) -> LiftedModel:
        place = SpectrumGrid(
            where, lifted.harmonics, lifted.rotor_hz, entries, np.zeros((len(where), len(entries)), dtype=np.bool_)
        )
        sources = _turning_loads(question, loads, where, lifted, _fastest(turbine))
        noise, given = question.noise(where[:, None] + lifted.rotor_hz * lifted.harmonics, entries)
        return LiftedModel(
            data, place, weights, None, np.zeros(data.shape[:2], dtype=np.bool_), lifted.overlap,
            np.eye(m, dtype=np.complex128), question.compiled, turbine.model.freedoms, question.centres,
            question.inputs[0], question.parameters, question.has_lag, sources, noise, given,
            np.array([blocks * len(pool) for pool in pools]), blocks, None if sums is None else single,
            1.0 if sums is None else sums.gusts,
        )  # fmt: skip

    model, bands = model_at(base, None), ((float(base[0]), (K - 0.5) * lifted.rotor_hz),)
    text = HYPOTHESES[loads].text
    resonance = 2.0 * math.pi * width * blocks / lifted.overlap
    start = damped_start(question.turbine, question.parameters, *model.prior)
    return Posed(model, model_at(fine, smoothing), start, bands, text, resonance)


def _pooled(entries: Complex, pools: Sequence[NDArray[np.intp]]) -> Complex:
    """Entries (B, e) of the bins in every pool, (pools, e, g), 0 beyond the last."""
    data = np.zeros((len(pools), entries.shape[1], max(len(pool) for pool in pools)), dtype=np.complex128)
    for where, pool in zip(data, pools, strict=True):
        where[:, : len(pool)] = entries[pool].T
    return data


def _turning_loads(question: RotorQuestion, loads: str, base: Array, lifted: Lifted, fastest: float) -> Sources:
    """The load model at base frequencies."""
    model, v = question.turbine.model, question.turbine.values
    if loads != "rotor-wind":
        frequency = base[:, None] + lifted.rotor_hz * lifted.harmonics
        broad = BroadbandLoads(question.loads, model, frequency)
        return question.with_narrow_band(broad, frequency) if loads == NarrowBand.name else broad
    moment = next(load.rms for load in question.loads if model.freedom(load.load).blade)
    lever = v["blade_inertia_1"] / v["blade_first_moment_1"]
    rotor = WindRotor(model.blades, v["hinge_offset"], lever, lifted.rotor_hz, moment, fastest)
    return WindLoads(model.freedoms, rotor, base, lifted.harmonics)
