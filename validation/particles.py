"""Accuracy of the particle filter: compared with the Kalman filter where that is exact, where it fails, and on the
published study.

The paper compares its extended Kalman filter (30 s) with a SIR particle filter of 2 000 particles (103 hours, similar
errors). ``python -m validation.particles [--runs N]`` prints that comparison and what a particle filter has to
show beforehand: errors that fall as 1/√N, static coefficients under four kinds of treatment, sensors with heavy tails,
a posterior with two summits, and motion and loads unknown.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters import EKF, Cloud, ParticleFilter, ParticleInfo, RaoBlackwellised, SplitModel, degeneracy
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.mechanics.equations import Equations
from windsysid.output.console import render
from windsysid.output.table import Table
from windsysid.results.identification import Identification
from windsysid.simulation.record import simulate_record
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.parameter import Parameter
from windsysid.study.arms import identify_section, record_balance
from windsysid.study.particles import (
    PUBLISHED_HOURS,
    SIR,
    LinearCase,
    force_balance_case,
    identify_section_by_particles,
)
from windsysid.study.published import PUBLISHED, PUBLISHED_SECONDS
from windsysid.study.scenario import RATE, SECTION, simulate_reference
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["main"]


def compare(seeds: int) -> list[Table]:
    """The paper's comparison on several records: average errors, Eq (24), of both filters, with the time they took."""
    turbine = load_turbine("verne555").exact()
    plain = replace(SIR, discount=1.0, tempering=False)
    ekf, sir, errors, words = [], [], [], []
    for seed in range(seeds):
        reference = simulate_reference(turbine, seed)
        balance = record_balance(turbine, reference, reference.inputs[:, 3:])
        ekf.append(identify_section(turbine, reference, balance))
        sir.append(identify_section_by_particles(turbine, reference, balance, replace(SIR, seed=seed)))
        case = force_balance_case(turbine, balance, SECTION)
        _, bare = _run(case, replace(plain, seed=seed))
        words.append(degeneracy(bare))
        errors.append([_average_errors(turbine, case.model, mean) for mean in (ekf[-1].mean, sir[-1].mean, bare.mean)])
    table = np.median(errors, axis=0)  # (ways, windows, n_θ)
    names = [e.name for e in ekf[0].estimates]
    rows = [_error_row(name, table[:, :, names.index(name)]) for name in PUBLISHED]
    seconds = [f"{np.median([found.elapsed for found in several]):.3f} s" for several in (ekf, sir)]
    rows.append(("time", f"{PUBLISHED_SECONDS:g} s; {PUBLISHED_HOURS:g} h", *seconds, *seconds, ""))
    off = [(s.mean - e.mean)[-1] / e.std[-1] for s, e in zip(sir, ekf, strict=True)]
    width = [s.std[-1] / e.std[-1] for s, e in zip(sir, ekf, strict=True)]
    headings = (
        "coefficient",
        "published",
        "EKF 0–100 s",
        "SIR 0–100 s",
        "EKF 30–100 s",
        "SIR 30–100 s",
        "no kernel, 30–100 s",
    )
    title = (
        f"The paper's comparison: {SIR.particles} particles, {sir[0].samples} samples, loads known, median of {seeds}"
        " records"
    )
    return [
        _table(title, headings, rows),
        _table(
            "At the end of the section",
            ("", "EKF", "SIR"),
            [
                ("±2σ holds the reference", _coverage(ekf), _coverage(sir)),
                ("estimate − EKF's, in its σ, rms", "", f"{np.sqrt(np.mean(np.square(off))):.2f}"),
                ("σ ÷ EKF's", "", f"{np.mean(width):.2f}"),
            ],
        ),
        _table("The first record, in words", ("filter", ""), [("SIR", sir[0].notes[-1]), ("no kernel", words[0])]),
    ]


def _error_row(name: str, errors: Array) -> tuple[str, ...]:
    """Cells of a coefficient from its errors (ways, windows) [%]."""
    return (name, f"{PUBLISHED[name]:g} %", *(f"{error:.3g} %" for error in (*errors[:2].T.flat, errors[2, 1])))


