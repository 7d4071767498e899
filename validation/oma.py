"""Operational modal analysis on records with known modes: do the bands cover the true values, and what does it cost?

- Closely spaced modes, 0.98, 1.00, 1.02 Hz with 0.8, 1.0, 1.2 % (the benchmark of the Bayesian literature: Au,
  Operational Modal Analysis, Springer 2017), 5 000 s.
- One mode at several lengths, compared with Au's laws, c_f² = ζ/(2π N_c B_f) and c_ζ² = 1/(2π ζ N_c B_ζ) with N_c
  cycles and the band f (1 ± 10 ζ).
- Four modes far apart, each with a coloured load of its own, 600 s at 50 Hz: is every one found, and no other?
- Frames of N storeys, 600 s at 50 Hz, output only: white forces on every storey, 1 % noise on every geophone.
- Frames of 5 storeys, 600 s, 10 % noise, which one load drives on all storeys alike, or at the top: every mode has the
  same load as its neighbours.
- Several records of two modes, 250 s each, together: with the same sensors, and with sensors that move.
- Loads with a peak: seas (JONSWAP, 4 to 12 s) under frames of 0.15 to 1 Hz, and machines whose speed varies by 0.3, 1
  and 3 %, on frames and on towers with two channels, also with an amplitude that varies by 40 %: is the peak graded as
  a mode?
- Steep loads, of spectra f⁻⁵ to f⁴.
- OpenFAST (`--openfast FOLDER`): c2 and d1, tower and edgewise modes.

How often intervals cover the true values is counted over frequencies and damping ratios of grade A or B; so are modes
of such grades that are none.
Oscillators are sampled exactly, by the matrix exponential of state and noise covariance. Seeds begin at `FRESH`, beyond
those that tests and development used.

``python -m validation.oma [--runs N] [--openfast FOLDER]`` prints the tables.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, expm
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from windsysid.output.console import render
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.spectral.oma.analyse import analyse_vibration
from windsysid.spectral.oma.result import OperationalModes

Array = np.ndarray

Modes = Sequence[tuple[float, float]]
"""Frequencies [Hz] and damping ratios."""

FRESH = 170_000
CLOSE = ((0.98, 0.008), (1.00, 0.010), (1.02, 0.012))
LENGTHS = (200.0, 500.0, 1500.0)
STOREYS = (5, 20, 40)
APART = ((0.8, 0.008), (1.9, 0.010), (3.1, 0.012), (4.6, 0.015))
APART_SHAPES = ((1.0, 0.9, 0.6, 0.3), (1.0, 0.1, -0.9, -0.7), (1.0, -0.9, -0.2, 0.9), (0.8, -1.0, 1.0, -0.5))
KAPPA = 10.0

FILES = {"c2": "c2_turb12_full.outb", "d1": "d1_turb12_full_KSS090.outb"}
TRUTH = {"c2": (0.3153, 0.8908, 1.0402, 1.2990), "d1": (0.2986, 0.8907, 1.0323, 1.2988)}
TIPS = ("tower_x_acceleration", *(f"blade_{b}_tip_lag_acceleration" for b in (1, 2, 3)))


def responses(modes: Modes, mixing: Array, rate: float, samples: int, rng: np.random.Generator) -> Array:
    """Velocities (T, r) of modes q̈ + 2ζω q̇ + ω² q = w under white loads `mixing` (r, s), sampled exactly."""
    r = len(modes)
    state, load = np.zeros((2 * r, 2 * r)), np.zeros((2 * r, mixing.shape[1]))
    for j, (f, z) in enumerate(modes):
        w = 2.0 * np.pi * f
        state[2 * j, 2 * j + 1] = 1.0
        state[2 * j + 1, 2 * j : 2 * j + 2] = -w * w, -2.0 * z * w
        load[2 * j + 1] = mixing[j]
    n = 2 * r
    both = expm(np.block([[-state, load @ load.T], [np.zeros((n, n)), state.T]]) / rate)
    step = both[n:, n:].T
    noise = step @ both[:n, n:]
    sizes, ways = np.linalg.eigh(0.5 * (noise + noise.T))
    lead = int(8.0 / (2.0 * np.pi * min(f * z for f, z in modes)) * rate)
    shocks = rng.normal(size=(samples + lead, n)) @ (ways * np.sqrt(np.maximum(sizes, 0.0))).T
    poles, vectors = np.linalg.eig(step)
    turned = shocks @ np.linalg.inv(vectors).T
    x = np.column_stack([lfilter([1.0], [1.0, -p], turned[:, i]) for i, p in enumerate(poles)]) @ vectors.T
    return np.asarray(x.real[lead:, 1::2])


def record(values: Array, rate: float, quantity: str = "velocity", unit: str = "m/s") -> Record:
    """Readings (T, n) as a record."""
    names = tuple(f"point_{i}_{quantity}" for i in range(1, values.shape[1] + 1))
    return Record(np.arange(len(values)) / rate, values, names, (unit,) * len(names), name="simulated")


class Score(NamedTuple):
    """Comparison of found modes with the true ones, over one or more records.

    Attributes
    ----------
    z
        Errors of frequency and of ln ζ in standard deviations, and whether the mode is of grade A or B, for each true
        mode that was found.
    expected
        Number of true modes.
    false
        Modes of grade A or B that are none.
    seconds
        Of processor time.
    """

    z: tuple[tuple[float, float, bool], ...] = ()
    expected: int = 0
    false: int = 0
    seconds: float = 0.0

    def with_more(self, other: "Score") -> "Score":
        """Both together."""
        return Score(
            self.z + other.z, self.expected + other.expected, self.false + other.false, self.seconds + other.seconds
        )


def scored(found: OperationalModes, truth: Modes) -> Score:
    """Each true mode with one of those that were found, within 5 %; those nearest to each other together."""
    modes = found.modes
    off = np.array([[abs(m.frequency.estimate / f - 1.0) for m in modes] for f, _ in truth]).reshape(len(truth), -1)
    rows, columns = linear_sum_assignment(np.minimum(off, 0.05))
    pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if off[i, j] < 0.05]
    zs = []
    for i, j in pairs:
        mode, (f, z) = modes[j], truth[i]
        ratio = mode.damping_ratio
        errors = (
            (mode.frequency.estimate - f) / mode.frequency.std,
            float(np.log(ratio.estimate / z)) / ratio.relative_std,
        )
        zs.append((*errors, mode.trusted))
    matched = {j for _, j in pairs}
    false = sum(mode.trusted for j, mode in enumerate(modes) if j not in matched)
    return Score(tuple(zs), len(truth), false, found.elapsed)


def analysed(make: Callable[[int], tuple[Record, Modes]], seeds: Iterable[int]) -> Score:
    """Analyse the records of some seeds, and compare the modes with the true ones."""
    total = Score()
    for made, modes in map(make, seeds):
        total = total.with_more(scored(analyse_vibration(made), modes))
    return total


def row(name: str, score: Score, runs: int) -> tuple[str, ...]:
    """A line of a table: how often ±2σ held the truth of modes of grade A or B."""
    trusted = [(a, b) for a, b, sure in score.z if sure]
    z = np.array(trusted).reshape(-1, 2)
    held = np.mean(np.abs(z) < 2.0, axis=0) if len(z) else (np.nan, np.nan)
    mean, rms = (z.mean(axis=0), np.sqrt(np.mean(z**2, axis=0))) if len(z) else ((np.nan,) * 2,) * 2
    most = np.abs(z).max(axis=0) if len(z) else (np.nan,) * 2
    return (
        name, f"{len(score.z)} of {score.expected}", str(len(z)), str(score.false),
        f"{100 * held[0]:.1f} %", f"{100 * held[1]:.1f} %", f"{mean[0]:+.2f}, {mean[1]:+.2f}",
        f"{rms[0]:.2f}, {rms[1]:.2f}", f"{most[0]:.1f}, {most[1]:.1f}", f"{score.seconds / runs:.2f}",
    )  # fmt: skip


HEADINGS = (
    "case", "found", "A or B", "A or B, but none", "f in ±2σ", "ζ in ±2σ", "mean z", "rms z", "largest |z|",
    "seconds a record",
)  # fmt: skip


def close_modes(runs: int) -> Iterable[tuple[str, ...]]:
    """Three modes two per cent apart."""
    total = Score()
    for seed in range(FRESH, FRESH + runs):
        rng = np.random.default_rng(seed)
        q = responses(CLOSE, np.eye(3), 8.0, 40_000, rng)
        y = (q / q.std(axis=0)) @ rng.normal(size=(3, 4)) + 0.05 * rng.normal(size=(40_000, 4))
        total = total.with_more(scored(analyse_vibration(record(y, 8.0)), CLOSE))
    yield row("three close modes, 5 000 s", total, runs)


def modes_apart_record(seed: int) -> tuple[Record, Modes]:
    """Four well-separated modes, each with a coloured load of its own: record and modes."""
    rate, count = 50.0, 30_000
    rng = np.random.default_rng(seed)
    y = 0.002 * rng.normal(size=(count, 4))
    for (f, z), shape in zip(APART, APART_SHAPES, strict=True):
        size, angle = np.exp(-z * 2.0 * np.pi * f / rate), 2.0 * np.pi * f * np.sqrt(1.0 - z * z) / rate
        load = lfilter([1.0], [1.0, -np.exp(-20.0 / rate)], rng.normal(size=count))
        y += np.outer(lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * size * np.cos(angle), size**2], load), shape)
    return record(y, rate, "acceleration", "m/s^2"), APART


def modes_apart(runs: int) -> Iterable[tuple[str, ...]]:
    """Four well-separated modes."""
    total, whole = Score(), 0
    for seed in range(FRESH + 4000, FRESH + 4000 + runs):
        found = analyse_vibration(modes_apart_record(seed)[0])
        whole += found.trusted and len(found.modes) == len(APART)
        total = total.with_more(scored(found, APART))
    yield row(f"four modes apart, 600 s; {whole} of {runs} records with four modes, all A or B", total, runs)


def single_modes(runs: int) -> Iterable[tuple[str, ...]]:
    """One mode at several lengths, compared with Au's laws."""
    b_f = 2 / np.pi * (np.arctan(KAPPA) - KAPPA / (KAPPA**2 + 1))
    b_z = 2 / np.pi * (np.arctan(KAPPA) + KAPPA / (KAPPA**2 + 1) - 2 * np.arctan(KAPPA) ** 2 / KAPPA)
    for length in LENGTHS:
        total, ratios = Score(), []
        for seed in range(FRESH + 1000, FRESH + 1000 + runs):
            rng = np.random.default_rng(seed)
            samples = int(8 * length)
            q = responses([(1.0, 0.01)], np.eye(1), 8.0, samples, rng)
            y = q / q.std() * np.array([1.0, 0.6, -0.3]) + 0.05 * rng.normal(size=(samples, 3))
            found = analyse_vibration(record(y, 8.0))
            total = total.with_more(scored(found, [(1.0, 0.01)]))
            ratios += [
                (m.frequency.relative_std / np.sqrt(m.damping_ratio.estimate / (2 * np.pi * length * b_f)),
                m.damping_ratio.relative_std * np.sqrt(2 * np.pi * m.damping_ratio.estimate * length * b_z))
                for m in found.modes if abs(m.frequency.estimate - 1.0) < 0.05
            ]  # fmt: skip
        over = np.median(ratios, axis=0)
        yield row(f"one mode, {length:g} s; σ over Au's law {over[0]:.2f}, {over[1]:.2f}", total, runs)


