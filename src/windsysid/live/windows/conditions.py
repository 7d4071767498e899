"""Conditions of a window, as covariates of its estimates: the turbine's state, and SCADA if there is any.

As in an archive (`windsysid.fleet.series`) a state other than the commonest has an indicator, which holds all that the
air does to it; wind, pitch and rotor speed count in the commonest state only. Transients are left out, and states that
were too rare to learn from. What is commonest, what is there, and what it is standardised by is learned from the first
windows (`Standards`).
"""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.fleet.rows import Row
from windsysid.fleet.series import COVARIATES, MIN_SHARE, MIN_STATE_RECORDS, MIN_STATE_SHARE, STRONG_WIND_QUANTILE
from windsysid.turbine.operation import STATES

__all__ = ["NO_STATE", "Standards", "conditions_of", "covariates_of", "learn_standards", "state_of"]

NO_STATE = -1
"""The state of a window that says nothing: refused, failed, of a rotor that starts or stops, or not there."""

MIN_SPREAD = {"wind_speed": 1.0, "temperature": 3.0, "pitch": 0.02}
"""[m/s], [°C], [rad]: a covariate is standardised by this where it moved less while it was learned from."""

MIN_SPEED_SPREAD_SHARE = 0.02
"""Minimum spread of the rotor speed, as a share of its mean."""


class Standards(NamedTuple):
    """Covariates in use, and their standardisation.

    Attributes
    ----------
    usual
        The commonest state, as its place in `STATES`.
    others
        States with an indicator.
    columns
        Of `COVARIATES`, those that are used, by their place.
    centre, spread
        Of each of them, in the commonest state.
    strong
        Wind beyond which there is another slope [m/s]; NaN where there is no wind.
    """

    usual: int
    others: tuple[int, ...]
    columns: tuple[int, ...]
    centre: tuple[float, ...]
    spread: tuple[float, ...]
    strong: float


def state_of(row: Row) -> int:
    """The state of a window's row, as its place in `STATES`, or `NO_STATE`."""
    if row["status"] != "ok" or row["state"] == "transient":
        return NO_STATE
    return STATES.index(row["state"]) if row["state"] in STATES else STATES.index("unknown")


def conditions_of(row: Row) -> NDArray[np.float32]:
    """Values of `COVARIATES` (4,) from SCADA and record, NaN if missing."""
    own = row["rotor_speed"] if row["rotor_speed"] is not None else row["scada_rotor_speed"]
    said = [own if name == "rotor_speed" else row[f"scada_{name}"] for name in COVARIATES]
    return np.array([math.nan if value is None else value for value in said], dtype=np.float32)


def learn_standards(states: NDArray[np.int8], conditions: NDArray[np.float32]) -> Standards:
    """Standards of windows (n,) with conditions (n, 4), of which at least one has a state."""
    counts = Counter(states[states != NO_STATE].tolist())
    usual = counts.most_common(1)[0][0]
    least = max(MIN_STATE_SHARE * sum(counts.values()), MIN_STATE_RECORDS)
    others = tuple(sorted(state for state, count in counts.items() if state != usual and count >= least))
    among = conditions[states == usual].astype(np.float64)
    columns = [i for i in range(len(COVARIATES)) if np.isfinite(among[:, i]).mean() >= MIN_SHARE]
    centre = [float(np.nanmean(among[:, i])) for i in columns]
    spread = [
        max(float(np.nanstd(among[:, i])), MIN_SPREAD.get(COVARIATES[i], MIN_SPEED_SPREAD_SHARE * abs(middle)), 1e-9)
        for i, middle in zip(columns, centre, strict=True)
    ]
    wind = COVARIATES.index("wind_speed")
    strong = float(round(np.nanquantile(among[:, wind], STRONG_WIND_QUANTILE))) if wind in columns else math.nan
    return Standards(usual, others, tuple(columns), tuple(centre), tuple(spread), strong)


def covariates_of(standards: Standards, states: NDArray[np.int8], conditions: NDArray[np.float32]) -> Array:
    """Covariates (n, m) of windows, standardised; NaN where a window is left out.

    The columns: an indicator of each other state, each covariate, and what the wind has above `strong`; zeros where
    there is none of these, so that a window can be left out.
    """
    usual = states == standards.usual
    columns = [np.asarray(states == other, dtype=np.float64) for other in standards.others]
    for i, centre, spread in zip(standards.columns, standards.centre, standards.spread, strict=True):
        said = conditions[:, i].astype(np.float64)
        everywhere = COVARIATES[i] == "temperature"
        columns.append(np.where(usual | everywhere, (said - centre) / spread, 0.0))
        if COVARIATES[i] == "wind_speed":
            columns.append(np.where(usual, np.maximum(said - standards.strong, 0.0) / spread, 0.0))
    x = np.column_stack(columns or [np.zeros(len(states))])
    taken = usual | np.isin(states, standards.others)
    return np.ascontiguousarray(np.where(taken[:, None], x, math.nan))