def _coverage(several: Sequence[Identification]) -> str:
    """Share of all estimates whose ±2σ band holds the reference."""
    held = [e.low <= (e.reference or 0.0) <= e.high for found in several for e in found.estimates]
    return f"{100.0 * float(np.mean(held)):.0f} %"


def _average_errors(turbine: Turbine, model: StateSpace, mean: Array) -> Array:
    """Average error (Eq 24) [%] of each coefficient over the whole section and from 30 s on (2, n_θ)."""
    history = np.column_stack([q.physical(theta) for q, theta in zip(model.parameters, mean.T, strict=True)])
    off = 100.0 * np.abs(history / [turbine.values[q.name] for q in model.parameters] - 1.0)
    return np.array([off.mean(axis=0), off[round(30.0 * RATE) :].mean(axis=0)])


def convergence(case: LinearCase, seeds: int) -> Table:
    """Errors against the Kalman filter by number of particles."""
    exact, info = EKF.run(case.model, EKF.init(case.model), case.inputs, case.readings)
    std = np.sqrt(np.diag(exact.cov))
    rows: list[tuple[str, ...]] = []
    for count in (500, 2000, 8000, 32_000):
        off, width, log = [], [], []
        for seed in range(seeds):
            cloud, found = _run(case, ParticleFilter(count, seed))
            off.append((cloud.mean - exact.mean) / std)
            width.append(np.sqrt(np.diag(cloud.cov)) / std)
            log.append(found.log_likelihood.sum() - info.log_likelihood.sum())
        error = float(np.sqrt(np.mean(np.square(off))))
        rows.append(
            (
                f"{count}",
                f"{error:.3f}",
                f"{error * np.sqrt(count):.1f}",
                f"{np.mean(width):.3f}",
                f"{np.sqrt(np.mean(np.square(log))):.2f}",
            )
        )
    return _table(
        f"Against the Kalman filter: ten coefficients, {len(case.readings)} samples, {seeds} seeds",
        ("particles", "error of means/σ", "× √N", "σ ÷ Kalman's", "error of log-likelihood"), rows,
    )  # fmt: skip


def static_coefficients(case: LinearCase, seeds: int) -> Table:
    """Comparison of coefficients that stay: resampled only, walking, or drawn from Liu and West's kernel."""
    second = round(RATE)
    start, _ = EKF.run(case.model, EKF.init(case.model), case.inputs[:second], case.readings[:second])
    model = replace(case.model, mean=start.mean, cov=start.cov)
    rest = LinearCase(model, case.inputs[second:], case.readings[second:])
    exact, _ = EKF.run(model, EKF.init(model), rest.inputs, rest.readings)
    std = np.sqrt(np.diag(exact.cov))

    def walking(share: float) -> LinearCase:
        """Coefficients that walk by `share` of their final standard deviation per sample."""
        walk = np.atleast_2d((share * std) ** 2)
        return rest._replace(model=replace(model, blocks=model.blocks._replace(walk=walk)))

    plain = ParticleFilter(discount=1.0, tempering=False)
    kinds = {
        "resampled only": (rest, plain),
        "random walk, 0.001 σ a sample": (walking(0.001), plain),
        "random walk, 0.01 σ a sample": (walking(0.01), plain),
        "random walk, 0.1 σ a sample": (walking(0.1), plain),
        **{f"Liu–West, δ = {delta:g}": (rest, ParticleFilter(discount=delta)) for delta in (0.99, 0.95, 0.9, 0.8, 0.6)},
    }
    rows = []
    for name, (here, options) in kinds.items():
        off, width, distinct = [], [], []
        for seed in range(seeds):
            cloud, _ = _run(here, replace(options, seed=seed))
            off.append((cloud.mean - exact.mean) / std)
            width.append(np.sqrt(np.diag(cloud.cov)) / std)
            distinct.append(len(np.unique(cloud.particles[0])))
        rows.append(
            (name, f"{np.mean(distinct):.0f}", f"{np.sqrt(np.mean(np.square(off))):.2f}", f"{np.mean(width):.3f}")
        )
    return _table(
        f"Static coefficients, 2000 particles, {len(rest.readings)} samples after the first second, {seeds} seeds",
        ("treatment", "values left", "error of means/σ", "σ ÷ Kalman's"), rows,
    )  # fmt: skip


