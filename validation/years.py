"""Years of 10-minute records: how often a watch alarms for nothing, and how soon it sees what is wrong.

A year is simulated as what its records would say: one estimate per coefficient and 10 minutes, with the covariance of a
record of that length by `windsysid.plan` for that turbine at a load scale, loads and noise unknown. Two winds: mean 6
m/s (load scale 0.3) and 12 m/s (load scale 1). On top:

- temperature: a season of ±10 K, a day of ±4 K, weather of 3 K that lasts three days. Support stiffness falls by 0.03
%, blade stiffness by 0.1 % per K.
- wind: about its mean by 30 % with a memory of 12 hours; damping is proportional to 1 + 0.5 (v / mean − 1).
- what no covariate explains: stiffness wanders by 0.02 %, damping by 1 % in a day; blocks scatter 1.2 times as much as
their bands say.
- bad data: one block in 200 is off by 10 σ on average, 3 % and one whole fortnight are missing.

Changes come after 30 days: 2, 5 and 10 % of k_x, 20 % of one blade's k_beta, c_x halved and doubled. The watch
(`windsysid.monitoring.watch.watch`) is given temperature and wind speed, and 0.1 false alarms a year; each trial
follows the coefficient that changes, at the threshold that all of the turbine's together have.

``python -m validation.years [--years N] [--turbine NAME]`` prints the tables. With ``--raw N`` it simulates and
identifies N raw records of 10 minutes instead, k_x 5 % less in the second half, and holds their scatter against that of
the compressed years. With ``--faults`` it identifies one raw record of verne555 as it is, with a softer support, and
with faults of its sensors.
"""

import argparse
import math
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.identifiability import standard_deviations
from windsysid.errors import WindsysidError
from windsysid.identification.planning.plan import plan
from windsysid.monitoring.changes import Watch
from windsysid.monitoring.series import DAY, RecordBlocks, gather
from windsysid.monitoring.watch import TOLERATED_DRIFT, YEAR, watch
from windsysid.output.console import render
from windsysid.results.posterior import Posterior
from windsysid.turbine.file import load_turbine

__all__ = ["CHANGES", "WINDS", "Delay", "Site", "delays", "false_alarms", "raw", "simulate_blocks", "site", "smallest"]


BLOCK = 600.0
"""[s]"""

WINDS = {6.0: 0.3, 12.0: 1.0}
"""Mean wind speed [m/s] and load scale."""

CHANGES = (("k_x", 0.98), ("k_x", 0.95), ("k_x", 0.90), ("k_beta_1", 0.80), ("c_x", 0.5), ("c_x", 2.0))
"""Coefficient and factor."""

STATED = 0.1
"""False alarms a year."""

OFTEN = 10.0
"""A rate that shows itself in few years."""

RAW_SAMPLES = 12.0
"""Samples of a raw record per period of the fastest degree of freedom."""

BEFORE, AFTER = 30.0, 15.0
"""Days before and after a change."""


class Site(NamedTuple):
    """A turbine in a wind: its coefficients' names, relative standard deviations of a block, mean wind [m/s]."""

    turbine: str
    names: tuple[str, ...]
    sigma: Array
    wind: float


class Delay(NamedTuple):
    """Number of trials that detected a change: delays to the alarm [s], infinite without one, and whether the bands
    held the truth.
    """

    seconds: Array
    when: float
    size: float


def site(turbine: str, wind: float) -> Site:
    """Information of 10 minutes on a packaged turbine at one of `WINDS`."""
    planned = plan(load_turbine(turbine).exact(), duration=BLOCK, load_scale=WINDS[wind])
    sigma = standard_deviations(planned.information(BLOCK))[: planned.unknown]
    return Site(turbine, planned.names[: planned.unknown], sigma, wind)


