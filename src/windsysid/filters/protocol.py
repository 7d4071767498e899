"""The filter protocol: belief, information that comes out of a step, and the functions every filter has."""

import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.filters.gaussian import scratch
from windsysid.kernels.jit import pasted
from windsysid.kernels.rows import inner, multiply
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.step import linearise_reading, predict_moments, set_parameters

__all__ = ["Belief", "Filter", "Info", "compare", "empty_info"]


class Belief(NamedTuple):
    """State of a Gaussian filter between two samples, from which it continues.

    Attributes
    ----------
    mean
        Mean of the states (n,).
    cov
        Covariance of the states (n, n).
    inputs
        Inputs at the belief's own time (n_u + n_w,).
    samples
        Number of samples so far; 0 for the prior, which holds at the first sample.
    """

    mean: Array
    cov: Array
    inputs: Array
    samples: int


class Info(NamedTuple):
    """Output of a filter for T samples: states, innovations, likelihood.

    Attributes
    ----------
    mean, std
        Mean and standard deviation of the state after each sample (T, n).
    innovation, innovation_std
        Reading minus its prediction, and the predicted standard deviation of that (T, m), both before any reading of
        the sample is used; NaN where the reading is missing.
    whitened
        Standardised innovations: decorrelated, with unit variance (T, m); NaN where missing or gated.
    whitening_std
        Their divisors (T, m): the standard deviation of a reading given the past and the readings before it in the same
        sample.
    log_likelihood
        Log density of the readings of each sample given the past (T,), without those gated.
    gated
        Readings left out because the innovation was beyond the model's gate (T, m), as bool.
    """

    mean: Array
    std: Array
    innovation: Array
    innovation_std: Array
    whitened: Array
    whitening_std: Array
    log_likelihood: Array
    gated: NDArray[np.bool_]


def empty_info(samples: int, n: int, m: int) -> Info:
    """Workspace for the results of T samples of m readings and n states; nothing gated."""
    state, reading = (samples, n), (samples, m)
    return Info(
        np.empty(state), np.empty(state), np.empty(reading), np.empty(reading), np.empty(reading), np.empty(reading),
        np.empty(samples), np.zeros(reading, dtype=np.bool_),
    )  # fmt: skip


def checked_samples(model: StateSpace, inputs: Array, readings: Array) -> tuple[Array, Array]:
    """Inputs (T, n_u + n_w) and readings (T, m) as a kernel takes them; ValueError if a shape does not fit."""
    inputs = np.require(inputs, np.float64, ["C", "W"])
    readings = np.require(readings, np.float64, ["C", "W"])
    columns, m = len(model.inputs), len(model.readings)
    if inputs.shape != (len(inputs), columns) or readings.shape != (len(inputs), m):
        raise ValueError(
            f"expected inputs (T, {columns}) and readings (T, {m}), got {inputs.shape} and {readings.shape}"
        )
    return inputs, readings


