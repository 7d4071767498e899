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
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.inspection.health import Finding
from windsysid.records.record import Record

__all__ = ["lost_rows"]

ORDERS = (3, 8, 12)
"""Of the autoregressive models: a short one sees the rows after a loss whole again before the next, a long one follows
many modes."""

MIN_ROWS = 1000
"""Rows below which no model is fitted."""

MAX_ROWS = 500_000
"""Rows from the beginning that are examined."""

MIN_PERIOD, MAX_PERIOD = 3, 64
"""Rows from one loss to the next: models cannot but learn from losses that are nearer; those farther apart are lost
buffers (`continuity.lost_samples`)."""

SIGMAS = 7.0
"""Of a remainder's sum: exceeded by chance in one of 10⁸ records, over all 2 000 remainders."""

LEAST_GAIN = 0.3
"""Of g after a loss: 1 for one row that is lost, less as the model has learnt from the losses."""

OTHERS_GAIN, GAIN_BEFORE = 0.6, 0.3
"""Greatest |g| at any other remainder, and at the one before, relative to g after a loss, which falls from row to row.
A sinusoid at a multiple of the rate over 2k gives a g that goes up and down by the same."""


class _Prediction(NamedTuple):
    """x̂₂ − x̂₁ and x − x̂₁ of a record (T, n), whitened over the channels."""

    ahead: Array
    error: Array


def lost_rows(record: Record, channels: Sequence[str]) -> list[Finding]:
    """Rows that were lost though the times go on evenly, in these channels together."""
    values = np.column_stack([record[name][:MAX_ROWS] for name in channels]) if channels else np.empty((0, 0))
    values = values[:, np.isfinite(values).all(axis=0)]
    if len(values) < MIN_ROWS or not values.shape[1]:
        return []
    period = max(_every(_predict(values, order)) for order in ORDERS)[1]
    if not period:
        return []
    text = (
        f"one row was lost after every {period}, though the times go on evenly: frequencies come out"
        f" {100.0 / period:.2g} % too high; write the time at which each row was taken"
    )
    spans = np.array([[record.time[0], record.time[-1]]])
    return [Finding("", "lost rows", "warning", text, record.samples, spans)]


def _predict(values: Array, order: int) -> _Prediction:
    """One and two steps ahead, by an autoregressive model of each channel, from row `order` on."""
    pairs = [_predicted(column - column.mean(), order) for column in values.T]
    ahead, error = (np.column_stack(each)[order:] for each in zip(*pairs, strict=True))
    own, into = np.linalg.eigh(error.T @ error / len(error))
    into = into[:, own > 1e-9 * own[-1]] / np.sqrt(own[own > 1e-9 * own[-1]])
    return _Prediction(ahead @ into, error @ into)


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


def _every(prediction: _Prediction) -> tuple[float, int]:
    """How clearly rows are lost at a regular distance [standard deviations], and the number of rows from one loss to
    the next; zeros where none are."""
    found = (0.0, 0)
    for period in range(MIN_PERIOD, min(MAX_PERIOD, len(prediction.error) // 50) + 1):
        sure = _sure(prediction, period)
        if sure > max(SIGMAS, found[0]) and _sure(_without_cycle(prediction, period), period) > SIGMAS:
            found = (sure, period)
    return found


def _sure(prediction: _Prediction, period: int) -> float:
    """How far g after a loss is from 0 [standard deviations]; 0 where it does not fall from there on."""
    product = np.sum(prediction.error * prediction.ahead, axis=1)
    power = np.sum(prediction.ahead**2, axis=1)
    place: NDArray[np.int64] = np.arange(len(product)) % period
    sums, squares, powers = (np.bincount(place, each, period) for each in (product, product**2, power))
    gain = sums / np.maximum(powers, 1e-300)
    after = int(np.argmax(gain))
    return float(sums[after] / np.sqrt(max(squares[after], 1e-300))) if _falls_off(np.roll(gain, -after)) else 0.0


def _without_cycle(prediction: _Prediction, period: int) -> _Prediction:
    """The same without what repeats every so many rows, as blows of a machine do that runs in step with the logger."""
    place: NDArray[np.int64] = np.arange(len(prediction.error)) % period
    number = np.bincount(place, minlength=period)
    parts = []
    for part in prediction:
        mean = np.column_stack([np.bincount(place, column, period) / number for column in part.T])
        parts.append(part - mean[place])
    return _Prediction(*parts)


def _falls_off(gain: Array) -> bool:
    """Whether g (k,), from the row after a loss on, is as a loss makes it."""
    top = gain[0]
    return bool(top > LEAST_GAIN and gain[-1] < GAIN_BEFORE * top and np.abs(gain[1:]).max() < OTHERS_GAIN * top)
