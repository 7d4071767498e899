"""A bank: many extended Kalman filters side by side on the same readings, each with its own numbers in the model.

Learning parameters from a likelihood takes the filter at many neighbouring parameter values. They differ in numbers
only, so they are run in groups of `LANES`, the lane being the last axis of every array: each operation of the filter is
one operation of the processor's vector unit. The bank computes what `windsysid.filters.ekf` computes for models without
parameters in the state, in the order

    predict   m⁻ = f(m),   P⁻ = F P Fᵀ + Γ Q Γᵀ
    update    reading by reading:  v = P h,  s = h v + r,  m ← m + v ν/s,  P ← P − v vᵀ/s

where P is changed once for all readings of a sample: v = P⁻ h − Σ u (u h) over the readings before, u = v/√s, and P =
P⁻ − Σ u uᵀ.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters.bank_kernel import run_kernel
from windsysid.filters.lanes import Lanes, lanes_of, patterns_of, scratch_of
from windsysid.kernels.simd import LANES
from windsysid.mechanics.compile import CompiledModel
from windsysid.statespace.compose import StateSpace

__all__ = ["LANES", "Bank", "Scores", "bank_of", "run_bank"]


class Bank(NamedTuple):
    """Filters of one structure, and what they believe.

    Attributes
    ----------
    compiled
        The model's kernels.
    lanes
        One `Lanes` per group.
    mean, cov
        Beliefs (groups, n, LANES), (groups, n, n, LANES).
    inputs
        Inputs at the beliefs' own time (n_u + n_w,).
    samples
        How many samples they have seen.
    filters
        How many filters there are; lanes beyond repeat the last one.
    """

    compiled: CompiledModel
    lanes: tuple[Lanes, ...]
    mean: Array
    cov: Array
    inputs: Array
    samples: int
    filters: int


class Scores(NamedTuple):
    """What came out of T samples of m readings for each filter.

    Attributes
    ----------
    whitened
        Innovations decorrelated and scaled to unit variance (T, m, filters); 0 where the reading is missing.
    log_std
        Logarithm of what they were divided by (T, m, filters); 0 where missing.
    """

    whitened: Array
    log_std: Array


def bank_of(models: Sequence[StateSpace]) -> Bank:
    """Put filters for models of one structure side by side, each at its model's prior.

    Raises
    ------
    ValueError
        If the models differ in more than their numbers, or have parameters in the state.
    """
    first = models[0]
    n = len(first.states)
    for model in models:
        if model.states != first.states or model.readings != first.readings or model.parameters:
            raise ValueError("a bank holds models of the same states and readings, without parameters in the state")
    padded = [*models, *[models[-1]] * (-len(models) % LANES)]
    groups = [padded[i : i + LANES] for i in range(0, len(padded), LANES)]
    patterns = patterns_of(first, padded)
    return Bank(
        first.compiled,
        tuple(lanes_of(group, patterns) for group in groups),
        np.ascontiguousarray([np.stack([m.mean for m in group], axis=-1) for group in groups]).reshape(-1, n, LANES),
        np.ascontiguousarray([np.stack([m.cov for m in group], axis=-1) for group in groups]).reshape(-1, n, n, LANES),
        np.zeros(len(first.inputs)),
        0,
        len(models),
    )


def run_bank(bank: Bank, inputs: Array, readings: Array, pool: ThreadPoolExecutor | None = None) -> tuple[Bank, Scores]:
    """Filter T samples with every filter: inputs (T, n_u + n_w), readings (T, m), NaN = missing."""
    inputs = np.require(inputs, np.float64, ["C", "W"])
    readings = np.require(readings, np.float64, ["C", "W"])
    samples, m = readings.shape
    mean, cov = bank.mean.copy(), bank.cov.copy()
    groups = len(bank.lanes)
    whitened, variance = np.zeros((samples, m, groups, LANES)), np.ones((samples, m, groups, LANES))
    kernel, rates, reading = run_kernel(), bank.compiled.rates_of_lanes, bank.compiled.reading_of_lanes

    def run(g: int) -> None:
        kernel(
            rates, reading, bank.lanes[g], scratch_of(bank.lanes[g], mean.shape[1]), mean[g], cov[g],
            bank.inputs, inputs, readings, bank.samples > 0, g, whitened, variance,
        )  # fmt: skip

    list((pool.map if pool else map)(run, range(len(bank.lanes))))
    log_std = 0.5 * np.log(variance)
    scores = (array.reshape(samples, m, groups * LANES)[..., : bank.filters] for array in (whitened, log_std))
    last = inputs[-1].copy() if samples else bank.inputs
    return bank._replace(mean=mean, cov=cov, inputs=last, samples=bank.samples + samples), Scores(*scores)
