"""Pull and release of a real tower: frequency and damping with bands from one strain channel at 10 Hz, compared with a
plain damped cosine.

A rope pulled the 30 m wooden tower of the 45 kW turbine at Björkö and let it go. Strain at the base is proportional to
the top's displacement in the first mode, so that

    s̈ + 2 ζ ω ṡ + ω² s = f,    ω = 2π × frequency_hz,

with f a broadband load of unknown level (the wind did not pause) and a reading s + s₂ + offset + noise, offset and
noise unknown too. s₂ is a second mode of the same form, with a load of its own: the record shows one between 4 and 5
Hz, which may be the alias of a higher one, and with the first mode alone the result is not trusted. The equations run
at 40 Hz, where the fourth-order Runge–Kutta method damps the first mode by 10⁻⁶ of the critical; the three samples in
four that were not taken are missing data. For comparison, `scipy.optimize.curve_fit` fits a e^(−ζωt) cos(ω√(1−ζ²) t +
φ) + offset to the same samples; its bands take what is left for white noise.

``python -m validation.bjorko --data FILE`` prints the table. Source of the record: Fogelström et al. 2023, Zenodo
record 8230330. It is not part of windsysid.
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import sympy as sp

from windsysid._types import Array
from windsysid.errors import RecordError, WindsysidError
from windsysid.identification.fit_equations import Fit, Reading, fit
from windsysid.mechanics.equations import Equations
from windsysid.output.console import render
from windsysid.records.record import Record
from windsysid.results.posterior import SIGMAS
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter

__all__ = ["SECTIONS", "Band", "coverage", "damped_cosine", "decay", "identify_decay", "read_decay"]


RELEASED = 11.8
"""[s] The first crest after the release."""

SECTIONS = ((RELEASED, 18.0), (RELEASED, 25.0), (RELEASED, 40.1), (18.0, 40.1))
"""[s] What is looked at: large motion, the usual choice, everything, the end alone."""

FINER = 4
"""Steps of the equations per sample."""

RUNS = 40
TRUTH = (0.835, 0.015)
"""Number of simulated decays, and their frequency [Hz] and damping ratio."""

CHANNEL = "tower_strain"
MICRO = 1e6

STATES = first, first_rate, second, second_rate = sp.symbols("first first_rate second second_rate", real=True)
UNKNOWN = frequency, ratio, frequency_2, ratio_2 = sp.symbols("frequency ratio frequency_2 ratio_2", real=True)
LOADS = force, force_2 = sp.symbols("force force_2", real=True)


def _mode(
    x: sp.Symbol, rate: sp.Symbol, load: sp.Symbol, hertz: sp.Symbol, damping: sp.Symbol
) -> tuple[sp.Expr, sp.Expr]:
    omega = 2 * sp.pi * hertz
    return rate, load - 2 * damping * omega * rate - omega**2 * x


TOWER = Equations(
    "tower", STATES, (), UNKNOWN, LOADS,
    (*_mode(first, first_rate, force, frequency, ratio), *_mode(second, second_rate, force_2, frequency_2, ratio_2)),
)  # fmt: skip
PARAMETERS = (
    Parameter("frequency", 0.8, 0.2),
    Parameter("ratio", 0.02, 0.02, logarithmic=False),
    Parameter("frequency_2", 4.6, 0.1),
    Parameter("ratio_2", 0.03, 0.03, logarithmic=False),
)


class Band(NamedTuple):
    """An estimate with its ±2σ band."""

    estimate: float
    low: float
    high: float


def read_decay(path: str | Path) -> Record:
    """The measured strain [10⁻⁶ V/V], time from the file.

    Raises
    ------
    RecordError
        If the file cannot be read as two columns of numbers.
    """
    try:
        time, strain = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    except (OSError, ValueError) as error:
        raise RecordError(
            f"{path}: expected two columns, time [s] and strain [V/V], below one line of names, got: {error}"
        ) from None
    return Record(time, MICRO * strain[:, None], (CHANNEL,), ("1",), name=Path(path).stem)


def identify_decay(record: Record) -> Fit:
    """Frequency and damping ratio of one mode from the free decay of one channel, load, noise and offset unknown."""
    values = record[CHANNEL]
    middle, size = float(np.nanmean(values)), float(np.nanstd(values))
    fine = np.full((FINER * (record.samples - 1) + 1, 1), np.nan)
    fine[::FINER, 0] = values - middle
    time = record.time[0] + np.arange(len(fine)) / (FINER * record.rate)
    slow, fast = (2.0 * np.pi * PARAMETERS[i].centre for i in (0, 2))
    little = 0.02 * size
    return fit(
        TOWER,
        Record(time, fine, (CHANNEL,), ("1",), name=record.name),
        parameters=PARAMETERS,
        sensors=(Reading(CHANNEL, first + second, noise=0.01 * size, bias=size),),
        cov=np.diag([3.0 * size, 3.0 * size * slow, 2.0 * little, 2.0 * little * fast]) ** 2,
        loads=(GaussMarkov("force", little * slow**2, 0.5), GaussMarkov("force_2", little * fast**2, 0.05)),
    )


def damped_cosine(record: Record) -> tuple[Band, Band]:
    """Frequency [Hz] and damping ratio of a damped cosine in white noise, by SciPy's `curve_fit`."""
    from scipy.optimize import curve_fit

    time, values = record.time - record.time[0], record[CHANNEL]

    def cosine(t: Array, a: float, b: float, frequency: float, ratio: float, offset: float) -> Array:
        omega = 2.0 * np.pi * frequency
        turn = omega * np.sqrt(1.0 - ratio**2) * t
        return np.asarray((a * np.cos(turn) + b * np.sin(turn)) * np.exp(-ratio * omega * t) + offset)

    start = [float(np.ptp(values)) / 2.0, 0.0, PARAMETERS[0].centre, PARAMETERS[1].centre, float(np.mean(values))]
    best, cov = curve_fit(cosine, time, values, start)
    sigma = np.sqrt(np.diag(cov))
    bands = [Band(*(float(best[i] + k * sigma[i]) for k in (0.0, -SIGMAS, SIGMAS))) for i in (2, 3)]
    return bands[0], bands[1]


