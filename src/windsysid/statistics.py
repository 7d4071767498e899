"""Statistics of loads and noise as parameters: what nobody knows beforehand, learned from the record.

Wrong statistics ruin honest bands more than the choice of filter does, so they are identified with the coefficients: one rms for
the loads on the support, one for those on the blades, one time constant, and one noise level for each kind of sensor on either.
Each is a factor on what the turbine file and the sensor list say.

Of a first-order load with corner below the modes only the level rms²/τ of its spectrum is well seen; rms and time constant wander
together. The coordinates η are therefore ln(rms² / τ)/2, ln τ and ln noise, relative to what was given.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windsysid.loads import GaussMarkov
from windsysid.mechanics.sensors import Sensor

__all__ = ["Statistic", "given_statistics", "learned_statistics", "spreads", "with_statistics"]

Array = NDArray[np.float64]

SPREAD, TIME_CONSTANT_SPREAD = 1.5, 0.7
"""Prior standard deviations of η: levels may be wrong by a factor of four or five, the time constant by a factor of two."""


@dataclass(frozen=True)
class Statistic:
    """One statistic of the loads or the sensors.

    Attributes
    ----------
    name, unit
        ``load_rms_support``, ``load_time_constant``, ``noise_blade_acceleration`` …, SI unit.
    given
        What the turbine file or the sensor list says.
    estimate, low, high
        What the record says, with a ±2σ band; NaN until it has been learned.
    """

    name: str
    unit: str
    given: float
    estimate: float = math.nan
    low: float = math.nan
    high: float = math.nan


def given_statistics(loads: Sequence[GaussMarkov], sensors: Sequence[Sensor]) -> tuple[Statistic, ...]:
    """The statistics that a model of these loads and sensors has."""
    found: dict[str, Statistic] = {}
    for load in loads:
        name = _load_group(load)
        found.setdefault(name, Statistic(name, "N" if name == "load_rms_support" else "N*m", load.rms))
    if loads:
        found["load_time_constant"] = Statistic("load_time_constant", "s", loads[0].time_constant)
    for sensor in sensors:
        found.setdefault(_sensor_group(sensor), Statistic(_sensor_group(sensor), sensor.unit, sensor.noise))
    return tuple(found.values())


def spreads(statistics: Sequence[Statistic]) -> Array:
    """Prior standard deviation of each η (n,)."""
    return np.array([TIME_CONSTANT_SPREAD if s.name == "load_time_constant" else SPREAD for s in statistics])


def with_statistics(
    statistics: Sequence[Statistic], eta: Array, loads: Sequence[GaussMarkov], sensors: Sequence[Sensor]
) -> tuple[tuple[GaussMarkov, ...], tuple[Sensor, ...]]:
    """Loads and sensors with the statistics that coordinates η (n,) stand for."""
    logarithms = _logarithms(statistics) @ eta
    factor = {s.name: math.exp(float(value)) for s, value in zip(statistics, logarithms, strict=True)}
    return (
        tuple(
            replace(
                load,
                rms=load.rms * factor[_load_group(load)],
                time_constant=load.time_constant * factor["load_time_constant"],
            )
            for load in loads
        ),
        tuple(sensor.model_copy(update={"noise": sensor.noise * factor[_sensor_group(sensor)]}) for sensor in sensors),
    )


def learned_statistics(statistics: Sequence[Statistic], eta: Array, cov: Array) -> tuple[Statistic, ...]:
    """The statistics with estimates and ±2σ bands, from η (n,) and its covariance (n, n)."""
    to_logarithms = _logarithms(statistics)
    middle = to_logarithms @ eta
    std = np.sqrt(np.diag(to_logarithms @ cov @ to_logarithms.T))
    learned = []
    for s, value, e in zip(statistics, middle, std, strict=True):
        low, estimate, high = (s.given * math.exp(float(value + k * e)) for k in (-2.0, 0.0, 2.0))
        learned.append(replace(s, estimate=estimate, low=low, high=high))
    return tuple(learned)


def _logarithms(statistics: Sequence[Statistic]) -> Array:
    """The matrix that turns η into logarithms of factors: ln rms = η_level + η_τ / 2, the others as they are."""
    names = [s.name for s in statistics]
    matrix: Array = np.eye(len(names))
    if "load_time_constant" in names:
        for row, name in enumerate(names):
            if name.startswith("load_rms"):
                matrix[row, names.index("load_time_constant")] = 0.5
    return matrix


def _load_group(load: GaussMarkov) -> str:
    coordinate = load.load.removeprefix("load_")
    return {"x": "load_rms_support", "y": "load_rms_support", "roll": "load_rms_roll"}.get(
        coordinate, "load_rms_blades"
    )


def _sensor_group(sensor: Sensor) -> str:
    return f"noise_{'blade' if sensor.blade else 'tower'}_{sensor.quantity}"