def frame(storeys: int) -> tuple[list[tuple[float, float]], Array]:
    """Modes of a shear frame, 1 to about 12 Hz, 1 % each, and its shapes (N, N) for unit modal masses."""
    k = 2.0 * np.eye(storeys) - np.eye(storeys, k=1) - np.eye(storeys, k=-1)
    k[-1, -1] = 1.0
    squares, shapes = eigh(k)
    frequency = np.sqrt(squares / squares[-1]) * 12.0
    return [(float(f), 0.01) for f in frequency], shapes


def frame_record(storeys: int, seed: int) -> tuple[Record, Modes]:
    """A frame under white forces on every storey: record and modes."""
    rng = np.random.default_rng(seed)
    modes, shapes = frame(storeys)
    y = responses(modes, shapes.T, 50.0, 30_000, rng) @ shapes.T
    return record(y + 0.01 * y.std(axis=0) * rng.normal(size=y.shape), 50.0), modes


def frames(runs: int) -> Iterable[tuple[str, ...]]:
    """Frames of several storeys."""
    for storeys in STOREYS:
        total = analysed(partial(frame_record, storeys), range(FRESH + 2000, FRESH + 2000 + runs))
        yield row(f"frame of {storeys} storeys, 600 s at 50 Hz", total, runs)