def simulate_blocks(
    place: Site, *, days: float, seed: int, change: tuple[str, float] | None = None, only: str | None = None
) -> RecordBlocks:
    """Blocks of a turbine, one coefficient of which is multiplied by a factor after `BEFORE` days.

    Relative coordinates: ln(k / k₀) for stiffness, c / c₀ for damping.
    """
    rng = np.random.default_rng(seed)
    count = int(days * DAY / BLOCK)
    time = BLOCK * np.arange(count)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    season = 10.0 * np.sin(2.0 * np.pi * time / YEAR + phase) + 4.0 * np.sin(2.0 * np.pi * time / DAY)
    temperature = 10.0 + season + 3.0 * _memory(rng, count, 3.0 * DAY)
    wind = place.wind * np.exp(0.3 * _memory(rng, count, 0.5 * DAY) - 0.045)
    names = place.names if only is None else (only,)
    theta: Array = np.empty((count, len(names)))
    std = np.empty_like(theta)
    for i, name in enumerate(names):
        sigma, stiff = float(place.sigma[place.names.index(name)]), name.startswith("k_")
        daily = 0.0002 if stiff else 0.01
        steps = daily * math.sqrt(BLOCK / DAY) * rng.standard_normal(count)
        if stiff:
            truth = np.cumsum(steps) + (-0.001 if "beta" in name else -0.0003) * (temperature - 10.0)
        else:
            truth = 1.0 + np.cumsum(steps) + 0.5 * (wind / place.wind - 1.0)
        if change is not None and change[0] == name:
            after = time >= BEFORE * DAY
            truth = truth + np.log(change[1]) * after if stiff else truth * np.where(after, change[1], 1.0)
        bad = rng.random(count) < 0.005
        errors = 1.2 * sigma * rng.standard_normal(count) * np.where(bad, 10.0, 1.0)
        theta[:, i], std[:, i] = truth + errors, sigma
    lost = rng.random(count) < 0.03
    if days > 60.0:
        out = int(rng.uniform(0.0, count - 14.0 * DAY / BLOCK))
        lost[out : out + int(14.0 * DAY / BLOCK)] = True
    theta[lost] = np.nan
    return RecordBlocks(
        names, np.asarray(time, dtype=np.float64), theta, std, tuple(name.startswith("k_") for name in names),
        (1.0,) * len(names),
        np.column_stack([temperature, wind]), ("temperature", "wind_speed"),
        kinds=tuple(name.partition("_")[0] for name in names),
    )  # fmt: skip


def false_alarms(
    place: Site, years: int, rate: float, *, tolerated: Mapping[str, float] = TOLERATED_DRIFT, seed: int = 0
) -> int:
    """Alarms in that many years without a change."""
    of = (simulate_blocks(place, days=YEAR / DAY, seed=seed + year) for year in range(years))
    return sum(len(watch(blocks, alarms_per_year=rate, tolerated=tolerated).changes) for blocks in of)


def smallest(place: Site, name: str, *, seed: int = 0) -> tuple[float, float]:
    """The jump of one coefficient that is found within a day after a year [%], with and without covariates."""
    told = simulate_blocks(place, days=YEAR / DAY, seed=seed, only=name)
    kept = replace(told, covariates=np.empty((len(told.time), 0)), covariate_names=())
    found = [watch(blocks, alarms_per_year=STATED / len(place.names)).series[0].smallest for blocks in (told, kept)]
    return found[0], found[1]


def delays(place: Site, change: tuple[str, float], trials: int, *, seed: int = 1000) -> Delay:
    """Delay and accuracy of the detection of one change."""
    seconds, when, size = np.full(trials, np.inf), 0, 0
    for trial in range(trials):
        blocks = simulate_blocks(place, days=BEFORE + AFTER, seed=seed + trial, change=change, only=change[0])
        found = watch(blocks, alarms_per_year=STATED / len(place.names))
        right = [c for c in found.changes if c.found >= BEFORE * DAY]
        if right:
            first = right[0]
            seconds[trial] = first.found + BLOCK - BEFORE * DAY
            when += first.earliest <= BEFORE * DAY <= first.latest
            size += first.low <= 100.0 * (change[1] - 1.0) <= first.high
    seen = max(int(np.isfinite(seconds).sum()), 1)
    return Delay(seconds, when / seen, size / seen)


