"""Time per sample of other people's filters, on the same model, data and settings, and whether they end with the same
estimates.

    python benchmarks/peers.py               in an environment made from benchmarks/peers.txt (make bench)

Every library is taken at its best. Those on JAX (dynamax, cuthbert) run in one compiled scan, in float64, warmed, on
SymPy's equations written out for XLA, with derivatives of their own, and give out no more than the moments. Those that
call Python for each sample (filterpy, Stone-Soup, pykalman) compile no equations and know no derivatives. They are
timed with the same equations in NumPy and exact Jacobians (`models.Written`; filterpy also with central differences, as
for users who have no derivatives), and once more with windsysid's compiled kernels (`models.Kernels`), where what is
left of them is their algebra. All run in turns, pinned to one core, and are charged for the processor time of all their
threads; slow ones get fewer samples. The final means and standard deviations of the ten coefficients are compared with
windsysid's after the same samples; where they differ, there is no table.
"""

import os

if hasattr(os, "sched_setaffinity"):  # before any library has started threads, which would stay where they are
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pykalman.unscented
from agreement import in_jax
from cuthbert import filter as cuthbert_filter
from cuthbert.gaussian import moments
from cuthbertlib.kalman import filter_update
from dynamax.linear_gaussian_ssm.inference import lgssm_filter, make_lgssm_params
from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter, unscented_kalman_filter
from dynamax.nonlinear_gaussian_ssm.inference_ukf import UKFHyperParams
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from models import Balance, Differences, Kernels, Problem, Written
from sheets import Sheet, medians, number, present
from stonesoup.models.base import GaussianModel, LinearModel
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, KalmanUpdater, UnscentedKalmanUpdater

from windsysid import load_turbine
from windsysid.filters import EKF, UKF

Array = np.ndarray
Moments = tuple[Array, Array]
"""Mean (n,) and covariance (n, n) after the last sample."""

REPEATS = 7

AGREES = 1e-6
"""Largest difference of final estimates, in standard deviations, and of standard deviations, relative to them."""

ALPHA, BETA = 1.0, 1.0
"""Of the unscented transform, with κ = 3 − n: windsysid's."""

FIELDS = ["filtered_means", "filtered_covariances"]
"""Outputs that dynamax returns."""


class Run(NamedTuple):
    """A peer's filter over the first T samples."""

    formulation: str
    peer: str
    equations: str
    samples: int
    of: Callable[[int], Moments]


# Force balance: ten constant coefficients, y_k = H_k θ + unit noise. A filter that can leave the prediction out may.


def filterpy_linear(balance: Balance, samples: int) -> Moments:
    peer = KalmanFilter(dim_x=len(balance.mean), dim_z=balance.readings.shape[1])
    peer.x, peer.P, peer.R = balance.mean, balance.cov, np.eye(peer.dim_z)
    for y, H in zip(balance.readings[:samples], balance.regressors, strict=False):
        peer.update(y, H=H)
    return peer.x, peer.P


def pykalman_linear(balance: Balance, samples: int) -> Moments:
    n, m = len(balance.mean), balance.readings.shape[1]
    peer = pykalman.KalmanFilter(
        transition_matrices=np.eye(n),
        observation_matrices=balance.regressors[:samples],
        transition_covariance=np.zeros((n, n)),
        observation_covariance=np.eye(m),
        initial_state_mean=balance.mean,
        initial_state_covariance=balance.cov,
    )
    means, covs = peer.filter(balance.readings[:samples])
    return means[-1], covs[-1]


def stonesoup_linear(balance: Balance, kind: type[KalmanUpdater], samples: int) -> Moments:
    model = _Rows(ndim_state=len(balance.mean), mapping=None)
    model.noise = np.eye(balance.readings.shape[1])
    settings = _unscented(len(balance.mean)) if kind is UnscentedKalmanUpdater else {}
    updater = kind(model, **settings)
    belief: Any = GaussianState(balance.mean[:, None], balance.cov)
    for y, H in zip(balance.readings[:samples], balance.regressors, strict=False):
        model.H = H
        prediction = GaussianStatePrediction(belief.state_vector, belief.covar)
        belief = updater.update(SingleHypothesis(prediction, Detection(StateVector(y))))
    return np.asarray(belief.mean).ravel(), np.asarray(belief.covar)


