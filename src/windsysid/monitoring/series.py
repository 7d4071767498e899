"""Estimates of records in order of time: the series that the watch follows.

A block is one record's estimates without their prior, the noise found in its sensors, and the covariates of its time.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.mechanics.rotor import MEAN_LAG
from windsysid.mechanics.sensors import noise_source
from windsysid.monitoring.covariates import lines_of, read_covariates
from windsysid.monitoring.dates import MIN_BLOCKS, Order, Span, in_order, spans_of
from windsysid.monitoring.modal_tracks import all_hold_modes, modal_tracks
from windsysid.monitoring.own_information import without_prior
from windsysid.results.posterior import SIGMAS, Posterior, load_posterior
from windsysid.spectral.oma.known_modes import KnownModes, ModesLike, as_modes
from windsysid.statespace.parameter import Parameter

__all__ = ["DAY", "MIN_BLOCKS", "RecordBlocks", "gather", "gather_modes", "left_out_of", "read_blocks"]


DAY = 86400.0

Result = Posterior | KnownModes


@dataclass(frozen=True, eq=False)
class RecordBlocks:
    """Estimates of records in order of time.

    Attributes
    ----------
    names
        Of the n series: coefficients, then the noise of sensors.
    time
        (T,) [s], increasing.
    theta, std
        (T, n) estimates in filter coordinates without their prior, and standard deviations; NaN where a record has no
        estimate of grade A or B.
    logarithmic
        Of each series, whether θ is a logarithm.
    reference
        Of each series, the value at θ = 0 (logarithmic) or θ = 1.
    units
        SI unit of each series, for noise that of its sensor; empty if unknown.
    kinds
        Of each series: ``k`` for a stiffness and anything else, ``c`` for a damping, ``f`` for a frequency, ``noise``;
        empty where all others are stiffnesses.
    covariates
        (T, m); a block without all of them is left out.
    covariate_names
        Of the m.
    left_out
        By series, how many records do not count for it, by reason: codes of findings (docs/findings.md).
    records
        Names of the T records; empty where they have none.
    begin
        Calendar time of time 0, where it is known.
    notes
        How the records were put in order, and what speaks against it.
    """

    names: tuple[str, ...]
    time: Array
    theta: Array
    std: Array
    logarithmic: tuple[bool, ...]
    reference: tuple[float, ...]
    covariates: Array
    covariate_names: tuple[str, ...] = ()
    left_out: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    records: tuple[str, ...] = ()
    begin: datetime | None = None
    notes: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()

    def kind(self, i: int) -> str:
        """The kind of series i."""
        return self.kinds[i] if self.kinds else "noise" if noise_source(self.names[i]) else "k"

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names))
        for what, value in (("theta", self.theta), ("std", self.std)):
            if value.shape != shape:
                raise ConfigurationError(f"blocks: expected {what} of shape {shape}, got {value.shape}")
        if self.covariates.shape != (shape[0], len(self.covariate_names)):
            raise ConfigurationError(
                f"blocks: expected covariates of shape {(shape[0], len(self.covariate_names))}, got"
                f" {self.covariates.shape}"
            )
        if shape[0] < MIN_BLOCKS:
            raise ConfigurationError(f"blocks: expected at least {MIN_BLOCKS} records to learn from, got {shape[0]}")
        if not (np.diff(self.time) > 0.0).all():
            raise ConfigurationError(
                "blocks: expected times that increase from record to record: put the records in order"
            )
        if not (self.std[np.isfinite(self.std)] > 0.0).all():
            raise ConfigurationError("blocks: expected positive standard deviations")

    def when(self, seconds: float) -> str:
        """A time of these blocks as a date, or as a day since the first."""
        if self.begin is None:
            return f"day {seconds / DAY:.2f}"
        return (self.begin + timedelta(seconds=seconds)).isoformat(sep=" ", timespec="minutes")

    def between(self, earliest: float, latest: float) -> str:
        """An interval of time, in one word where it is one block."""
        return self.when(latest) if earliest == latest else f"{self.when(earliest)} … {self.when(latest)}"


def gather(
    posteriors: Sequence[Posterior],
    *,
    time: Array | None = None,
    covariates: Mapping[str, Array] | None = None,
    noise: Sequence[Mapping[str, tuple[float, float]]] = (),
    begin: datetime | None = None,
) -> RecordBlocks:
    """Blocks from the posteriors of records, each less its prior, in the coordinates of the first.

    Without `time`, the records are put in order of when they began, where all of them say it; otherwise they stay as
    given, 10 minutes apart.

    Parameters
    ----------
    posteriors
        Of T records of one turbine.
    time
        (T,) [s], increasing.
    covariates
        (T,) of each name, for the posteriors as they are given.
    noise
        For each record, noise of sensors with its standard deviation relative to itself.
    begin
        Calendar time of time 0.

    Raises
    ------
    ConfigurationError
        If records are too few, times do not increase, two records began at the same time, some say their zone and some
        do not, or lengths disagree.
    """
    placed = in_order(posteriors, time, covariates, begin)
    posteriors = [posteriors[i] for i in placed.order]
    frame = [q for q in posteriors[0].parameters if q.name != MEAN_LAG]  # which is the wind's
    names = [q.name for q in frame]
    known = [posteriors[0].turbine.model.coefficient(name) for name in names]
    theta, std = _own_estimates(posteriors, frame)
    sensors, noise_theta, noise_std = _noise_levels([noise[i] for i in placed.order] if noise else (), len(posteriors))
    series = _SeriesColumns(
        left_out=left_out_of(one for p in posteriors for one in p.unusable.items() if one[0] in names),
        names=(*names, *sensors),
        theta=np.hstack([theta, noise_theta]),
        std=np.hstack([std, noise_std]),
        logarithmic=(*(q.logarithmic for q in frame), *(True,) * len(sensors)),
        reference=(*(q.reference for q in frame), *(1.0,) * len(sensors)),
        units=(*(one.unit for one in known), *_units_of(sensors, posteriors)),
        kinds=(*("c" if one.kind == "damping" else "k" for one in known), *("noise",) * len(sensors)),
    )
    return _blocks(series, posteriors, placed, covariates)


class _SeriesColumns(NamedTuple):
    """Fields of `RecordBlocks` that have an entry for each series, or for some."""

    left_out: Mapping[str, Mapping[str, int]]
    names: tuple[str, ...]
    theta: Array
    std: Array
    logarithmic: tuple[bool, ...]
    reference: tuple[float, ...]
    units: tuple[str, ...]
    kinds: tuple[str, ...] = ()


def _blocks(
    series: _SeriesColumns, results: Sequence[Result], placed: Order, covariates: Mapping[str, Array] | None,
    notes: Sequence[str] = (),
) -> RecordBlocks:  # fmt: skip
    """Blocks of results that are in order."""
    return RecordBlocks(
        **series._asdict(),
        time=placed.time,
        covariates=placed.covariates,
        covariate_names=tuple(covariates or ()),
        records=tuple(result.record for result in results),
        begin=placed.begin,
        notes=(*placed.notes, *notes),
    )


def _own_estimates(posteriors: Sequence[Posterior], frame: Sequence[Parameter]) -> tuple[Array, Array]:
    """Estimates (T, n) of a frame's coefficients without their prior, and standard deviations; NaN where there are
    none, or of grade C."""
    names = [q.name for q in frame]
    theta, std = np.full((2, len(posteriors), len(names)), np.nan)
    for row, posterior in enumerate(posteriors):
        own = {q.name for q in posterior.parameters}
        known = [q for q in frame if q.name in own]
        at = [names.index(q.name) for q in known]
        theta[row, at], cov = without_prior(posterior, known)
        std[row, at] = np.sqrt(np.diag(cov))
        theta[row, [q.name in posterior.unusable for q in frame]] = np.nan
    std[np.isnan(theta)] = np.nan
    return theta, std


def left_out_of(unusable: Iterable[tuple[str, str]]) -> dict[str, dict[str, int]]:
    """Count pairs of a quantity and the reason why it is of grade C: by quantity and reason, the commonest first."""
    found: dict[str, dict[str, int]] = {}
    for (name, reason), count in Counter(unusable).most_common():
        found.setdefault(name, {})[reason] = count
    return found


def _units_of(names: Sequence[str], posteriors: Sequence[Posterior]) -> list[str]:
    """Units of statistics, empty where no posterior has one."""
    units = {one.name: one.unit for posterior in posteriors for one in posterior.statistics}
    return [units.get(name, "") for name in names]


def _noise_levels(noise: Sequence[Mapping[str, tuple[float, float]]], count: int) -> tuple[list[str], Array, Array]:
    """Names of n sensors, logarithms (T, n) of their noise, and standard deviations; NaN where there are none."""
    sensors = sorted({name for found in noise for name in found})
    theta, std = np.full((2, count, len(sensors)), np.nan)
    for row, found in enumerate(noise):
        for name, (value, relative) in found.items():
            at = row, sensors.index(name)
            theta[at], std[at] = math.log(value), relative
    return sensors, theta, std


def read_blocks(folders: Sequence[str | Path], covariates: str | Path | None = None) -> RecordBlocks:
    """Read the results in folders and their covariates, in order of time, for `windsysid.monitor`.

    Parameters
    ----------
    folders : sequence of str or Path
        Folders that ``windsysid identify``, ``windsysid oma`` or the ``save`` of a result wrote, at least 12. Records
        with a known start are put in order of time. Others are taken in the order given; where that is the alphabetical
        one, as a shell gives it, in natural order: ``res-2`` before ``res-10``.
    covariates : str or Path, optional
        CSV file with a row for each record. All columns but ``time`` and ``folder`` are covariates; an empty cell is a
        missing value. Rows belong to the folders named in ``folder``; without that column, to the records that began at
        their ``time`` (ISO 8601), where both are known; otherwise to the folders in their order. Where records have no
        start, ``time``, in seconds or as ISO 8601, gives it.

    Returns
    -------
    RecordBlocks
        Estimates (T, n), their standard deviations (T, n), and covariates (T, m).

    Raises
    ------
    ConfigurationError
        If a folder holds no result, records cannot be put in order, or the file does not fit.

    Examples
    --------
    >>> import shutil
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> home = Path(tempfile.mkdtemp())
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> _ = ws.identify(record, "tower", formulation="spectral").save(home / "first")
    >>> folders = [shutil.copytree(home / "first", home / f"res-{i}") for i in range(12)]  # in place of twelve records
    >>> ws.read_blocks(folders).names[:4]
    ('k_side_side', 'c_side_side', 'k_fore_aft', 'c_fore_aft')
    """
    found = _read_results(folders)
    spans = spans_of([result for _, result in found])
    notes: list[str] = []
    if spans is None:
        found = _in_natural_order(found, notes)
    known = _Covariates()
    if covariates is not None:
        found, known = _join_covariates(Path(covariates), found, spans)
    blocks = _gather_results([result for _, result in found], known, notes)
    return replace(blocks, notes=(*notes, *blocks.notes))


def _read_results(folders: Sequence[str | Path]) -> list[tuple[Path, Result]]:
    """Each folder with its result, all of them of one kind."""
    read: Callable[[str | Path], Result] = as_modes if all_hold_modes(folders) else load_posterior
    return [(Path(folder), read(folder)) for folder in folders]


class _Covariates(NamedTuple):
    """Columns (T,) of a file, and where results do not say when they began, its times (T,) [s] and their begin."""

    columns: Mapping[str, Array] = MappingProxyType({})
    time: Array | None = None
    begin: datetime | None = None


def _join_covariates(
    path: Path, found: list[tuple[Path, Result]], spans: Sequence[Span] | None
) -> tuple[list[tuple[Path, Result]], _Covariates]:
    """Results, in order of the file's times where these alone say it, and the lines of each."""
    table = read_covariates(path, len(found))
    rows = lines_of(table, [folder for folder, _ in found], spans)
    time = table.time if spans is None else None
    if time is not None and table.folders:
        order = np.argsort(time[rows])
        found, rows = [found[i] for i in order], [rows[i] for i in order]
    columns = {name: values[rows] for name, values in table.columns.items()}
    if time is None:
        return found, _Covariates(columns)
    return found, _Covariates(columns, time[rows], table.dates[0] if table.dates else None)


