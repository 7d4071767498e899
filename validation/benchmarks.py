"""Benchmarks of structural identification that others designed, through the interface that users have.

- **Bouc–Wen**: a mass on a hysteretic spring, m ẍ + c ẋ + k z = −m a_g with ż = ẋ − β |ẋ| |z|ⁿ⁻¹ z − γ ẋ |z|ⁿ. m = 1, k
= 9, c = 0.3, β = 2, γ = 1, n = 2;
  k, c, β, γ and n are identified. Wu & Smyth, Struct. Control Health Monit. 14, 2007, https://doi.org/10.1002/stc.186.
- **Two-storey shear frame**: m₁ = m₂ = 1, k = 12 and 10, c = 0.6 and 0.5; the ks and cs are identified. The linear
companion; frames of this kind are
  tracked in Yang et al., Struct. Control Health Monit. 13, 2006, https://doi.org/10.1002/stc.84.

The ground moves as at El Centro, 1940, N–S, linear between samples; absolute accelerations are recorded with 5 % noise;
k starts at 2 to 5, c at 0.2. Public code for both problems, from which the other starts are:
https://github.com/sejaramillomo/Implementation-of-some-Bayesian-Filters-for-structural-system-identification. It scales
the ground to a peak of 5 g for the hysteretic spring, which leaves no doubt of its loops; as recorded (0.35 g) they are
thin. Both are run.

``python -m validation.benchmarks --ground FILE --output DIR`` prints the tables and writes the figures. El Centro is
not part of windsysid.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import sympy as sp

from windsysid._types import Array
from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.filters import FILTERS, Filter
from windsysid.identification.fit_equations import Reading, fit
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.equations import Equations
from windsysid.output.console import render
from windsysid.records.formats import read_record
from windsysid.records.record import AS_WRITTEN, Record
from windsysid.results.identification import Estimate
from windsysid.results.posterior import SIGMAS
from windsysid.simulation.integrate import Response, integrate
from windsysid.statespace.compose import compose
from windsysid.statespace.parameter import Parameter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = [
    "Benchmark",
    "Comparison",
    "bouc_wen",
    "compare",
    "difference_to_scipy",
    "figure",
    "read_ground",
    "record_of",
    "respond",
    "synthetic_ground",
    "two_storey",
]


NOISE = 0.05
"""Noise of a sample, as a share of the rms of the reading."""

STIFFNESS = (2.0, 3.0, 4.0, 5.0)
"""Start values of k, in turn."""

RESULT, ON_LINE = "fit", "fit, on line"

TOLD = 3.0
"""Factor on the noise that `fit` starts from; the filters are given the true noise."""

STRONG = 5.0 * 9.80665
"""Peak of the ground where loops are to be fat [m/s²]."""

SUBSTEPS = 20
"""Integration steps between samples of the truth; the filters take one."""

LOOP = 15.0
"""Drawn part of a loop [s]: later cycles are small and lie inside the first."""

AT_REST = 1e-3
"""Standard deviation of every initial state [m, m/s]."""


@dataclass(frozen=True)
class Benchmark:
    """A structure on moving ground.

    Attributes
    ----------
    name
        In words.
    equations
        With the input ``ground`` [m/s²].
    reads
        Channel and expression of each accelerometer.
    truth
        All parameters.
    starts
        The parameters to identify, for a start of the stiffness.
    peak
        What the ground's peak is scaled to [m/s²]; None: as recorded.
    """

    name: str
    equations: Equations
    reads: Mapping[str, sp.Expr]
    truth: Mapping[str, float]
    peak: float | None = None

    def starts(self, stiffness: float) -> tuple[Parameter, ...]:
        """The parameters to identify, with wide priors on bad starts; masses are known."""
        found = []
        for name in self.truth:
            if name[0] == "k":
                found.append(Parameter(name, stiffness, 1.5))
            elif name[0] == "c":
                found.append(Parameter(name, 0.2, 0.5, logarithmic=False, scale=2.0 * stiffness**0.5))
            elif name in ("beta", "gamma"):
                found.append(Parameter(name, 0.5, 1.5))
            elif name == "n":
                found.append(Parameter(name, 1.1, 1.0))
        return tuple(found)

    @property
    def known(self) -> dict[str, float]:
        """The parameters that are not identified."""
        return {name: value for name, value in self.truth.items() if name[0] == "m"}

    def sensors(self, noise: Array) -> tuple[Reading, ...]:
        """The accelerometers with their noise [m/s²]."""
        return tuple(Reading(name, read, s) for (name, read), s in zip(self.reads.items(), noise.tolist(), strict=True))


def bouc_wen(peak: float | None = None) -> Benchmark:
    """The hysteretic spring."""
    x, v, z, ground = sp.symbols("x v z ground", real=True)
    m, k, c, beta, gamma, n = sp.symbols("m k c beta gamma n", positive=True)
    absolute = -(c * v + k * z) / m  # the spring's and the damper's force; relative to the ground it is less by a_g
    hysteresis = v - beta * sp.Abs(v) * sp.Abs(z) ** (n - 1) * z - gamma * v * sp.Abs(z) ** n
    return Benchmark(
        "Bouc–Wen, " + ("ground as recorded" if peak is None else f"peak {peak / 9.80665:g} g"),
        Equations("bouc_wen", (x, v, z), (ground,), (m, k, c, beta, gamma, n), (), (v, absolute - ground, hysteresis)),
        {"acceleration": absolute},
        {"m": 1.0, "k": 9.0, "c": 0.3, "beta": 2.0, "gamma": 1.0, "n": 2.0},
        peak,
    )


def two_storey() -> Benchmark:
    """The shear frame; x and v are relative to the ground."""
    x_1, x_2, v_1, v_2, ground = sp.symbols("x_1 x_2 v_1 v_2 ground", real=True)
    m_1, m_2, k_1, k_2, c_1, c_2 = sp.symbols("m_1 m_2 k_1 k_2 c_1 c_2", positive=True)
    lower = k_1 * x_1 + c_1 * v_1
    upper = k_2 * (x_2 - x_1) + c_2 * (v_2 - v_1)
    first, second = (upper - lower) / m_1, -upper / m_2
    return Benchmark(
        "two-storey frame, ground as recorded",
        Equations(
            "two_storey", (x_1, x_2, v_1, v_2), (ground,), (m_1, m_2, k_1, k_2, c_1, c_2), (),
            (v_1, v_2, first - ground, second - ground),
        ),
        {"acceleration_1": first, "acceleration_2": second},
        {"m_1": 1.0, "m_2": 1.0, "k_1": 12.0, "k_2": 10.0, "c_1": 0.6, "c_2": 0.5},
    )  # fmt: skip


def read_ground(path: Path) -> Record:
    """Ground acceleration from a file: the channel ``ground`` in m/s²; one without a unit is in g.

    Raises
    ------
    RecordError
        If the file cannot be read.
    """
    record = read_record(path)
    channel, unit = record.channels[0], record.units[0]
    unit = "g" if unit.startswith(AS_WRITTEN) else unit
    return record.with_channels({"ground": (record[channel], unit)}).select(["ground"]).with_name(path.stem)


def synthetic_ground(seed: int = 0, *, duration: float = 30.0, rate: float = 50.0, peak: float = 3.0) -> Record:
    """An earthquake after Kanai and Tajimi: white noise through a layer of soil, swelling for 4 s and dying away.

    Parameters
    ----------
    duration, rate
        [s], [Hz].
    peak
        Greatest acceleration [m/s²].
    """
    from scipy.signal import bilinear, lfilter

    corner, damping = 15.0, 0.6  # of firm soil: rad/s; Tajimi, Proc. 2nd WCEE, 1960
    time = np.arange(round(duration * rate)) / rate
    soil = bilinear([2.0 * damping * corner, corner**2], [1.0, 2.0 * damping * corner, corner**2], rate)
    shaken = lfilter(*soil, np.random.default_rng(seed).standard_normal(time.size)) * time * np.exp(-time / 4.0)
    values = shaken * peak / np.max(np.abs(shaken))
    return Record(time, values[:, None], ("ground",), ("m/s^2",), name=f"synthetic ground, seed {seed}")


def respond(benchmark: Benchmark, ground: Record) -> tuple[Record, Response]:
    """Ground motion of the benchmark, and the response from rest, without noise."""
    values = ground["ground"]
    if benchmark.peak is not None:
        values = values * benchmark.peak / np.max(np.abs(values))
    ground = ground.with_channels({"ground": (values, "m/s^2")})
    model = compile_model(benchmark.equations, benchmark.sensors(np.ones(len(benchmark.reads))))
    p = [benchmark.truth[name] for name in model.parameters]
    start = np.zeros(len(model.states))
    return ground, integrate(model, p, values[:, None], rate=ground.rate, start=start, substeps=SUBSTEPS)


def record_of(benchmark: Benchmark, ground: Record, response: Response, seed: int) -> tuple[Record, Array]:
    """Records: ground and noisy accelerations, and the noise of each accelerometer [m/s²]."""
    noise = NOISE * np.sqrt(np.mean(response.readings**2, axis=0))
    drawn = np.random.default_rng(seed).standard_normal(response.readings.shape)
    noisy = response.readings + noise * drawn
    channels = {name: (noisy[:, i], "m/s^2") for i, name in enumerate(benchmark.reads)}
    return ground.with_channels(channels), noise


def difference_to_scipy(benchmark: Benchmark, ground: Record, response: Response) -> float:
    """The greatest difference between readings and those by SciPy's DOP853, in the rms of the reading."""
    from scipy.integrate import solve_ivp

    e = benchmark.equations
    p = [benchmark.truth[symbol.name] for symbol in e.parameters]
    rates = sp.lambdify([e.states, e.inputs, e.parameters], e.rates)
    reads = sp.lambdify([e.states, e.inputs, e.parameters], list(benchmark.reads.values()))
    h, x, worst = 1.0 / ground.rate, np.zeros(len(e.states)), np.zeros(len(benchmark.reads))
    acceleration = ground["ground"]

    def moving(t: float, x: Array, first: float, last: float) -> Array:
        return np.array(rates(x, [first + (last - first) * t / h], p))

    for k, found in enumerate(response.readings[1:]):
        ends = (float(acceleration[k]), float(acceleration[k + 1]))
        x = solve_ivp(moving, (0.0, h), x, method="DOP853", args=ends, rtol=1e-10, atol=1e-12).y[:, -1]
        worst = np.maximum(worst, np.abs(found - reads(x, ends[1:], p)))
    return float(np.max(worst / np.sqrt(np.mean(response.readings**2, axis=0))))


