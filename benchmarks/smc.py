"""Comparison of the particle filter with the library `particles`: time and estimates for one model and one scheme.

    python benchmarks/smc.py [--runs 5]        in an environment made from benchmarks/peers.txt

The model is the published one: ten static coefficients, five filtered force balances at 100 Hz, 100 s of the reference
record, loads known. Both filters begin at the Kalman posterior of the second before, resample systematically where the
effective sample size falls below half, and draw anew from Liu and West's kernel (a custom transition of `particles`,
which has none; ours takes the error of that draw's mean and covariance out, which is a part of what is timed). Both
give means and variances after each sample; `particles` is timed without, too. The peer works on NumPy arrays with one
matrix product per sample, and once more with the distributions of its manual. What is timed is processor time, so that
a busy machine is busy for all; the least of several runs counts. Errors are those against the Kalman filter, in its
standard deviations, over seeds.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from particles.collectors import Moments
from rich.console import Console
from rich.table import Table

import particles
from particles import distributions as dists
from windsysid import load_turbine
from windsysid.filters import EKF, ParticleFilter
from windsysid.identification.estimate.force_balance import Balance, analysis_band, balance_statespace
from windsysid.identification.model.prior import identifiable
from windsysid.statespace.compose import StateSpace
from windsysid.study.arms import START, record_balance
from windsysid.study.scenario import RATE, simulate_reference

DISCOUNT = 0.6
SHARE = 0.5


class Problem:
    """The model, 10 000 samples, and the Gaussian that both begin from."""

    def __init__(self) -> None:
        turbine = load_turbine("verne555").exact()
        reference = simulate_reference(turbine, 0)
        band = analysis_band(turbine)
        balance = record_balance(turbine, reference, reference.inputs[:, 3:])
        window = slice(round(480.0 * RATE), round(581.0 * RATE))
        cut = Balance(balance.force[window], balance.regressors[window])
        parameters = START.parameters(turbine, identifiable(turbine), linear=True)
        self.model, inputs = balance_statespace(cut, turbine.model.coordinates, parameters, rate=RATE, band=band)
        second = round(RATE)
        start, _ = EKF.run(self.model, EKF.init(self.model), inputs[:second], cut.force[:second])
        self.inputs, self.force = inputs[second:], cut.force[second:]
        self.mean, self.root = start.mean, np.linalg.cholesky(start.cov)
        self.exact, info = EKF.run(self.model, start._replace(samples=0), self.inputs, self.force)
        self.log_likelihood = float(info.log_likelihood.sum())
        # rows of Φ for θ as the filters scale it
        self.rows = inputs[second:].reshape(-1, 5, 10) * self.model.blocks.reference
        self.model = StateSpace(**{**self.model.__dict__, "mean": start.mean, "cov": start.cov})


class Peer(particles.FeynmanKac):
    """Model of the force balance for `particles`: states (N, 10)."""

    def __init__(self, problem: Problem, seed: int) -> None:
        super().__init__(len(problem.force))
        self.problem, self.kernel, self.rng = problem, None, np.random.default_rng(seed)
        self.transposed = np.ascontiguousarray(problem.rows.transpose(0, 2, 1)) / np.sqrt(problem.model.blocks.noise)
        self.scaled = problem.force / np.sqrt(problem.model.blocks.noise)
        self.peak = float(-0.5 * np.log(2.0 * np.pi * problem.model.blocks.noise).sum())
        self.a = (3.0 * DISCOUNT - 1.0) / (2.0 * DISCOUNT)

    def M0(self, N: int) -> np.ndarray:
        return self.problem.mean + self.rng.standard_normal((N, 10)) @ self.problem.root.T

    def time_to_resample(self, smc: particles.SMC) -> bool:
        due = smc.N * smc.ESSrmin > smc.aux.ESS
        if due:
            mean = smc.W @ smc.X
            away = smc.X - mean
            self.kernel = mean, np.linalg.cholesky((away * smc.W[:, None]).T @ away)
        return due

    def M(self, t: int, xp: np.ndarray) -> np.ndarray:
        if self.kernel is None:
            return xp
        (mean, root), self.kernel = self.kernel, None
        noise = self.rng.standard_normal(xp.shape) @ root.T
        return self.a * xp + (1.0 - self.a) * mean + np.sqrt(1.0 - self.a**2) * noise

    def logG(self, t: int, xp: np.ndarray | None, x: np.ndarray) -> np.ndarray:
        off = self.scaled[t] - x @ self.transposed[t]
        return self.peak - 0.5 * np.einsum("ij,ij->i", off, off)

    def default_moments(self, W: np.ndarray, X: np.ndarray) -> dict[str, np.ndarray]:
        mean = W @ X
        return {"mean": mean, "var": W @ (X * X) - mean**2}


class WithDistributions(Peer):
    """Model with the distributions of `particles`, as its manual writes a model."""

    def logG(self, t: int, xp: np.ndarray | None, x: np.ndarray) -> np.ndarray:
        expected = x @ self.problem.rows[t].T
        std = np.sqrt(self.problem.model.blocks.noise)
        sensors = (dists.Normal(loc=expected[:, c], scale=std[c]) for c in range(5))
        return dists.IndepProd(*sensors).logpdf(self.problem.force[t][None])


Found = tuple[np.ndarray, np.ndarray, float, int]


def ours(problem: Problem, count: int, seed: int, threads: int) -> Found:
    pf = ParticleFilter(count, seed, discount=DISCOUNT, threshold=SHARE, tempering=False, threads=threads)
    cloud, info = pf.run(problem.model, pf.init(problem.model), problem.inputs, problem.force)
    return cloud.mean, np.diag(cloud.cov), float(info.log_likelihood.sum()), int(info.resamplings.sum())


def theirs(problem: Problem, count: int, seed: int, kind: type[Peer] = Peer, moments: bool = True) -> Found:
    np.random.seed(seed)  # noqa: NPY002 (what its resampling draws from)
    smc = particles.SMC(
        fk=kind(problem, seed),
        N=count,
        resampling="systematic",
        ESSrmin=SHARE,
        collect=[Moments()] if moments else None,
    )
    smc.run()
    mean = smc.W @ smc.X
    return mean, smc.W @ (smc.X - mean) ** 2, float(smc.logLt), int(np.sum(smc.summaries.rs_flags))


def timed(run: Callable[[], Found], repeats: int) -> tuple[float, float]:
    best, wall = np.inf, np.inf
    for _ in range(repeats):
        began, clock = time.process_time(), time.perf_counter()
        run()
        best, wall = min(best, time.process_time() - began), min(wall, time.perf_counter() - clock)
    return best, wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="seeds of each (5)")
    runs = parser.parse_args().runs
    problem, console = Problem(), Console(width=120)
    std = np.sqrt(np.diag(problem.exact.cov))
    samples = len(problem.force)
    ways = {
        "windsysid, 1 thread": lambda n, seed: ours(problem, n, seed, 1),
        "windsysid, 2 threads": lambda n, seed: ours(problem, n, seed, 2),
        "particles": lambda n, seed: theirs(problem, n, seed),
        "particles, no moments": lambda n, seed: theirs(problem, n, seed, moments=False),
        "particles, its distributions": lambda n, seed: theirs(problem, n, seed, WithDistributions),
    }
    ours(problem, 300, 0, 2)  # compiles
    table = Table(title=f"2000 particles, {samples} samples, 10 coefficients", title_justify="left")
    for heading in (
        "filter",
        "processor s",
        "clock s",
        "÷ ours",
        "error of mean",
        "std ÷ Kalman's",
        "log L − Kalman's",
        "resampled",
    ):
        table.add_column(heading, justify="left" if heading == "filter" else "right")
    base = 0.0
    for name, way in ways.items():
        found = [way(2000, seed) for seed in range(runs)]
        seconds, wall = timed(lambda way=way: way(2000, 0), 5 if name.startswith("wind") else 1)
        base = base or seconds
        error = np.sqrt(np.mean([((f[0] - problem.exact.mean) / std) ** 2 for f in found]))
        ratio = np.mean([np.sqrt(f[1]) / std for f in found])
        logs = [f[2] - problem.log_likelihood for f in found]
        table.add_row(
            name, f"{seconds:.3f}", f"{wall:.3f}", f"{seconds / base:.1f}", f"{error:.2f}", f"{ratio:.2f}",
            f"{np.mean(logs):+.2f} ± {np.std(logs):.2f}", f"{np.mean([f[3] for f in found]):.0f}",
        )  # fmt: skip
    console.print(table)
    scaling = Table(title="Seconds of processor time, by particles", title_justify="left")
    counts = (100, 1000, 10_000, 100_000)
    for heading in ("filter", *(f"{n}" for n in counts)):
        scaling.add_column(heading, justify="left" if heading == "filter" else "right")
    short = {"windsysid": lambda n: ours(problem, n, 0, 1), "particles": lambda n: theirs(problem, n, 0)}
    for name, way in short.items():
        scaling.add_row(name, *(f"{timed(lambda way=way, n=n: way(n), 2 if n < 5000 else 1)[0]:.3f}" for n in counts))
    console.print(scaling)
    console.print(
        f"particles {particles.__version__ if hasattr(particles, '__version__') else ''}, NumPy {np.__version__}"
    )


if __name__ == "__main__":
    main()
