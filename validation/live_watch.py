"""The watch of ``windsysid live``, window after window: false alarms, delays, sensor or structure, and bands of levels.

Estimates are simulated as `validation.years` has them, one for each coefficient and 10 minutes: a season, weather, wind
that moves the damping, a wander that no covariate explains, scatter 1.2 times the bands, bad windows, gaps. No record
is simulated or identified. Each becomes the row that an identification would give, and
`windsysid.live.watch.watching.Watching` takes it in as the service does. A watch learns a day.

- False alarms: k_x, c_x and k_beta_1 of nrel5mw and the noise of a sensor, in wind of 12 m/s; watches of three weeks,
  so that most of it is a young watch's.
- Delays: one coefficient, at the threshold that all of the turbine's together have, 3 or 30 days after the watch began.
- Causes: k_x, c_x and a noise, of which the structure, a sensor's noise, or a sensor's gain changes; a gain moves
  coefficients and trust, as ``python -m validation.years --faults`` found.
- Drifts: k_x alone, which falls evenly over 60 days, 30 days after the watch began; and watches of months without a
  drift, with and without the temperature.
- Bands: a level without covariates that is constant, or wanders by a stated size a day.

Seeds begin at `--first`; those that the pages name were not looked at while building. ``python -m
validation.live_watch`` prints the tables.
"""

import argparse
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from validation.years import BLOCK, Site, simulate_blocks, site
from windsysid._types import Array
from windsysid.fleet.rows import Row, empty_row
from windsysid.live.store.contents import Alarm
from windsysid.live.watch.watching import Taken, WatchOptions, start
from windsysid.monitoring.series import DAY, RecordBlocks
from windsysid.monitoring.watch import TOLERATED_DRIFT, YEAR
from windsysid.output.console import render

__all__ = ["false_alarms", "rows_of"]

WIND = 12.0
"""[m/s]"""

SIZES = (0.99, 0.98, 0.97, 0.95)
"""Factors on k_x."""

NOISE = "noise_tower_acceleration"

FOLLOWED = ("k_x", "c_x", "k_beta_1")
"""Coefficients of the watches without a change."""

NOISE_SIGMA = 0.03
"""Relative standard deviation of a window's estimate of a noise; it scatters 1.2 times as much and wanders by 1 % a
day."""

STATED, OFTEN = 0.1, 10.0
"""False alarms a year."""

AFTER = 2.0
"""Days after a change."""

DRIFTS = (0.99, 0.98, 0.97, 0.95)
"""Factors on k_x at the end of a drift."""

DRIFT_BEFORE, DRIFT_OVER, DRIFT_AFTER = 30.0, 60.0, 30.0
"""Days before, of, and after a drift."""

WANDERS = (0.0, 0.0002, 0.002, 0.01)
"""Random walk of a level in a day, relative."""

SIGMA = 0.003
"""Of a window, where bands are counted."""

BEGIN = 1_767_225_600 * 10**9
STEP = round(1e9 * BLOCK)


class Delays(NamedTuple):
    """Of trials: from a change to its alarm [s], infinite without one; whether when and how much were within bands, of
    those with an alarm, as they were said a day later; alarms that were none of it."""

    seconds: Array
    when: float
    size: float
    other: int


def rows_of(
    blocks: RecordBlocks, noise: Mapping[str, Array], trusted: NDArray[np.bool_] | None = None
) -> Iterator[Row]:
    """Rows of windows (T,) that say this of coefficients, and this logarithm (T,) of each noise."""
    for k in range(len(blocks.time)):
        row = empty_row("simulated", 0, "sha256:0")
        row |= {"status": "ok", "state": "running", "trusted": trusted is None or bool(trusted[k])}
        row |= {
            f"scada_{name}": float(value)
            for name, value in zip(blocks.covariate_names, blocks.covariates[k], strict=True)
        }
        row["parameters"] = [
            {"name": name, "unit": "1", "kind": "damping" if name.startswith("c_") else "stiffness",
             "logarithmic": logarithmic, "prior_centre": 1.0, "coordinate_scale": 1.0, "own": theta, "own_std": std}
            for name, logarithmic, theta, std in zip(
                blocks.names, blocks.logarithmic, blocks.theta[k], blocks.std[k], strict=True
            ) if math.isfinite(theta)
        ]  # fmt: skip
        row["statistics"] = [
            {"name": name, "unit": "m/s^2", "estimate": math.exp(of[k]), "low": math.exp(of[k] - 2.0 * NOISE_SIGMA),
             "high": math.exp(of[k] + 2.0 * NOISE_SIGMA)} for name, of in noise.items() if math.isfinite(of[k])
        ]  # fmt: skip
        yield row