class Track(NamedTuple):
    """One filter on the first record: parameters with ±2σ, and states, after each sample."""

    estimate: Array
    low: Array
    high: Array
    states: Array


@dataclass(frozen=True)
class Comparison:
    """R records identified by each method.

    Attributes
    ----------
    benchmark
        What was identified.
    names
        The n parameters.
    errors, deviations
        By method, (R, n): relative to the truth, and in standard deviations; NaN where the filter diverged.
    seconds
        By method, (R,).
    warned
        How many results of `fit` said that they should not be trusted.
    tracks
        By what runs on line, on the first record; the states of `fit` are those at its result.
    result
        Of `fit`, on the first record.
    time, truth
        Of the first record: (T,) [s], and the states (T, n_x).
    """

    benchmark: Benchmark
    names: tuple[str, ...]
    errors: Mapping[str, Array]
    deviations: Mapping[str, Array]
    seconds: Mapping[str, Array]
    warned: int
    tracks: Mapping[str, Track]
    result: tuple[Estimate, ...]
    time: Array
    truth: Array

    def covers(self, method: str) -> Array:
        """Coverage of ±2σ, (n,); a filter that diverged does not cover."""
        return np.asarray(np.mean(np.abs(self.deviations[method]) < SIGMAS, axis=0))

    def table(self) -> "Table":
        """Errors, coverage and time as a Rich table."""
        from rich.table import Table

        runs = len(next(iter(self.seconds.values())))
        table = Table(
            title=f"{self.benchmark.name}: {runs} records, median error and ±2σ coverage", title_justify="left"
        )
        table.add_column("method")
        for heading in (*self.names, "all cover", "diverged", "seconds"):
            table.add_column(heading, justify="right")
        for method, errors in self.errors.items():
            lost = int(np.isnan(errors).any(axis=1).sum())
            covers = self.covers(method)
            typical = 100.0 * np.median(np.where(np.isnan(errors), np.inf, np.abs(errors)), axis=0)
            cells = [f"{error:.3g} %\n{100.0 * cover:.0f} %" for error, cover in zip(typical, covers, strict=True)]
            table.add_row(
                method, *cells, f"{100.0 * covers.mean():.1f} %", str(lost), f"{np.median(self.seconds[method]):.3f}"
            )
        return table