SHARED = {"on all storeys": np.ones(5), "at the top": np.eye(5)[-1]}
"""Load on each storey."""


def shared_load_record(load: Array, seed: int) -> tuple[Record, Modes]:
    """A frame that one load drives: record and modes."""
    rng = np.random.default_rng(seed)
    modes, shapes = frame(5)
    modes = [(f, 0.02) for f, _ in modes]
    y = responses(modes, (shapes.T @ load)[:, None], 50.0, 30_000, rng) @ shapes.T
    return record(y + 0.1 * y.std(axis=0) * rng.normal(size=y.shape), 50.0), modes


def shared_loads(runs: int) -> Iterable[tuple[str, ...]]:
    """A frame that one load drives: modes that respond together."""
    for where, load in SHARED.items():
        total = analysed(partial(shared_load_record, load), range(FRESH + 5000, FRESH + 5000 + runs))
        yield row(f"frame of 5 storeys, one load {where}", total, runs)


def forced(modes: Modes, shapes: Array, forces: Array, rate: float, samples: int) -> Array:
    """Accelerations (T, n) of a structure with these shapes under forces on its storeys, without the first part."""
    r = np.fft.rfftfreq(len(forces), 1.0 / rate)[:, None] / np.array([f for f, _ in modes])
    zeta = np.array([z for _, z in modes])
    modal = np.fft.rfft(forces @ shapes, axis=0) * -(r**2) / (1.0 - r**2 + 2j * zeta * r)
    return np.asarray(np.fft.irfft(modal @ shapes.T, len(forces), axis=0)[-samples:])


