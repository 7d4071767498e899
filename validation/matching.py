"""Correctness of the matching of measured modes to a model's modes, and calibration of its odds.

    python -m validation.matching --machines 2000 --records 20

A machine has three to seven modes, in half of the cases two of them 0.5 to 3 % apart. Its model has other frequencies
(drawn with a standard deviation of 1, 3 or 6 % for the machine, and of a quarter of that for each mode), damping ratios
within a factor of about two and shapes that are 10 % off; it lacks a fifth of the modes, has modes that nothing drives,
and all in random order. None of these distributions is a prior of `windsysid.match`.

Machines: measured modes are drawn with their uncertainty. Records: ten minutes of vibration at six places under random
loads are simulated, and `windsysid.oma` finds the modes.
"""

import argparse
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import windsysid as ws
from windsysid._types import Array
from windsysid.modal.matching.likelihood import ModelMode
from windsysid.modal.matching.match import candidates_of
from windsysid.modal.matching.result import MatchedMode
from windsysid.modal.shapes import assurance
from windsysid.spectral.oma.known_modes import KnownMode, as_modes

__all__ = ["Machine", "Outcome", "draw_machine", "main", "of_machine", "of_record"]

RATE, DURATION, CHANNELS = 20.0, 600.0, 6
NAMES = tuple(f"place_{i + 1}_acceleration" for i in range(CHANNELS))

BINS = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Borders of the probabilities of the table."""


class Machine(NamedTuple):
    """Frequencies [Hz], damping ratios and shapes (m, n) of a machine, its model, and the mode of the model that each
    mode is; None if the model lacks it."""

    frequency: Array
    damping: Array
    shape: Array
    model: list[ModelMode]
    truth: list[str | None]


class Outcome(NamedTuple):
    """Probability of a match, whether it is right, and whether it names a mode of the model."""

    probability: float
    right: bool
    named: bool


def draw_machine(random: np.random.Generator) -> Machine:
    """Draw a machine and its model."""
    count = int(random.integers(3, 8))
    frequency = np.sort(np.exp(random.uniform(math.log(0.3), math.log(6.0), count)))
    if random.random() < 0.5:
        i = int(random.integers(count - 1))
        frequency[i + 1] = frequency[i] * (1.0 + random.uniform(0.005, 0.03))
    damping = np.exp(random.normal(math.log(0.01), 0.5, count))
    shape = random.normal(size=(count, CHANNELS))
    scale = float(random.choice([0.01, 0.03, 0.06]))
    common = random.normal(0.0, scale)
    model, truth = [], list[str | None]()
    for i in range(count):
        lacking = random.random() < 0.2
        truth.append(None if lacking else f"mode {i}")
        if not lacking:
            f = frequency[i] * math.exp(common + random.normal(0.0, 0.25 * scale))
            off = shape[i] + 0.3 * np.linalg.norm(shape[i]) / math.sqrt(CHANNELS) * random.normal(size=CHANNELS)
            model.append(_model_mode(f"mode {i}", f, damping[i] * math.exp(random.normal(0.0, 0.7)), off))
    for i in range(int(random.integers(0, 4))):
        f = math.exp(random.uniform(math.log(0.3), math.log(6.0)))
        model.append(_model_mode(f"unseen {i}", f, 0.01, random.normal(size=CHANNELS)))
    random.shuffle(model)
    return Machine(frequency, damping, shape, model, truth)


def _model_mode(name: str, f: float, damping: float, shape: Array) -> ModelMode:
    return ModelMode(name, f, 0.0, damping, 0.0, dict(zip(NAMES, shape.astype(complex).tolist(), strict=True)))


def of_machine(seed: int) -> list[Outcome]:
    """Match modes that are drawn with their uncertainty; a fifth of the machine's are not measured."""
    random = np.random.default_rng(seed)
    machine = draw_machine(random)
    seen = [i for i in range(len(machine.frequency)) if random.random() < 0.8]
    measured = []
    for i in seen:
        std = random.uniform(0.01, 0.1)
        shape = machine.shape[i] / np.abs(machine.shape[i]).max()
        noisy = shape + std * (random.normal(size=CHANNELS) + 1j * random.normal(size=CHANNELS))
        f = math.log(machine.frequency[i]) + random.normal(0.0, 0.003)
        z = math.log(machine.damping[i]) + random.normal(0.0, 0.3)
        stds = dict.fromkeys(NAMES, std)
        measured.append(KnownMode(f"{i}", f, 0.003, z, 0.3, dict(zip(NAMES, noisy.tolist(), strict=True)), True, stds))
    if not (measured and machine.model):
        return []
    found = candidates_of(measured, machine.model, 0.0)
    return [_outcome(mode, machine.truth[i]) for mode, i in zip(found, seen, strict=True)]