def compare(benchmark: Benchmark, ground: Record, runs: int) -> Comparison:
    """Identify `runs` records, seeds 0, 1, …, by every joint filter and by `fit`.

    Raises
    ------
    ConfigurationError
        If `runs` is not positive.
    """
    if runs < 1:
        raise ConfigurationError(f"runs: expected at least 1, got {runs}")
    ground, response = respond(benchmark, ground)
    rows: dict[str, list[_End]] = {}
    priors: list[Sequence[Parameter]] = []
    results: list[tuple[Estimate, ...]] = []
    trusted: list[bool] = []
    tracks: dict[str, Track] = {}
    for seed in range(runs):
        record, noise = record_of(benchmark, ground, response, seed)
        parameters = benchmark.starts(STIFFNESS[seed % len(STIFFNESS)])
        for method in FILTERS:
            end, track = _filtered(method, benchmark, record, noise, parameters)
            rows.setdefault(method.name, []).append(end)
            tracks.setdefault(method.name, track)
        found = fit(
            benchmark.equations, record, parameters=parameters, values=benchmark.known,
            sensors=benchmark.sensors(TOLD * noise), cov=_at_rest(benchmark),
        )  # fmt: skip
        theta = np.array([q.coordinate(e.estimate) for q, e in zip(parameters, found.estimates, strict=True)])
        rows.setdefault(RESULT, []).append(_End(theta, np.sqrt(np.diag(found.cov)), found.elapsed))
        rows.setdefault(ON_LINE, []).append(_End(found.mean[-1], found.std[-1], found.elapsed))
        tracks.setdefault(ON_LINE, _track(parameters, found.mean, found.std, found.state_mean))
        priors.append(parameters)
        trusted.append(found.diagnosis is not None and found.diagnosis.trusted)
        results.append(found.estimates)
    names = tuple(q.name for q in priors[0])
    true = np.array([benchmark.truth[name] for name in names])
    errors: dict[str, Array] = {}
    deviations: dict[str, Array] = {}
    for name, ends in rows.items():
        at = np.array([_physical(q, end.theta) for q, end in zip(priors, ends, strict=True)])
        theta = np.array([[q.coordinate(value) for q, value in zip(row, true, strict=True)] for row in priors])
        errors[name] = at / true - 1.0
        deviations[name] = (np.array([end.theta for end in ends]) - theta) / np.array([end.std for end in ends])
    return Comparison(
        benchmark=benchmark,
        names=names,
        errors=errors,
        deviations=deviations,
        seconds={name: np.array([end.seconds for end in ends]) for name, ends in rows.items()},
        warned=trusted.count(False),
        tracks=tracks,
        result=results[0],
        time=ground.time,
        truth=response.states,
    )


