"""What records say, one after the other: the series that the watch follows.

A block is one record's estimates without their prior, the noise found in its sensors, and the covariates of its time.
"""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windsysid.comparison import without_prior
from windsysid.errors import ConfigurationError
from windsysid.output import result_file
from windsysid.result import SIGMAS, Posterior, load_posterior

__all__ = ["DAY", "FEWEST", "Blocks", "gather", "read_blocks"]

Array = NDArray[np.float64]

FEWEST = 12
"""Blocks that a watch needs."""

DAY = 86400.0


@dataclass(frozen=True, eq=False)
class Blocks:
    """What records say, one after the other.

    Attributes
    ----------
    names
        Of the n series: coefficients, and ``noise_…`` for what was found of sensors.
    time
        (T,) [s], increasing.
    theta, std
        (T, n) estimates in filter coordinates without their prior, and standard deviations; NaN where a record says nothing.
    logarithmic
        Of each series, whether θ is a logarithm.
    reference
        Of each series, the value at θ = 0 (logarithmic) or θ = 1.
    covariates
        (T, m); a block without all of them is left out.
    covariate_names
        Of the m.
    trusted
        (T,) whether nothing spoke against the record's result.
    records
        Names of the T records; empty where they have none.
    begin
        Calendar time of time 0, where it is known.
    """

    names: tuple[str, ...]
    time: Array
    theta: Array
    std: Array
    logarithmic: tuple[bool, ...]
    reference: tuple[float, ...]
    covariates: Array
    covariate_names: tuple[str, ...] = ()
    trusted: NDArray[np.bool_] | None = None
    records: tuple[str, ...] = ()
    begin: datetime | None = None

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names))
        for what, value in (("theta", self.theta), ("std", self.std)):
            if value.shape != shape:
                raise ConfigurationError(f"blocks: expected {what} of shape {shape}, got {value.shape}")
        if self.covariates.shape != (shape[0], len(self.covariate_names)):
            raise ConfigurationError(
                f"blocks: expected covariates of shape {(shape[0], len(self.covariate_names))}, got {self.covariates.shape}"
            )
        if shape[0] < FEWEST:
            raise ConfigurationError(f"blocks: expected at least {FEWEST} records to learn from, got {shape[0]}")
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
) -> Blocks:
    """Blocks from the posteriors of records, each less its prior, in the coordinates of the first.

    Parameters
    ----------
    posteriors
        Of T records of one turbine, in order.
    time
        (T,) [s]; every 10 minutes by default.
    covariates
        (T,) of each name.
    noise
        For each record, noise of sensors with its standard deviation relative to itself.
    begin
        Calendar time of time 0.

    Raises
    ------
    ConfigurationError
        If records are too few, times do not increase, or lengths disagree.
    """
    count = len(posteriors)
    if count < FEWEST:
        raise ConfigurationError(f"expected at least {FEWEST} records to learn from, got {count}")
    frame = posteriors[0]
    names = [q.name for q in frame.parameters]
    sensors = sorted({name for found in noise for name in found})
    theta = np.full((count, len(names) + len(sensors)), np.nan)
    std = theta.copy()
    for row, posterior in enumerate(posteriors):
        known = [q for q in frame.parameters if q.name in [own.name for own in posterior.parameters]]
        at = [names.index(q.name) for q in known]
        theta[row, at], cov = without_prior(posterior, known)
        std[row, at] = np.sqrt(np.diag(cov))
    for row, found in enumerate(noise):
        for name, (value, relative) in found.items():
            theta[row, len(names) + sensors.index(name)] = math.log(value)
            std[row, len(names) + sensors.index(name)] = relative
    columns = dict(covariates or {})
    return Blocks(
        names=(*names, *sensors),
        time=np.asarray(600.0 * np.arange(count) if time is None else time, dtype=np.float64),
        theta=theta,
        std=std,
        logarithmic=(*(q.logarithmic for q in frame.parameters), *(True for _ in sensors)),
        reference=(*(q.reference for q in frame.parameters), *(1.0 for _ in sensors)),
        covariates=np.column_stack(list(columns.values())) if columns else np.empty((count, 0)),
        covariate_names=tuple(columns),
        trusted=np.array([posterior.trusted for posterior in posteriors]),
        records=tuple(posterior.record for posterior in posteriors),
        begin=begin,
    )


def read_blocks(folders: Sequence[str | Path], covariates: str | Path | None = None) -> Blocks:
    """Blocks from folders that ``windsysid identify`` wrote, in order, and a CSV file with a line for each.

    The file's column ``time``, in seconds or as ISO 8601, says when each record began, every other column is a covariate; an empty cell is a missing value. Without a time, records
    are 10 minutes apart.

    Raises
    ------
    ConfigurationError
        If a folder holds no result, or the file does not fit.
    """
    posteriors = [load_posterior(folder) for folder in folders]
    noise = [_noise(Path(folder)) for folder in folders]
    if covariates is None:
        return gather(posteriors, noise=noise)
    columns, begin = _columns(Path(covariates), len(posteriors))
    time = columns.pop("time", None)
    return gather(posteriors, time=time, covariates=columns, noise=noise, begin=begin)


def _noise(folder: Path) -> dict[str, tuple[float, float]]:
    """Noise of sensors in a result's summary, each with its relative standard deviation."""
    try:
        statistics = json.loads(result_file(folder, "summary.json").read_text(encoding="utf-8")).get("statistics", {})
    except (OSError, ValueError):
        return {}
    return {
        name: (s["estimate"], math.log(s["high"] / s["low"]) / (2.0 * SIGMAS))
        for name, s in statistics.items()
        if name.startswith("noise_")
        and all(s[key] for key in ("estimate", "low", "high"))
        and s["high"] > s["low"] > 0.0
    }


def _columns(path: Path, count: int) -> tuple[dict[str, Array], datetime | None]:
    """Columns of a CSV file with one line a record, time in seconds, and the calendar time of time 0."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"covariates {path}: cannot be read: {error}") from None
    if len(lines) != count:
        raise ConfigurationError(f"covariates {path}: expected {count} lines, one for each record, got {len(lines)}")
    begin: datetime | None = None
    columns: dict[str, Array] = {}
    for name in lines[0]:
        texts = [(line[name] or "").strip() for line in lines]
        if name == "time" and not _is_number(texts[0]):
            try:
                dates = [datetime.fromisoformat(text) for text in texts]
                columns[name] = np.array([(date - dates[0]).total_seconds() for date in dates])
            except (ValueError, TypeError):
                raise ConfigurationError(
                    f"covariates {path}: expected times in seconds or as 2026-03-31T12:00, got {texts[0]!r}"
                ) from None
            begin = dates[0]
            continue
        bad = [text for text in texts if text and not _is_number(text)]
        if bad:
            raise ConfigurationError(
                f"covariates {path}: expected numbers in column '{name}', got {bad[0]!r}: leave the column out"
            )
        columns[name] = np.array([float(text) if text else math.nan for text in texts])
    return columns, begin


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
