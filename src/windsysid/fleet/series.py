"""Estimates of the records of one turbine of an archive, in order of time: the blocks that the watch follows.

States and SCADA are covariates. A state other than the commonest has an indicator, 0 or 1, which holds all that the air
does to it: wind, pitch and rotor speed count in the commonest state only, since they act otherwise on a parked rotor
than on a running one. Transients are left out, and states of which there are too few records to learn their effect
from.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.fleet.archive import read_table
from windsysid.mechanics.rotor import MEAN_LAG
from windsysid.mechanics.sensors import noise_source
from windsysid.monitoring.series import MIN_BLOCKS, RecordBlocks, left_out_of
from windsysid.monitoring.watch import MAX_LEARNING_BLOCKS
from windsysid.records.moments import moment
from windsysid.results.posterior import SIGMAS

__all__ = [
    "COVARIATES", "Pairs", "archive_blocks", "blocks_of", "numbers", "pairs", "seconds_of", "texts", "unidentified",
]  # fmt: skip

COVARIATES = ("wind_speed", "temperature", "pitch", "rotor_speed")
"""Of SCADA, where most records have them. The power follows from them, the yaw is no straight line."""

STRONG_WIND_QUANTILE = 0.9
"""Quantile of the wind that is learned from, beyond which a coefficient may follow the wind by another slope.

Blades pitch from the rated wind on, and damping levels off there. A single line would run on into winds that were never
learned from, and what it gets wrong in a stormy month looks like a jump.
"""

MIN_SHARE = 0.9
"""Share of the records that must have a covariate for it to be used: those without are left out."""

MIN_STATE_SHARE, MIN_STATE_RECORDS = 0.05, 10
"""Least share and number of a state among the records that are learned from."""

BLOCK_COLUMNS = (
    "status", "why", "source", "start", "time", "state", "trusted", "windsysid", "parameters", "statistics",
    "rotor_speed", *(f"scada_{name}" for name in COVARIATES),
)  # fmt: skip
"""Columns that `blocks_of` reads."""


class Pairs(NamedTuple):
    """A list column of a table as a flat one: the row of each entry (N,), and the entries' names (N,)."""

    row: NDArray[np.int64]
    names: NDArray[np.object_]
    entries: Any

    def field(self, name: str) -> Array:
        """A field of numbers (N,), NaN where there is none."""
        return numbers_of(self.entries.field(name))

    def texts(self, name: str) -> NDArray[np.object_]:
        """A field of text (N,), None where there is none."""
        return np.asarray(self.entries.field(name).to_numpy(zero_copy_only=False), dtype=object)

    def grades(self, table: Any, name: str = "grade") -> NDArray[np.object_]:
        """A field of grades (N,); where there is none, A or C, as the row of the table is trusted or not."""
        trusted = np.array([value is True for value in table["trusted"].to_pylist()], dtype=bool)
        pairs = zip(self.texts(name), np.where(trusted[self.row], "A", "C"), strict=True)
        return np.array([other if own is None else own for own, other in pairs], dtype=object)


def archive_blocks(archive: str | Path, turbine: str) -> RecordBlocks:
    """Blocks of one turbine of an archive.

    Raises
    ------
    ConfigurationError
        If there is no such turbine, or too few records of it were identified.
    """
    return blocks_of(read_table(archive, turbine, BLOCK_COLUMNS))


def blocks_of(table: Any) -> RecordBlocks:
    """Blocks from rows with the columns `BLOCK_COLUMNS`; ConfigurationError as `archive_blocks`."""
    notes: list[str] = []
    table = _usable(table, notes)
    begin = _begin(texts(table, "start").tolist())
    versions = sorted(set(texts(table, "windsysid")))
    if len(versions) > 1:
        notes.append(f"identified by windsysid {', '.join(versions)}: a change of version may look like a jump")
    covariates, names = _covariates(table, texts(table, "state"), notes)
    parameters = pairs(table, "parameters")
    bad, wanted = parameters.grades(table) == "C", parameters.names != MEAN_LAG
    own, own_std = np.where(bad, np.nan, parameters.field("own")), parameters.field("own_std")
    theta, std, order = _spread(parameters, table.num_rows, own, own_std, wanted)
    reasons = (reason or "not_trusted" for reason in parameters.texts("reason")[bad & wanted])
    noise_theta, noise_std, sensors, noise_units = _noise(table)
    first = {name: i for i, name in reversed(list(enumerate(parameters.names)))}
    logarithmic = [bool(parameters.entries.field("logarithmic")[first[name]].as_py()) for name in order]
    centre, scale = parameters.field("prior_centre"), parameters.field("coordinate_scale")
    reference = [float((centre if logs else scale)[first[name]]) for name, logs in zip(order, logarithmic, strict=True)]
    units, kinds = (
        [str(parameters.entries.field(of)[first[name]].as_py()) for name in order] for of in ("unit", "kind")
    )
    return RecordBlocks(
        names=(*order, *sensors),
        time=seconds_of(table) - seconds_of(table)[0],
        theta=np.hstack([theta, noise_theta]),
        std=np.hstack([std, noise_std]),
        logarithmic=(*logarithmic, *(True for _ in sensors)),
        reference=(*reference, *(1.0 for _ in sensors)),
        covariates=covariates,
        covariate_names=names,
        left_out=left_out_of(zip(parameters.names[bad & wanted], reasons, strict=True)),
        records=tuple(texts(table, "source")),
        units=(*units, *noise_units),
        kinds=(*("c" if kind == "damping" else "k" for kind in kinds), *("noise" for _ in sensors)),
        begin=begin,
        notes=tuple(notes),
    )