def _in_natural_order(found: list[tuple[Path, Result]], notes: list[str]) -> list[tuple[Path, Result]]:
    """Results in natural order where they came in alphabetical order; otherwise as they came."""
    texts = [str(folder) for folder, _ in found]
    natural = sorted(found, key=lambda one: _natural(str(one[0])))
    if texts != sorted(texts) or texts == [str(folder) for folder, _ in natural]:
        return found
    notes.append(f"folders were taken in natural order, {natural[0][0].name} … {natural[-1][0].name}")
    return natural


def _gather_results(
    results: Sequence[Result], known: _Covariates, notes: list[str]
) -> RecordBlocks:  # fmt: skip
    """`gather_modes` or `gather`, with the noise that posteriors hold."""
    modes = [result for result in results if isinstance(result, KnownModes)]
    if modes:
        return gather_modes(modes, time=known.time, covariates=known.columns, begin=known.begin)
    posteriors = [result for result in results if isinstance(result, Posterior)]
    silent = sum(posterior.record_hash is None for posterior in posteriors)
    if silent:
        notes.append(
            f"{silent} results of an older version do not hold the noise of their sensors, which is not watched in"
            " them: identify again"
        )
    noise = [_noise(posterior) for posterior in posteriors]
    return gather(posteriors, time=known.time, covariates=known.columns, noise=noise, begin=known.begin)