@dataclass(frozen=True)
class Filter:
    """Gaussian filter as pure functions: each returns a new belief and its `Info`, and changes nothing in place.

    `step` is `predict` and `update`, and `run` is `step` over T samples: batch, stream and restart agree bit for bit.

    Attributes
    ----------
    name
        Name in words.
    kernel
        For a model, the compiled filter: a function of `ARGUMENTS`.

    References
    ----------
    - Särkkä & Svensson, Bayesian Filtering and Smoothing, 2nd ed., Cambridge 2023, ch. 7 (`EKF`, `IEKF`) and 8 (`UKF`).
    - Bell & Cathey, IEEE Trans. Automatic Control 38(2), 1993, doi:10.1109/9.250476 (`IEKF`).
    - Julier & Uhlmann, Proc. IEEE 92(3), 2004, doi:10.1109/JPROC.2003.823141 (`UKF`).
    - van der Merwe & Wan, ICASSP 2001, doi:10.1109/ICASSP.2001.940586 (`UKF` in square-root form).

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> stiffness, sensor = ws.models.Parameter("k", 3.0, 0.5), ws.models.Reading("position", q, noise=0.01)
    >>> model = ws.models.compose(
    ...     spring, rate=20.0, values={}, parameters=[stiffness], cov=np.eye(2), sensors=[sensor]
    ... )
    >>> time = 0.05 * np.arange(400)
    >>> readings = (np.exp(-0.1 * time) * np.cos(2.0 * time))[:, None]  # released at q = 1 m with k = 4 N/m
    >>> belief, info = ws.filters.EKF.run(model, ws.filters.EKF.init(model), np.zeros((400, 1)), readings)
    >>> round(float(stiffness.physical(belief.mean[-1])), 2), info.mean.shape
    (4.01, (400, 3))
    """

    name: str
    kernel: Callable[[StateSpace], Callable[..., None]]

    def init(self, model: StateSpace) -> Belief:
        """The prior of the model as a belief that no sample has reached yet."""
        return Belief(model.mean.copy(), model.cov.copy(), np.zeros(len(model.inputs)), 0)

    def predict(self, model: StateSpace, belief: Belief, inputs: Array) -> Belief:
        """The `belief` of `model` at the time of `inputs` (n_u + n_w,), one sample on; the first stays at the prior."""
        nothing = np.full((1, len(model.readings)), np.nan)
        return self._filter(model, belief, np.atleast_2d(inputs), nothing)[0]

    def update(self, model: StateSpace, belief: Belief, readings: Array) -> tuple[Belief, Info]:
        """The `belief` of `model` after `readings` (m,) taken at its own time."""
        return self._filter(model, belief, belief.inputs[None], np.atleast_2d(readings), moves=False)[:2]

    def step(self, model: StateSpace, belief: Belief, inputs: Array, readings: Array) -> tuple[Belief, Info]:
        """Filter one sample from `belief` on: `run` of `model` over `inputs` (n_u + n_w,) and `readings` (m,)."""
        return self.run(model, belief, np.atleast_2d(inputs), np.atleast_2d(readings))

    def run(self, model: StateSpace, belief: Belief, inputs: Array, readings: Array) -> tuple[Belief, Info]:
        """Filter T samples.

        Parameters
        ----------
        belief
            Where to start: `init` of the model, or the belief an earlier run ended with.
        inputs
            Known inputs and known loads at each sample (T, n_u + n_w).
        readings
            (T, m); NaN = missing.

        Returns
        -------
        belief, info
            The belief after the last sample, and what came out of each.

        Raises
        ------
        ValueError
            If a shape does not fit the model.
        """
        return self._filter(model, belief, inputs, readings)[:2]

    def run_with_covariances(
        self, model: StateSpace, belief: Belief, inputs: Array, readings: Array
    ) -> tuple[Belief, Info, Array]:
        """As `run` of `model` from `belief` on over `inputs` and `readings`, and the covariances (T, n, n)."""
        return self._filter(model, belief, inputs, readings, keep=True)

    def _kept(self, model: StateSpace) -> Callable[..., None]:
        """The kernel with its scratch; each thread makes it once for a model, since that takes longer than a step."""
        kernels: dict[str, Callable[..., None]] = scratch.__dict__
        key = f"{self.name} of {id(model)}"
        if key not in kernels:
            kernels[key] = self.kernel(model)
            weakref.finalize(model, kernels.pop, key, None).atexit = False
        return kernels[key]

    def _filter(
        self,
        model: StateSpace,
        belief: Belief,
        inputs: Array,
        readings: Array,
        *,
        moves: bool = True,
        keep: bool = False,
    ) -> tuple[Belief, Info, Array]:
        inputs, readings = checked_samples(model, inputs, readings)
        samples, n, m = len(inputs), len(model.states), len(model.readings)
        mean, cov = belief.mean.copy(), belief.cov.copy()
        covs = np.empty((samples if keep else 0, n, n))
        info = empty_info(samples, n, m)
        self._kept(model)(mean, cov, belief.inputs, inputs, readings, belief.samples > 0, moves, covs, *info)
        last = inputs[-1].copy() if samples else belief.inputs
        return Belief(mean, cov, last, belief.samples + (samples if moves else 0)), info, covs


@pasted
def expect_sample(
    rates_jacobian: Any, reading_jacobian: Any, blocks: Any, ws: Any, before: Any, after: Any, moves: bool
) -> None:
    """Predict ``ws.mean`` and ``ws.cov`` to the next sample if it `moves`, and linearise the readings there."""
    set_parameters(blocks, ws, ws.mean)
    if moves:
        predict_moments(rates_jacobian, blocks, ws, ws.mean, ws.cov, before, after)
    linearise_reading(reading_jacobian, blocks, ws, ws.mean, after)


@pasted
def compare(ws: Any, blocks: Any, readings: Any, innovation: Any, innovation_std: Any, gated: Any) -> None:
    """Innovations (m,) of a linearised reading, their standard deviations, and which of them are beyond the gate."""
    multiply(ws.nothing, ws.H, 0, readings.size, 0, ws.cov.shape[0], ws.cov, ws.spread)
    for c in range(readings.size):
        innovation[c] = readings[c] - ws.y[c]
        innovation_std[c] = np.nan
        if np.isnan(readings[c]):
            continue
        innovation_std[c] = math.sqrt(blocks.noise[c] + inner(ws.H, c, ws.spread, c))
        gated[c] = abs(innovation[c]) > blocks.gate[0] * innovation_std[c]
