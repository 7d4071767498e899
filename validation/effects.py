"""Identification of effects: each alone, in pairs and three at once, as its size grows.

    python -m validation.effects [--first SEED] [--runs N] [--only KIND …] [--machines tower rotor] [--sizes SIZE …]

A tower and the scale rotor are simulated by programs that share no code with windsysid (`validation.towers`,
`validation.adversary`), and their sensor lists have no biases. Effects are added to one channel (a bias, a trend, a
step, as a share of its standard deviation), or to the loads of the support (a machine's sinusoid, a force that turns
with the rotor at 3P, a narrow-band load, as a share of the loads' standard deviation). Filters and spectra identify
each record with the one loop of `windsysid.identification.pipeline`.

Of every kind and size the table says in what share of the runs the first effect that was included is one that was
added, in what share all that were added and nothing else were included, in what share something is said against the
result, and the rms error of the estimates in standard deviations: without the loop, and with it.
"""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from validation import towers
from validation.adversary import scenarios
from validation.adversary.loads import independent, plus_line, plus_narrow_band
from validation.adversary.machine import Machine
from windsysid.errors import WindsysidError
from windsysid.identification.effects.random_walk_bias import RandomWalkBiases
from windsysid.identification.effects.sinusoidal_force import Sinusoids
from windsysid.identification.formulations import estimate
from windsysid.identification.job import FittedJob, Formulation, Job
from windsysid.identification.model.effect import Inclusion
from windsysid.identification.pipeline import run
from windsysid.records.record import Record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["KINDS", "Row", "main", "named", "study"]

FRESH = 46_500_000
"""Seeds that were not used while the effects were written."""

SIZES = 0.1, 0.2, 0.4, 0.8

KINDS = (
    "", "bias", "trend", "step", "sinusoid", "rotor harmonic", "narrow band",
    "bias + sinusoid", "trend + sinusoid", "step + sinusoid", "trend + step + sinusoid",
)  # fmt: skip
"""Effects that are added; the rotor harmonic to the rotor only."""

CHANNELS = {"tower": "tower_z_acceleration", "rotor": "tower_x_acceleration"}


def _tower(kind: Sequence[str], size: float, seed: int) -> tuple[Record, dict[str, float]]:
    loads = None
    if "sinusoid" in kind:
        loads = towers._line(0.36, 0.5 * size**2, 1)
    if "narrow band" in kind:
        loads = towers._narrow(0.36, 0.01, size, 1)
    with _entry(towers.KINDS, towers.Kind() if loads is None else towers.Kind(loads=loads)) as name:
        return towers.simulate(name, seed)


def _rotor(kind: Sequence[str], size: float, seed: int) -> tuple[Record, dict[str, float]]:
    loads = independent()
    if "sinusoid" in kind:
        loads = plus_line(1.9, 0.5 * size**2, (0,))
    if "rotor harmonic" in kind:
        loads = plus_line(3.0 * Machine().speed / (2.0 * math.pi), 0.5 * size**2, (0, 1))
    if "narrow band" in kind:
        loads = plus_narrow_band(1.9, 0.01, size, (0, 1))
    with _entry(scenarios.SCENARIOS, scenarios.Scenario(scenarios.HEALTHY, loads)) as name:
        return scenarios.record(name, seed), dict(Machine().truth)


@contextmanager
def _entry(table: Any, value: object) -> Iterator[str]:
    """An entry of a table for as long as it is used."""
    table["effects"] = value
    try:
        yield "effects"
    finally:
        del table["effects"]


def _turbine(machine: str) -> Turbine:
    packaged = load_turbine("tower" if machine == "tower" else "verne555")
    return replace(packaged, sensors=tuple(one.model_copy(update={"bias": 0.0}) for one in packaged.sensors))


def simulated(machine: str, kind: Sequence[str], size: float, seed: int) -> tuple[Record, dict[str, float]]:
    """A record with effects, and the coefficients of its machine."""
    made, truth = (_tower if machine == "tower" else _rotor)(kind, size, seed)
    channel, x = CHANNELS[machine], np.linspace(0.0, 1.0, made.samples)
    waves = {
        "bias": np.ones_like(x),
        "trend": np.polynomial.legendre.legval(2.0 * x - 1.0, [0.0, 1.0, -0.7, 0.5]),
        "step": 2.0 * (x > 0.55),
    }
    added = size * float(np.std(made[channel])) * sum((waves[one] for one in kind if one in waves), np.zeros_like(x))
    return made.with_channels({channel: (made[channel] + added, made.unit(channel))}), truth