def dynamax_linear(balance: Balance) -> Callable[[int], Moments]:
    n, m = len(balance.mean), balance.readings.shape[1]

    @jax.jit
    def run(y: jax.Array, H: jax.Array) -> tuple[jax.Array, jax.Array]:
        params = make_lgssm_params(
            jnp.asarray(balance.mean), jnp.asarray(balance.cov), jnp.eye(n), jnp.zeros((n, n)), H, jnp.eye(m)
        )
        found = lgssm_filter(params, y)
        return found.filtered_means, found.filtered_covariances

    return _last(run, balance.readings, balance.regressors)


def cuthbert_linear(balance: Balance) -> Callable[[int], Moments]:
    m = balance.readings.shape[1]

    @jax.jit
    def run(ys: jax.Array, Hs: jax.Array) -> tuple[jax.Array, jax.Array]:
        def update(belief: Any, data: Any) -> Any:
            y, H = data
            belief, _ = filter_update(*belief, H, jnp.zeros(m), jnp.eye(m), y)
            return belief, belief

        prior = jnp.asarray(balance.mean), jnp.linalg.cholesky(jnp.asarray(balance.cov))
        _, (means, roots) = jax.lax.scan(update, prior, (ys, Hs))
        return means, roots

    return _last(run, balance.readings, balance.regressors, root=True)


def filterpy_linear_unscented(balance: Balance, samples: int) -> Moments:
    n, m = len(balance.mean), balance.readings.shape[1]
    points = MerweScaledSigmaPoints(n, **_unscented(n))
    peer = UnscentedKalmanFilter(n, m, 1.0, hx=None, fx=None, points=points)
    peer.x, peer.P, peer.R = balance.mean, balance.cov, np.eye(m)
    for y, H in zip(balance.readings[:samples], balance.regressors, strict=False):
        peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        peer.update(y, hx=lambda x, H=H: H @ x)
    return peer.x, peer.P


def pykalman_linear_unscented(balance: Balance, samples: int) -> Moments:
    n, m = len(balance.mean), balance.readings.shape[1]
    readings = [lambda x, H=H: H @ x for H in balance.regressors[:samples]]
    return _pykalman_unscented(
        [lambda x: x], readings, np.zeros((n, n)), np.eye(m), (balance.mean, balance.cov), balance.readings[:samples]
    )


