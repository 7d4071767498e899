"""The modes of many records, each followed from one record to the next."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.output.folders import result_file, without
from windsysid.spectral.oma.known_modes import KnownMode, KnownModes, holds_modes, in_channels, without_damping_prior
from windsysid.spectral.oma.mode_tracking import Seen, follow_modes

__all__ = ["ModalTrack", "all_hold_modes", "modal_tracks", "tracks_of"]


def all_hold_modes(given: Sequence[object]) -> bool:
    """True for results of oma, False for those of identify.

    Raises
    ------
    ConfigurationError
        If there are some of each, or a folder that neither of the two wrote.
    """
    of_modes = [holds_modes(one) for one in given]
    for one, known in zip(given, of_modes, strict=True):
        if isinstance(one, str | Path) and not (known or result_file(one, "identification.nc").exists()):
            raise ConfigurationError(without("a result of windsysid identify or oma", one))
    if len(set(of_modes)) == 2:
        first, second = (_shown(given[of_modes.index(kind)]) for kind in (True, False))
        raise ConfigurationError(
            f"expected results of one kind, got {first} of oma and {second} of identify: give the same command for each"
        )
    return any(of_modes)


def _shown(given: object) -> str:
    return str(given) if isinstance(given, str | Path) else "one"


class ModalTrack(NamedTuple):
    """A mode over T records: its name, ln f and ln ζ without their prior (T, 2), and their standard deviations (T, 2);
    NaN where a record does not trust it."""

    name: str
    values: Array
    std: Array


def modal_tracks(records: Sequence[KnownModes]) -> tuple[list[ModalTrack], list[str]]:
    """The modes that half of the records trust, by rising frequency, and notes of those that fewer do.

    Raises
    ------
    ConfigurationError
        If there is none.
    """
    records = [_trusted(result) for result in records]
    tracks: list[ModalTrack] = []
    rare: list[str] = []
    taken: set[str] = set()
    for followed in tracks_of(records)[1]:
        sure = {t: records[t].modes[j] for t, j in followed.items()}
        at = _frequency(sure.values())
        if 2 * len(sure) < len(records):
            rare.append(f"{at} ({len(sure)} of {len(records)})")
        else:
            usual, _ = Counter(mode.name for mode in sure.values()).most_common(1)[0]
            named = usual not in taken
            taken.add(usual)
            tracks.append(_track(usual if named else f"the mode at {at}", sure, len(records)))
    if not tracks:
        got = ", ".join(rare[:4] or ["no modes"])
        raise ConfigurationError(f"expected a mode that half of {len(records)} records trust, got none: {got}")
    notes = [f"trusted in fewer than half of the records, and not followed: {', '.join(rare[:8])}"] if rare else []
    return tracks, notes


def _trusted(result: KnownModes) -> KnownModes:
    return result._replace(modes=tuple(mode for mode in result.modes if mode.trusted))


def _frequency(modes: Iterable[KnownMode]) -> str:
    return f"{math.exp(float(np.median([mode.ln_frequency for mode in modes]))):.4g} Hz"


def tracks_of(records: Sequence[KnownModes]) -> tuple[list[str], list[dict[int, int]]]:
    """All channels, and the modes of the records paired by frequency and shape: the mode's index by record."""
    channels = list(dict.fromkeys(name for result in records for mode in result.modes for name in mode.shape))
    seen = [
        [Seen(math.exp(mode.ln_frequency), in_channels(mode, channels)) for mode in result.modes] for result in records
    ]
    return channels, follow_modes(seen)


def _track(name: str, modes: Mapping[int, KnownMode], count: int) -> ModalTrack:
    """A mode over `count` records from those that have it."""
    values, std = np.full((2, count, 2), np.nan)
    for t, mode in modes.items():
        damping, spread = without_damping_prior(mode)
        values[t], std[t] = (mode.ln_frequency, damping), (mode.ln_frequency_std, spread)
    unknown = ~np.isfinite(std)
    values[unknown] = std[unknown] = np.nan
    return ModalTrack(name, values, std)
