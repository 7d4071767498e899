"""Rows that a logger lost at a regular distance before the times were written: times are even, readings are not.

An autoregressive model predicts each reading from those before it. Where a row was lost, the reading is the one that
the model predicts two steps ahead, x̂₂, and not one, x̂₁. With the errors whitened over the channels, let

    a = x̂₂ − x̂₁,        e = x − x̂₁,        g = Σ e·a / Σ |a|².

Where every k-th row was lost, g is near 1 over the rows that follow a loss, falls from there on, and is near 0 or below
at the other remainders of a row's number by k. Where nothing was lost, Σ e·a over the root of Σ (e·a)² is standard
normal, or narrower where errors have heavy tails (de la Peña, Lai & Shao, Self-Normalized Processes, Springer 2009).

Rows that were lost at random have no remainder in common, and are not found.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.inspection.health import Finding, sampled_every
from windsysid.records.record import Record

__all__ = ["lost_rows"]

ORDERS = (3, 8, 12)
"""Of the autoregressive models: a short one sees the rows after a loss whole again before the next, a long one follows
many modes."""

MIN_ROWS = 1000
"""Rows below which no model is fitted."""

MAX_ROWS = 100_000
"""Rows from the beginning that are examined."""

MAX_ALONE = 8
"""Channels that are also examined one by one."""

MIN_PERIOD, MAX_PERIOD = 4, 64
"""Rows from one loss to the next: models cannot but learn from losses that are nearer; those farther apart are lost
buffers (`continuity.lost_samples`)."""

SIGMAS = 7.0
"""Of a remainder's sum: exceeded by chance in one of 10⁷ records, over all 2 000 remainders, models and channels."""

LEAST_GAIN = 0.4
"""Of g after a loss: 1 for one row that is lost, less as the model has learnt from the losses."""

OTHERS_GAIN, GAIN_BEFORE = 0.6, 0.3
"""Greatest |g| at any other remainder, and at the one before, relative to g after a loss, which falls from row to row.
A sinusoid at a multiple of the rate over 2k gives a g that goes up and down by the same."""

EQUAL = 0.5
"""Least share of the sum after one loss in that after another: where only every second or third is one, k is larger."""


class _Prediction(NamedTuple):
    """x̂₂ − x̂₁ and x − x̂₁ (T, n), whitened over the channels."""

    ahead: Array
    error: Array


def lost_rows(record: Record, channels: Sequence[str]) -> list[Finding]:
    """Rows that were lost though the times go on evenly, in these channels together or in one of them."""
    values = np.column_stack([record[name][:MAX_ROWS] for name in channels]) if channels else np.empty((0, 0))
    usable = [np.isfinite(column).all() and sampled_every(column)[0] == 1 for column in values.T]
    values = values[:, usable]
    if len(values) < MIN_ROWS or not values.shape[1]:
        return []
    period = max(_agreed(_predictions(values, order)) for order in ORDERS)[1]
    if not period:
        return []
    text = (
        f"one row was lost after every {period}, though the times go on evenly: frequencies come out"
        f" {100.0 / period:.2g} % too high; write the time at which each row was taken"
    )
    spans = np.array([[record.time[0], record.time[-1]]])
    return [Finding("", "lost rows", "warning", text, record.samples, spans)]


def _predictions(values: Array, order: int) -> list[_Prediction]:
    """One and two steps ahead, by an autoregressive model of each channel, from row `order` on: all channels together,
    and some alone, as others may be rough."""
    pairs = [_predicted(column - column.mean(), order) for column in values.T]
    ahead, error = (np.column_stack(each)[order:] for each in zip(*pairs, strict=True))
    own, into = np.linalg.eigh(error.T @ error / len(error))
    into = into[:, own > 1e-9 * own[-1]] / np.sqrt(own[own > 1e-9 * own[-1]])
    alone = [_Prediction(ahead[:, [i]], error[:, [i]]) for i in range(min(MAX_ALONE, values.shape[1]))]
    return [_Prediction(ahead @ into, error @ into), *(alone if values.shape[1] > 1 else [])]


def _predicted(x: Array, order: int) -> tuple[Array, Array]:
    """x̂₂ − x̂₁ and x − x̂₁ (T,) of one channel, in standard deviations of the latter."""
    products = np.array([x[: len(x) - lag] @ x[lag:] for lag in range(order + 1)])
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    moment = products[lags] + 1e-9 * products[0] * np.eye(order)  # what is sampled very often predicts itself
    weights = np.linalg.lstsq(moment, products[1:], rcond=None)[0]
    first = np.convolve(x, np.concatenate([[0.0], weights]))[: len(x)]
    second = weights[0] * first + np.convolve(x, np.concatenate([[0.0], weights[1:]]))[: len(x)]
    error = x - first
    size = max(float(np.std(error[order:])), 1e-300)
    return (second - first) / size, error / size


def _agreed(predictions: Sequence[_Prediction]) -> tuple[float, int]:
    """What all channels together say, or else two that are examined alone: a row is lost in all of them, and one alone
    may be computed anew at every k-th row only."""
    together, *alone = map(_every, predictions)
    periods = [period for _, period in alone]
    return max([together, *(one for one in alone if periods.count(one[1]) > 1)])


def _every(prediction: _Prediction) -> tuple[float, int]:
    """How clearly rows are lost at a regular distance [standard deviations], and the number of rows from one loss to
    the next; zeros where none are."""
    found = (0.0, 0)
    terms = _terms(prediction)
    for period in range(MIN_PERIOD, min(MAX_PERIOD, len(terms) // 50) + 1):
        sure = _sure(terms, period)
        if sure > max(SIGMAS, found[0]) and _sure(_terms(_without_cycle(prediction, period)), period) > SIGMAS:
            found = (sure, period)
    return found


def _terms(prediction: _Prediction) -> Array:
    """e·a, its square and |a|² (T, 3)."""
    product = np.sum(prediction.error * prediction.ahead, axis=1)
    return np.column_stack([product, product**2, np.sum(prediction.ahead**2, axis=1)])


def _sure(terms: Array, period: int) -> float:
    """How far g after a loss is from 0 [standard deviations]; 0 where it does not fall from there on, or is not the
    same after the next loss and the one after that."""
    cycles = 2 * (len(terms) // (2 * period))
    sums, squares, powers = terms[: cycles * period].reshape(cycles, period, 3).sum(axis=0).T
    gain = sums / np.maximum(powers, 1e-300)
    after = int(np.argmax(gain))
    if not _falls_off(np.roll(gain, -after)):
        return 0.0
    for losses in (2, 3):
        at = terms[after : after + losses * period * ((cycles - 1) // losses) : period]
        each = at[: len(at) // losses * losses].reshape(-1, losses, 3).sum(axis=0)
        if each[:, 0].min() < EQUAL * each[:, 0].max():
            return 0.0
    return float(sums[after] / np.sqrt(max(squares[after], 1e-300)))


def _without_cycle(prediction: _Prediction, period: int) -> _Prediction:
    """The same without what repeats every so many rows, as blows of a machine do that runs in step with the logger."""
    cycles = len(prediction.error) // period
    parts = []
    for part in prediction:
        each = part[: cycles * period].reshape(cycles, period, -1)
        parts.append((each - each.mean(axis=0)).reshape(cycles * period, -1))
    return _Prediction(*parts)


def _falls_off(gain: Array) -> bool:
    """Whether g (k,), from the row after a loss on, is as a loss makes it."""
    top = gain[0]
    return bool(top > LEAST_GAIN and gain[-1] < GAIN_BEFORE * top and np.abs(gain[1:]).max() < OTHERS_GAIN * top)