def dynamax_linear_unscented(balance: Balance) -> Callable[[int], Moments]:
    n, m = len(balance.mean), balance.readings.shape[1]
    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(balance.mean),
        initial_covariance=jnp.asarray(balance.cov),
        dynamics_function=lambda x, u: x,
        dynamics_covariance=jnp.zeros((n, n)),
        emission_function=lambda x, u: u.reshape(m, n) @ x,
        emission_covariance=jnp.eye(m),
    )

    @jax.jit
    def run(y: jax.Array, H: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = unscented_kalman_filter(params, y, UKFHyperParams(**_unscented(n)), inputs=H, output_fields=FIELDS)
        return found.filtered_means, found.filtered_covariances

    return _last(run, balance.readings, balance.regressors.reshape(-1, m * n))


# The joint model.


def filterpy_extended(problem: Problem, kernels: Kernels | Written, samples: int) -> Moments:
    model, Q = problem.model, problem.noise
    peer = ExtendedKalmanFilter(dim_x=problem.n, dim_z=kernels.m)
    peer.x, peer.P, peer.R = model.mean, model.cov, np.diag(model.blocks.noise)
    expected = np.empty(0)

    def linearise(x: Array, at: Array) -> Array:
        nonlocal expected
        expected, H = kernels.read(x, at)
        return H

    for k, (at, y) in enumerate(zip(problem.inputs[:samples], problem.readings, strict=False)):
        if k:
            end, peer.F, gain = kernels.step(peer.x, problem.inputs[k - 1], at)
            peer.Q = gain @ Q @ gain.T
            peer.predict_x = lambda u=0, end=end: setattr(peer, "x", end)
            peer.predict()
        peer.update(y, partial(linearise, at=at), lambda x: expected)
    return _coefficients(peer.x, peer.P, problem)


def _stonesoup(problem: Problem, samples: int, predictor: Any, updater: Any, belief: Any) -> Moments:
    for k, (at, y) in enumerate(zip(problem.inputs[:samples], problem.readings, strict=False)):
        updater.measurement_model.at = at
        if k:
            predictor.transition_model.between = problem.inputs[k - 1], at
            prediction = predictor.predict(belief)
        else:
            prediction = GaussianStatePrediction(belief.state_vector, belief.covar)
        belief = updater.update(SingleHypothesis(prediction, Detection(StateVector(y))))
    return _coefficients(np.asarray(belief.mean).ravel(), np.asarray(belief.covar), problem)


def stonesoup_extended(problem: Problem, kernels: Kernels | Written, samples: int) -> Moments:
    model = problem.model
    transition, reading = _Transition(), _Reading(ndim_state=problem.n, mapping=None)
    transition.kernels = reading.kernels = kernels
    transition.load_noise, reading.noise = problem.noise, np.diag(model.blocks.noise)
    predictor, updater = ExtendedKalmanPredictor(transition), ExtendedKalmanUpdater(reading)
    return _stonesoup(problem, samples, predictor, updater, GaussianState(model.mean[:, None], model.cov))


def dynamax_joint(problem: Problem, unscented: bool) -> Callable[[int], Moments]:
    step, read = in_jax(problem)
    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(problem.mean / problem.size),
        initial_covariance=jnp.asarray(problem.scaled(problem.cov)),
        dynamics_function=step,
        dynamics_covariance=jnp.asarray(problem.scaled(problem.Q)),
        emission_function=read,
        emission_covariance=jnp.eye(len(problem.unit)),
    )
    settings = UKFHyperParams(**_unscented(len(problem.mean)))

    @jax.jit
    def run(y: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        if unscented:
            found = unscented_kalman_filter(params, y, settings, inputs=u, output_fields=FIELDS)
        else:
            found = extended_kalman_filter(params, y, inputs=u, output_fields=FIELDS)
        return found.filtered_means, found.filtered_covariances

    return _rescaled(_last(run, problem.readings / problem.unit, _pairs(problem.inputs)), problem)


def cuthbert_extended(problem: Problem) -> Callable[[int], Moments]:
    step, read = in_jax(problem)
    n = problem.n
    none, unit = jnp.zeros(problem.drawn), jnp.eye(len(problem.unit))
    load_root = jnp.linalg.cholesky(jnp.asarray(problem.scaled(problem.Q)[n:, n:]))

    def moved(state: Any, at: Any) -> Any:
        u, _ = at

        def mean_and_root(x: jax.Array) -> tuple[jax.Array, jax.Array]:
            def end(noise: jax.Array) -> jax.Array:
                return step(jnp.concatenate([x, noise]), u)[:n]

            return end(none), jax.jacfwd(end)(none) @ load_root

        return mean_and_root, state.mean

    def observed(state: Any, at: Any) -> Any:
        u, y = at
        return (lambda x: (read(jnp.concatenate([x, none]), u), unit)), state.mean, y

    mean, root = problem.model.mean / problem.size[:n], jnp.linalg.cholesky(problem.scaled(problem.cov)[:n, :n])
    first = jnp.asarray(problem.readings[0] / problem.unit)

    @jax.jit
    def run(y: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        # the first sample finds the prior where it is: an update without a prediction
        H = jax.jacfwd(lambda x: read(jnp.concatenate([x, none]), u[0]))(jnp.asarray(mean))
        expected = read(jnp.concatenate([mean, none]), u[0])
        (start, start_root), _ = filter_update(jnp.asarray(mean), root, H, expected - H @ mean, unit, first)
        peer = moments.build_filter(start, start_root, moved, observed)
        states = cuthbert_filter(peer, (u[1:], y[1:]), peer.init_prepare())
        return states.mean, states.chol_cov

    return _rescaled(_last(run, problem.readings / problem.unit, _pairs(problem.inputs), root=True), problem)


def filterpy_unscented(problem: Problem, kernels: Kernels, samples: int) -> Moments:
    n = len(problem.mean)
    points = MerweScaledSigmaPoints(n, **_unscented(n))
    peer = UnscentedKalmanFilter(n, kernels.m, 1.0, hx=None, fx=None, points=points)
    peer.x, peer.P, peer.Q, peer.R = problem.mean, problem.cov, problem.Q, np.diag(problem.model.blocks.noise)
    before = problem.inputs[0]
    peer.sigmas_f = points.sigma_points(peer.x, peer.P)
    for k, (at, y) in enumerate(zip(problem.inputs[:samples], problem.readings, strict=False)):
        if k:
            peer.predict(fx=lambda x, _, b=before, a=at: kernels.step_points(x[None], b, a)[0])
        peer.update(y, hx=lambda x, a=at: kernels.read_points(x[None], a)[0])
        before = at
    return _coefficients(peer.x, peer.P, problem)


def stonesoup_unscented(problem: Problem, kernels: Kernels, samples: int) -> Moments:
    transition, reading = _PointTransition(), _PointReading(ndim_state=len(problem.mean), mapping=None)
    transition.kernels = reading.kernels = kernels
    transition.Q, reading.noise = problem.Q, np.diag(problem.model.blocks.noise)
    settings = _unscented(len(problem.mean))
    predictor = UnscentedKalmanPredictor(transition, **settings)
    updater = UnscentedKalmanUpdater(reading, **settings)
    return _stonesoup(problem, samples, predictor, updater, GaussianState(problem.mean[:, None], problem.cov))


def pykalman_unscented(problem: Problem, kernels: Kernels, samples: int) -> Moments:
    inputs = problem.inputs[:samples]
    steps = [lambda x, b=b, a=a: kernels.step_points(x[None], b, a)[0] for b, a in pairwise(inputs)]
    readings = [lambda x, a=at: kernels.read_points(x[None], a)[0] for at in inputs]
    prior, R = (problem.mean, problem.cov), np.diag(problem.model.blocks.noise)
    found = _pykalman_unscented(steps, readings, problem.Q, R, prior, problem.readings[:samples])
    return _coefficients(*found, problem)


def _pykalman_unscented(
    steps: list[Any], readings: list[Any], Q: Array, R: Array, prior: Moments, measured: Array
) -> Moments:
    # it takes no β: its default of 0 is set to ours for the time of the run
    usual = pykalman.unscented.moments2points.__defaults__
    pykalman.unscented.moments2points.__defaults__ = (ALPHA, BETA, None)
    try:
        peer = pykalman.AdditiveUnscentedKalmanFilter(
            # a column each: of a plain list pykalman 0.11.2 takes the first function for every sample
            np.array(steps)[:, None] if len(steps) > 1 else steps,
            np.array(readings)[:, None],
            transition_covariance=Q,
            observation_covariance=R,
            initial_state_mean=prior[0],
            initial_state_covariance=prior[1],
        )
        means, covs = peer.filter(measured)
    finally:
        pykalman.unscented.moments2points.__defaults__ = usual
    return means[-1], covs[-1]


# Stone-Soup's models are classes.


class _Noise:
    """Noise covariance of a Gaussian model, and methods that Stone-Soup requires and a Kalman filter never calls."""

    noise: Array

    @property
    def ndim_meas(self) -> int:
        return len(self.noise)

    def covar(self, **_: Any) -> Array:
        return self.noise


class _Rows(_Noise, LinearModel, GaussianModel, MeasurementModel):
    H: Array

    def matrix(self, **_: Any) -> Array:
        return self.H


class _Transition(TransitionModel, GaussianModel):
    """The step of 25 states; function, Jacobian and covariance come out of one call."""

    kernels: Kernels
    between: tuple[Array, Array]
    load_noise: Array

    @property
    def ndim_state(self) -> int:
        return self.kernels.n

    def function(self, state: Any, noise: Any = False, **_: Any) -> StateVector:
        end, self.F, self.gain = self.kernels.step(np.asarray(state.state_vector).ravel(), *self.between)
        return StateVector(end)

    def jacobian(self, state: Any, **_: Any) -> Array:
        return self.F

    def covar(self, **_: Any) -> Array:
        return self.gain @ self.load_noise @ self.gain.T


class _Reading(_Noise, MeasurementModel, GaussianModel):
    kernels: Kernels
    at: Array

    def function(self, state: Any, noise: Any = False, **_: Any) -> StateVector:
        y, self.H = self.kernels.read(np.asarray(state.state_vector).ravel(), self.at)
        return StateVector(y)

    def jacobian(self, state: Any, **_: Any) -> Array:
        return self.H


class _PointTransition(_Transition):
    """The step of 35 states, for all sigma points (35, 71) at once."""

    Q: Array

    @property
    def ndim_state(self) -> int:
        return len(self.Q)

    def function(self, state: Any, noise: Any = False, **_: Any) -> StateVectors:
        points = np.asarray(state.state_vector).T
        return self.kernels.step_points(points, *self.between).T.view(StateVectors)

    def covar(self, **_: Any) -> Array:
        return self.Q


class _PointReading(_Reading):
    def function(self, state: Any, noise: Any = False, **_: Any) -> StateVectors:
        points = np.asarray(state.state_vector).T
        return self.kernels.read_points(points, self.at).T.view(StateVectors)


# Shapes and scales.


def _unscented(n: int) -> dict[str, float]:
    return {"alpha": ALPHA, "beta": BETA, "kappa": 3.0 - n}


def _coefficients(mean: Array, cov: Array, problem: Problem) -> Moments:
    block = problem.model.parameter_block
    return mean[block], cov[block, block]


def _pairs(inputs: Array) -> Array:
    """Inputs at either end of the step that leads to each sample."""
    return np.hstack([np.vstack([inputs[:1], inputs[:-1]]), inputs])


def _last(
    run: Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]], readings: Array, data: Array, root: bool = False
) -> Callable[[int], Moments]:
    """A compiled run over the first T samples, its results waited for."""
    y, u = jnp.asarray(readings), jnp.asarray(data)

    def first(samples: int) -> Moments:
        means, covs = jax.block_until_ready(run(y[:samples], u[:samples]))
        last = np.asarray(covs[-1])
        return np.asarray(means[-1]), last @ last.T if root else last

    return first


