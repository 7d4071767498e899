"""What `--formulation auto` does with records of many kinds: is it ever sure and wrong?

Each record is simulated on the scale model, or a tower, with priors drawn about the truth. The table gives for
``auto``, ``joint`` and ``spectral``, and where requested of the spectra of two ``pieces``, how many records they trust,
how often ±2σ covers the true value, in all records and in those that are trusted, the greatest error among these, the
rms error of all and the median processor time. Errors are in σ; what is refused has none.

``python -m validation.auto [--first SEED] [--runs N] [--kinds KIND …] [--only FORMULATION …]`` prints the table, and
``--records`` a line for every record before it.
"""

import argparse
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.signal import lfilter

from validation.mismatch import total_coefficients
from validation.pieces import cut
from validation.robustness import DAMAGES
from windsysid._types import Array
from windsysid.errors import WindsysidError
from windsysid.identification.identify import identify
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.mechanics.compile import compile_model
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.signals.inputs import steady_inputs
from windsysid.simulation.integrate import integrate
from windsysid.simulation.record import simulate_record
from windsysid.simulation.wind import packaged_wind, wind_loads
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.units import RPM

RATE, TOWER_RATE, DURATION = 100.0, 20.0, 100.0
"""[Hz], [Hz], [s]"""

FRESH = 91_000

Formulation = Literal["auto", "joint", "spectral", "pieces"]
FORMULATIONS: tuple[Formulation, ...] = ("auto", "joint", "spectral", "pieces")

PIECES = 2
"""Into how many a record is cut whose pieces' spectra are added."""


def simulated(turbine: str, loads: str, duration: float = DURATION) -> Callable[[int], Record]:
    """Records of a turbine."""
    rate = TOWER_RATE if turbine == "tower" else RATE
    return lambda seed: simulate_record(turbine, duration=duration, rate=rate, seed=seed, loads=loads)


def at_speed(turbine: str, rpm: float) -> Callable[[int], Record]:
    """Records of a turbine in wind at another speed of its rotor: 540 s, 20 readings a second."""
    machine = replace(load_turbine(turbine).exact(), rotor_speed=rpm / RPM)
    return lambda seed: simulate_record(machine, duration=540.0, rate=20.0, seed=seed, loads="wind")


def at_varying_speed(turbine: str, rpm: float, share: float) -> Callable[[int], Record]:
    """Record at a speed that varies by a share (one σ) and is forgotten in about 40 s, as a controller lets it."""
    machine = replace(load_turbine(turbine).exact(), rotor_speed=rpm / RPM)
    rate, lead, duration, slow = 25.0, 60.0, 540.0, 20.0

    def of(seed: int) -> Record:
        rng = np.random.default_rng([seed, 4])
        count, more = round((lead + duration) * rate), round(20.0 * slow * rate)
        keep = math.exp(-1.0 / (slow * rate))
        once = lfilter([1.0 - keep], [1.0, -keep], rng.standard_normal(count + more))
        wander = lfilter([1.0 - keep], [1.0, -keep], once)[more:]
        speed = machine.rotor_speed * (1.0 + share * (wander - wander.mean()) / wander.std())
        psi = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / rate])
        rotor = np.column_stack([psi, speed, np.gradient(speed, 1.0 / rate)])
        model = compile_model(machine.model, machine.sensors)
        p = np.array([machine.values[name] for name in model.parameters])
        wind = wind_loads(machine, *packaged_wind(turbine), rotor, rate=rate, seed=seed)
        fastest = max(machine.natural_frequency(name) for name in machine.model.coordinates) / (2.0 * np.pi)
        y = integrate(
            model, p, np.hstack([rotor, wind.loads]), rate=rate, start=np.zeros(len(model.states)),
            substeps=math.ceil(20.0 * fastest / rate),
        ).readings  # fmt: skip
        y += rng.standard_normal(y.shape) * [sensor.noise for sensor in machine.sensors]
        first = round(lead * rate)
        return Record(
            time=np.arange(count - first) / rate,
            values=np.column_stack([np.mod(psi, 2.0 * np.pi), speed, y])[first:],
            channels=("rotor_azimuth", "rotor_speed", *(sensor.channel for sensor in machine.sensors)),
            units=("rad", "rad/s", *(sensor.unit for sensor in machine.sensors)),
            name="varying speed",
        )

    return of


