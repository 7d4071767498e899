"""Fits of the packaged tower that nothing has estimated: the values of its file, with standard deviations as given; and
identifications of which nobody asks an effect."""

from functools import lru_cache
from typing import Any

import numpy as np

from tests.conftest import effects_untested
from windsysid.identification import identify as front
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.fit import Outcome, known_inputs, no_innovations
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.record import simulate_record
from windsysid.statespace.compose import compose
from windsysid.turbine.file import load_turbine

TOWER = load_turbine("tower")
CHANNELS = tuple(sensor.channel for sensor in TOWER.sensors)
RATE, SAMPLES = 4.0, 800


def record_of(readings: np.ndarray, **others: np.ndarray) -> Record:
    """A record of the tower's two sensors (T, 2), and of other channels without a unit."""
    return Record(
        np.arange(len(readings)) / RATE, np.column_stack([readings, *others.values()]), (*CHANNELS, *others),
        ("m/s^2", "m/s^2", *("" for _ in others)), name="tower",
    )  # fmt: skip


def noise(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((SAMPLES, 2))


def outcome_of(record: Record, *, std: float = 0.01, **changes: Any) -> Outcome:
    """The fit of a record that is as the file says, each coordinate with the same standard deviation, with priors that
    know much less."""
    parameters = Prior(spread=5.0).parameters(TOWER, identifiable(TOWER), linear=False)
    model = compose(TOWER.model, rate=record.rate, values=TOWER.values, parameters=parameters, sensors=TOWER.sensors)
    theta = np.array([q.coordinate(TOWER.values[q.name]) for q in parameters])
    n = len(theta)
    found = Outcome(
        TOWER, model, theta[None], np.full((1, n), std), no_innovations(2, 0.0), theta, std**2 * np.eye(n),
        known_inputs(record, TOWER, TOWER.sensors), CHANNELS, 0.0, (), sensors=TOWER.sensors,
    )  # fmt: skip
    return found._replace(**changes)


def job_of(record: Record, **changes: Any) -> Job:
    known: dict[str, Any] = dict.fromkeys(("sensors", "prior", "parameters", "rate"))
    known |= {"record": record, "part": record, "turbine": TOWER, "loads": "auto"}
    return Job(**(known | changes))


def fitted(record: Record, formulation: Any = "spectral", **changes: Any) -> FittedJob:
    return FittedJob(formulation, outcome_of(record, **changes), record, TOWER.sensors, ())


def identify_without_effects(*given: Any, formulation: str = "joint", **options: Any) -> Identification:
    """Identify, by filters unless told otherwise, for a test that asks nothing of effects."""
    with effects_untested():
        return front.identify(*given, formulation=formulation, **options)  # type: ignore[arg-type]


@lru_cache(maxsize=1)
def rotor_record() -> Record:
    """40 s of the scale model, which several modules identify."""
    return simulate_record(load_turbine("verne555").exact(), duration=40.0, rate=100.0, seed=2)


@lru_cache(maxsize=2)
def rotor_from(scale: float) -> Identification:
    """Filters of that record, with priors at `scale` times the values of the file."""
    return identify_without_effects(rotor_record(), load_turbine("verne555").exact(), prior=Prior(scale, scale))


def std_of_model(found: Identification, name: str) -> float:
    """Standard deviation of an estimate without what contradictory data and rival explanations add."""
    shares = dict(
        zip(found.budget.causes, next(one.causes for one in found.budget.rows if one.name == name), strict=True)
    )
    added = shares.get("dispersion", 0.0) + shares.get("rival explanations", 0.0)
    return float(found[name].std * np.sqrt(1.0 - added))
