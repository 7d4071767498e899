"""Information of a planned record in its first seconds, and its growth after them.

Readings come from a simulated record (`windsysid.identification.planning.plan`). Information on numbers of the model is
the sum of squared slopes of the innovations; on clocks it is the curvature of the likelihood
(`windsysid.identification.estimate.clock_lag`).
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from windsysid._types import Array
from windsysid.filters.bank import bank_of
from windsysid.identification.estimate.clock_lag import Lateness, clock_information, shifted
from windsysid.identification.estimate.scoring import BANK_THREADS, look, neighbours, score
from windsysid.identification.model.turbine_problem import TurbineProblem
from windsysid.loads.statistics import to_logarithms
from windsysid.output.progress import Progress

__all__ = ["planned_information"]

BLOCK_COUNT = 10
"""Setting: parts of the record from whose scatter the accuracy is estimated."""

RELATIVE_STEP = 1e-6
"""Numerical: relative width of the differences."""

CLOCK_SAMPLES = 10_000
"""Setting: samples from which the information on clocks is taken."""


def planned_information(
    problem: TurbineProblem, rate: float, finding: float, progress: Progress
) -> tuple[Array, Array]:
    """I(t₀) (n, n), and the growth [1/s] in each block of the record (BLOCKS, n, n), in relative coordinates.

    The tolerances come last, in standard deviations of what the files say; that is information from the start.
    """
    theta = problem.wide_prior[0]
    known = problem.unknowns.only("parameters", "statistics", "tolerances")
    at, eta = known.of("parameters"), known.of("statistics")
    relative = [1.0 if q.logarithmic else t for q, t in zip(problem.parameters, theta[at].tolist(), strict=True)]
    sizes = known.vector(parameters=relative, statistics=1.0, tolerances=1.0)
    to_relative = np.diag(sizes)  # ∂ unknowns / ∂ ln p
    to_relative[eta, eta] = np.linalg.inv(to_logarithms(problem.statistics))
    widths = RELATIVE_STEP * np.abs(sizes)
    first = max(1, round(finding * rate))
    ends = np.linspace(first, len(problem.readings), BLOCK_COUNT + 1).astype(int)
    bank = bank_of([problem.build(values) for values in neighbours(theta, widths)])
    found: list[Array] = []
    with ThreadPoolExecutor(BANK_THREADS) as pool:
        for begin, end in zip([0, *ends[:-1]], ends, strict=True):
            progress("information of the simulated record", begin / len(problem.readings))
            part = slice(begin, end)
            bank, scored = score(bank, problem.inputs[part], problem.readings[part], widths, pool)
            found.append(to_relative.T @ scored.fisher @ to_relative)
    seconds = np.diff(ends)[:, None, None] / rate
    size, whole = len(theta), len(theta) + len(problem.clocks)
    growths = np.zeros((BLOCK_COUNT, whole, whole))
    growths[:, :size, :size] = np.array(found[1:]) / seconds
    start = np.diag(problem.unknowns.vector(tolerances=1.0, clocks=1.0))
    start[:size, :size] += found[0]
    if problem.clocks:
        progress("information on clocks", None)
        some = slice(first, first + CLOCK_SAMPLES)
        block = problem.inputs[some], problem.readings[some]
        samples = shifted(problem, [block], np.zeros(len(problem.clocks)))
        seen = look(problem.build, samples, theta, widths, changes=Lateness(samples, problem.clocks))
        said = clock_information(problem.build(theta), samples, seen.found, problem.clocks)
        length = len(block[1]) / rate
        growths[:, size:, :size] = (said.mixed.T @ to_relative) / length
        growths[:, :size, size:] = growths[:, size:, :size].swapaxes(1, 2)
        growths[:, size:, size:] = said.curvature / length
    return start, growths