def of_record(seed: int) -> list[Outcome]:
    """Match modes that `oma` finds in simulated vibration; a peak that is no mode of the machine is no match."""
    random = np.random.default_rng(seed)
    machine = draw_machine(random)
    known = as_modes(ws.oma(_record(machine, random), limits=(0.25, 7.0))).modes
    if not (known and machine.model):
        return []
    found = candidates_of(known, machine.model, 0.0)
    return [_outcome(match, _true_name(machine, mode)) for match, mode in zip(found, known, strict=True)]


def _record(machine: Machine, random: np.random.Generator) -> ws.Record:
    """Acceleration of oscillators under white loads, simulated exactly at the samples."""
    from scipy.signal import lfilter

    t = np.arange(0.0, DURATION, 1.0 / RATE)
    values = 0.02 * random.normal(size=(len(t), CHANNELS))
    for f, z, shape in zip(machine.frequency, machine.damping, machine.shape, strict=True):
        omega = 2.0 * math.pi * f
        step = np.exp(omega * (-z + 1j * math.sqrt(1.0 - z**2)) / RATE)
        noise = random.normal(size=len(t)) + 1j * random.normal(size=len(t))
        wave = lfilter([1.0], [1.0, -step], noise * math.sqrt(0.5 * (1.0 - abs(step) ** 2))).real
        values += np.exp(random.normal(0.0, 0.5)) * np.outer(wave, shape)
    return ws.Record(t, values, NAMES, ("m/s^2",) * CHANNELS, name="machine")


def _true_name(machine: Machine, mode: KnownMode) -> str | None:
    """The mode of the model that a measured mode is, by the machine's own frequencies and shapes."""
    shape = np.array([mode.shape[name] for name in NAMES])
    near = [i for i, f in enumerate(machine.frequency) if abs(math.exp(mode.ln_frequency) / f - 1.0) < 0.015]
    alike = {i: assurance(shape, machine.shape[i].astype(complex)) for i in near}
    best = max(alike, key=alike.__getitem__, default=None)
    return None if best is None or alike[best] < 0.5 else machine.truth[best]


def _outcome(mode: MatchedMode, truth: str | None) -> Outcome:
    named = mode.best.frequency is not None
    return Outcome(mode.best.probability, (mode.best.name if named else None) == truth, named)


def table(title: str, outcomes: Sequence[Outcome]) -> str:
    """Share of right matches, by their probability."""
    named = [one for one in outcomes if one.named and one.probability > 0.5]
    right = f"{sum(one.right for one in named)} of {len(named)} that are named are right"
    rows = [
        f"{title}: {len(outcomes)} measured modes; {right}",
        "| probability | matches | right | expected |", "|---|---|---|---|",
    ]  # fmt: skip
    for low, high in itertools.pairwise(BINS):
        inside = [one for one in outcomes if low < one.probability <= high]
        if inside:
            rate, expected = (100.0 * np.mean([one[i] for one in inside]) for i in (1, 0))
            rows.append(f"| {low:g} to {high:g} | {len(inside)} | {rate:.1f} % | {expected:.1f} % |")
    return "\n".join(rows)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=2000, help="machines whose measured modes are drawn")
    parser.add_argument("--records", type=int, default=20, help="records that are simulated")
    parser.add_argument("--seed", type=int, default=51_000, help="of the first machine and record")
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.seed, chosen.seed + max(chosen.machines, chosen.records))
    print(table("machines", [one for seed in seeds[: chosen.machines] for one in of_machine(seed)]))
    print(table("records", [one for seed in seeds[: chosen.records] for one in of_record(seed)]))


if __name__ == "__main__":
    main()
