"""Are the bands true? Monte Carlo on the reference scenario: how often ±2σ holds the reference, and how large the errors are.

100 s of the scale model from stationary vibration, five accelerometers, priors drawn 30 % off, statistics of loads and noise learned.
Beside the result stands what the joint filter alone would have said on line, with the statistics given exactly.
``python -m windsysid.study.calibration [--runs N]`` prints the table; a run takes a few seconds.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.console import render
from windsysid.formulation import Prior, identifiable
from windsysid.identification import usable_sensors
from windsysid.joint import identify_jointly
from windsysid.simulate import simulate_record
from windsysid.statespace import Parameter
from windsysid.turbine import Turbine, load_turbine

__all__ = ["Calibration", "calibrate"]

Array = NDArray[np.float64]


class Calibration(NamedTuple):
    """Deviations of R runs from the reference, (R, n_θ) each: in standard deviations, and relative.

    `online` is the joint filter at the end of the record, `result` the mode of the posterior.
    """

    names: tuple[str, ...]
    online: Array
    result: Array
    online_error: Array
    result_error: Array


def calibrate(runs: int, *, duration: float = 100.0, rate: float = 100.0) -> Calibration:
    """Identify `runs` simulated records, seeds 0, 1, …, from priors drawn around the reference."""
    turbine = load_turbine("verne555")
    names = identifiable(turbine)
    rows: list[tuple[Array, Array, Array, Array]] = []
    for seed in range(runs):
        record = simulate_record(turbine, duration=duration, rate=rate, seed=seed)
        rng = np.random.default_rng([seed, 2])
        outcome = identify_jointly(record, turbine, usable_sensors(record, turbine, None), _Drawn(rng=rng), names)
        block = outcome.model.parameter_block
        truth = np.array([_coordinate(q, turbine.values[q.name]) for q in outcome.model.parameters])
        pairs = (
            (outcome.online.mean[-1, block], outcome.online.std[-1, block]),
            (outcome.theta, np.sqrt(np.diag(outcome.cov))),
        )
        deviations = [(theta - truth) / std for theta, std in pairs]
        errors = [
            np.array([
                float(q.physical(t)) / turbine.values[q.name] - 1.0
                for q, t in zip(outcome.model.parameters, theta, strict=True)
            ])
            for theta, _ in pairs
        ]  # fmt: skip
        rows.append((*deviations, *errors))
    return Calibration(tuple(names), *(np.array(column) for column in zip(*rows, strict=True)))


@dataclass(frozen=True)
class _Drawn(Prior):
    """Priors whose centres are drawn from themselves, so that the reference is a fair draw from each."""

    rng: np.random.Generator = field(default_factory=np.random.default_rng)

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        drawn = []
        for q in super().parameters(turbine, names, linear=linear):
            off = q.spread * self.rng.standard_normal()
            drawn.append(replace(q, centre=q.centre * math.exp(off) if q.logarithmic else q.centre + off))
        return tuple(drawn)


def _coordinate(q: Parameter, value: float) -> float:
    """θ of a physical value."""
    return math.log(value / q.reference) if q.logarithmic else value / q.reference


def main() -> None:
    """Print coverage and errors."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m windsysid.study.calibration", description=__doc__)
    parser.add_argument("--runs", type=int, default=30, help="records to identify (30)")
    found = calibrate(parser.parse_args().runs)
    table = Table(title=f"{len(found.result)} runs: ±2σ coverage and rms error", title_justify="left")
    headings = (
        "coefficient",
        "result covers",
        "rms error",
        "rms of error/σ",
        "on line covers",
        "rms error",
        "rms of error/σ",
    )
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "coefficient" else "right")
    columns = [slice(i, i + 1) for i in range(len(found.names))]
    for name, i in [*zip(found.names, columns, strict=True), ("all", slice(None))]:
        cells = []
        for deviation, error in ((found.result, found.result_error), (found.online, found.online_error)):
            rms = "" if name == "all" else f"{100.0 * np.sqrt(np.mean(error[:, i] ** 2)):.2f} %"
            covers = f"{100.0 * np.mean(np.abs(deviation[:, i]) < 2.0):.1f} %"
            cells += [covers, rms, f"{np.sqrt(np.mean(deviation[:, i] ** 2)):.2f}"]
        table.add_row(name, *cells)
    print(render(table))


if __name__ == "__main__":
    main()