def coloured(density: Callable[[Array], Array], rate: float, samples: int, rng: np.random.Generator) -> Array:
    """Values (T,) with a spectrum of this form and a standard deviation of 1."""
    white = np.fft.rfft(rng.normal(size=samples))
    x = np.fft.irfft(white * np.sqrt(density(np.maximum(np.fft.rfftfreq(samples, 1.0 / rate), 0.02))), samples)
    return np.asarray(x / x.std())


def jonswap(period: float) -> Callable[[Array], Array]:
    """Spectrum of a sea of some peak period [s], with a peak enhancement of 3.3 (Hasselmann et al. 1973)."""

    def density(f: Array) -> Array:
        r = f * period
        width = np.where(r < 1.0, 0.07, 0.09)
        return np.asarray(r**-5.0 * np.exp(-1.25 * r**-4.0) * 3.3 ** np.exp(-((r - 1.0) ** 2) / (2.0 * width**2)))

    return density


def small_frame(lowest: float, damping: float, storeys: int = 3) -> tuple[list[tuple[float, float]], Array]:
    """Modes of a shear frame from `lowest` [Hz] on."""
    modes, shapes = frame(storeys)
    return [(f * lowest / modes[0][0], damping) for f, _ in modes], shapes


def sea_record(seed: int) -> tuple[Record, Modes]:
    """A frame in a sea: record and modes."""
    rate, samples, rng = 10.0, 6000, np.random.default_rng(seed)
    modes, shapes = small_frame(float(np.exp(rng.uniform(np.log(0.15), 0.0))), 0.012)
    sea = coloured(jonswap(rng.uniform(4.0, 12.0)), rate, 16_000, rng)
    forces = 0.3 * rng.normal(size=(16_000, 3)) + rng.uniform(0.3, 3.0) * np.outer(sea, [1.0, 0.6, 0.3])
    y = forced(modes, shapes, forces, rate, samples)
    y += 0.01 * y.std() * rng.normal(size=y.shape)
    y *= 0.1 / y.std()  # m/s², as `inspect` refuses motions of 10 m
    return record(y, rate, "acceleration", "m/s^2"), modes


def seas(runs: int) -> Iterable[tuple[str, ...]]:
    """Frames in seas whose peak is below, at or above the first mode."""
    total = analysed(sea_record, range(FRESH + 6000, FRESH + 6000 + runs))
    yield row("frame of 3 storeys in a sea, 600 s", total, runs)


