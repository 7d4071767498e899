"""Detection of rows lost at regular intervals although the time stamps are equidistant.

An autoregressive model predicts each reading from the previous ones. After a lost row, the reading agrees with the
prediction two steps ahead, x̂₂, and not one step ahead, x̂₁. With the errors whitened over the channels, let

    a = x̂₂ − x̂₁,        e = x − x̂₁,        g = Σ e·a / Σ |a|².

If every k-th row was lost, g is near 1 over the rows that follow a loss, decreases over the next rows, and is near 0 or
negative for the other remainders of the row number by k. If no row was lost, Σ e·a over the root of Σ (e·a)² is
standard normal, or narrower for errors with heavy tails (de la Peña, Lai & Shao, Self-Normalized Processes, Springer
2009).

Rows lost at random have no common remainder and are not detected.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import OUTLIER_SIGMAS
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults.health import sampled_every
from windsysid.inspection.limits import MAX_OTHER_GAIN_RATIO, MIN_LOSS_GAIN, MIN_PREDICTED_ROWS
from windsysid.records.record import Record

__all__ = ["lost_rows"]

MODEL_ORDERS = (3, 8, 12)
"""Setting: orders of the autoregressive models: the memory of a low order is shorter than the distance between losses,
a high order describes more modes."""

MAX_ROWS = 100_000
"""Setting: largest number of rows that are examined, from the beginning of the record."""

MAX_SINGLE_CHANNELS = 8
"""Setting: largest number of channels that are examined one by one, in addition to all together."""

MIN_PERIOD_ROWS, MAX_PERIOD_ROWS = 4, 64
"""Setting: smallest and largest number of rows from one loss to the next that are searched: more frequent losses bias
the models, rarer ones are lost buffers (`continuity.lost_samples`)."""

MAX_MULTIPLE = 2000
"""Numerical: largest multiple of periods whose remainders are summed in one pass."""


class _Prediction(NamedTuple):
    """x̂₂ − x̂₁ and x − x̂₁ (T, n), whitened over the channels."""

    ahead: Array
    error: Array


def lost_rows(record: Record, channels: Sequence[str]) -> list[Fault]:
    """Find rows lost at regular intervals although times are equidistant, in these channels together or one by one."""
    values = np.column_stack([record[name][:MAX_ROWS] for name in channels]) if channels else np.empty((0, 0))
    usable = [np.isfinite(column).all() and sampled_every(column)[0] == 1 for column in values.T]
    values = values[:, usable]
    if len(values) < MIN_PREDICTED_ROWS or not values.shape[1]:
        return []
    period = max(_agreed(_predictions(values, order)) for order in MODEL_ORDERS)[1]
    if not period:
        return []
    spans = np.array([[record.time[0], record.time[-1]]])
    return [Fault("", "lost rows", "warning", record.samples, spans, {"period": period})]


def _predictions(values: Array, order: int) -> list[_Prediction]:
    """Predict one and two steps ahead with an autoregressive model of each channel, from row `order` on.

    The first prediction is of all channels together, the others are of single channels, since some may be noisy.
    """
    pairs = [_predicted(column - column.mean(), order) for column in values.T]
    ahead, error = (np.column_stack(each)[order:] for each in zip(*pairs, strict=True))
    own, into = np.linalg.eigh(error.T @ error / len(error))
    into = into[:, own > 1e-9 * own[-1]] / np.sqrt(own[own > 1e-9 * own[-1]])
    alone = [_Prediction(ahead[:, [i]], error[:, [i]]) for i in range(min(MAX_SINGLE_CHANNELS, values.shape[1]))]
    return [_Prediction(ahead @ into, error @ into), *(alone if values.shape[1] > 1 else [])]


def _predicted(x: Array, order: int) -> tuple[Array, Array]:
    """Compute x̂₂ − x̂₁ and x − x̂₁ (T,) of one channel, in standard deviations of the latter."""
    products = np.array([x[: len(x) - lag] @ x[lag:] for lag in range(order + 1)])
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    moment = products[lags] + 1e-9 * products[0] * np.eye(order)  # oversampled channels are nearly singular
    weights = np.linalg.lstsq(moment, products[1:], rcond=None)[0]
    first = np.convolve(x, np.concatenate([[0.0], weights]))[: len(x)]
    second = weights[0] * first + np.convolve(x, np.concatenate([[0.0], weights[1:]]))[: len(x)]
    error = x - first
    size = max(float(np.std(error[order:])), 1e-300)
    return (second - first) / size, error / size


def _agreed(predictions: Sequence[_Prediction]) -> tuple[float, int]:
    """Result of all channels together, or of two single channels that agree on the period.

    A lost row is missing in all channels; one channel alone may be updated at every k-th row only.
    """
    together, *alone = map(_detected, predictions)
    periods = [period for _, period in alone]
    return max([together, *(one for one in alone if periods.count(one[1]) > 1)])


def _detected(prediction: _Prediction) -> tuple[float, int]:
    """Significance of rows lost at regular intervals [σ], and number of rows from one loss to the next; zeros if none
    are detected."""
    found = (0.0, 0)
    terms = _terms(prediction)
    for period, sums in sorted(_by_remainder(terms).items()):
        significance = _significance(terms, sums)
        if significance > max(OUTLIER_SIGMAS, found[0]):
            left = _terms(_without_cycle(prediction, period))
            if _significance(left, _by_remainder(left)[period]) > OUTLIER_SIGMAS:
                found = (significance, period)
    return found


def _terms(prediction: _Prediction) -> Array:
    """Terms e·a, (e·a)² and |a|² of all rows (T, 3)."""
    product = np.einsum("ti,ti->t", prediction.error, prediction.ahead)
    return np.column_stack([product, product**2, np.einsum("ti,ti->t", prediction.ahead, prediction.ahead)])


def _by_remainder(terms: Array) -> dict[int, Array]:
    """Sums of the terms (T, 3) by the remainder of the row number (k, 3), over an even number of cycles, for each
    period k that is searched: sums of one pass over the rows, by a multiple of 2k, serve several periods."""
    sums, found, rows = dict[int, Array](), {}, len(terms)
    for k in range(min(MAX_PERIOD_ROWS, rows // 50), MIN_PERIOD_ROWS - 1, -1):
        multiple = next((known for known in sums if known % (2 * k) == 0), MAX_MULTIPLE // (2 * k) * 2 * k)
        first, last = rows // multiple * multiple, rows // (2 * k) * 2 * k
        if multiple not in sums:
            sums[multiple] = terms[:first].reshape(-1, multiple, 3).sum(axis=0)
        found[k] = sums[multiple].reshape(-1, k, 3).sum(axis=0) + terms[first:last].reshape(-1, k, 3).sum(axis=0)
    return found


def _significance(terms: Array, by_remainder: Array) -> float:
    """Significance of g after a loss [σ]; 0 if g does not decrease over the next rows, or differs between losses."""
    period, (sums, squares, powers) = len(by_remainder), by_remainder.T
    gain = sums / np.maximum(powers, 1e-300)
    after = int(np.argmax(gain))
    if not _falls_off(gain, after):
        return 0.0
    cycles = len(terms) // (2 * period) * 2
    for losses in (2, 3):
        at = terms[after : after + losses * period * ((cycles - 1) // losses) : period]
        each = at[: len(at) // losses * losses].reshape(-1, losses, 3).sum(axis=0)
        if each[:, 0].min() < MIN_LOSS_GAIN * each[:, 0].max():
            return 0.0
    return float(sums[after] / np.sqrt(max(squares[after], 1e-300)))


def _without_cycle(prediction: _Prediction, period: int) -> _Prediction:
    """Subtract the periodic part, which a machine that runs synchronously with the logger may cause."""
    cycles = len(prediction.error) // period
    parts = []
    for part in prediction:
        each = part[: cycles * period].reshape(cycles, period, -1)
        parts.append((each - each.mean(axis=0)).reshape(cycles * period, -1))
    return _Prediction(*parts)


def _falls_off(gain: Array, after: int) -> bool:
    """Test whether g (k,) has the pattern of a loss before the row `after`, where it is largest."""
    top = gain[after]
    return bool(top > MIN_LOSS_GAIN and np.abs(np.delete(gain, after)).max() < MAX_OTHER_GAIN_RATIO * top)