def decay(turbine: str) -> Callable[[int], Record]:
    """Records of motion that was given at the first sample and dies out: 20 s, without loads."""

    def of(seed: int) -> Record:
        machine, rng = load_turbine(turbine).exact(), np.random.default_rng(seed)
        model = compile_model(machine.model, machine.sensors)
        like = simulate_record(turbine, duration=20.0, rate=RATE, seed=seed)
        rms = like.values[:, -len(machine.sensors) :].std(axis=0)
        inputs = steady_inputs(model.inputs, machine.rotor_speed, 20.0, RATE)[: like.samples]
        if "rotor_azimuth" in like:
            inputs[:, 0] += like["rotor_azimuth"][0]
        p = np.array([machine.values[name] for name in model.parameters])
        n = len(model.states) // 2
        start = np.concatenate([0.01 * rng.standard_normal(n), np.zeros(n)])
        known = np.hstack([inputs, np.zeros((len(inputs), len(model.loads)))])

        def read(factor: float) -> Array:
            return integrate(model, p, known, rate=RATE, start=factor * start, substeps=10).readings

        y = read((1.0 * rms / read(1.0).std(axis=0)).min())  # gravity shakes a rotor as it does however it began
        y += rng.standard_normal(y.shape) * [sensor.noise for sensor in machine.sensors]
        values = np.column_stack([like.values[:, : -len(machine.sensors)], y])
        return replace(like, values=values, name="decay")

    return of


def damaged(name: str, loads: str) -> Callable[[int], Record]:
    """Records of the scale model with the damage of `validation.robustness`."""

    def of(seed: int) -> Record:
        return DAMAGES[name](simulated("verne555", loads)(seed), np.random.default_rng([seed, 3]))

    return of