class _End(NamedTuple):
    """Final estimate of a method: θ and its standard deviation (n,), and the seconds it took."""

    theta: Array
    std: Array
    seconds: float


def _filtered(
    method: Filter, benchmark: Benchmark, record: Record, noise: Array, parameters: Sequence[Parameter]
) -> tuple[_End, Track]:
    """A joint filter on a record; it is given what the noise is."""
    model = compose(
        benchmark.equations, rate=record.rate, values=benchmark.known, parameters=parameters,
        sensors=benchmark.sensors(noise), cov=_at_rest(benchmark),
    )  # fmt: skip
    inputs, readings = record["ground"][:, None], np.column_stack([record[name] for name in benchmark.reads])
    method.run(model, method.init(model), inputs[:0], readings[:0])  # compiled outside the clock
    started = time.perf_counter()
    belief, info = method.run(model, method.init(model), inputs, readings)
    elapsed = time.perf_counter() - started
    block = model.parameter_block
    end = _End(belief.mean[block], np.sqrt(np.diag(belief.cov)[block]), elapsed)
    return end, _track(parameters, info.mean[:, block], info.std[:, block], info.mean[:, : block.start])


def _track(parameters: Sequence[Parameter], mean: Array, std: Array, states: Array) -> Track:
    middle, low, high = (_physical(parameters, mean + k * std) for k in (0.0, -SIGMAS, SIGMAS))
    return Track(middle, low, high, states)


def _physical(parameters: Sequence[Parameter], theta: Array) -> Array:
    """Parameters in their own units for θ (…, n)."""
    return np.stack([q.physical(theta[..., i]) for i, q in enumerate(parameters)], axis=-1)


def _at_rest(benchmark: Benchmark) -> Array:
    """Covariance of the states at the first sample."""
    return np.asarray(AT_REST**2 * np.eye(len(benchmark.equations.states)))


