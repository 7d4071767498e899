"""Do other people's filters say the same? filterpy and dynamax on the joint model of the scale model's rotor, at equal
settings.

    python benchmarks/agreement.py [--samples 500]        in an environment made from benchmarks/peers.txt

The model is the filters' own: 25 states (5 displacements, 5 velocities, 5 loads, 10 coefficients), 5 accelerometers,
100 Hz. Both peers know additive noise only, so that the load noise η and the deviation ξ of the loads from straight
lines within a step, which both reach the motion inside the step, become a part of the state that is forgotten and drawn
anew at every sample: exactly the same model with 35 states. filterpy gets the step and the readings as black boxes, and
the Jacobians by differences; dynamax gets the SymPy equations lambdified for JAX, and differentiates them itself.
States and readings are scaled to unit size for the peers, because dynamax adds 1e-9 to the diagonal of every matrix it
solves with. That is all of its difference: with 1e-12 instead it falls a thousandfold.

Differences are the largest over all samples and states: of the means in standard deviations, of the standard deviations
as a ratio.
"""

import argparse
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import sympy as sp
from dynamax.nonlinear_gaussian_ssm import (
    ParamsNLGSSM,
    extended_kalman_filter,
    extended_kalman_smoother,
    unscented_kalman_filter,
    unscented_kalman_smoother,
)
from dynamax.nonlinear_gaussian_ssm.inference_ukf import UKFHyperParams
from dynamax.utils.utils import psd_solve
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from models import Problem
from rich.console import Console
from rich.table import Table

from windsysid import load_turbine
from windsysid.filters import EKF, UKF, Belief, smooth
from windsysid.models import StateSpace

jax.config.update("jax_enable_x64", True)