def _rescaled(run: Callable[[int], Moments], problem: Problem) -> Callable[[int], Moments]:
    def first(samples: int) -> Moments:
        mean, cov = run(samples)
        size = problem.size[: len(mean)]
        return _coefficients(mean * size, cov * np.outer(size, size), problem)

    return first


def sheets(short: bool) -> Iterator[Sheet]:
    many, few = 2000, 50 if short else 200
    turbine = load_turbine("verne555").exact()
    problem, balance = Problem(turbine, many), Balance(turbine, many)
    kernels, written = Kernels(problem.model), Written(problem)
    linear, linear_unscented = "force balance, Kalman", "force balance, unscented"
    extended, unscented = "joint, extended", "joint, unscented"
    own, xla, numpy = "windsysid's", "XLA", "NumPy"
    runs = [
        Run(linear, "filterpy", "", few, partial(filterpy_linear, balance)),
        Run(linear, "pykalman", "", few, partial(pykalman_linear, balance)),
        Run(linear, "Stone-Soup", "", few, partial(stonesoup_linear, balance, KalmanUpdater)),
        Run(linear, "dynamax", "", many, dynamax_linear(balance)),
        Run(linear, "cuthbert", "", many, cuthbert_linear(balance)),
        Run(linear_unscented, "filterpy", "", few, partial(filterpy_linear_unscented, balance)),
        Run(linear_unscented, "pykalman", "", few, partial(pykalman_linear_unscented, balance)),
        Run(linear_unscented, "Stone-Soup", "", few, partial(stonesoup_linear, balance, UnscentedKalmanUpdater)),
        Run(linear_unscented, "dynamax", "", many, dynamax_linear_unscented(balance)),
        Run(
            extended,
            "filterpy",
            "NumPy, differences",
            few // 5,
            partial(filterpy_extended, problem, Differences(problem)),
        ),
        Run(extended, "filterpy", numpy, few, partial(filterpy_extended, problem, written)),
        Run(extended, "filterpy", own, few, partial(filterpy_extended, problem, kernels)),
        Run(extended, "Stone-Soup", numpy, few, partial(stonesoup_extended, problem, written)),
        Run(extended, "Stone-Soup", own, few, partial(stonesoup_extended, problem, kernels)),
        Run(extended, "dynamax", xla, many, dynamax_joint(problem, unscented=False)),
        Run(extended, "cuthbert", xla, many, cuthbert_extended(problem)),
        Run(unscented, "filterpy", own, few, partial(filterpy_unscented, problem, kernels)),
        Run(unscented, "pykalman", own, few, partial(pykalman_unscented, problem, kernels)),
        Run(unscented, "Stone-Soup", own, few, partial(stonesoup_unscented, problem, kernels)),
        Run(unscented, "dynamax", xla, many, dynamax_joint(problem, unscented=True)),
    ]
    ours = {
        linear: (EKF, balance.model, balance.inputs, balance.force),
        linear_unscented: (UKF, balance.model, balance.inputs, balance.force),
        extended: (EKF, problem.model, problem.inputs, problem.readings),
        unscented: (UKF, problem.model, problem.inputs, problem.readings),
    }
    for formulation, (f, model, inputs, readings) in ours.items():
        _, info, covs = f.run_with_covariances(model, f.init(model), inputs, readings)
        block = model.parameter_block
        means, stds = info.mean[:, block], np.sqrt(np.einsum("kii->ki", covs[:, block, block]))
        if model is balance.model:
            means, stds = means / balance.size, stds / balance.size
        theirs = [run for run in runs if run.formulation == formulation]
        timed: dict[str, Callable[[], object]] = {
            f"{run.peer} {run.equations}": partial(run.of, run.samples) for run in theirs
        }
        timed["windsysid"] = partial(f.run, model, f.init(model), inputs, readings)
        taken = medians(timed, 3 if short else REPEATS)
        least = 1e6 * taken["windsysid"] / many
        rows = [("windsysid", own if model is problem.model else "", str(many), number(least), "1", "", "")]
        for run in theirs:
            mean, cov = run.of(run.samples)
            off = np.max(np.abs(mean - means[run.samples - 1]) / stds[run.samples - 1])
            wider = np.max(np.abs(np.sqrt(np.diag(cov)) / stds[run.samples - 1] - 1.0))
            if not max(off, wider) < AGREES:
                raise SystemExit(f"{run.peer}, {formulation} filter: {off:.0e} σ off, expected less than {AGREES:g}")
            each = 1e6 * taken[f"{run.peer} {run.equations}"] / run.samples
            cells = (number(each), number(each / least), f"{off:.0e}", f"{wider:.0e}")
            rows.append((run.peer, run.equations, str(run.samples), *cells))
        yield Sheet(
            f"{formulation} filter, {len(model.states)} states, one core",
            ("", "equations", "samples", "µs per sample", "÷ windsysid", "estimates differ by [σ]", "σ / σ − 1"),
            rows,
            {f"{formulation} filter": least},
        )


if __name__ == "__main__":
    present(__doc__, sheets)