def heavy_tails(case: LinearCase, runs: int) -> Table:
    """Readings with Student t noise, 3 degrees of freedom: how often ±2σ holds the coefficients."""
    samples, nu = 1000, 3.0
    rows_of, turbine = case.inputs[:samples], load_turbine("verne555").exact()
    truth = np.array([turbine.values[q.name] / q.reference for q in case.model.parameters])
    blocks = case.model.blocks
    scale = np.sqrt(blocks.noise)
    m = len(scale)
    clean = np.einsum("tmn,n->tm", rows_of.reshape(samples, m, -1), truth * blocks.reference)
    told = {
        "EKF, told the scale": (blocks.noise, None),
        "EKF, told the standard deviation": (blocks.noise * nu / (nu - 2.0), None),
        "particle filter, Student t": (blocks.noise, ParticleFilter(freedom=nu)),
    }
    deviations: dict[str, list[Array]] = {name: [] for name in told}
    widths: dict[str, list[Array]] = {name: [] for name in told}
    errors: dict[str, list[Array]] = {name: [] for name in told}
    for seed in range(runs):
        rng = np.random.default_rng([seed, 7])
        readings = clean + scale * rng.standard_t(nu, (samples, m))
        for name, (noise, options) in told.items():
            model = replace(case.model, blocks=blocks._replace(noise=noise))
            if options is None:
                belief, _ = EKF.run(model, EKF.init(model), rows_of, readings)
                mean, cov = belief.mean, belief.cov
            else:
                cloud, _ = _run(LinearCase(model, rows_of, readings), replace(options, seed=seed))
                mean, cov = cloud.mean, cloud.cov
            std = np.sqrt(np.diag(cov))
            deviations[name].append((mean - truth) / std)
            widths[name].append(std)
            errors[name].append(mean - truth)
    least = np.sqrt(np.mean(np.square(errors["EKF, told the scale"]), axis=0))
    rows = [
        (
            name, f"{100.0 * np.mean(np.abs(deviations[name]) < 2.0):.1f} %",
            f"{np.sqrt(np.mean(np.square(deviations[name]))):.2f}",
            f"{np.mean(np.sqrt(np.mean(np.square(errors[name]), axis=0)) / least):.2f}",
        )
        for name in told
    ]  # fmt: skip
    return _table(
        f"Student t noise of 3 degrees of freedom: {runs} runs of {samples} samples, ten coefficients",
        ("filter", "±2σ holds", "rms of error/σ", "rms error ÷ the EKF's"), rows,
    )  # fmt: skip


def two_summits(seeds: int) -> Table:
    """An accelerometer tilted by α reads a cos α of a known motion: α and −α are equally possible."""
    import sympy as sp

    alpha, motion = sp.symbols("alpha motion", real=True)
    model = compose(
        Equations("tilted", (), (motion,), (alpha,), (), ()), rate=10.0, values={},
        parameters=[Parameter("alpha", 0.05, 0.3, False)],
        sensors=(_ExpressionSensor("reading", motion * sp.cos(alpha), 0.2),),
    )  # fmt: skip
    rng = np.random.default_rng(11)
    inputs = 2.0 * rng.standard_normal((400, 1))
    readings = inputs * np.cos(0.35) + 0.2 * rng.standard_normal((400, 1))
    grid = np.linspace(-1.5, 1.5, 30_001)
    log_density = (
        -0.5 * ((grid - 0.05) / 0.3) ** 2 - 0.5 * np.sum((readings - inputs * np.cos(grid)) ** 2, axis=0) / 0.04
    )
    weights = np.exp(log_density - log_density.max())
    weights /= weights.sum()

    def row(name: str, values: Array, weights: Array) -> tuple[str, ...]:
        size = float(np.abs(values) @ weights)
        width = float(np.sqrt(values**2 @ weights - size**2))
        return name, f"{100.0 * weights[values > 0.0].sum():.0f} %", f"{size:.3f} ± {width:.3f} rad"

    rows = [row("exact, by quadrature", grid, weights)]
    for seed in range(seeds):
        cloud, _ = _run(LinearCase(model, inputs, readings), ParticleFilter(5000, seed, discount=0.9995))
        rows.append(row(f"particle filter, seed {seed}", cloud.particles[0], cloud.weights))
    belief, _ = EKF.run(model, EKF.init(model), inputs, readings)
    std = float(np.sqrt(belief.cov[0, 0]))
    rows.append(("EKF", "one summit", f"{belief.mean[0]:.3f} ± {std:.3f} rad"))
    return _table(
        "A posterior with two summits: tilt of an accelerometer, ±0.35 rad", ("filter", "share above 0", "|α|"), rows
    )


