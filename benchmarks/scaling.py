"""Growth of cost and memory with samples, blades, turbines in one process, threads and particles.

    python benchmarks/scaling.py             (make bench)

The joint extended Kalman filter on 100 Hz records of the scale model; the particle filter on its force balance. Every
case runs in a process of its own, because the peak memory of a process only grows. "µs per sample" is processor time;
one and two threads are compared by elapsed time.

*Turbines*: each has coefficients, a belief and readings of its own; every second of data each filter takes in a hundred
samples and the belief is all that stays. "× real time" is how many seconds of data of all turbines go through in one.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from sheets import Sheet, number, present

from windsysid import Turbine, load_turbine
from windsysid.filters import EKF, Belief, ParticleFilter
from windsysid.identification.estimate import scoring as likelihood
from windsysid.identification.estimate.force_balance import Balance, analysis_band, balance_statespace
from windsysid.identification.estimate.online import MEMORY, advance, begin
from windsysid.identification.estimate.time_domain import first_estimate
from windsysid.identification.model.prior import identifiable
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensors import Sensor
from windsysid.models import Prior
from windsysid.simulation.record import simulate_record
from windsysid.statespace.compose import compose
from windsysid.study.arms import START, record_balance
from windsysid.study.scenario import simulate_reference

Array = np.ndarray

RATE, PIECE = 100.0, 10_000
"""Samples per second, and samples that a record in pieces is taken in at a time."""

SECONDS = 5
"""Seconds of data that every turbine takes in, after one that does not count."""


def with_blades(turbine: Turbine, blades: int) -> Turbine:
    """The turbine with so many blades like its first one."""
    numbers = range(1, blades + 1)

    def renamed(name: str, i: int) -> str:
        return name.replace("_1", f"_{i}", 1)

    values = {k: v for k, v in turbine.values.items() if k[-2:-1] != "_" or not k[-1].isdigit()}
    values |= {renamed(k, i): v for k, v in turbine.values.items() if k.endswith("_1") for i in numbers}
    loads = [load for load in turbine.loads if "beta" not in load.load]
    loads += [
        replace(load, load=renamed(load.load, i)) for load in turbine.loads if "beta_1" in load.load for i in numbers
    ]
    sensors: list[Sensor] = [sensor for sensor in turbine.sensors if not sensor.blade]
    for sensor in turbine.sensors:
        if sensor.blade == 1:
            sensors += [
                sensor.model_copy(update={"channel": renamed(sensor.channel, i), "point": renamed(sensor.point, i)})
                for i in numbers
            ]
    model = replace(turbine.rotor, blades=blades)
    assert isinstance(model, RotorModel)
    return replace(turbine, model=model, values=values, loads=tuple(loads), sensors=tuple(sensors))


def posed(turbine: Turbine, samples: int) -> TurbineProblem:
    record = simulate_record(turbine, duration=samples / RATE, rate=RATE, seed=1)
    return pose(record, turbine, turbine.sensors, Prior())


# Cases: each is called by name in a process of its own and returns numbers.


def samples(folder: str, count: int, piece: int) -> dict[str, float]:
    """µs per sample of a record of so many, in pieces or (piece = count) whole."""
    model = posed(load_turbine("verne555").exact(), 100).model
    # mapped, so that the record itself counts only as far as it is read
    inputs, readings = (np.load(Path(folder) / f"{name}.npy", mmap_mode="c") for name in ("inputs", "readings"))

    def run() -> None:
        belief = EKF.init(model)
        for first in range(0, count, piece):
            last = min(first + piece, count)
            belief, _ = EKF.run(model, belief, inputs[first:last], readings[first:last])
        assert np.isfinite(belief.mean).all()

    return {"each": 1e6 * _timed(run, 3)[0] / count}


def blades(_: str, count: int) -> dict[str, float]:
    """µs per sample with so many blades."""
    problem = posed(with_blades(load_turbine("verne555").exact(), count), 2000)
    model = problem.model
    taken, _ = _timed(lambda: EKF.run(model, EKF.init(model), problem.inputs, problem.readings), 9)
    return {"each": 1e6 * taken / 2000, "states": len(model.states), "readings": len(model.readings)}


def turbines(_: str, count: int, threads: int) -> dict[str, float]:
    """Seconds that a second of data of so many turbines takes."""
    turbine, second = load_turbine("verne555").exact(), round(RATE)
    problem = posed(turbine, 20_000)
    nx = len(problem.model.compiled.states)
    loads = problem.loads.blocks({s.name: s.given for s in problem.statistics})
    rng = np.random.default_rng(0)
    fleet = []
    for _ in range(count):
        parameters = [replace(q, centre=q.centre * np.exp(0.1 * rng.standard_normal())) for q in problem.parameters]
        fleet.append(
            compose(
                turbine.model, rate=RATE, values=turbine.values, parameters=parameters, loads=loads,
                sensors=turbine.sensors, cov=problem.model.cov[:nx, :nx],
            )
        )  # fmt: skip
    starts = rng.integers(0, 20_000 - (SECONDS + 1) * second, size=count)
    beliefs: list[Belief] = [EKF.init(model) for model in fleet]
    seconds = iter(range(SECONDS + 1))

    def share(first: int, k: int) -> None:
        for i in range(first, count, threads):
            part = slice(starts[i] + k * second, starts[i] + (k + 1) * second)
            beliefs[i], _ = EKF.run(fleet[i], beliefs[i], problem.inputs[part], problem.readings[part])

    with ThreadPoolExecutor(threads) as pool:

        def advance() -> None:
            k = next(seconds)
            list(pool.map(lambda first: share(first, k), range(threads)))

        processor, clock = _timed(advance, SECONDS)
    assert all(np.isfinite(belief.mean).all() for belief in beliefs)
    return {"processor": processor, "clock": clock}


def online(_: str, count: int, settled: int) -> dict[str, float]:
    """µs per sample of the on-line posterior; statistics of loads and noise are learned.

    The time counts from the start, or once the first samples are no longer held.
    """
    turbine = load_turbine("verne555").exact()
    problem = posed(turbine, count)
    first = first_estimate(turbine, RATE)
    held = MEMORY * first if settled else 0
    columns = problem.inputs.shape[1], problem.readings.shape[1]
    begun = begin(*problem.prior, first, columns)
    begun, _ = advance(problem.build, begun, problem.inputs[:held], problem.readings[:held], problem.start)

    def run() -> object:
        return advance(problem.build, begun, problem.inputs[held:], problem.readings[held:], problem.start)

    return {"each": 1e6 * _timed(run, 3)[0] / (count - held)}


def search(_: str, threads: int) -> dict[str, float]:
    """Seconds to the mode of the posterior of 100 s of record, all that `identify` learns unknown."""
    likelihood.BANK_THREADS = threads
    problem = posed(load_turbine("verne555").exact(), 10_000)
    mean, cov = problem.prior
    start, start_cov = problem.start(problem.inputs, problem.readings)

    def run() -> object:
        return likelihood.posterior_mode(
            problem.build, problem.inputs, problem.readings,
            prior=(mean, cov), start=(start, start_cov),
        )  # fmt: skip

    processor, clock = _timed(run, 3)
    return {"processor": processor, "clock": clock}


def particles(_: str, count: int, threads: int) -> dict[str, float]:
    """µs per sample with so many particles on the force balance of 10 coefficients."""
    turbine = load_turbine("verne555").exact()
    reference, band, second = simulate_reference(turbine, 0), analysis_band(turbine), round(RATE)
    balance = record_balance(turbine, reference, reference.inputs[:, 3:])
    balance = Balance(balance.force[48_000:58_100], balance.regressors[48_000:58_100])
    parameters = START.parameters(turbine, identifiable(turbine), linear=True)
    model, inputs = balance_statespace(balance, turbine.model.coordinates, parameters, rate=RATE, band=band)
    start, _ = EKF.run(model, EKF.init(model), inputs[:second], balance.force[:second])
    model = replace(model, mean=start.mean, cov=start.cov)
    length = max(200, min(10_000, 20_000_000 // count))
    part = slice(second, second + length)
    particle_filter = ParticleFilter(count, 0, threads=threads)

    def run() -> object:
        return particle_filter.run(model, particle_filter.init(model), inputs[part], balance.force[part])

    processor, clock = _timed(run, 3)
    return {"processor": 1e6 * processor / length, "clock": 1e6 * clock / length}


CASES = {f.__name__: f for f in (samples, blades, turbines, online, search, particles)}


def peak_memory() -> float:
    """Most memory that this process has had [MB]."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would count what the parent had when it forked
        line = next(line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _timed(run: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median seconds of the processor and of the clock, after one run that does not count."""
    run()
    taken = []
    for _ in range(repeats):
        processor, clock = time.process_time(), time.perf_counter()
        run()
        taken.append((time.process_time() - processor, time.perf_counter() - clock))
    median = np.median(taken, axis=0)
    return float(median[0]), float(median[1])


def alone(folder: str, case: str, *arguments: int, script: str = __file__) -> dict[str, float]:
    """Run a case in a process of its own and return its numbers, with the peak memory [MB] of that process."""
    command = [sys.executable, script, "--case", case, folder, *map(str, arguments)]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    if said.returncode:
        raise SystemExit(f"{case} {arguments} failed: {said.stderr.strip().splitlines()[-1]}")
    return json.loads(said.stdout.splitlines()[-1])


def sheets(short: bool) -> Iterator[Sheet]:
    most = 100_000 if short else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        problem = posed(load_turbine("verne555").exact(), most)
        np.save(Path(folder) / "inputs.npy", problem.inputs)
        np.save(Path(folder) / "readings.npy", problem.readings)
        for case in (("samples", 1000, 1000), ("particles", 100, 1)):
            alone(folder, *case)  # compiles, which takes memory too
        rows, costs = [], {}
        for count in (10**k for k in range(3, 7) if 10**k <= most):
            found = alone(folder, "samples", count, count)
            rows.append((f"{count:,}".replace(",", " "), number(found["each"]), number(found["peak"])))
            costs[f"joint EKF, {count} samples"] = found["each"]
        found = alone(folder, "samples", most, PIECE)
        rows.append(
            (f"{most:,}, in pieces of {PIECE:,}".replace(",", " "), number(found["each"]), number(found["peak"]))
        )
        yield Sheet(
            "Samples of one record",
            ("samples", "µs per sample", "peak memory, MB"), rows, costs,
        )  # fmt: skip

        rows, costs = [], {}
        for count in range(2, 6):
            found = alone(folder, "blades", count)
            rows.append((str(count), f"{found['states']:.0f}", f"{found['readings']:.0f}", number(found["each"])))
            costs[f"joint EKF, {count} blades"] = found["each"]
        yield Sheet("Blades", ("blades", "states", "readings", "µs per sample"), rows, costs)

        rows, costs = [], {}
        for count in (1, 10, 100) if short else (1, 10, 100, 1000):
            one, two = alone(folder, "turbines", count, 1), alone(folder, "turbines", count, 2)
            each = 1e6 * one["processor"] / (count * RATE)
            cells = (1e3 * one["clock"], 1.0 / one["clock"], 1e3 * two["clock"], 1.0 / two["clock"], one["peak"])
            rows.append((str(count), number(each), *map(number, cells)))
            costs[f"{count} turbines"] = each
        headings = ("ms, 1 thread", "× real time", "ms, 2 threads", "× real time, 2 threads", "peak memory, MB")
        yield Sheet(
            "Turbines in one process, 100 Hz: one second of data of all",
            ("turbines", "µs per sample", *headings),
            rows,
            costs,
        )

        rows, costs = [], {}
        for what, count, settled in (
            ("the first 10 000 samples", 10_000, 0),
            ("from 80 periods to 20 000 samples", 20_000, 1),
        ):
            found = alone(folder, "online", count, settled)
            cells = (found["each"], 1e6 / (RATE * found["each"]), found["peak"])
            rows.append((what, *map(number, cells)))
            costs[f"on line, {what}"] = found["each"]
        yield Sheet(
            "On line, statistics of loads and noise learned, 100 Hz",
            ("part of the record", "µs per sample", "turbines in real time, 1 core", "peak memory, MB"), rows, costs,
        )  # fmt: skip

        rows, costs = [], {}
        for threads in (1, 2):
            found = alone(folder, "search", threads)
            rows.append((str(threads), *map(number, (found["processor"], found["clock"], found["peak"]))))
            costs[f"search, {threads} threads"] = found["processor"]
        yield Sheet(
            "Search for the mode of the posterior, 15 unknowns, 10 000 samples",
            ("threads", "s of the processor", "s of the clock", "peak memory, MB"), rows, costs,
        )  # fmt: skip

        rows, costs = [], {}
        for count in (100, 1000, 10_000) if short else (100, 1000, 10_000, 100_000):
            one, two = alone(folder, "particles", count, 1), alone(folder, "particles", count, 2)
            cells = (one["processor"], 1e3 * one["processor"] / count, one["clock"], two["clock"], one["peak"])
            rows.append((f"{count:,}".replace(",", " "), *map(number, cells)))
            costs[f"{count} particles"] = one["processor"]
        headings = ("ns per particle", "µs by the clock, 1 thread", "2 threads", "peak memory, MB")
        yield Sheet(
            "Particles on the force balance, ten coefficients", ("particles", "µs per sample", *headings), rows, costs
        )


def main() -> None:
    if "--case" not in sys.argv:
        present(__doc__, sheets)
        return
    _, _, case, folder, *arguments = sys.argv
    found = CASES[case](folder, *map(int, arguments))
    print(json.dumps(found | {"peak": peak_memory()}))


if __name__ == "__main__":
    main()
