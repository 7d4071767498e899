"""The posterior while the record is still being taken: recursive scoring, in fixed memory.

A bank of state-only filters runs at θ and its neighbours (`windsysid.identification.estimate.scoring`). After each
block of samples the differences between its filters give the block's gradient g and Fisher information J, and θ moves
by a Gauss–Newton step on the sum of all that is known,

    Λ ← Λ + J,    θ ← θ + Λ⁻¹ g.

The filters follow: their means and covariances are moved along their own slopes ∂m/∂θ, ∂P/∂θ, which the bank knows as
well. This is the recursive prediction error method with the gain's own dependence on θ included (Ljung 1979; Ljung &
Söderström 1983, ch. 3).

What is learned at a wrong θ, in the first seconds, must not be kept. So the samples since the start are held until
`MEMORY` × `first` of them have come; whenever their number has doubled the mode of the posterior is found anew from the
original prior, and the recursion goes on from there. Blocks grow with the record: a step then never moves θ by much.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.filters.bank import Bank, bank_of
from windsysid.identification.estimate.scoring import (
    BANK_THREADS,
    DIFFERENCE_STEP_SIGMAS,
    find_innovation_mode,
    look,
    neighbours,
    score,
)
from windsysid.statespace.compose import StateSpace

__all__ = ["History", "Online", "advance", "begin", "finish", "join_histories", "restored", "stored"]

Start = Callable[[Array, Array], tuple[Array, Array]]

REFIT_MULTIPLES = 1, 2, 4, 8
"""Setting: multiples of the first samples at which the mode is found anew from all that are held."""

MEMORY = REFIT_MULTIPLES[-1]
"""Number of times that the first samples are repeated."""

ON_LINE_TOLERANCE = 0.2
"""Numerical: Newton's decrement of the last step of a search on line: blocks move θ as far, and filters follow."""

BLOCKS_PER_RECORD = 20
"""Setting: a block is one of so many equal parts of what has been seen."""

MAX_BLOCK_SAMPLES = 50_000
"""Setting: samples beyond which blocks do not grow: those of a block are held."""


class Online(NamedTuple):
    """State between two samples: all that is needed to continue.

    Attributes
    ----------
    prior_mean, prior_cov
        Gaussian prior of θ (n_θ,), (n_θ, n_θ).
    theta, precision
        θ (n_θ,) and the inverse of its covariance (n_θ, n_θ).
    bank, widths
        The filters, None before the first estimate, and how far they are from θ (n_θ,).
    first, samples
        Samples before the first estimate, and samples that θ knows of.
    inputs, readings
        Samples that are held: all since the start until the memory is full, then those of the block that is not
        complete.
    """

    prior_mean: Array
    prior_cov: Array
    theta: Array
    precision: Array
    widths: Array
    bank: Bank | None
    first: int
    samples: int
    inputs: Array
    readings: Array

    @property
    def reached(self) -> int:
        """Samples taken in, those held for the next block included."""
        return _first_held(self) + len(self.readings)

    @property
    def cov(self) -> Array:
        """Covariance of θ (n_θ, n_θ)."""
        return np.asarray(np.linalg.inv(self.precision), dtype=np.float64)


class History(NamedTuple):
    """Estimates in the order they came: after how many samples (B,), mean (B, n_θ), covariance (B, n_θ, n_θ)."""

    samples: NDArray[np.int64]
    mean: Array
    cov: Array


def begin(prior_mean: Array, prior_cov: Array, first: int, columns: tuple[int, int]) -> Online:
    """Nothing known but the prior.

    Parameters
    ----------
    first
        Samples before the first estimate: some ten periods of the slowest mode.
    columns
        Numbers of inputs and of readings.
    """
    precision = np.asarray(np.linalg.inv(prior_cov), dtype=np.float64)
    nothing = np.empty((0, columns[0])), np.empty((0, columns[1]))
    return Online(prior_mean, prior_cov, prior_mean.copy(), precision, np.zeros(0), None, first, 0, *nothing)


