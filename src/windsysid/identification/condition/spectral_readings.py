"""Readings as spectra need them: without gaps."""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.identification.limits import MAX_MISSING_SHARE
from windsysid.records.record import Record
from windsysid.results.finding import Finding

__all__ = ["read_bridged"]


def read_bridged(record: Record, channels: Sequence[str], notes: list[Finding]) -> Array:
    """What channels hold (T, m), short gaps bridged, which `notes` then say.

    Raises
    ------
    RecordError
        If more than `MAX_MISSING_SHARE` of a channel is missing.
    """
    columns = []
    for name in channels:
        values = record[name]
        missing = ~np.isfinite(values)
        if missing.mean() > MAX_MISSING_SHARE:
            raise RecordError(
                f"channel '{name}': expected at most {100 * MAX_MISSING_SHARE:g} % missing samples for spectra, got "
                f"{100 * missing.mean():.3g} %: choose another section, or the joint formulation"
            )
        if missing.any():
            values = np.interp(record.time, record.time[~missing], values[~missing])
            data = {"channel": name, "count": missing.sum()}
            notes.append(Finding("missing_samples_bridged", "note", data))
        columns.append(values)
    return np.column_stack(columns)