def louder(make: Callable[[int], Record]) -> Callable[[int], Record]:
    """Record with a second half that is three times as strong."""

    def of(seed: int) -> Record:
        record = make(seed)
        factor = np.where(np.arange(record.samples) < record.samples // 2, 1.0, 3.0)[:, None]
        readings = [channel.endswith("acceleration") for channel in record.channels]
        return replace(record, values=np.where(readings, factor * record.values, record.values))

    return of


KINDS: dict[str, tuple[str, str, Callable[[int], Record]]] = {
    "random loads": ("verne555", "random", simulated("verne555", "random")),
    "random loads, 20 s": ("verne555", "random", simulated("verne555", "random", 20.0)),
    "random loads, second half three times as loud": (
        "verne555", "random", louder(simulated("verne555", "random")),
    ),
    "free decay, 20 s": ("verne555", "random", decay("verne555")),
    "wind": ("verne555", "wind", simulated("verne555", "wind")),
    "wind with feedback": ("verne555", "wind-feedback", simulated("verne555", "wind-feedback")),
    "wind, 20 s": ("verne555", "wind", simulated("verne555", "wind", 20.0)),
    "wind, second half three times as loud": ("verne555", "wind", louder(simulated("verne555", "wind"))),
    **{f"wind, {name}": ("verne555", "wind", damaged(name, "wind")) for name in DAMAGES if name != "clean"},
    **{f"nrel5mw at {rpm} rpm, wind": ("nrel5mw", "wind", at_speed("nrel5mw", rpm)) for rpm in (7.5, 9.0, 10.5, 12.1)},
    **{
        f"{name}, wind, speed varies by {percent} %": (name, "wind", at_varying_speed(name, 10.5, 0.01 * percent))
        for name in ("nrel5mw", "nrel5mw_full")
        for percent in (4, 8, 14)
    },
    **{
        f"tower, random loads, {duration} s": ("tower", "random", simulated("tower", "random", float(duration)))
        for duration in (600, 400, 270, 120)
    },
    "tower, second half three times as loud, 600 s": (
        "tower", "random", louder(simulated("tower", "random", 600.0)),
    ),
    "tower, free decay, 20 s": ("tower", "random", decay("tower")),
}  # fmt: skip
"""Turbine, loads that the true coefficients hold under, records."""


class Told(NamedTuple):
    """Result of one record.

    Attributes
    ----------
    by
        The formulation of the result, or ``refused``.
    trusted
        Whether it is.
    off
        Errors of the coefficients in their σ (n,).
    seconds
        Processor time.
    """

    by: str
    trusted: bool
    off: Array
    seconds: float


def ask(kind: str, record: Record, seed: int, formulation: Formulation) -> Told:
    """Identify a record of a kind."""
    name, loads, _ = KINDS[kind]
    turbine = load_turbine(name).exact()
    truth = total_coefficients(turbine, loads, seed) if loads == "wind-feedback" else turbine
    started = time.process_time()
    try:
        prior = DrawnPrior(seed=seed)
        if formulation == "pieces":
            parts = cut(record, record.duration / PIECES)
            found = identify_pieces(parts, truth, formulation="spectral", prior=prior)
        else:
            found = identify(record, truth, formulation=formulation, prior=prior)
    except WindsysidError:
        return Told("refused", trusted=False, off=np.empty(0), seconds=time.process_time() - started)
    seconds = time.process_time() - started
    return Told(found.formulation, found.diagnosis.trusted, errors(found, truth.values), seconds)


def errors(found: Identification, truth: Mapping[str, float]) -> Array:
    """Errors of the coefficients in their σ (n,)."""
    known = [(i, q) for i, q in enumerate(found.parameters) if truth.get(q.name)]
    return np.array(
        [
            (q.coordinate(found[q.name].estimate) - q.coordinate(truth[q.name])) / found.cov[i, i] ** 0.5
            for i, q in known
        ]
    )


def row(told: Sequence[Told]) -> str:
    """Result of a formulation on the records of a kind, as cells of a table."""
    every = [one for one in told if one.off.size]
    trusted = [one for one in every if one.trusted]
    off, sure = (np.concatenate([np.empty(0), *(one.off for one in some)]) for some in (every, trusted))
    by = ", ".join(f"{name} {count}" for name, count in sorted(Counter(one.by for one in told).items()))
    cells = [by, f"{len(trusted)} of {len(told)}"]
    cells += [f"{100.0 * np.mean(np.abs(some) < 2.0):.1f} %" if some.size else "" for some in (off, sure)]
    cells += [f"{np.abs(sure).max():.1f}" if sure.size else "", f"{np.sqrt(np.mean(off**2)):.2f}" if off.size else ""]
    return " | ".join([*cells, f"{np.median([one.seconds for one in told]):.1f} s"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20, help="records of each kind (20)")
    parser.add_argument("--first", type=int, default=FRESH, help=f"first seed ({FRESH})")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS), help="of records")
    parser.add_argument("--only", nargs="+", choices=FORMULATIONS, default=FORMULATIONS[:3], help="formulations")
    parser.add_argument("--records", action="store_true", help="say something of every record")
    given = parser.parse_args()
    print("| record | asked | by | trusted | ±2σ holds: all | trusted | greatest of them | rms error | time |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind in given.kinds:
        told: dict[Formulation, list[Told]] = {formulation: [] for formulation in given.only}
        for seed in range(given.first, given.first + given.runs):
            record = KINDS[kind][2](seed)
            for formulation in given.only:
                one = ask(kind, record, seed, formulation)
                told[formulation].append(one)
                if given.records:
                    worst = np.abs(one.off).max(initial=0.0)
                    print(
                        f"  {kind}, {seed}: {formulation} by {one.by}, trusted {one.trusted}, {worst:.1f} σ", flush=True
                    )
        for formulation in given.only:
            print(f"| {kind} | {formulation} | {row(told[formulation])} |", flush=True)


if __name__ == "__main__":
    main()
