"""The modes of many records, each followed from one record to the next."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.spectral.oma.known_modes import KnownModes, in_channels, without_damping_prior
from windsysid.spectral.oma.mode_tracking import Seen, follow_modes

__all__ = ["ModalTrack", "modal_tracks"]


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
    records = [result._replace(modes=tuple(mode for mode in result.modes if mode.trusted)) for result in records]
    channels = list(dict.fromkeys(name for result in records for mode in result.modes for name in mode.shape))
    seen = [
        [Seen(math.exp(mode.ln_frequency), in_channels(mode, channels)) for mode in result.modes] for result in records
    ]
    tracks: list[ModalTrack] = []
    rare: list[str] = []
    for followed in follow_modes(seen):
        sure = {t: records[t].modes[j] for t, j in followed.items()}
        at = f"{math.exp(float(np.median([mode.ln_frequency for mode in sure.values()]))):.4g} Hz"
        if 2 * len(sure) < len(records):
            rare.append(f"{at} ({len(sure)} of {len(records)})")
            continue
        values, std = np.full((len(records), 2), np.nan), np.full((len(records), 2), np.nan)
        for t, mode in sure.items():
            damping, spread = without_damping_prior(mode)
            values[t], std[t] = (mode.ln_frequency, damping), (mode.ln_frequency_std, spread)
        unknown = ~np.isfinite(std)
        values[unknown] = std[unknown] = np.nan
        usual, _ = Counter(mode.name for mode in sure.values()).most_common(1)[0]
        name = usual if usual not in [track.name for track in tracks] else f"the mode at {at}"
        tracks.append(ModalTrack(name, values, std))
    if not tracks:
        raise ConfigurationError(
            f"expected a mode that half of {len(records)} records trust, got none: {', '.join(rare[:4]) or 'no modes'}"
        )
    notes = [f"trusted in fewer than half of the records, and not followed: {', '.join(rare[:8])}"] if rare else []
    return tracks, notes
