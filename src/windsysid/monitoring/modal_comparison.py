"""Comparison of the modes of two records: frequencies and damping ratios, mode by mode.

Modes are paired by frequency and shape (`windsysid.spectral.oma.mode_tracking`). Each pair's change of ln f and of ln ζ
is Gaussian, the prior of damping taken out of both. Odds are those of `windsysid.monitoring.comparison`, with priors of
changes of half the size for a frequency, which goes with the root of a stiffness.
"""

import math
from collections.abc import Sequence

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.modal.shapes import assurance
from windsysid.monitoring.change import MAX_REPORTED_LOG_FACTOR, Comparison, QuantityChange
from windsysid.monitoring.modal_tracks import tracks_of
from windsysid.monitoring.own_information import TYPICAL_CHANGE
from windsysid.results.posterior import SIGMAS
from windsysid.spectral.oma.known_modes import (
    KnownMode,
    KnownModes,
    ModesLike,
    as_modes,
    in_channels,
    without_damping_prior,
)

__all__ = ["compare_modes"]

MIN_SAME_SHAPE_MAC = 0.9
"""Modal assurance criterion below which it is said that a shape changed."""


def compare_modes(before: ModesLike, after: ModesLike) -> Comparison:
    """Changes between the modes of two records.

    Raises
    ------
    ConfigurationError
        If no mode is trusted in both.
    """
    records = a, b = as_modes(before), as_modes(after)
    channels, tracks = tracks_of(records)
    sure = _trusted_pairs(a, b, tracks)
    changes = [change for old, new in sure for change in _changes(old, new)]
    doubts = [f"the record {result.record} is doubtful: see its report" for result in records if not result.trusted]
    notes = _left_out(records, tracks) + _other_shapes(sure, channels)
    same = a.record_hash is not None and (a.record_hash, a.section) == (b.record_hash, b.section)
    return Comparison((a.record, b.record), tuple(changes), (), (), same, tuple(doubts), tuple(notes))


def _trusted_pairs(a: KnownModes, b: KnownModes, tracks: Sequence[dict[int, int]]) -> list[tuple[KnownMode, KnownMode]]:
    """Modes that both records trust; ConfigurationError without any."""
    pairs = [(a.modes[t[0]], b.modes[t[1]]) for t in tracks if len(t) == 2]
    sure = [(old, new) for old, new in pairs if old.trusted and new.trusted]
    if not sure:
        raise ConfigurationError(
            f"{a.record} and {b.record}: expected a mode that both found and trust, got {len(pairs)} that both found"
        )
    return sure


def _left_out(records: Sequence[KnownModes], tracks: Sequence[dict[int, int]]) -> list[str]:
    """Notes of modes that are not trusted in both records, then of those that one record has alone."""
    notes, alone = [], []
    for track in tracks:
        modes = {record: records[record].modes[j] for record, j in track.items()}
        if len(modes) == 1:
            ((record, mode),) = modes.items()
            alone.append(f"only {records[record].record} has {_named(mode)}")
        elif not all(mode.trusted for mode in modes.values()):
            notes.append(f"not trusted in both, and not compared: {_named(modes[0])}")
    return notes + alone


def _other_shapes(pairs: Sequence[tuple[KnownMode, KnownMode]], channels: list[str]) -> list[str]:
    """Notes of modes whose shape changed."""
    alike = [(old, assurance(in_channels(old, channels), in_channels(new, channels))) for old, new in pairs]
    return [f"the shape of {mode.name} differs: MAC {mac:.2f}" for mode, mac in alike if mac < MIN_SAME_SHAPE_MAC]


def _named(mode: KnownMode) -> str:
    return f"{mode.name}, {math.exp(mode.ln_frequency):.4g} Hz"


def _changes(old: KnownMode, new: KnownMode) -> list[QuantityChange]:
    frequency = (old.ln_frequency, old.ln_frequency_std), (new.ln_frequency, new.ln_frequency_std)
    damping = without_damping_prior(old), without_damping_prior(new)
    return [
        _change(f"frequency of {old.name}", "Hz", "frequency", *frequency),
        _change(f"damping of {old.name}", "1", "damping", *damping),
    ]


def _change(name: str, unit: str, kind: str, old: tuple[float, float], new: tuple[float, float]) -> QuantityChange:
    """A change of a logarithm, each record's with its standard deviation."""
    step, sigma = new[0] - old[0], math.hypot(old[1], new[1])
    values = math.exp(old[0]), math.exp(new[0])
    prior = 0.5 * TYPICAL_CHANGE["stiffness"] if kind == "frequency" else TYPICAL_CHANGE["damping"]
    if not SIGMAS * sigma < MAX_REPORTED_LOG_FACTOR:
        return QuantityChange(name, unit, *values, math.nan, -100.0, math.inf, 0.0, 1.0, kind)
    posterior = 1.0 / (sigma**-2.0 + prior**-2.0)
    log_odds = 0.5 * math.log(posterior / prior**2) + 0.5 * step**2 * posterior / sigma**4
    chance = math.erfc(abs(step) / sigma / math.sqrt(2.0))
    percent, low, high = (100.0 * float(np.expm1(step + k * sigma)) for k in (0.0, -SIGMAS, SIGMAS))
    return QuantityChange(name, unit, *values, percent, low, high, log_odds, chance, kind)
