"""Are the bands of the spectral formulation true? Monte Carlo on the scale model, in simulated wind and under random
loads.

Every run simulates a record of the scale model, draws priors 30 % off around the truth, and identifies it from its
spectra. The statistics of loads and noise are unknown. In simulated wind (`windsysid.simulation.wind`) with feedback
the air damps the motion, and the truth is the total coefficient (`validation.mismatch.total_coefficients`).

Under random loads, which the model knows but for their statistics, the errors are compared with the least that is
possible (`validation.calibration.bound`). That bound knows the weight that drives the blades at 1P and the mean lag
angle, which tell k_β and c_x. Spectra leave both open, since wind shear comes at 1P too and mean wind turns the blades.

``python -m validation.spectral [--runs N] [--first SEED] [--loads wind wind-feedback random]
[--in-pieces SECONDS]`` prints the table.
"""

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from validation.calibration import bound
from validation.mismatch import total_coefficients
from validation.pieces import cut
from windsysid._types import Array
from windsysid.identification.identify import identify
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.output.console import render
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine

__all__ = ["Run", "calibrate_spectra"]

RATE = 100.0
DURATION = 100.0
LOADS = ("wind", "wind-feedback", "random")
GROUPS = {"k_x, k_y": ("k_x", "k_y"), "k_beta": ("k_beta",), "c_x, c_y": ("c_x", "c_y"), "c_beta": ("c_beta",)}
"""Groups of the table: beginnings of names."""


class Run(NamedTuple):
    """One identification, the last axis being the ten coefficients.

    Attributes
    ----------
    loads, seed
        What drove the record, and what wind, noise and prior were drawn with.
    deviation, moved, error
        (estimate − truth) / σ and estimate − truth in the coordinates of the bands, and relative to the truth (n,).
    trusted
        Whether the diagnosis trusts the result.
    seconds
        Processor time of the identification, the reading of the record aside.
    """

    loads: str
    seed: int
    deviation: Array
    moved: Array
    error: Array
    trusted: bool
    seconds: float


def calibrate_spectra(
    runs: int, first: int = 0, loads: Sequence[str] = LOADS, length: float | None = None
) -> Iterator[Run]:
    """Identify `runs` records under each kind of loads, seeds `first` and on, in pieces of a `length` [s] where it is
    given; the same on any number of processors."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(_one_run, product(loads, range(first, first + runs), [length]))


def _one_run(which: tuple[str, int, float | None]) -> Run:
    loads, seed, length = which
    turbine = load_turbine("verne555").exact()
    truth = total_coefficients(turbine, loads, seed)
    record = simulate_record(turbine, duration=DURATION, rate=RATE, seed=seed, loads=loads)
    started = time.process_time()
    if length is None:
        found = identify(record, truth, formulation="spectral", prior=DrawnPrior(seed=seed))
    else:
        pieces = cut(record, length)
        found = identify_pieces(pieces, truth, formulation="spectral", prior=DrawnPrior(seed=seed))
    seconds = time.process_time() - started
    deviation, moved, error = [], [], []
    for i, q in enumerate(found.parameters):
        if q.name in truth.model.coefficients:
            value, true = found[q.name].estimate, truth.values[q.name]
            moved.append(q.coordinate(value) - q.coordinate(true))
            deviation.append(moved[-1] / float(np.sqrt(found.cov[i, i])))
            error.append(value / true - 1.0)
    return Run(loads, seed, np.array(deviation), np.array(moved), np.array(error), found.diagnosis.trusted, seconds)


def main() -> None:
    """Print coverage and errors."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.spectral", description=__doc__)
    parser.add_argument("--runs", type=int, default=100, help="records under each kind of loads (100)")
    parser.add_argument("--first", type=int, default=0, help="first seed (0)")
    parser.add_argument("--loads", nargs="+", choices=LOADS, default=list(LOADS))
    parser.add_argument("--in-pieces", type=float, metavar="SECONDS", help="take each record in piece by piece")
    options = parser.parse_args()
    found = calibrate_spectra(options.runs, options.first, options.loads, options.in_pieces)
    total = options.runs * len(options.loads)
    runs = list(track(found, description="spectral", total=total, console=Console(stderr=True)))
    names = load_turbine("verne555").exact().model.coefficients
    for loads in options.loads:
        chosen = [run for run in runs if run.loads == loads]
        z, moved, error = (np.array([getattr(run, part) for run in chosen]) for part in ("deviation", "moved", "error"))
        over = np.sqrt(np.mean(moved**2, axis=0)) / bound("reference", DURATION) if loads == "random" else None
        trusted = sum(run.trusted for run in chosen)
        seconds = float(np.median([run.seconds for run in chosen]))
        title = (
            f"{loads}: {len(chosen)} records of {DURATION:g} s, {trusted} trusted, {seconds:.2f} s of processor "
            f"time each (median)"
        )
        table = Table(title=title, title_justify="left")
        headings = ["coefficients", "±2σ holds", "mean error/σ", "rms error/σ", "mean error", "rms error"]
        for heading in headings if over is None else [*headings, "over the bound"]:
            table.add_column(heading, justify="left" if heading == "coefficients" else "right")
        for label, beginnings in (*GROUPS.items(), ("all", ("",))):
            of = [i for i, name in enumerate(names) if name.startswith(beginnings)]
            Z, E = z[:, of], 100.0 * error[:, of]
            cells = [f"{100.0 * np.mean(np.abs(Z) < 2.0):.1f} %", f"{Z.mean():+.2f}", f"{np.sqrt(np.mean(Z**2)):.2f}"]
            cells += ["", ""] if label == "all" else [f"{E.mean():+.2f} %", f"{np.sqrt(np.mean(E**2)):.2f} %"]
            if over is not None:
                cells.append(f"{np.sqrt(np.mean(over[of] ** 2)):.2f}")
            table.add_row(label, *cells)
        print(render(table))


if __name__ == "__main__":
    main()
