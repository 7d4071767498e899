"""A bank: many extended Kalman filters side by side on the same readings, each with its own numbers in the model.

Learning parameters from a likelihood takes the filter at many neighbouring parameter values. They differ in numbers
only, so they are run in groups of `LANES`, the lane being the last axis of every array: each operation of the filter is
one operation of the processor's vector unit. The bank computes what `windsysid.filters.ekf` computes for models without
parameters in the state, in the order

    predict   m⁻ = f(m),   P⁻ = F P Fᵀ + Γ Q Γᵀ + V Vᵀ
    update    reading by reading:  v = P h,  s = h v + r,  m ← m + v ν/s,  P ← P − v vᵀ/s

where P is changed once for all readings of a sample: v = P⁻ h − Σ u (u h) over the readings before, u = v/√s, and P =
P⁻ − Σ u uᵀ. With changes dy of the readings a bank carries how far means go with them, dm, through the same F and the
gains: dν = dy − h dm − E dw, and the log-likelihood changes by −Σ ν dν/s. A change may act on the loads w, too. Each
lane may have changes of its own: one filter in all lanes tells `LANES` responses at the price of one.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters.bank_kernel import run_kernel
from windsysid.filters.lanes import Lanes, lanes_of, pad_within_factors, patterns_of, scratch_of
from windsysid.kernels.simd import LANES
from windsysid.mechanics.compile import CompiledModel
from windsysid.statespace.compose import StateSpace

__all__ = ["LANES", "Bank", "BankScores", "bank_of", "run_bank"]


class Bank(NamedTuple):
    """Filters of one structure, and their beliefs.

    Attributes
    ----------
    compiled
        The model's kernels.
    lanes
        One `Lanes` per group.
    mean, cov
        Beliefs (groups, n, LANES), (groups, n, n, LANES).
    tangents
        How far the means go with each of c changes of the readings (groups, c, n, LANES).
    inputs
        Inputs at the beliefs' own time (n_u + n_w,).
    changed
        Changes at that time (m + n_w, c, LANES).
    samples
        How many samples they have seen.
    filters
        How many filters there are; lanes beyond repeat the last one.
    """

    compiled: CompiledModel
    lanes: tuple[Lanes, ...]
    mean: Array
    cov: Array
    tangents: Array
    inputs: Array
    changed: Array
    samples: int
    filters: int


class BankScores(NamedTuple):
    """Results of T samples of m readings for each filter.

    Attributes
    ----------
    whitened
        Innovations decorrelated and scaled to unit variance (T, m, filters); 0 where the reading is missing.
    log_std
        Logarithm of what they were divided by (T, m, filters); 0 where missing.
    slopes
        Of the log-likelihood to each change of the readings (c, filters).
    responses
        By how much `whitened` of the first filters changes with each change (T, m, c, LANES); empty where they were not
        requested.
    """

    whitened: Array
    log_std: Array
    slopes: Array
    responses: Array


def bank_of(models: Sequence[StateSpace], changes: int = 0) -> Bank:
    """Put filters for models of one structure side by side, each at its model's prior, for c changes of the readings.

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
    padded = pad_within_factors([*models, *[models[-1]] * (-len(models) % LANES)])
    groups = [padded[i : i + LANES] for i in range(0, len(padded), LANES)]
    patterns = patterns_of(first, padded)
    return Bank(
        first.compiled,
        tuple(lanes_of(group, patterns) for group in groups),
        np.ascontiguousarray([np.stack([m.mean for m in group], axis=-1) for group in groups]).reshape(-1, n, LANES),
        np.ascontiguousarray([np.stack([m.cov for m in group], axis=-1) for group in groups]).reshape(-1, n, n, LANES),
        np.zeros((len(groups), changes, n, LANES)),
        np.zeros(len(first.inputs)),
        np.zeros((len(first.readings), changes, LANES)),
        0,
        len(models),
    )


def run_bank(
    bank: Bank, inputs: Array, readings: Array, pool: ThreadPoolExecutor | None = None, changes: Array | None = None, *,
    respond: bool = False,
) -> tuple[Bank, BankScores]:  # fmt: skip
    """Filter T samples with every filter: inputs (T, n_u + n_w), readings (T, m), NaN = missing.

    With `changes` of the readings (T, m, c), or of readings and loads in each lane (T, m + n_w, c, LANES), the same
    filters tell how their likelihood changes with each of them, and the whitened innovations of the first filters if
    they `respond`, with gains held.
    """
    inputs = np.require(inputs, np.float64, ["C", "W"])
    readings = np.require(readings, np.float64, ["C", "W"])
    samples, m = readings.shape
    mean, cov, tangents = bank.mean.copy(), bank.cov.copy(), bank.tangents.copy()
    groups, c = tangents.shape[:2]
    changes = _in_lanes(changes, (samples, m, c, LANES))
    changed = bank.changed if bank.changed.shape == changes.shape[1:] else np.zeros(changes.shape[1:])
    slopes = np.zeros((groups, c, LANES))
    whitened, variance = np.zeros((samples, m, groups, LANES)), np.ones((samples, m, groups, LANES))
    responses, none = np.zeros((samples if respond else 0, m, c, LANES)), np.zeros((0, m, c, LANES))
    kernel, rates, reading = run_kernel(), bank.compiled.rates_of_lanes, bank.compiled.reading_of_lanes

    def run(g: int) -> None:
        kernel(
            rates, reading, bank.lanes[g], scratch_of(bank.lanes[g], mean.shape[1], c), mean[g], cov[g], tangents[g],
            bank.inputs, inputs, readings, changes, changed, bank.samples > 0, g, whitened, variance, slopes[g],
            none if g else responses,
        )  # fmt: skip

    list((pool.map if pool else map)(run, range(len(bank.lanes))))
    with np.errstate(invalid="ignore", divide="ignore"):  # of a filter that diverges: what it says is no number
        log_std = 0.5 * np.log(variance)
    z, log_s = (array.reshape(samples, m, groups * LANES)[..., : bank.filters] for array in (whitened, log_std))
    along = slopes.transpose(1, 0, 2).reshape(c, groups * LANES)[:, : bank.filters]
    last, changed = (inputs[-1].copy(), changes[-1].copy()) if samples else (bank.inputs, changed)
    after = bank._replace(
        mean=mean, cov=cov, tangents=tangents, inputs=last, changed=changed, samples=bank.samples + samples
    )
    return after, BankScores(z, log_s, along, responses)


def _in_lanes(changes: Array | None, shape: tuple[int, ...]) -> Array:
    """Changes of each lane, where those of all lanes (T, m, c), or none, are given."""
    if changes is None:
        return np.zeros(shape)
    if changes.ndim == 3:
        changes = np.broadcast_to(changes[..., None], shape)
    return np.require(changes, np.float64, ["C", "W"])