def advance(
    build: Callable[[Array], StateSpace],
    online: Online,
    inputs: Array,
    readings: Array,
    start: Start | None = None,
) -> tuple[Online, History]:
    """Take in T samples. However they are cut into pieces, the estimates are the same, bit for bit.

    Parameters
    ----------
    build
        The state-only model for a value of θ (n_θ,).
    start
        Where the first estimate begins to look, and how uncertain that is, from the first samples' inputs and readings:
        θ (n_θ,) and its covariance. The prior by default.
    """
    online = online._replace(
        inputs=np.concatenate([online.inputs, inputs]), readings=np.concatenate([online.readings, readings])
    )
    rows = []
    with ThreadPoolExecutor(BANK_THREADS) as pool:
        while (end := _next_due(online)) - _first_held(online) <= len(online.readings):
            online = _take_block(build, online, end, pool, start)
            rows.append((online.samples, online.theta, online.cov))
    return online, _history(rows, len(online.theta))


def finish(build: Callable[[Array], StateSpace], online: Online, start: Start | None = None) -> tuple[Online, History]:
    """Take in what is held of a block that will not be completed; `start` as for `advance`."""
    end = _first_held(online) + len(online.readings)
    if end == online.samples:
        return online, _history([], len(online.theta))
    with ThreadPoolExecutor(BANK_THREADS) as pool:
        online = _take_block(build, online, end, pool, start)
    return online, _history([(online.samples, online.theta, online.cov)], len(online.theta))


def stored(online: Online, history: History) -> dict[str, Any]:
    """All that is needed to go on, and the estimates so far, in arrays by name."""
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in online._asdict().items() if name != "bank"}
    arrays |= {f"history_{name}": values for name, values in history._asdict().items()}
    if online.bank is not None:
        bank = online.bank
        arrays |= {"bank_mean": bank.mean, "bank_cov": bank.cov, "bank_inputs": bank.inputs}
        arrays["bank_samples"] = np.asarray(bank.samples)
    return arrays


def restored(build: Callable[[Array], StateSpace], arrays: Mapping[str, Any]) -> tuple[Online, History]:
    """Restore from `stored`: the continued run equals one without a stop, bit for bit.

    Raises
    ------
    KeyError, ValueError
        If the arrays are others, or of another problem.
    """
    fields = {name: arrays[name] for name in Online._fields if name != "bank"}
    online = Online(**fields, bank=None)._replace(first=int(arrays["first"]), samples=int(arrays["samples"]))
    history = History(*(arrays[f"history_{name}"] for name in History._fields))
    if "bank_mean" not in arrays:
        return online, history
    bank = bank_of([build(theta) for theta in neighbours(online.theta, online.widths)])
    mean, cov, inputs = arrays["bank_mean"], arrays["bank_cov"], arrays["bank_inputs"]
    if bank.mean.shape != mean.shape:
        raise ValueError("another model")
    bank = bank._replace(mean=mean, cov=cov, inputs=inputs, samples=int(arrays["bank_samples"]))
    return online._replace(bank=bank), history


def join_histories(histories: Sequence[History]) -> History:
    """One history of several that follow each other."""
    return History(*(np.concatenate(parts) for parts in zip(*histories, strict=True)))


def spread_over_samples(
    prior_mean: Array, prior_cov: Array, history: History | None, samples: int
) -> tuple[Array, Array]:
    """Mean and standard deviation of θ estimated online after each of so many samples (T, n_θ): the prior before the
    first estimate.

    NaN where there is no history.
    """
    if history is None:
        return (np.full((samples, len(prior_mean)), np.nan),) * 2
    mean = np.concatenate([prior_mean[None], history.mean])
    variance = np.array([np.diag(cov) for cov in (prior_cov, *history.cov)])
    known = np.searchsorted(np.concatenate([[0], history.samples]), np.arange(1, samples + 1), side="right") - 1
    return mean[known], np.sqrt(variance[known])


def _history(rows: list[tuple[int, Array, Array]], n: int) -> History:
    samples = np.array([count for count, _, _ in rows], dtype=np.int64)
    mean, cov = (np.array([row[i] for row in rows]) for i in (1, 2))
    return History(samples, mean.reshape(-1, n), cov.reshape(-1, n, n))