def decay(
    frequency: float, ratio: float, *, load: float, noise: float, seconds: float, rate: float, seed: int
) -> Record:
    """A simulated record of the same kind: release from 10, broadband load of that rms relative to ω² × 10, white
    noise.

    Exact for a load that is constant between its samples, 20 to each of the record's.
    """
    from scipy.linalg import expm

    rng = np.random.default_rng(seed)
    omega, step = 2.0 * np.pi * frequency, 1.0 / (20 * rate)
    transition = expm(step * np.array([[0, 1, 0], [-(omega**2), -2 * ratio * omega, 1], [0, 0, 0]]))
    samples = int(seconds * rate)
    decaying = np.exp(-step / 0.5)
    kicks = load * 10.0 * omega**2 * np.sqrt(1.0 - decaying**2) * rng.standard_normal(20 * samples)
    state, readings, push = np.array([10.0, 0.0, 0.0]), np.empty(samples), 0.0
    for i in range(20 * samples):
        if i % 20 == 0:
            readings[i // 20] = state[0]
        push = decaying * push + kicks[i]
        state[2] = push
        state = transition @ state
    values = 66.0 + readings + noise * rng.standard_normal(samples)
    return Record(np.arange(samples) / rate, values[:, None], (CHANNEL,), ("1",), name=f"simulated decay {seed}")


def coverage(runs: int = RUNS) -> dict[str, tuple[int, int]]:
    """Number of simulated decays whose bands of frequency and damping ratio cover the true values, by method."""
    held = {"windsysid": [0, 0], "damped cosine": [0, 0]}
    for seed in range(runs):
        record = decay(*TRUTH, load=0.05, noise=0.02, seconds=28.0, rate=10.0, seed=seed)
        found = identify_decay(record)
        for method, bands in (("windsysid", _bands(found)), ("damped cosine", damped_cosine(record))):
            for i, (band, truth) in enumerate(zip(bands, TRUTH, strict=True)):
                held[method][i] += band.low <= truth <= band.high
    return {method: (counts[0], counts[1]) for method, counts in held.items()}


def main() -> None:
    """Print the tables."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.bjorko", description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="pull_release_10Hz.csv: time [s], strain [V/V]")
    record = read_decay(parser.parse_args().data)
    table = Table(title="Tower at Björkö, pulled and released; ±2σ bands", title_justify="left")
    for heading in ("section [s]", "method", "frequency [Hz]", "damping ratio [%]", "trusted"):
        table.add_column(heading)
    for start, end in SECTIONS:
        part = record.section(start, end)
        found = identify_decay(part)
        trust = "yes" if found.diagnosis.trusted else "; ".join(found.diagnosis.reasons)
        table.add_row(f"{start:g} … {end:g}", "windsysid", *_cells(*_bands(found)), trust)
        table.add_row("", "damped cosine", *_cells(*damped_cosine(part)), "")
    share = Table(title=f"{RUNS} simulated decays under wind: the ±2σ band covers the true value", title_justify="left")
    for heading in ("method", "frequency", "damping ratio"):
        share.add_column(heading)
    for method, held in coverage().items():
        share.add_row(method, *(f"{100 * count / RUNS:.0f} %" for count in held))
    print(render(table, share))


def _bands(found: Fit) -> tuple[Band, Band]:
    bands = [Band(e.estimate, e.low, e.high) for e in (found["frequency"], found["ratio"])]
    return bands[0], bands[1]


def _cells(of_frequency: Band, of_ratio: Band) -> tuple[str, str]:
    return (
        f"{of_frequency.estimate:.4f} ({of_frequency.low:.4f} … {of_frequency.high:.4f})",
        f"{100 * of_ratio.estimate:.2f} ({100 * of_ratio.low:.2f} … {100 * of_ratio.high:.2f})",
    )


if __name__ == "__main__":
    try:
        main()
    except WindsysidError as error:
        sys.exit(str(error))