def machine(frequency: float, wander: float, modulation: float, rate: float, rng: np.random.Generator) -> Array:
    """Force (50 000,) of a machine whose frequency [Hz] and amplitude vary by these shares, over 20 s and 8 s."""

    def slow(seconds: float) -> Array:
        x = lfilter([1.0], [1.0, -np.exp(-1.0 / (seconds * rate))], rng.normal(size=50_000))
        return np.asarray(x / x.std())

    phase = 2.0 * np.pi * np.cumsum(frequency * (1.0 + wander * slow(20.0))) / rate
    return np.asarray((1.0 + modulation * slow(8.0)) * np.sin(phase))


def machine_record(wander: float, seed: int, modulation: float = 0.0) -> tuple[Record, Modes]:
    """A frame with a machine of varying speed between the first two modes: record and modes."""
    rate, samples, rng = 50.0, 30_000, np.random.default_rng(seed)
    modes, shapes = small_frame(1.0, 0.01)
    force = np.outer(machine(1.8, wander, modulation, rate, rng), [1, 0.6, 0.3])
    y = forced(modes, shapes, rng.normal(size=(50_000, 3)) + 1.5 * force, rate, samples)
    return record(y + 0.01 * y.std() * rng.normal(size=y.shape), rate, "acceleration", "m/s^2"), modes


def machine_tower_record(wander: float, modulation: float, seed: int) -> tuple[Record, Modes]:
    """A tower of two channels with a machine of varying speed below the second modes: record and modes."""
    rate, samples, rng = 20.0, 12_000, np.random.default_rng(seed)
    modes = [(0.32, 0.006), (0.34, 0.02), (2.2, 0.01), (2.5, 0.01)]
    shapes = np.array([[1, 0.2, 0.8, 0], [-0.2, 1, 0, 0.8]])
    force = np.outer(machine(rng.uniform(0.6, 1.6), wander, modulation, rate, rng), rng.normal(size=2))
    y = forced(modes, shapes, rng.normal(size=(50_000, 2)) + 0.5 * force, rate, samples)
    return record(y + 0.01 * y.std() * rng.normal(size=y.shape), rate, "acceleration", "m/s^2"), modes


def machines(runs: int) -> Iterable[tuple[str, ...]]:
    """Frames with a machine of varying speed between the first two modes, and towers with one below the second ones."""
    for wander, modulation in ((0.003, 0.0), (0.01, 0.0), (0.03, 0.0), (0.01, 0.4)):
        made = partial(machine_record, wander, modulation=modulation)
        total = analysed(made, range(FRESH + 7000, FRESH + 7000 + runs))
        yield row(f"frame of 3 storeys, machine at 1.8 Hz {_varying(wander, modulation)}", total, runs)
    for wander, modulation in ((0.003, 0.0), (0.01, 0.0), (0.01, 0.4)):
        total = analysed(partial(machine_tower_record, wander, modulation), range(FRESH + 9000, FRESH + 9000 + runs))
        yield row(f"tower of two channels, machine at 0.6 to 1.6 Hz {_varying(wander, modulation)}", total, runs)


def _varying(wander: float, modulation: float) -> str:
    return f"± {100 * wander:g} %" + (f", amplitude ± {100 * modulation:g} %" if modulation else "")


SLOPES = (-5, -4, -2, 2, 4)
"""Exponents of the frequency in a load's spectrum."""


def steep_load_record(slope: int, seed: int) -> tuple[Record, Modes]:
    """A frame of four storeys under loads with a steep spectrum: record and modes."""
    rate, samples, rng = 20.0, 12_000, np.random.default_rng(seed)
    modes, shapes = small_frame(0.5, 0.012, 4)
    each = [coloured(lambda f: f**slope, rate, 20_000, rng) for _ in range(4)]
    y = forced(modes, shapes, np.column_stack(each), rate, samples)
    y += 0.003 * y.std(axis=0).min() * rng.normal(size=y.shape)
    return record(y, rate, "acceleration", "m/s^2"), modes


def steep_loads(runs: int) -> Iterable[tuple[str, ...]]:
    """Frames of four storeys under loads of steep spectra."""
    for slope in SLOPES:
        total = analysed(partial(steep_load_record, slope), range(FRESH + 8000, FRESH + 8000 + runs))
        yield row(f"frame of 4 storeys, loads as f^{slope}", total, runs)