def _next_due(online: Online) -> int:
    """The sample at which the next estimate is due."""
    if online.samples < online.first:
        return online.first
    block = online.samples + min(max(online.first // 4, online.samples // BLOCKS_PER_RECORD), MAX_BLOCK_SAMPLES)
    ahead = [ratio * online.first for ratio in REFIT_MULTIPLES if ratio * online.first > online.samples]
    return min(block, *ahead) if ahead else block


def _first_held(online: Online) -> int:
    """The number of the first sample held."""
    return 0 if online.samples < MEMORY * online.first else online.samples


def _take_block(
    build: Callable[[Array], StateSpace], online: Online, end: int, pool: ThreadPoolExecutor, start: Start | None
) -> Online:
    """The estimate after `end` samples."""
    held_from = _first_held(online)
    held = online.inputs[: end - held_from], online.readings[: end - held_from]
    if online.bank is None or end / online.first in REFIT_MULTIPLES:
        begin_at = start(*held) if start and online.bank is None else (online.theta, online.cov)
        online = _find_anew(build, online, *held, pool, begin_at)
    else:
        part = slice(online.samples - held_from, None)
        bank, found = score(online.bank, held[0][part], held[1][part], online.widths, pool)
        precision = online.precision + found.fisher
        step = np.asarray(np.linalg.solve(precision, found.gradient), dtype=np.float64)
        if held_from == 0 and not np.isfinite(step).all():  # a filter of the bank lost its way
            online = _find_anew(build, online, *held, pool, (online.prior_mean, online.prior_cov))
        else:
            online = _recentre_bank(build, online, bank, precision, step)
    online = online._replace(samples=end)
    drop = end - held_from if end >= MEMORY * online.first else 0
    return online._replace(inputs=online.inputs[drop:], readings=online.readings[drop:])


def _find_anew(
    build: Callable[[Array], StateSpace], online: Online, inputs: Array, readings: Array, pool: ThreadPoolExecutor,
    start: tuple[Array, Array],
) -> Online:  # fmt: skip
    """The mode of the posterior of all samples since the start, and the bank there."""
    mode = find_innovation_mode(
        build, [(inputs, readings)],
        prior=(online.prior_mean, online.prior_cov), start=start, tolerance=ON_LINE_TOLERANCE,
    )  # fmt: skip
    seen = mode.look
    if not mode.decrement < ON_LINE_TOLERANCE:  # too long a step to follow along the slopes
        widths = DIFFERENCE_STEP_SIGMAS * np.sqrt(1.0 / np.diag(np.linalg.inv(mode.cov)))
        seen = look(build, [(inputs, readings)], mode.mean, widths, pool)
    information = np.linalg.inv(online.prior_cov)
    precision = seen.found.fisher + information
    pull = seen.found.gradient - information @ (seen.theta - online.prior_mean)
    step = np.asarray(np.linalg.solve(precision, pull), dtype=np.float64)
    return _recentre_bank(build, online._replace(theta=seen.theta, widths=seen.widths), seen.bank, precision, step)


def _recentre_bank(
    build: Callable[[Array], StateSpace], online: Online, bank: Bank, precision: Array, step: Array
) -> Online:
    """θ one step on, and the bank's filters about it."""
    theta, widths = online.theta + step, DIFFERENCE_STEP_SIGMAS / np.sqrt(np.diag(precision))
    fresh = bank_of([build(values) for values in neighbours(theta, widths)])
    n = len(theta)
    offsets = np.array(neighbours(np.zeros(n), widths))
    beliefs = []
    for array in (bank.mean, bank.cov):
        lanes = np.moveaxis(array, 0, -2).reshape(*array.shape[1:-1], -1)[..., : bank.filters]
        slopes = (lanes[..., 1:] - lanes[..., :1]) / online.widths
        moved = (lanes[..., 0] + slopes @ step)[..., None] + slopes @ offsets.T
        padded = np.concatenate(
            [moved, np.repeat(moved[..., -1:], len(fresh.lanes) * array.shape[-1] - bank.filters, -1)], -1
        )
        split = padded.reshape(*array.shape[1:-1], len(fresh.lanes), array.shape[-1])
        beliefs.append(np.ascontiguousarray(np.moveaxis(split, -2, 0)))
    mean, cov = beliefs
    if not np.all(np.linalg.eigvalsh(np.moveaxis(cov, -1, 1)) > 0.0):  # too long a step for straight slopes
        cov = np.broadcast_to(bank.cov[:1, ..., :1], bank.cov.shape).copy()
    fresh = fresh._replace(mean=mean, cov=cov, inputs=bank.inputs, samples=bank.samples)
    return online._replace(theta=theta, precision=precision, widths=widths, bank=fresh)