def named(effects: Sequence[Inclusion]) -> list[str]:
    """Included effects of a job, in the words of `KINDS`, in the order of inclusion."""
    found = list[str]()
    for one in effects:
        if isinstance(one, Sinusoids):
            found += ["rotor harmonic" if sine.order else "sinusoid" for sine in one.sines]
        elif isinstance(one, RandomWalkBiases):
            found.append("random walk" if one.drifts else "trend")
        else:
            found.append({"sensor_bias": "bias", "narrow_band_load": "narrow band"}.get(one.code, one.code))
    return list(dict.fromkeys(found))


class Row(NamedTuple):
    """One run: effects that were added and those that were named, whether something is said against the result, and
    errors [σ] without the loop and with it; NaN where a search failed."""

    added: tuple[str, ...]
    named: tuple[str, ...]
    doubted: bool
    plain: float
    extended: float

    @property
    def first(self) -> bool:
        """Test whether the first effect that was named was added; of none, that none was named."""
        return self.named[0] in self.added if self.named and self.added else self.named == self.added

    @property
    def exactly(self) -> bool:
        """Test whether all that were added were named, and nothing else."""
        return set(self.named) == set(self.added)


def _error(fit: FittedJob, truth: Mapping[str, float]) -> float:
    """The rms error of the estimates [σ]."""
    at = zip(fit.outcome.model.parameters, fit.outcome.theta, np.sqrt(np.diag(fit.outcome.cov)), strict=True)
    off = [(theta - q.coordinate(truth[q.name])) / std for q, theta, std in at if q.name in truth]
    return float(np.sqrt(np.mean(np.square(off))))


def study(machine: str, formulation: Formulation, kind: str, size: float, seed: int) -> Row:
    """Identify one record without the loop and with it."""
    added = tuple(kind.split(" + ")) if kind else ()
    made, truth = simulated(machine, added, size, seed)
    job = Job(made, made, _turbine(machine), None, DrawnPrior(seed=seed), None, None, "auto", formulation)
    try:
        plain = _error(estimate(job), truth)
    except (WindsysidError, np.linalg.LinAlgError):
        plain = math.nan
    try:
        answered, fit = run(job)
    except (WindsysidError, np.linalg.LinAlgError):
        return Row(added, (), True, plain, math.nan)
    doubted = bool(fit.outcome.doubts or fit.unmodelled)
    return Row(added, tuple(named(answered.effects)), doubted, plain, _error(fit, truth))


def table(machine: str, formulation: Formulation, kinds: Sequence[str], sizes: Sequence[float], seeds: range) -> None:
    """Print the table of a machine and a formulation."""
    print(f"\n{machine}, {'filters' if formulation == 'joint' else 'spectra'}, {len(seeds)} runs of each")
    print(f"{'added':26}{'size':>6}{'first':>8}{'exactly':>9}{'doubts':>8}{'error without':>15}{'with the loop':>15}")
    for kind in kinds:
        if kind == "rotor harmonic" and machine == "tower":
            continue
        for size in sizes if kind else (0.0,):
            rows = [study(machine, formulation, kind, size, seed) for seed in seeds]
            shares = [float(np.mean(of)) for of in zip(*((r.first, r.exactly, r.doubted) for r in rows), strict=True)]
            errors = [float(np.sqrt(np.nanmean(np.square(of)))) for of in zip(*(row[3:] for row in rows), strict=True)]
            print(
                f"{kind or 'nothing':26}{size:6.2g}{shares[0]:8.0%}{shares[1]:9.0%}{shares[2]:8.0%}"
                f"{errors[0]:13.2f} σ{errors[1]:13.2f} σ", flush=True,
            )  # fmt: skip


def main() -> None:
    """Print the tables that were requested."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=FRESH, help="first seed")
    parser.add_argument("--runs", type=int, default=6, help="runs of each kind and size")
    parser.add_argument("--only", nargs="+", default=list(KINDS), choices=KINDS, help="kinds")
    parser.add_argument("--machines", nargs="+", default=["tower", "rotor"], choices=["tower", "rotor"])
    parser.add_argument("--sizes", nargs="+", type=float, default=list(SIZES), help="shares of a standard deviation")
    given = parser.parse_args()
    for machine in given.machines:
        formulations: tuple[Formulation, ...] = ("joint", "spectral") if machine == "tower" else ("joint",)
        for formulation in formulations:
            table(machine, formulation, given.only, given.sizes, range(given.first, given.first + given.runs))


if __name__ == "__main__":
    main()