def several_records(runs: int) -> Iterable[tuple[str, ...]]:
    """Short records of one structure, alone and together; the same sensors, and two of four moved (setups)."""
    rate, length, modes = 8.0, 250.0, [(1.0, 0.01), (1.3, 0.015)]
    samples = int(rate * length)
    same, moved = ([0, 1, 2, 3],) * 4, ([0, 1, 2, 3], [0, 1, 4, 5], [0, 1, 6, 7])
    for name, columns in (("same sensors", same), ("setups", moved)):
        total, shapes, apart = Score(), [], 0
        for seed in range(FRESH + 3000, FRESH + 3000 + runs):
            rng = np.random.default_rng(seed)
            whole = rng.normal(size=(8, 2))
            records = []
            for number, chosen in enumerate(columns):
                q = responses(modes, np.eye(2), rate, samples, rng)
                y = (0.5 + rng.random()) * (q / q.std(axis=0)) @ whole[chosen].T
                y += 0.05 * rng.normal(size=y.shape)
                names = tuple(f"point_{c}_velocity" for c in chosen)
                time = np.arange(samples) / rate
                records.append(Record(time, y, names, ("m/s",) * len(names), name=f"record {number}"))
            found = analyse_vibration(records)
            total = total.with_more(scored(found, modes))
            apart += sum(mode.doubted_for("records") for mode in found.modes)
            order = [int(channel.split("_")[1]) for channel in found.channels]
            for mode in found.modes:
                k = int(np.argmin([abs(mode.frequency.estimate - f) for f, _ in modes]))
                true = whole[order, k] / whole[order[int(np.argmax(np.abs(mode.shape)))], k]
                sure = mode.shape_std > 0.0
                if mode.trusted:
                    shapes += list((mode.shape.real - true)[sure] / mode.shape_std[sure])
        held = 100.0 * float(np.mean(np.abs(shapes) < 2.0)) if shapes else float("nan")
        title = f"{len(columns)} records of {length:g} s, {name}; shapes in ±2σ {held:.1f} %, {apart} said to disagree"
        yield row(title, total, runs)


def turbines(folder: Path) -> Iterable[tuple[str, ...]]:
    """c2 and d1 compared with their true modes."""
    for name, file in FILES.items():
        found = analyse_vibration(read_record(folder / file), sensors=TIPS, section=(60.0, 600.0))
        for truth in TRUTH[name]:
            mode = min(found.modes, key=lambda m: abs(m.frequency.estimate - truth))
            off = mode.frequency.estimate - truth
            yield (name, mode.name, f"{truth:.4f}", f"{mode.frequency.estimate:.4f}", f"{100 * off / truth:+.2f} %",
            f"{off / mode.frequency.std:+.1f}",
                   mode.frequency.grade + mode.damping_ratio.grade, f"{found.elapsed:.1f}")  # fmt: skip


def table(title: str, headings: Sequence[str], rows: Iterable[tuple[str, ...]]) -> None:
    """Print a table, and its lines as they come."""
    from rich.table import Table

    shown = Table(title=title, title_justify="left")
    for heading in headings:
        shown.add_column(heading)
    for cells in rows:
        print(*cells, sep=" | ", file=sys.stderr, flush=True)
        shown.add_row(*cells)
    print(render(shown, width=150), flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--runs", type=int, default=50, help="records of single modes, four times that of close ones (50)"
    )
    parser.add_argument("--frames", type=int, default=3, help="records of each frame, 0 for none (3)")
    parser.add_argument("--openfast", type=Path, help="folder of c2 and d1")
    given = parser.parse_args()
    began = time.time()
    if given.openfast is not None:
        headings = ("record", "mode", "truth [Hz]", "found", "error", "z", "grades", "seconds")
        table("OpenFAST, 540 s of wind", headings, turbines(given.openfast))
    if given.frames > 0:
        table("frames, output only", HEADINGS, frames(given.frames))
    if given.runs > 0:
        table("close modes", HEADINGS, close_modes(4 * given.runs))
        table("modes apart", HEADINGS, modes_apart(runs=2 * given.runs))
        table("one load", HEADINGS, shared_loads(-(-given.runs // 2)))
        table("loads with a peak", HEADINGS, [*seas(given.runs), *machines(-(-given.runs // 2))])
        table("steep loads", HEADINGS, steep_loads(-(-given.runs // 3)))
        table("one mode", HEADINGS, single_modes(given.runs))
        table("several records together", HEADINGS, several_records(given.runs))
    print(f"{time.time() - began:.0f} s")


if __name__ == "__main__":
    main()
