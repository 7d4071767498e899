"""What `--formulation auto` does with records of many kinds: is it ever sure and wrong?

Each record is simulated on the scale model, or its tower, with priors drawn about the truth. The table says how
``auto`` identified it, whether it was trusted, the greatest error in σ and the processor time, and the same of
``joint`` alone where that is asked for (`--joint`).

``python -m validation.auto [--first SEED] [--runs N] [--kinds KIND …] [--joint]`` prints the table.
"""

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from validation.mismatch import total_coefficients
from validation.robustness import DAMAGES
from windsysid.identification.identify import identify
from windsysid.mechanics.compile import compile_model
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.signals.inputs import steady_inputs
from windsysid.simulation.integrate import integrate
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine

RATE, DURATION = 100.0, 100.0
FRESH = 71_000


def simulated(turbine: str, loads: str, duration: float = DURATION) -> Callable[[int], Record]:
    """Records of a turbine."""
    return lambda seed: simulate_record(turbine, duration=duration, rate=RATE, seed=seed, loads=loads)


def decay(turbine: str) -> Callable[[int], Record]:
    """Records of motion that was given at the first sample and dies out: 20 s, without loads."""

    def of(seed: int) -> Record:
        machine, rng = load_turbine(turbine).exact(), np.random.default_rng(seed)
        model = compile_model(machine.model, machine.sensors)
        like = simulate_record(turbine, duration=20.0, rate=RATE, seed=seed)
        rms = like.values[:, -len(machine.sensors) :].std(axis=0)
        inputs = steady_inputs(model.inputs, machine.rotor_speed, 20.0, RATE)[: like.samples]
        p = np.array([machine.values[name] for name in model.parameters])
        n = len(model.states) // 2
        start = np.concatenate([0.01 * rng.standard_normal(n), np.zeros(n)])
        nothing = np.zeros((len(inputs), len(model.loads)))
        y = integrate(model, p, np.hstack([inputs, nothing]), rate=RATE, start=start, substeps=2).readings
        y *= (5.0 * rms / y.std(axis=0)).min()
        y += rng.standard_normal(y.shape) * [sensor.noise for sensor in machine.sensors]
        values = np.column_stack([like.values[:, : -len(machine.sensors)], y])
        return replace(like, values=values, name="decay")

    return of


def damaged(name: str, loads: str) -> Callable[[int], Record]:
    """Records of the scale model with the damage of `validation.robustness`."""

    def of(seed: int) -> Record:
        return DAMAGES[name](simulated("verne555", loads)(seed), np.random.default_rng([seed, 3]))

    return of


def louder(seed: int) -> Record:
    """A record in wind whose second half is three times as loud."""
    record = simulated("verne555", "wind")(seed)
    factor = np.where(record.time < 0.5 * DURATION, 1.0, 3.0)[:, None]
    readings = [channel.endswith("acceleration") for channel in record.channels]
    return replace(record, values=np.where(readings, factor * record.values, record.values))


KINDS: dict[str, tuple[str, str, Callable[[int], Record]]] = {
    "wind": ("verne555", "wind", simulated("verne555", "wind")),
    "wind with feedback": ("verne555", "wind-feedback", simulated("verne555", "wind-feedback")),
    **{f"wind, {name}": ("verne555", "wind", damaged(name, "wind")) for name in DAMAGES if name != "clean"},
    "wind, second half three times as loud": ("verne555", "wind", louder),
    "wind, 20 s": ("verne555", "wind", simulated("verne555", "wind", 20.0)),
    "random loads": ("verne555", "random", simulated("verne555", "random")),
    "free decay, 20 s": ("verne555", "random", decay("verne555")),
    "tower, random loads, 600 s": ("tower", "random", simulated("tower", "random", 600.0)),
    "tower, free decay, 20 s": ("tower", "random", decay("tower")),
}
"""Turbine, loads that the true coefficients hold under, records."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="records of each kind (3)")
    parser.add_argument("--first", type=int, default=FRESH, help=f"first seed ({FRESH})")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS), help="of records")
    parser.add_argument("--joint", action="store_true", help="identify them by joint alone, too")
    given = parser.parse_args()
    print("| record | auto: by | trusted | greatest error/σ | time | joint: trusted | greatest error/σ | time |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in given.kinds:
        name, loads, make = KINDS[kind]
        for seed in range(given.first, given.first + given.runs):
            record = make(seed)
            turbine = load_turbine(name).exact()
            truth = total_coefficients(turbine, loads, seed) if loads == "wind-feedback" else turbine
            cells = []
            for formulation in ("auto", "joint")[: 1 + given.joint]:
                started = time.process_time()
                found = identify(record, truth, formulation=formulation, prior=DrawnPrior(seed=seed))  # type: ignore[arg-type]
                seconds = time.process_time() - started
                trusted = found.diagnosis.trusted
                by = [found.formulation] if formulation == "auto" else []
                cells += [*by, "yes" if trusted else "no", f"{worst(found, truth.values):.1f}", f"{seconds:.1f} s"]
            print(f"| {kind} | {' | '.join(cells)} |", flush=True)
            if given.runs == 1:
                print("\n".join(f"  {text}" for text in (*found.notes, *found.diagnosis.reasons)))


def worst(found: Identification, truth: Mapping[str, float]) -> float:
    """Greatest error of a coefficient in its σ."""
    off = [0.0]
    for i, q in enumerate(found.parameters):
        if truth.get(q.name):
            off.append(abs(q.coordinate(found[q.name].estimate) - q.coordinate(truth[q.name])) / found.cov[i, i] ** 0.5)
    return max(off)


if __name__ == "__main__":
    main()
