"""Statistics of loads and noise as parameters, learned from the record.

Wrong statistics ruin honest intervals more than the choice of filter does, so they are identified with the
coefficients: one rms for the load on each degree of freedom, one time constant (harmonics of the rotor have their own
of either), and one noise level for each kind of sensor. Each is a factor on what the turbine file and the sensor list
say. Loads on like degrees of freedom, those on the blades for instance, are alike in the file and alike by a factor of
two in a record: their levels are tied by the prior.

Of a first-order load with corner below the modes only the level rms²/τ of its spectrum is well seen; rms and time
constant wander together. The coordinates η are therefore ln(rms² / τ)/2, ln τ and ln noise, relative to what was given,
and of tied levels, whose prior has the covariance SPREAD² + TIE² δ_ij, the columns of its Cholesky factor, so that η
are independent.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from windsysid._types import Array
from windsysid.mechanics.model import MechanicalModel
from windsysid.mechanics.sensors import Sensor
from windsysid.statespace.gauss_markov import GaussMarkov

__all__ = [
    "Statistic", "coordinates_of", "learned_statistics", "load_groups", "moved_loads", "moved_sensors", "noise_groups",
    "to_logarithms", "values_of",
]  # fmt: skip


LOG_LEVEL_STD, LOG_TIME_CONSTANT_STD = 1.5, 0.7
"""Prior standard deviations of η: levels may be wrong by a factor of four or five, the time constant by a factor of
two."""

MAX_LOG_RATIO = 300.0
"""Of the logarithm of a statistic over what was given: a search that went astray finds no number beyond."""

LOG_LEVEL_DIFFERENCE_STD = 0.5
"""Prior standard deviation of the logarithm of one degree of freedom's level about that of its like: loads on like
degrees of freedom differ by a factor of two."""


@dataclass(frozen=True)
class Statistic:
    """One statistic of the loads or the sensors.

    Attributes
    ----------
    name, unit
        ``load_rms_x``, ``load_time_constant``, ``noise_blade_acceleration`` …, SI unit.
    given
        What the turbine file or the sensor list says, or what its size should be: the median of the prior.
    estimate, low, high
        What the record says, with a 95 % interval; NaN until it has been learned.
    spread
        Prior standard deviation of its coordinate η.
    like
        Name of what it is tied to by the prior, common to all that are; empty where it stands alone.
    kind
        ``level``: how strong a load is; ``narrow-band level``: how strong a narrow-band load is; ``noise``: of sensors;
        ``shape``: any other number of a load's spectrum.
    of
        The degree of freedom that a level drives; empty where it is common to several.
    time_constant
        Name of the time constant that only rms²/τ, the level of the spectrum, is well known of; empty where there is
        none.
    """

    name: str
    unit: str
    given: float
    estimate: float = math.nan
    low: float = math.nan
    high: float = math.nan
    spread: float = LOG_LEVEL_STD
    like: str = ""
    kind: Literal["level", "narrow-band level", "noise", "shape"] = "shape"
    of: str = ""
    time_constant: str = ""


def load_groups(loads: Sequence[GaussMarkov], model: MechanicalModel) -> tuple[Statistic, ...]:
    """The statistics of loads on a model, as its turbine file lists them."""
    found: dict[str, Statistic] = {}
    for load in loads:
        freedom = model.freedom(load.load)
        name, like = _level(load, model), freedom.group + _line(load)
        level = Statistic(name, freedom.load_unit, load.rms, like=like, kind="level", of=freedom.name)
        found.setdefault(name, replace(level, time_constant=_time_group(load)))
    factors = {like: _tied(number) for like, number in Counter(s.like for s in found.values()).items()}
    rows: Counter[str] = Counter()
    for name, one in found.items():
        row, factor = rows[one.like], factors[one.like]
        rows[one.like] += 1
        found[name] = replace(one, spread=float(factor[row, row]), like=one.like if len(factor) > 1 else "")
    for load in loads:
        name = _time_group(load)
        found.setdefault(name, Statistic(name, "s", load.time_constant, spread=LOG_TIME_CONSTANT_STD))
    return tuple(found.values())


def _tied(levels: int) -> Array:
    """The lower Cholesky factor (n, n) of the prior covariance of n tied levels; of one that stands alone, its
    spread."""
    cov = np.full((levels, levels), LOG_LEVEL_STD**2) + (
        LOG_LEVEL_DIFFERENCE_STD**2 * np.eye(levels) if levels > 1 else 0.0
    )
    return np.asarray(np.linalg.cholesky(cov))


def noise_groups(sensors: Sequence[Sensor]) -> tuple[Statistic, ...]:
    """The statistics of the sensors' noise."""
    found: dict[str, Statistic] = {}
    for sensor in sensors:
        found.setdefault(sensor.noise_group, Statistic(sensor.noise_group, sensor.unit, sensor.noise, kind="noise"))
    return tuple(found.values())