def gather_modes(
    results: Sequence[ModesLike],
    *,
    time: Array | None = None,
    covariates: Mapping[str, Array] | None = None,
    begin: datetime | None = None,
) -> RecordBlocks:
    """Blocks from the modes of records, followed from one to the next by frequency and shape, as `gather` puts them in
    order.

    A mode counts in the records in which it is trusted. Modes that fewer than half of the records trust are not
    followed; a note lists them.

    Raises
    ------
    ConfigurationError
        As `gather` does, or if there is no mode to follow.
    """
    known = [as_modes(result) for result in results]
    placed = in_order(known, time, covariates, begin)
    known = [known[i] for i in placed.order]
    tracks, notes = modal_tracks(known)
    names = tuple(f"{what} of {track.name}" for track in tracks for what in ("frequency", "damping"))
    theta = np.hstack([track.values for track in tracks])
    missing = np.isnan(theta).sum(axis=0).tolist()
    series = _SeriesColumns(
        left_out={name: {"not found, or not trusted": of} for name, of in zip(names, missing, strict=True) if of},
        names=names,
        theta=theta,
        std=np.hstack([track.std for track in tracks]),
        logarithmic=(True, True) * len(tracks),
        reference=(1.0, 1.0) * len(tracks),
        units=("Hz", "1") * len(tracks),
        kinds=("f", "c") * len(tracks),
    )
    return _blocks(series, known, placed, covariates, notes)


def _natural(text: str) -> list[tuple[int, str]]:
    """A key that sorts numbers in text by their size."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", text) if part]


def _noise(posterior: Posterior) -> dict[str, tuple[float, float]]:
    """Noise of sensors, each with its relative standard deviation."""
    return {
        s.name: (s.estimate, math.log(s.high / s.low) / (2.0 * SIGMAS))
        for s in posterior.statistics
        if s.kind == "noise" and s.estimate > 0.0 and math.inf > s.high > s.low > 0.0
    }