def unidentified(tables: Iterable[Any]) -> str | None:
    """Sentence with the commonest reason if no record of some tables was identified; None if one was."""
    of = Counter(pair for t in tables for pair in zip(texts(t, "status"), texts(t, "why"), strict=True))
    if not of or any(status == "ok" for status, _ in of):
        return None
    (status, why), count = of.most_common(1)[0]
    more = f", {of.total() - count} for other reasons" if len(of) > 1 else ""
    return f"no record was identified ({count} {status}: {why}{more})"


def _usable(table: Any, notes: list[str]) -> Any:
    """Identified rows with a date, each once, in a steady state of which there are enough to learn from."""
    if why := unidentified([table]):
        raise ConfigurationError(why)
    good = (texts(table, "status") == "ok") & np.array([start is not None for start in texts(table, "start")])
    table = _first_of_each(table.filter(_mask(good)), notes)
    state = texts(table, "state")
    table = table.filter(_mask(_learned(state, state != "transient", notes)))
    if table.num_rows < MIN_BLOCKS:
        raise ConfigurationError(
            f"expected at least {MIN_BLOCKS} identified records with a date, in a steady state; got {table.num_rows}"
        )
    return table


def _noise(table: Any) -> tuple[Array, Array, list[str], list[str]]:
    """Logarithms (T, n) of the noise found in sensors, their standard deviations, and the n names and units."""
    noise = pairs(table, "statistics")
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.log(noise.field("high") / noise.field("low")) / (2.0 * SIGMAS)
        level = np.log(noise.field("estimate"))
    wanted = np.array([bool(noise_source(name)) for name in noise.names], dtype=bool) & np.isfinite(level + relative)
    level, relative, names = _spread(noise, table.num_rows, level, relative, wanted & (relative > 0.0))
    units = dict(zip(noise.names.tolist(), noise.texts("unit").tolist(), strict=True))
    return level, relative, names, [units[name] for name in names]


def numbers(table: Any, column: str) -> Array:
    """A column of numbers (T,), NaN where there is none."""
    return numbers_of(table[column].combine_chunks())


def numbers_of(array: Any) -> Array:
    """An Arrow array of numbers, NaN where there is none."""
    return np.asarray(array.to_numpy(zero_copy_only=False), dtype=np.float64)


def texts(table: Any, column: str) -> NDArray[np.object_]:
    """A column of text (T,), None where there is none."""
    return np.asarray(table[column].combine_chunks().to_numpy(zero_copy_only=False), dtype=object)


def seconds_of(table: Any) -> Array:
    """When records began [s since 1970], NaN where that is not known."""
    stamps = table["time"].combine_chunks().to_numpy(zero_copy_only=False).astype("datetime64[us]")
    return np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) / 1e6)


def pairs(table: Any, column: str) -> Pairs:
    """A list column of a table, flat."""
    import pyarrow.compute as pc

    lists = table[column].combine_chunks()
    entries = pc.list_flatten(lists)
    row = pc.list_parent_indices(lists).to_numpy()
    key = "name" if entries.type.get_field_index("name") >= 0 else "channel"
    return Pairs(row, np.asarray(entries.field(key).to_numpy(zero_copy_only=False), dtype=object), entries)