def figure(found: Comparison) -> "Figure":
    """Parameters over time for each filter with ±2σ, truth and result; the loop z over x of a hysteretic spring."""
    from matplotlib.figure import Figure

    states = [symbol.name for symbol in found.benchmark.equations.states]
    panels = len(found.names) + ("z" in states)
    columns = 3 if panels > 4 else 2
    drawing = Figure(figsize=(4.2 * columns, 3.0 * -(-panels // columns) + 0.6), layout="constrained")
    axes = drawing.subplots(-(-panels // columns), columns, squeeze=False).ravel()
    for i, (ax, name) in enumerate(zip(axes, found.names, strict=False)):
        _parameter(ax, found, i, name)
    if "z" in states:
        _loop(axes[len(found.names)], found, states.index("x"), states.index("z"))
    for ax in axes[panels:]:
        ax.remove()
    handles, labels = axes[0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside upper center", ncols=2 * columns, frameon=False, fontsize=9)
    return drawing


def _colours(found: Comparison) -> dict[str, str]:
    from windsysid.reports.figures.plots import ERROR, ESTIMATE

    return dict(zip(found.tracks, (ERROR, "#5b8c3e", "#8a5aa8"), strict=False)) | {ON_LINE: ESTIMATE}


def _parameter(ax: "Axes", found: Comparison, i: int, name: str) -> None:
    from windsysid.reports.figures.plots import REFERENCE, symbol, tidy

    colours, true = _colours(found), found.benchmark.truth[name]
    for method, track in found.tracks.items():
        begun = np.any(track.estimate != track.estimate[0], axis=1)
        time, low, high = found.time[begun], track.low[begun, i], track.high[begun, i]
        ax.fill_between(time, low, high, color=colours[method], alpha=0.2, lw=0)
        ax.plot(time, track.estimate[begun, i], color=colours[method], lw=1.2, label=method)
    ax.axhline(true, color=REFERENCE, ls="--", lw=1, label="truth")
    e = found.result[i]
    low, middle, high = np.clip([e.low, e.estimate, e.high], 0.0, 2.0 * true)
    ax.errorbar(
        found.time[-1] * 1.08, middle, yerr=[[middle - low], [high - middle]],
        fmt="o", ms=4, color=colours[ON_LINE], capsize=3, label="fit ±2σ", clip_on=False, zorder=5,
    )  # fmt: skip
    ax.set_ylim(0.0, 2.0 * true)
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlim(0.3, found.time[-1])
    ax.set_ylabel(symbol(name))
    ax.set_xlabel("time [s]")
    tidy(ax)


def _loop(ax: "Axes", found: Comparison, x: int, z: int) -> None:
    from windsysid.reports.figures.plots import REFERENCE, tidy

    colours, part = _colours(found), found.time <= LOOP
    for method, track in found.tracks.items():
        ax.plot(track.states[part, x], track.states[part, z], color=colours[method], lw=1.2)
    ax.plot(found.truth[part, x], found.truth[part, z], color=REFERENCE, lw=0.9, ls=(0, (4, 3)))
    ax.set_xlabel(f"x [m], first {LOOP:g} s")
    ax.set_ylabel("z [m]")
    tidy(ax)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables and write one figure per benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m validation.benchmarks", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--ground", type=Path, help="ground acceleration: time [s] and acceleration [g]")
    parser.add_argument("--output", type=Path, help="folder of the figures; none by default")
    parser.add_argument("--runs", type=int, default=20, help="records per benchmark (20)")
    options = parser.parse_args(arguments)
    try:
        if options.ground is None:
            raise ConfigurationError(
                "the ground motion is not part of windsysid: give El Centro, or any other, with --ground FILE, "
                "two columns without heading: time [s] and acceleration [g]"
            )
        ground = read_ground(options.ground)
        if options.output is not None:
            options.output.mkdir(parents=True, exist_ok=True)
        for benchmark, file in (
            (bouc_wen(), "bouc_wen"), (bouc_wen(STRONG), "bouc_wen_5g"), (two_storey(), "two_storey"),
        ):  # fmt: skip
            moved, response = respond(benchmark, ground)
            found = compare(benchmark, ground, options.runs)
            apart = difference_to_scipy(benchmark, moved, response)
            notes = f"{found.warned} of {options.runs} fits warn; the simulated truth is {apart:.1e} rms from SciPy's"
            print(render(found.table(), notes, ""), flush=True)
            if options.output is not None:
                figure(found).savefig(options.output / f"{file}.png", dpi=150)
    except (WindsysidError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