def noise_of(count: int, seed: int) -> Array:
    """The logarithm of a noise, as windows find it (T,)."""
    rng = np.random.default_rng([seed, 1])
    level = np.cumsum(0.01 * math.sqrt(BLOCK / DAY) * rng.standard_normal(count))
    return np.asarray(level + 1.2 * NOISE_SIGMA * rng.standard_normal(count), dtype=np.float64)


def watched(rows: Iterator[Row], options: WatchOptions) -> tuple[list[Taken], float]:
    """Results of a watch, without checkpoints, and its processor time of a window [s]."""
    watching, taken, spent = start("simulated", options), [], 0.0
    watching.checkpoint = lambda: b""  # type: ignore[method-assign]  # not read here
    for k, row in enumerate(rows):
        begin = time.process_time()
        one = watching.take(row, BEGIN + k * STEP)
        spent += time.process_time() - begin
        taken.append(one)
    return taken, spent / max(len(taken), 1)


def said(taken: Sequence[Taken]) -> list[Alarm]:
    """Alarms of jumps, as they were last said, in their order."""
    return list({alarm.key: alarm for one in taken for alarm in one.alarms if alarm.kind != "data"}.values())


def false_alarms(
    place: Site, days: float, learn: int, rate: float, tolerated: Mapping[str, float], seed: int
) -> tuple[list[float], list[bool], float]:
    """When a watch without a change had alarms [days after it began], which of them were of the noise, and the
    processor time of a window [s]."""
    blocks = simulate_blocks(of_these(place, FOLLOWED), days=days, seed=seed)
    noise = {NOISE: noise_of(len(blocks.time), seed)}
    taken, cost = watched(rows_of(blocks, noise), WatchOptions(learn=learn, alarms_per_year=rate, tolerated=tolerated))
    alarms = said(taken)
    return [(alarm.opened - BEGIN) / 1e9 / DAY for alarm in alarms], [alarm.about == NOISE for alarm in alarms], cost


def of_these(place: Site, names: Sequence[str]) -> Site:
    """A site of which only these coefficients are known."""
    return place._replace(names=tuple(names), sigma=place.sigma[[place.names.index(name) for name in names]])


def delay(place: Site, factor: float, before: float, seed: int) -> tuple[float, bool, bool, int]:
    """One trial: seconds to the alarm, when and size within band, and other alarms."""
    blocks = simulate_blocks(place, days=before + AFTER, seed=seed, only="k_x")
    blocks.theta[blocks.time >= before * DAY] += math.log(factor)
    series = len(place.names) + 2  # noises
    taken, _ = watched(rows_of(blocks, {}), WatchOptions(alarms_per_year=STATED / series))
    change = BEGIN + round(before * DAY) * 10**9
    right = [alarm for alarm in said(taken) if alarm.opened > change]
    others = len(said(taken)) - min(len(right), 1)
    if not right:
        return math.inf, False, False, others
    first = right[0]
    band = first.text.partition(" % (")[2].partition(" %)")[0].split(" … ")
    within = float(band[0]) <= 100.0 * (factor - 1.0) <= float(band[1])
    return (first.opened - change) / 1e9, first.earliest <= change <= first.latest, within, others