Function = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def black_boxes(problem: Problem) -> tuple[Function, Function]:
    """Step and readings by our own kernels, by value: a prediction and an innovation without any uncertainty."""
    model, n = problem.model, problem.n
    blocks = model.blocks
    still = blocks._replace(load_noise=0.0 * blocks.load_noise, load_within=0.0 * blocks.load_within)
    still_model = StateSpace(**{**model.__dict__, "blocks": still})
    H, R, nothing = blocks.load_output[0], blocks.load_within[0], np.zeros((n, n))
    nx, nz, first = len(model.compiled.states), len(R), len(model.compiled.inputs)

    def step(state: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        state = state * problem.size
        eta, xi = np.split(state[n:], [nz])
        early, late = before.copy(), after.copy()
        early[first:] += H @ (R @ xi)
        late[first:] += H @ (eta + R @ xi)
        end = EKF.predict(still_model, Belief(state[:n], nothing, early, 1), late).mean
        end[nx : nx + nz] += eta
        return np.concatenate([end, np.zeros(problem.drawn)]) / problem.size

    def read(state: np.ndarray, _: np.ndarray, at: np.ndarray) -> np.ndarray:
        belief = Belief((state * problem.size)[:n], nothing, at, 1)
        return -EKF.update(model, belief, np.zeros(len(model.readings)))[1].innovation[0] / problem.unit

    return step, read


def in_jax(problem: Problem) -> tuple[Callable, Callable]:
    """Step and readings from the SymPy equations: M a = F solved, RK4, loads and parameters as in windsysid."""
    blocks = problem.model.blocks
    equations = problem.turbine.model.equations()
    arguments = (equations.states, equations.inputs, equations.parameters, equations.loads)
    mass = sp.lambdify(arguments, equations.mass, modules="jax")
    force = sp.lambdify(arguments, list(equations.force), modules="jax")
    rates = sp.lambdify((*arguments, equations.accelerations), list(equations.rates), modules="jax")
    readings = problem.turbine.model.readings(problem.turbine.sensors)
    reading = sp.lambdify((*arguments, equations.accelerations), readings, modules="jax")
    nx, nz, nu, n = len(equations.states), int(blocks.sizes[1]), len(equations.inputs), problem.n
    h, phi, H = blocks.step[0], jnp.asarray(blocks.load_transition[0]), jnp.asarray(blocks.load_output[0])
    R = jnp.asarray(blocks.load_within[0])
    size, unit = jnp.asarray(problem.size), jnp.asarray(problem.unit)

    def parameters(theta: jax.Array) -> jax.Array:
        reference = jnp.asarray(blocks.reference)
        physical = jnp.where(jnp.asarray(blocks.logarithmic) == 1, reference * jnp.exp(theta), reference * theta)
        return jnp.asarray(blocks.p).at[jnp.asarray(blocks.chosen)].set(physical)

    def accelerations(x: jax.Array, u: jax.Array, p: jax.Array, w: jax.Array) -> jax.Array:
        return jnp.linalg.solve(jnp.array(mass(x, u, p, w)), jnp.array(force(x, u, p, w)))

    def slope(x: jax.Array, u: jax.Array, p: jax.Array, w: jax.Array) -> jax.Array:
        return jnp.array(rates(x, u, p, w, accelerations(x, u, p, w)))

    def step(state: jax.Array, inputs: jax.Array) -> jax.Array:
        before, after = jnp.split(inputs, 2)
        state = state * size
        x, z, theta, eta, xi = jnp.split(state, [nx, nx + nz, n, n + nz])
        p, z1, within = parameters(theta), phi @ z + eta, R @ xi
        w0, w1 = before[nu:] + H @ (z + within), after[nu:] + H @ (z1 + within)
        middle, w = 0.5 * (before[:nu] + after[:nu]), 0.5 * (w0 + w1)
        k1 = slope(x, before[:nu], p, w0)
        k2 = slope(x + 0.5 * h * k1, middle, p, w)
        k3 = slope(x + 0.5 * h * k2, middle, p, w)
        k4 = slope(x + h * k3, after[:nu], p, w1)
        end = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return jnp.concatenate([end, z1, theta, jnp.zeros(problem.drawn)]) / size

    def read(state: jax.Array, inputs: jax.Array) -> jax.Array:
        _, at = jnp.split(inputs, 2)
        x, z, theta, _ = jnp.split(state * size, [nx, nx + nz, n])
        p, w = parameters(theta), at[nu:] + H @ z
        return jnp.array(reading(x, at[:nu], p, w, accelerations(x, at[:nu], p, w))) / unit

    return step, read


def slopes(function: Function, state: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Central differences with Richardson's extrapolation, by fractions of a state's size."""

    def difference(j: int, width: float) -> np.ndarray:
        off = width * np.eye(len(state))[j]
        return (function(state + off, before, after) - function(state - off, before, after)) / (2.0 * width)

    return np.stack([(4.0 * difference(j, 0.05) - difference(j, 0.1)) / 3.0 for j in range(len(state))], axis=1)


def run_filterpy(
    peer: Any,
    problem: Problem,
    predict: Callable[[np.ndarray, np.ndarray], None],
    update: Callable[[np.ndarray, np.ndarray], None],
) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations (T, n) of a filter that `predict` and `update` move."""
    peer.x, peer.P = problem.mean / problem.size, problem.scaled(problem.cov)
    peer.Q, peer.R = problem.scaled(problem.Q), np.eye(len(problem.unit))
    means, stds = [], []
    for k, (at, reading) in enumerate(zip(problem.inputs, problem.readings, strict=True)):
        if k:
            predict(problem.inputs[k - 1], at)
        update(reading / problem.unit, at)
        means.append(peer.x * problem.size)
        stds.append(np.sqrt(np.diag(peer.P)) * problem.size)
    return np.array(means)[:, : problem.n], np.array(stds)[:, : problem.n]


def filterpy_extended(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations (T, n)."""
    step, read = black_boxes(problem)
    peer = ExtendedKalmanFilter(dim_x=len(problem.mean), dim_z=len(problem.unit))

    def predict(before: np.ndarray, after: np.ndarray) -> None:
        peer.F = slopes(step, peer.x, before, after)
        peer.predict_x = lambda u=0: setattr(peer, "x", step(peer.x, before, after))
        peer.predict()

    def update(reading: np.ndarray, at: np.ndarray) -> None:
        peer.update(reading, HJacobian=lambda x: slopes(read, x, at, at), Hx=lambda x: read(x, at, at))

    return run_filterpy(peer, problem, predict, update)


def filterpy_unscented(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations (T, n)."""
    step, read = black_boxes(problem)
    n = len(problem.mean)
    points = MerweScaledSigmaPoints(n, alpha=1.0, beta=1.0, kappa=3.0 - n)
    peer = UnscentedKalmanFilter(n, len(problem.unit), 1.0, hx=read, fx=step, points=points)

    def predict(before: np.ndarray, after: np.ndarray) -> None:
        peer.predict(fx=lambda x, _: step(x, before, after))

    def update(reading: np.ndarray, at: np.ndarray) -> None:
        peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        peer.update(reading, hx=lambda x: read(x, at, at))

    return run_filterpy(peer, problem, predict, update)


def dynamax_all(problem: Problem, boost: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Means and standard deviations (T, n) of its filters and smoothers; `boost` is on the diagonals it solves with."""
    psd_solve.__defaults__ = (boost,)
    step, read = in_jax(problem)
    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(problem.mean / problem.size),
        initial_covariance=jnp.asarray(problem.scaled(problem.cov)),
        dynamics_function=step,
        dynamics_covariance=jnp.asarray(problem.scaled(problem.Q)),
        emission_function=read,
        emission_covariance=jnp.eye(len(problem.unit)),
    )
    before = np.vstack([problem.inputs[:1], problem.inputs[:-1]])
    inputs = jnp.asarray(np.hstack([before, problem.inputs]))
    emissions = jnp.asarray(problem.readings / problem.unit)
    settings = UKFHyperParams(alpha=1.0, beta=1.0, kappa=3.0 - len(problem.mean))

    def unpacked(means: jax.Array, covs: jax.Array) -> tuple[np.ndarray, np.ndarray]:
        stds = np.sqrt(np.einsum("kii->ki", np.asarray(covs)))
        return (np.asarray(means) * problem.size)[:, : problem.n], (stds * problem.size)[:, : problem.n]

    extended = jax.jit(lambda y, u: extended_kalman_filter(params, y, inputs=u))(emissions, inputs)
    unscented = jax.jit(lambda y, u: unscented_kalman_filter(params, y, settings, inputs=u))(emissions, inputs)
    back = jax.jit(lambda y, u: extended_kalman_smoother(params, y, inputs=u))(emissions, inputs)
    unscented_back = jax.jit(lambda y, u: unscented_kalman_smoother(params, y, settings, inputs=u))(emissions, inputs)
    return {
        "extended": unpacked(extended.filtered_means, extended.filtered_covariances),
        "unscented": unpacked(unscented.filtered_means, unscented.filtered_covariances),
        "extended smoother": unpacked(back.smoothed_means, back.smoothed_covariances),
        "unscented smoother": unpacked(unscented_back.smoothed_means, unscented_back.smoothed_covariances),
    }


def iterations_in_dynamax() -> float:
    """Variance after one reading of unit noise of a state of unit variance, by ``num_iter=2``; ½ is exact."""
    params = ParamsNLGSSM(
        initial_mean=jnp.zeros(1),
        initial_covariance=jnp.eye(1),
        dynamics_function=lambda x: x,
        dynamics_covariance=jnp.eye(1),
        emission_function=lambda x: x,
        emission_covariance=jnp.eye(1),
    )
    return float(extended_kalman_filter(params, jnp.zeros((1, 1)), num_iter=2).filtered_covariances[0, 0, 0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=500, help="samples of the record (500)")
    samples = parser.parse_args().samples
    problem = Problem(load_turbine("verne555").exact(), samples)
    model, inputs, readings = problem.model, problem.inputs, problem.readings
    ours = {}
    for name, f in (("extended", EKF), ("unscented", UKF)):
        _, info = f.run(model, f.init(model), inputs, readings)
        ours[name] = (info.mean, info.std)
        ours[f"{name} smoother"] = smooth(model, inputs, readings, f)[:2]
    theirs = {
        ("filterpy", "extended"): filterpy_extended(problem),
        ("filterpy", "unscented"): filterpy_unscented(problem),
    }
    for peer, boost in (("dynamax", 1e-9), ("dynamax, 1e-12 on diagonals", 1e-12)):
        theirs |= {(peer, name): result for name, result in dynamax_all(problem, boost).items()}

    table = Table(title=f"{samples} samples, largest differences from windsysid", title_justify="left")
    for heading in ("", "peer", "mean [σ]", "σ / σ − 1"):
        table.add_column(heading, justify="left" if heading in ("", "peer") else "right")
    for (peer, name), (mean, std) in sorted(theirs.items(), key=lambda item: item[0][::-1]):
        our_mean, our_std = ours[name]
        off = np.max(np.abs(mean - our_mean) / our_std), np.max(np.abs(std / our_std - 1.0))
        table.add_row(name, peer, *(f"{value:.1e}" for value in off))
    moved = np.max(np.abs(ours["unscented"][0] - ours["extended"][0]) / ours["extended"][1])
    table.add_row("unscented", "our own extended, for scale", f"{moved:.1e}", "")
    Console(width=100).print(table)
    print(
        f"dynamax's num_iter=2 leaves a variance of {iterations_in_dynamax():.3f} where one reading leaves 0.5: it"
        " takes the reading in twice, so there is\nno iterated filter to compare with."
    )


if __name__ == "__main__":
    main()
