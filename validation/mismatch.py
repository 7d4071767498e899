"""Are the bands true under wind that no rational load model matches?

The scale model stands in turbulent wind on its turning blades (`windsysid.simulation.wind`): Kaimal's spectrum falls
with f^{−5/3}, its coherence is no rational function either, and the blades sample it. Every run simulates a record,
draws priors 30 % off around the truth, and identifies it twice, with one independent first-order process on each degree
of freedom ("broadband"), and with the load model that the record chooses ("auto"). The statistics of loads
and noise are unknown.

Without feedback the wind pushes a machine as if that stood still. With it, the air damps the motion, and the truth is
the total coefficient: that of the structure plus the mean of C on its diagonal (`windsysid.simulation.wind.blades`).
``python -m validation.mismatch [--runs N] [--first SEED]`` prints the table.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.identify import identify
from windsysid.output.console import render
from windsysid.simulation.integrate import constant_speed_inputs
from windsysid.simulation.record import MIN_LEAD_IN_SECONDS, simulate_record
from windsysid.simulation.wind import packaged_wind, wind_loads
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Run", "mismatch", "total_coefficients"]


RATE = 100.0
DURATION = 100.0
WINDS = ("wind", "wind-feedback")
MODELS = ("broadband", "auto")


class Run(NamedTuple):
    """One identification, the last axis being the ten coefficients.

    Attributes
    ----------
    wind, model, seed
        How the record was made, the load model that was requested, and what wind, noise and prior were drawn with.
    chosen
        The load model that was taken.
    deviation, error
        (estimate − truth) / σ, and relative to the truth (n,).
    trusted
        Whether the diagnosis trusts the result.
    seconds
        In the filter.
    """

    wind: str
    model: str
    seed: int
    chosen: str
    deviation: Array
    error: Array
    trusted: bool
    seconds: float


def total_coefficients(turbine: Turbine, wind: str, seed: int, *, duration: float = DURATION) -> Turbine:
    """The turbine with the coefficients that the record of that wind and seed was made with, air included."""
    if wind != "wind-feedback":
        return turbine
    rotor = constant_speed_inputs(turbine.rotor_speed, MIN_LEAD_IN_SECONDS + duration, RATE)
    made = wind_loads(turbine, *packaged_wind(turbine.name), rotor, rate=RATE, seed=seed)
    air = np.diag(made.damping[round(MIN_LEAD_IN_SECONDS * RATE) :].mean(axis=0))
    names = [f"c_{name}" for name in turbine.model.coordinates]
    return turbine.with_values({name: turbine.values[name] + c for name, c in zip(names, air, strict=True)})


def mismatch(runs: int, first: int, models: Sequence[str] = MODELS) -> Iterator[Run]:
    """Identify `runs` records of each wind with each of some load models; the same on any number of processors."""
    with ProcessPoolExecutor() as pool:
        yield from pool.map(_one_run, product(range(first, first + runs), WINDS, models))


def _one_run(which: tuple[int, str, str]) -> Run:
    seed, wind, model = which
    turbine = load_turbine("verne555").exact()
    truth = total_coefficients(turbine, wind, seed)
    record = simulate_record(turbine, duration=DURATION, rate=RATE, seed=seed, loads=wind)
    found = identify(record, truth, formulation="joint", prior=DrawnPrior(seed=seed), loads=model)
    names = truth.model.coefficients
    estimates = [found[name] for name in names]
    true = np.array([truth.values[name] for name in names])
    value, low, high = (np.array([getattr(e, part) for e in estimates]) for part in ("estimate", "low", "high"))
    stiff = np.array([name.startswith("k_") for name in names])
    with np.errstate(invalid="ignore"):
        deviation = np.where(
            stiff, np.log(value / true) / (0.25 * np.log(high / low)), (value - true) / (0.25 * (high - low))
        )
    chosen = next((one.data["model"] for one in found.findings if one.code == "load_model_chosen"), "broadband")
    return Run(wind, model, seed, chosen, deviation, value / true - 1.0, found.diagnosis.trusted, found.elapsed)


def main() -> None:
    """Print coverage and errors."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.mismatch", description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="records of each wind to identify (20)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first record (0)")
    parser.add_argument("--models", nargs="+", choices=MODELS, default=MODELS, help="load models to ask for (both)")
    options = parser.parse_args()
    models = options.models
    total = options.runs * len(WINDS) * len(models)
    runs = mismatch(options.runs, options.first, models)
    found = list(track(runs, total=total, description="mismatch", console=Console(stderr=True)))
    names = load_turbine("verne555").exact().model.coefficients
    for wind in WINDS:
        title = f"{wind}: {options.runs} records of {DURATION:g} s, priors 30 % off, statistics not given"
        table = Table(title=title, title_justify="left")
        table.add_column("coefficient")
        of = {model: [run for run in found if run.wind == wind and run.model == model] for model in models}
        for model in models:
            for heading in ("±2σ holds", "rms of error/σ", "rms error"):
                table.add_column(f"{model}: {heading}", justify="right")
        rows = [(name, slice(k, k + 1)) for k, name in enumerate(names)]
        for name, k in [*rows, ("stiffness", slice(0, None, 2)), ("damping", slice(1, None, 2)), ("all", slice(None))]:
            table.add_row(
                name, *(cell for model in models for cell in _cells(of[model], k)), end_section=name == names[-1]
            )
        print(render(table))
        for model in models:
            chosen = [run.chosen for run in of[model]]
            counts = ", ".join(f"{name} {chosen.count(name)}" for name in dict.fromkeys(chosen))
            seconds = float(np.median([run.seconds for run in of[model]]))
            print(
                f"{model}: took {counts}; trusted {sum(run.trusted for run in of[model])} of {len(of[model])}; median"
                f" {seconds:.0f} s"
            )


def _cells(runs: Sequence[Run], k: slice) -> tuple[str, str, str]:
    deviation, error = (np.array([getattr(run, part)[k] for run in runs]) for part in ("deviation", "error"))
    holds = f"{100.0 * np.mean(np.abs(deviation) < 2.0):.1f} %"
    return holds, f"{np.sqrt(np.mean(deviation**2)):.2f}", f"{100.0 * np.sqrt(np.mean(error**2)):.2f} %"


if __name__ == "__main__":
    main()