def raw(turbine: str, records: int, *, factor: float = 0.95) -> tuple[RecordBlocks, Watch]:
    """Simulate and identify raw records of 10 minutes, k_x times `factor` in the second half; watch their blocks."""
    from rich.console import Console
    from rich.progress import track

    each = ((turbine, seed, factor if seed >= records // 2 else 1.0) for seed in range(records))
    with ProcessPoolExecutor() as pool:
        found = pool.map(_raw_record, each, chunksize=4)
        posteriors = list(track(found, total=records, description="raw records", console=Console(stderr=True)))
    blocks = gather(posteriors)
    return blocks, watch(blocks, alarms_per_year=STATED)


def _raw_record(which: tuple[str, int, float]) -> Posterior:
    """Information of one record, sampled `RAW_SAMPLES` times per period of the fastest degree of freedom."""
    from windsysid.identification.identify import identify
    from windsysid.simulation.record import simulate_record

    name, seed, factor = which
    healthy = load_turbine(name).exact()
    rate = RAW_SAMPLES * max(healthy.natural_frequency(q) for q in healthy.model.coordinates) / (2.0 * math.pi)
    damaged = healthy.with_values({"k_x": factor * healthy.values["k_x"]})
    record = simulate_record(damaged, duration=BLOCK, rate=rate, seed=seed)
    return identify(record, healthy, formulation="joint").posterior


def _memory(rng: np.random.Generator, count: int, seconds: float) -> Array:
    """A first-order Gauss–Markov series of unit variance (count,)."""
    from scipy.signal import lfilter

    a = math.exp(-BLOCK / seconds)
    noise = math.sqrt(1.0 - a * a) * rng.standard_normal(count)
    return np.asarray(lfilter([1.0], [1.0, -a], noise, zi=[a * rng.standard_normal()])[0])


def main() -> None:
    """Print the tables."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.years", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--years",
        type=int,
        default=4,
        help="years without a change, for each wind; 5 trials of each change for every year",
    )
    parser.add_argument("--turbine", default="nrel5mw", help="a packaged turbine with k_x, c_x and k_beta_1")
    parser.add_argument(
        "--raw", type=int, metavar="N", help="raw records of 10 minutes instead, 24 or more; 1008 are a week"
    )
    parser.add_argument("--faults", action="store_true", help="what faults of sensors do to one raw record")
    options = parser.parse_args()
    if options.faults:
        print(_fault_table())
        return
    if options.raw is not None:
        print(_raw_table(options.turbine, options.raw))
        return
    if options.years < 1:
        raise SystemExit(f"--years: expected 1 or more, got {options.years}")
    alarms = Table(title=f"{options.turbine}: alarms in a year without a change", title_justify="left")
    for heading in (
        "wind [m/s]",
        f"stated {STATED:g}",
        f"stated {OFTEN:g}, nothing tolerated",
        "jump of k_beta_1 detectable in a day",
        "covariates not told",
    ):
        alarms.add_column(heading, justify="right")
    seen = Table(title=f"{options.turbine}: from a change to its alarm", title_justify="left")
    for heading in ("change", "wind [m/s]", "σ of a block", "median", "90 %", "when within band", "size within band"):
        seen.add_column(heading, justify="left" if heading == "change" else "right")
    for wind in WINDS:
        place = site(options.turbine, wind)
        kinds = ((STATED, TOLERATED_DRIFT), (OFTEN, dict.fromkeys(TOLERATED_DRIFT, 0.0)))
        rates = [false_alarms(place, options.years, rate, tolerated=of) / options.years for rate, of in kinds]
        jumps = smallest(place, "k_beta_1")
        alarms.add_row(f"{wind:g}", *(f"{rate:.3g}" for rate in rates), *(f"{jump:.2g} %" for jump in jumps))
        for i, change in enumerate(CHANGES):
            found = delays(place, change, 5 * options.years, seed=1000 * (i + 1))
            sigma = place.sigma[place.names.index(change[0])]
            seen.add_row(
                f"{change[0]} × {change[1]:g}", f"{wind:g}", f"{100.0 * sigma:.2g} %", _hours(found.seconds, 0.5),
                _hours(found.seconds, 0.9),
                f"{100.0 * found.when:.0f} %", f"{100.0 * found.size:.0f} %",
            )  # fmt: skip
    print(
        render(
            alarms,
            seen,
            f"{options.years} years and {5 * options.years} trials of each change in each wind; bands ±2σ (95.45 %)",
        )
    )


def _fault_table() -> str:
    """Effect of a sensor's fault, and trust in the result."""
    from rich.table import Table

    from windsysid.identification.identify import identify
    from windsysid.simulation.record import simulate_record

    turbine = load_turbine("verne555").exact()
    softer = turbine.with_values({"k_x": 0.95 * turbine.values["k_x"]})
    healthy, damaged = (simulate_record(one, duration=300.0, rate=50.0, seed=1) for one in (turbine, softer))
    tower, blade, noise = (
        "tower_x_acceleration",
        "blade_1_lag_acceleration",
        np.random.default_rng(9).standard_normal(healthy.samples),
    )
    cases = [("none", healthy), ("none, support 5 % softer", damaged)]
    for fault, channel, gain, more in (
        (f"noise × 5, {tower}", tower, 1.0, 0.05 * math.sqrt(24.0)), (f"gain × 0.8, {tower}", tower, 0.8, 0.0),
        (f"gain × 0.8, {blade}", blade, 0.8, 0.0),
    ):  # fmt: skip
        values = healthy.values.copy()
        column = healthy.channels.index(channel)
        values[:, column] = gain * values[:, column] + more * noise
        cases.append((fault, replace(healthy, values=values)))
    table = Table(title="verne555, 300 s: change from the sound record", title_justify="left")
    for heading in ("fault", "k_x", "k_y", "k_beta_1", "c_x", "noise, tower", "noise, blades", "trusted"):
        table.add_column(heading, justify="left" if heading == "fault" else "right")
    sound: dict[str, float] = {}
    for fault, record in cases:
        found = identify(record, turbine, formulation="joint")
        values_found = {e.name: e.estimate for e in found.estimates} | {s.name: s.estimate for s in found.statistics}
        sound = sound or values_found
        changes = [
            f"{100.0 * (values_found[name] / sound[name] - 1.0):+.2g} %"
            for name in ("k_x", "k_y", "k_beta_1", "c_x", "noise_tower_acceleration", "noise_blade_acceleration")
        ]
        table.add_row(fault, *changes, "yes" if found.diagnosis.trusted else "no")
    return render(table)


def _raw_table(turbine: str, records: int) -> str:
    """Scatter of raw records compared with their bands and those of the compressed years, and the result of the
    watch."""
    from rich.table import Table

    if records < 24:
        raise SystemExit(f"--raw: expected 24 or more, got {records}")
    blocks, found = raw(turbine, records)
    place = site(turbine, 12.0)
    table = Table(title=f"{turbine}: {records} raw records of 10 minutes", title_justify="left")
    for heading in ("", "scatter", "their bands' σ", "σ of the compressed years"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, sigma in zip(place.names, place.sigma, strict=True):
        i = blocks.names.index(name)
        size = 1.0 if blocks.logarithmic[i] else abs(float(np.median(blocks.theta[:, i])))
        halves = np.concatenate([half - half.mean() for half in np.array_split(blocks.theta[:, i], [records // 2])])
        scatter = math.sqrt(float(np.square(halves).sum()) / (records - 2)) / size
        own = float(np.median(blocks.std[:, i])) / size
        table.add_row(name, *(f"{100.0 * value:.2g} %" for value in (scatter, own, float(sigma))))
    return render(table, found.sentence)


def _hours(seconds: Array, share: float) -> str:
    at = float(np.sort(seconds)[math.ceil(share * len(seconds)) - 1])
    return f"> {AFTER:g} d" if math.isinf(at) else f"{at / 3600.0:.1f} h"


if __name__ == "__main__":
    try:
        main()
    except WindsysidError as error:
        sys.exit(str(error))