def joint_formulation(samples: int) -> Table:
    """Motion, loads and ten coefficients from accelerometers: particles on everything, or on the coefficients alone."""
    turbine = load_turbine("verne555").exact()
    record = simulate_record(turbine, duration=60.0, rate=RATE, seed=1)
    problem = pose(record, turbine, turbine.sensors, Prior())
    inputs, readings, block = problem.inputs[:samples], problem.readings[:samples], problem.model.parameter_block
    truth = np.array([q.coordinate(turbine.values[q.name]) for q in problem.model.parameters])
    split = SplitModel(problem.model, problem.build(problem.prior[0]))
    rows: list[tuple[str, ...]] = []

    def add(name: str, mean: Array, cov: Array, log_likelihood: Array, fared: str, began: float) -> None:
        std = np.sqrt(np.diag(cov))[block]
        off = np.sqrt(np.mean(((mean[block] - truth) / std) ** 2))
        rows.append(
            (
                name,
                f"{log_likelihood.sum():.0f}",
                f"{off:.1f}" if off < 100.0 else "> 100",
                fared,
                f"{time.process_time() - began:.2f} s",
            )
        )

    began = time.process_time()
    belief, info = EKF.run(problem.model, EKF.init(problem.model), inputs, readings)
    add("EKF", belief.mean, belief.cov, info.log_likelihood, "", began)
    for count in (2000, 8000):
        began = time.process_time()
        pf = ParticleFilter(count)
        cloud, one = pf.run(problem.model, pf.init(problem.model), inputs, readings)
        add(f"SIR, {count}", cloud.mean, cloud.cov, one.log_likelihood, degeneracy(one).partition(":")[0], began)
    for count in (256, 1024):
        began = time.process_time()
        rb = RaoBlackwellised(count)
        mixture, two = rb.run(split, rb.init(split), inputs, readings)
        add(
            f"Rao-Blackwellised, {count}",
            mixture.mean,
            mixture.cov,
            two.log_likelihood,
            degeneracy(two).partition(":")[0],
            began,
        )
    return _table(
        f"The joint formulation: 25 states, {samples} samples of five accelerometers",
        ("filter", "log-likelihood", "rms of error/σ", "particles", "processor time"), rows,
    )  # fmt: skip


class _ExpressionSensor(NamedTuple):
    """A sensor that reads an expression."""

    channel: str
    expression: object
    noise: float
    bias: float = 0.0


def _run(case: LinearCase, options: ParticleFilter) -> tuple[Cloud, ParticleInfo]:
    return options.run(case.model, options.init(case.model), case.inputs, case.readings)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50, help="records with heavy tails (50)")
    parser.add_argument("--seeds", type=int, default=5, help="seeds of everything else (5)")
    options = parser.parse_args()
    turbine = load_turbine("verne555").exact()
    reference = simulate_reference(turbine, 0)
    balance = record_balance(turbine, reference, reference.inputs[:, 3:])
    case = force_balance_case(turbine, balance, (400.0, 500.0))
    short = LinearCase(case.model, case.inputs[:2000], case.readings[:2000])
    tables: tuple[Callable[[], Sequence[Table]], ...] = (
        lambda: [convergence(short, options.seeds)],
        lambda: [static_coefficients(case, options.seeds)],
        lambda: [heavy_tails(case, options.runs)],
        lambda: [two_summits(3)],
        lambda: [joint_formulation(1000)],
        lambda: compare(options.seeds),
    )
    for made in tables:
        for found in made():
            print(render(found), flush=True)


def _table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table of numbers; one of words where it has two columns."""
    return Table(headings, rows, title, words=range(len(headings)) if len(headings) < 3 else (0,))


if __name__ == "__main__":
    main()