def _spread(
    of: Pairs, rows: int, values: Array, std: Array, wanted: NDArray[np.bool_] | None = None
) -> tuple[Array, Array, list[str]]:
    """Entries as columns (rows, n): values, standard deviations, NaN where a row has none, and the n names."""
    chosen = np.ones(len(of.row), dtype=bool) if wanted is None else wanted
    order = list(dict.fromkeys(of.names[chosen]))
    at = {name: i for i, name in enumerate(order)}
    column = np.array([at[name] for name in of.names[chosen]], dtype=np.int64)
    found = np.full((2, rows, len(order)), np.nan)
    for into, what in zip(found, (values, std), strict=True):
        into[of.row[chosen], column] = what[chosen]
    found[:, ~(np.isfinite(found).all(axis=0) & (found[1] > 0.0))] = np.nan
    return found[0], found[1], order


def _first_of_each(table: Any, notes: list[str]) -> Any:
    """Rows in order of time; of records that begin together, the first by its path."""
    seconds, sources = seconds_of(table), texts(table, "source")
    order = np.lexsort((sources.astype(str), seconds))
    again = np.append(False, np.diff(seconds[order]) <= 0.0)[: len(order)]
    if again.any():
        notes.append(f"{int(again.sum())} records begin when another does, and were left out")
    return table.take(order[~again])


def _learned(state: NDArray[np.object_], steady: NDArray[np.bool_], notes: list[str]) -> NDArray[np.bool_]:
    """Rows whose state has enough records to learn from."""
    if not steady.all():
        notes.append(f"{int((~steady).sum())} records of a rotor that starts or stops were left out")
    while steady.any():
        learning = state[steady][: _learning(int(steady.sum()))]
        counts = Counter(learning.tolist())
        least = max(MIN_STATE_SHARE * len(learning), MIN_STATE_RECORDS)
        usual = counts.most_common(1)[0][0]
        rare = [one for one in dict.fromkeys(state[steady]) if one != usual and counts[one] < least]
        if not rare:
            break
        of = Counter(state[steady].tolist())[rare[0]]
        notes.append(f"{of} records of a turbine that was {rare[0]} were left out: too few of them to learn from")
        steady = steady & (state != rare[0])
    return steady


def _covariates(table: Any, state: NDArray[np.object_], notes: list[str]) -> tuple[Array, tuple[str, ...]]:
    """Indicators of states, then SCADA (T, m), and their names."""
    usual = Counter(state.tolist()).most_common(1)[0][0]
    columns = {one: (state == one).astype(np.float64) for one in dict.fromkeys(state) if one != usual}
    for name in COVARIATES:
        values = numbers(table, f"scada_{name}")
        if name == "rotor_speed":
            own = numbers(table, "rotor_speed")
            values = np.where(np.isfinite(own), own, values)
        there = float(np.isfinite(values).mean())
        if there >= MIN_SHARE:
            among = float(np.nanmean(values[state == usual]))
            columns[name] = values if name == "temperature" else np.where(state == usual, values, among)
            if name == "wind_speed":
                columns |= _strong_wind(values, state == usual, notes)
        elif there > 0.0:
            notes.append(f"{name} was left out: only {100.0 * there:.0f} % of the records have it")
    empty = np.empty((len(state), 0))
    return np.column_stack(list(columns.values())) if columns else empty, tuple(columns)


def _strong_wind(values: Array, usual: NDArray[np.bool_], notes: list[str]) -> dict[str, Array]:
    """By how much the wind (T,) is stronger than most that is learned from [m/s], in the commonest state."""
    learning = values[: _learning(len(values))]
    learned = learning[usual[: len(learning)] & np.isfinite(learning)]
    if not learned.size:
        return {}
    most = round(float(np.quantile(learned, STRONG_WIND_QUANTILE)))  # whole, so that turbines of the type have the same
    notes.append(f"strong_wind is what the wind has above {most} m/s")
    return {"strong_wind": np.where(usual, np.maximum(values - most, 0.0), 0.0)}


def _learning(count: int) -> int:
    """Number of records that are learned from before the first alarm."""
    return min(MAX_LEARNING_BLOCKS, max(count // 2, 1))


def _begin(starts: Sequence[str]) -> datetime:
    """The moment of the first record; ConfigurationError where some records say their zone and some do not."""
    zones = {moment(starts[i]).tzinfo is not None for i in range(len(starts))}
    if len(zones) > 1:
        raise ConfigurationError(
            "records with a zone and without cannot be put in order: give the zone in the mapping file, [time] zone"
        )
    return moment(starts[0])


def _mask(values: NDArray[np.bool_]) -> Any:
    import pyarrow as pa  # type: ignore[import-untyped,unused-ignore]

    return pa.array(values)
