"""The filters side by side on the joint model of the scale model's rotor: time per sample, errors and coverage.

    python benchmarks/filters.py             time per sample, in one run
    python benchmarks/filters.py --runs 100  and errors and ±2σ coverage of 100 runs of 100 s, by every filter

25 states (5 displacements, 5 velocities, 5 loads, 10 coefficients), 5 accelerometers, 100 Hz. Statistics of loads and
noise are given; priors are drawn 30 % off. Two records: *reference*, stationary vibration under the loads of the
turbine file; *informative*, free decay from 30 mm under loads 20 times weaker, noise ten times lower.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from windsysid import Turbine, load_turbine
from windsysid.filters import FILTERS, smooth
from windsysid.models import Parameter, StateSpace, compile_model, compose
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads

RATE, DURATION, LEAD_IN = 100.0, 100.0, 60.0


def record(turbine: Turbine, start: Sequence[float], lead_in: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (T, 8) with the loads unknown (zero), and readings (T, 5)."""
    rng = np.random.default_rng([seed, 1])
    model = compile_model(turbine.model, turbine.sensors)
    rotor = constant_speed_inputs(turbine.rotor_speed, lead_in + DURATION, RATE)
    loads = draw_loads(turbine.loads, model.loads, len(rotor), RATE, rng)
    p = [turbine.values[name] for name in model.parameters]
    clean = integrate(model, p, np.hstack([rotor, loads]), rate=RATE, start=start, substeps=2).readings
    noise = [sensor.noise for sensor in turbine.sensors] * rng.standard_normal(clean.shape)
    first = round(lead_in * RATE)
    return np.hstack([rotor, np.zeros_like(loads)])[first:], (clean + noise)[first:]


def joint_model(turbine: Turbine, size: Sequence[float], seed: int) -> StateSpace:
    """The joint model, its priors drawn; `size` is the prior standard deviation of the motion."""
    rng = np.random.default_rng([seed, 2])
    parameters = []
    for name, value in turbine.coefficients.items():
        off = 0.3 * rng.standard_normal()
        if name.startswith("k"):
            parameters.append(Parameter(name, value * np.exp(off), 0.3))
        else:
            parameters.append(Parameter(name, value * (1.0 + off), 0.3 * value, False, 10.0 * value))
    return compose(
        turbine.model, rate=RATE, values=turbine.values, parameters=parameters, loads=turbine.loads,
        sensors=turbine.sensors, cov=np.diag(np.square(size)),
    )  # fmt: skip


def scenarios(turbine: Turbine) -> dict[str, tuple[Turbine, list[float], float, list[float]]]:
    """By name: the turbine, the first state, the seconds before the record, and the prior of the motion."""
    quiet = replace(
        turbine,
        loads=tuple(replace(load, rms=load.rms / 20.0) for load in turbine.loads),
        sensors=tuple(sensor.model_copy(update={"noise": sensor.noise / 10.0}) for sensor in turbine.sensors),
    )
    return {
        "reference": (turbine, [0.0] * 10, LEAD_IN, [0.05] * 5 + [0.5] * 5),
        "informative": (quiet, [0.03, 0.03] + [0.0] * 8, 0.0, [0.05] * 5 + [0.5] * 5),
    }


def speed(turbine: Turbine, samples: int = 2000, repeats: int = 15) -> Table:
    """Least processor time of several runs, per sample."""
    motion = scenarios(turbine)["reference"]
    inputs, readings = (array[:samples] for array in record(*motion[:3], seed=0))
    model = joint_model(turbine, motion[3], seed=0)
    runs = {f.name: lambda f=f: f.run(model, f.init(model), inputs, readings) for f in FILTERS}
    runs |= {f"{f.name}, smoothed": lambda f=f: smooth(model, inputs, readings, f) for f in FILTERS}
    best = dict.fromkeys(runs, np.inf)
    for run in runs.values():
        run()  # compiles
    for _ in range(repeats):  # in turns, so that a busy machine is busy for all
        for name, run in runs.items():
            begun = time.thread_time()
            run()
            best[name] = min(best[name], time.thread_time() - begun)
    table = Table(title=f"{len(model.states)} states, {len(model.readings)} readings", title_justify="left")
    for heading in ("filter", "µs per sample", "÷ the first"):
        table.add_column(heading, justify="left" if heading == "filter" else "right")
    first = next(iter(best.values()))
    for name, least in best.items():
        table.add_row(name, f"{1e6 * least / samples:.1f}", f"{least / first:.1f}")
    return table


def quality(turbine: Turbine, runs: int) -> Table:
    """Errors of the coefficients at the end of the record, and share of true values within ±2σ."""
    table = Table(title=f"{runs} runs of {DURATION:g} s, ten coefficients each", title_justify="left")
    for heading in ("record", "filter", "±2σ holds", "rms of error/σ", "rms error k", "rms error c", "diverged"):
        table.add_column(heading, justify="left" if heading in ("record", "filter") else "right")
    for name, (machine, start, lead_in, size) in scenarios(turbine).items():
        deviations = {f.name: [] for f in FILTERS}
        errors = {f.name: [] for f in FILTERS}
        for seed in range(runs):
            inputs, readings = record(machine, start, lead_in, seed)
            model = joint_model(machine, size, seed)
            truth = np.array([machine.values[q.name] for q in model.parameters])
            theta = np.array(
                [
                    np.log(v / q.centre) if q.logarithmic else v / q.scale
                    for q, v in zip(model.parameters, truth, strict=True)
                ]
            )
            for f in FILTERS:
                belief, info = f.run(model, f.init(model), inputs, readings)
                at = belief.mean[model.parameter_block]
                deviations[f.name].append((at - theta) / info.std[-1, model.parameter_block])
                physical = np.array([float(q.physical(t)) for q, t in zip(model.parameters, at, strict=True)])
                errors[f.name].append(physical / truth - 1.0)
        stiff = np.array([q.logarithmic for q in model.parameters])
        for f in FILTERS:
            z, off = np.array(deviations[f.name]), np.array(errors[f.name])
            lost = ~np.isfinite(z).all(axis=1) | (np.abs(off[:, stiff]) > 1.0).any(axis=1)
            z, off = z[~lost], off[~lost]
            table.add_row(
                name, f.name, f"{100 * np.mean(np.abs(z) < 2.0):.1f} %", f"{np.sqrt(np.mean(z**2)):.2f}",
                f"{100 * np.sqrt(np.mean(off[:, stiff] ** 2)):.2f} %",
                f"{100 * np.sqrt(np.mean(off[:, ~stiff] ** 2)):.1f} %",
                str(np.count_nonzero(lost)),
            )  # fmt: skip
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=0, help="records for errors and coverage (none)")
    runs = parser.parse_args().runs
    turbine, console = load_turbine("verne555").exact(), Console(width=120)
    console.print(speed(turbine))
    if runs:
        console.print(quality(turbine, runs))


if __name__ == "__main__":
    main()