def drift(place: Site, factor: float, seed: int) -> tuple[float, bool, int, int]:
    """One trial: days from the begin of a drift to its alarm, infinite without one; whether its band held the change,
    drift and wander, as it was first said; alarms of jumps, and others of drifts."""
    days = DRIFT_BEFORE + DRIFT_OVER + DRIFT_AFTER
    blocks = simulate_blocks(place, days=days, seed=seed, only="k_x")
    fall = np.log1p((factor - 1.0) * np.clip((blocks.time / DAY - DRIFT_BEFORE) / DRIFT_OVER, 0.0, 1.0))
    exact = simulate_blocks(place._replace(sigma=1e-12 * place.sigma), days=days, seed=seed, only="k_x")
    truth = fall + exact.theta[:, 0] + 0.0003 * exact.covariates[:, 0]  # without what the temperature does
    blocks.theta[:, 0] += fall
    series = len(place.names) + 2  # noises
    taken, _ = watched(rows_of(blocks, {}), WatchOptions(alarms_per_year=STATED / series))
    every = [alarm for one in taken for alarm in one.alarms if alarm.kind != "data"]
    keys = {alarm.key for alarm in every}
    slow = {key for key in keys if ":drift:" in key}
    change = BEGIN + round(DRIFT_BEFORE * DAY) * 10**9
    first = next((alarm for alarm in every if alarm.key in slow and alarm.opened > change), None)
    if first is None:
        return math.inf, False, len(keys - slow), len(slow)
    known = np.isfinite(truth)
    since, until = (np.flatnonzero(known[: (at - BEGIN) // STEP + 1])[-1] for at in (first.earliest, first.latest))
    band = first.text.partition(" % (")[2].partition(" %)")[0].split(" … ")
    within = float(band[0]) <= 100.0 * math.expm1(truth[until] - truth[since]) <= float(band[1])
    return (first.opened - change) / 1e9 / DAY, within, len(keys - slow), len(slow) - 1


def quiet(
    place: Site, days: float, rate: float, tolerated: Mapping[str, float], weather: bool, seed: int
) -> tuple[int, int]:
    """Alarms of jumps and of drifts of a watch of which nothing changes; without `weather` it knows no condition."""
    blocks = simulate_blocks(of_these(place, FOLLOWED), days=days, seed=seed)
    if not weather:
        blocks = replace(blocks, covariates=np.empty((len(blocks.time), 0)), covariate_names=())
    noise = {NOISE: noise_of(len(blocks.time), seed)}
    taken, _ = watched(rows_of(blocks, noise), WatchOptions(alarms_per_year=rate, tolerated=tolerated))
    keys = [alarm.key for alarm in said(taken)]
    slow = sum(":drift:" in key for key in keys)
    return len(keys) - slow, slow


def cause(place: Site, what: str, seed: int) -> list[str]:
    """Kinds of the alarms that a change of the structure, of a sensor's noise or gain gives."""
    blocks = simulate_blocks(of_these(place, ("k_x", "c_x")), days=6.0, seed=seed)
    after = blocks.time >= 4.0 * DAY
    noise, trusted = noise_of(len(blocks.time), seed), np.ones(len(after), dtype=bool)
    if what == "structure":
        blocks.theta[after, 0] += math.log(0.95)
    elif what == "noise":
        noise[after] += math.log(3.5)
    else:
        blocks.theta[after, 0] += math.log(0.85)
        blocks.theta[after, 1] *= 1.48
        noise[after] += math.log(0.67)
        trusted[after] = np.random.default_rng(seed).random(int(after.sum())) < 0.1
    taken, _ = watched(rows_of(blocks, {NOISE: noise}, trusted), WatchOptions())
    return [alarm.kind for alarm in said(taken)]


def coverage(wander: float, seed: int) -> tuple[float, float, float]:
    """Shares of levels whose ±2σ covers the true value: on the first day, on days 2 to 7, and on days 8 to 21."""
    rng = np.random.default_rng(seed)
    count = round(21.0 * DAY / BLOCK)
    truth = np.cumsum(wander * math.sqrt(BLOCK / DAY) * rng.standard_normal(count))
    theta = truth + 1.2 * SIGMA * rng.standard_normal(count)
    blocks = RecordBlocks(
        ("k_x",), np.asarray(BLOCK * np.arange(count)), theta[:, None], np.full((count, 1), SIGMA), (True,), (1.0,),
        np.empty((count, 0)),
    )  # fmt: skip
    taken, _ = watched(rows_of(blocks, {}), WatchOptions())
    inside = np.array([
        (one.levels[0].level_low or 0.0) <= math.exp(at) <= (one.levels[0].level_high or 0.0)
        for one, at in zip(taken, truth, strict=True)
    ])  # fmt: skip
    day, week = 144, 7 * 144
    return float(inside[12:day].mean()), float(inside[day:week].mean()), float(inside[week:].mean())


def main() -> None:
    """Print the tables."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.live_watch", description=__doc__.splitlines()[0])
    parser.add_argument("--watches", type=int, default=16, help="watches without a change, at each rate")
    parser.add_argument("--days", type=float, default=21.0, help="how long each of them lasts, a week or more")
    parser.add_argument("--trials", type=int, default=12, help="trials of each change, and of each wander")
    parser.add_argument("--before", type=float, nargs="+", default=[3.0, 30.0], help="days that a watch is old")
    parser.add_argument("--learn", type=int, default=144, help="windows that watches without a change learn from")
    parser.add_argument("--first", type=int, default=700_000, help="the first seed")
    parser.add_argument("--only", choices=("alarms", "delays", "causes", "drift", "bands"), help="one of the tables")
    options = parser.parse_args()
    if min(options.watches, options.trials) < 1 or not 7.0 <= options.days <= 3660.0 or min(options.before) < 1.5:
        raise SystemExit("--watches, --trials: expected 1 or more; --days: expected 7 to 3660; --before: 1.5 or more")
    if not 12 <= options.learn <= 2016:
        raise SystemExit(f"--learn: expected 12 to 2016 windows, got {options.learn}")
    place = site("nrel5mw", WIND)
    trials = range(options.trials)
    with ProcessPoolExecutor() as pool:
        if options.only in (None, "delays"):
            table = Table(title="From a change of k_x to its alarm", title_justify="left")
            for heading in ("change", "days before", "seen", "median", "90 %", "when within", "size within", "others"):
                table.add_column(heading, justify="left" if heading == "change" else "right")
            for i, (before, factor) in enumerate((days, factor) for days in options.before for factor in SIZES):
                seeds = [options.first + 1000 * i + k for k in trials]
                found = _delays(list(pool.map(partial(delay, place, factor, before), seeds)))
                seen = int(np.isfinite(found.seconds).sum())
                table.add_row(
                    f"k_x × {factor:g}", f"{before:g}", f"{seen} of {len(seeds)}", _hours(found.seconds, 0.5),
                    _hours(found.seconds, 0.9), f"{100.0 * found.when:.0f} %", f"{100.0 * found.size:.0f} %",
                    f"{found.other}",
                )  # fmt: skip
            print(render(table), flush=True)
        if options.only in (None, "causes"):
            table = Table(title="What alarms were put down to", title_justify="left")
            for heading in ("change", "structure", "sensor", "trials without an alarm"):
                table.add_column(heading, justify="left" if heading == "change" else "right")
            names = {"structure": "k_x × 0.95", "noise": "noise × 3.5", "gain": "gain × 0.8: k_x, c_x, noise, trust"}
            for i, (what, name) in enumerate(names.items()):
                kinds = list(
                    pool.map(partial(cause, place, what), [options.first + 20_000 + 1000 * i + k for k in trials])
                )
                every = [kind for one in kinds for kind in one]
                silent = sum(not one for one in kinds)
                table.add_row(name, f"{every.count('structure')}", f"{every.count('sensor')}", f"{silent}")
            print(render(table), flush=True)
        if options.only in (None, "drift"):
            firsts = [options.first + 80_000 + 1000 * i for i in range(len(DRIFTS) + 3)]
            table = Table(title=f"k_x that falls over {DRIFT_OVER:g} days", title_justify="left")
            for heading in ("change", "seen", "median", "last", "size within", "jumps", "other drifts"):
                table.add_column(heading, justify="left" if heading == "change" else "right")
            for factor, first in zip(DRIFTS, firsts, strict=False):
                drifts = list(pool.map(partial(drift, place, factor), [first + k for k in trials]))
                days = np.sort([one[0] for one in drifts])
                seen = int(np.isfinite(days).sum())
                table.add_row(
                    f"k_x × {factor:g}", f"{seen} of {len(drifts)}", _days(days[(len(days) - 1) // 2]), _days(days[-1]),
                    f"{100.0 * sum(one[1] for one in drifts) / max(seen, 1):.0f} %", f"{sum(one[2] for one in drifts)}",
                    f"{sum(one[3] for one in drifts)}",
                )  # fmt: skip
            print(render(table, f"watched for {DRIFT_AFTER:g} days more; days from the begin of the drift"), flush=True)
            table = Table(title="Alarms where nothing drifts", title_justify="left")
            for heading in ("stated a year", "tolerated", "temperature", "years", "of jumps", "of drifts"):
                table.add_column(heading, justify="left" if heading in ("tolerated", "temperature") else "right")
            nothing = dict.fromkeys(TOLERATED_DRIFT, 0.0)
            rows = ((STATED, TOLERATED_DRIFT, True), (OFTEN, nothing, True), (STATED, TOLERATED_DRIFT, False))
            for (rate, sizes, weather), first in zip(rows, firsts[len(DRIFTS) :], strict=True):
                rest = partial(quiet, place, options.days, rate, sizes, weather)
                counts = list(pool.map(rest, [first + k for k in range(options.watches)]))
                table.add_row(
                    f"{rate:g}", "nothing" if sizes is nothing else "as by default", "told" if weather else "not told",
                    f"{options.watches * options.days * DAY / YEAR:.2g}", f"{sum(one[0] for one in counts)}",
                    f"{sum(one[1] for one in counts)}",
                )  # fmt: skip
            told = f"{options.watches} watches of {options.days:g} days each, {len(FOLLOWED) + 1} series"
            print(render(table, f"{told}; half of the stated rate is of drifts"), flush=True)
        if options.only in (None, "bands"):
            table = Table(title="±2σ of the level holds the truth (95.4 % is right)", title_justify="left")
            for heading in ("random walk a day", "first day", "days 2 to 7", "days 8 to 21"):
                table.add_column(heading, justify="right")
            for i, wander in enumerate(WANDERS):
                shares = np.array(
                    list(pool.map(partial(coverage, wander), [options.first + 40_000 + 1000 * i + k for k in trials]))
                )
                table.add_row(f"{100.0 * wander:g} %", *(f"{100.0 * share:.1f} %" for share in shares.mean(axis=0)))
            print(render(table, f"{options.trials} series, σ of a window {100.0 * SIGMA:g} %"), flush=True)
        if options.only in (None, "alarms"):
            table = Table(title="Alarms without a change", title_justify="left")
            headings = ("stated a year", "tolerated", "alarms", "years", "in a year", "in week 1", "of noise", "ms")
            for heading in headings:
                table.add_column(heading, justify="left" if heading == "tolerated" else "right")
            years = options.watches * options.days * DAY / YEAR
            for i, (rate, sizes) in enumerate(
                ((STATED, TOLERATED_DRIFT), (OFTEN, dict.fromkeys(TOLERATED_DRIFT, 0.0)))
            ):
                run = partial(false_alarms, place, options.days, options.learn, rate, sizes)
                each = list(pool.map(run, [options.first + 60_000 + 1000 * i + k for k in range(options.watches)]))
                when = [day for one in each for day in one[0]]
                table.add_row(
                    f"{rate:g}", "nothing" if i else "as by default", f"{len(when)}", f"{years:.2g}",
                    f"{len(when) / years:.2g}", f"{sum(day <= 7.0 for day in when)}",
                    f"{sum(sum(one[1]) for one in each)}", f"{1e3 * np.mean([one[2] for one in each]):.2g}",
                )  # fmt: skip
            told = f"{options.watches} watches of {options.days:g} days each; ms of a processor a window of"
            print(render(table, f"{told} {len(FOLLOWED) + 1} series"), flush=True)


def _delays(trials: Sequence[tuple[float, bool, bool, int]]) -> Delays:
    seconds = np.array([one[0] for one in trials])
    seen = max(int(np.isfinite(seconds).sum()), 1)
    within = [sum(one[i] for one in trials) / seen for i in (1, 2)]
    return Delays(seconds, within[0], within[1], sum(one[3] for one in trials))


def _days(days: float) -> str:
    return "none" if math.isinf(days) else f"{days:.0f} d"


def _hours(seconds: Array, share: float) -> str:
    at = float(np.sort(seconds)[math.ceil(share * len(seconds)) - 1])
    return f"> {AFTER:g} d" if math.isinf(at) else f"{at / 3600.0:.1f} h"


if __name__ == "__main__":
    main()