def values_of(statistics: Sequence[Statistic], eta: Array) -> dict[str, float]:
    """Value of each statistic by name, from its coordinates η (n,)."""
    logarithms = np.clip(to_logarithms(statistics) @ eta, -MAX_LOG_RATIO, MAX_LOG_RATIO)
    return {s.name: s.given * math.exp(float(value)) for s, value in zip(statistics, logarithms, strict=True)}


def coordinates_of(statistics: Sequence[Statistic], values: Mapping[str, float]) -> Array:
    """η (n,) of values by name; those not named stay as given."""
    logarithms = np.array([math.log(values.get(s.name, s.given) / s.given) for s in statistics])
    return np.asarray(np.linalg.solve(to_logarithms(statistics), logarithms))


def moved_loads(
    statistics: Sequence[Statistic], values: Mapping[str, float], loads: Sequence[GaussMarkov], model: MechanicalModel
) -> tuple[GaussMarkov, ...]:
    """The file's loads with the statistics that they have in `values`; those not among `statistics` as the file
    says."""
    factor = {s.name: values[s.name] / s.given for s in statistics}
    return tuple(
        replace(
            load,
            rms=load.rms * factor[_level(load, model)],
            time_constant=load.time_constant * factor.get(_time_group(load), 1.0),
        )
        for load in loads
    )


def moved_sensors(
    statistics: Sequence[Statistic], values: Mapping[str, float], sensors: Sequence[Sensor]
) -> tuple[Sensor, ...]:
    """The sensors with the noise that it has in `values`."""
    factor = {s.name: values[s.name] / s.given for s in statistics}
    return tuple(sensor.model_copy(update={"noise": sensor.noise * factor[sensor.noise_group]}) for sensor in sensors)


def learned_statistics(statistics: Sequence[Statistic], eta: Array, cov: Array) -> tuple[Statistic, ...]:
    """The statistics with estimates and 95 % intervals, from η (n,) and its covariance (n, n)."""
    matrix = to_logarithms(statistics)
    middle = matrix @ eta
    std = np.sqrt(np.diag(matrix @ cov @ matrix.T))
    learned = []
    for s, value, e in zip(statistics, middle, std, strict=True):
        low, estimate, high = (s.given * math.exp(float(value + k * e)) for k in (-2.0, 0.0, 2.0))
        learned.append(replace(s, estimate=estimate, low=low, high=high))
    return tuple(learned)


def to_logarithms(statistics: Sequence[Statistic]) -> Array:
    """Matrix from η to the logarithms of factors: ln rms = Σ η_level + η_τ / 2, the others unchanged."""
    times = tuple(s.time_constant for s in statistics)
    return _to_logarithms(tuple(s.name for s in statistics), tuple(s.like for s in statistics), times).copy()


@lru_cache(maxsize=64)
def _to_logarithms(names: tuple[str, ...], ties: tuple[str, ...], times: tuple[str, ...]) -> Array:
    matrix: Array = np.eye(len(names))
    for like in {*ties} - {""}:
        tied = [i for i, other in enumerate(ties) if other == like]
        factor = _tied(len(tied))
        matrix[np.ix_(tied, tied)] = factor / np.diag(factor)
    for row, time in enumerate(times):
        if time and time in names:
            matrix[row, names.index(time)] = 0.5
    return matrix


def _level(load: GaussMarkov, model: MechanicalModel) -> str:
    return f"load_rms_{model.freedom(load.load).name}{_line(load)}"


_TIME = "load_time_constant"


def _time_group(load: GaussMarkov) -> str:
    return _TIME + _line(load)


def _line(load: GaussMarkov) -> str:
    return f"_{load.harmonic}P" if load.harmonic else ""
