"""Both formulations in the form that other libraries take, with windsysid's own compiled equations and exact Jacobians
for those that call Python.

*Joint*: `Problem`, 25 states. The noise (η, ξ) of its loads, at and between samples, reaches the motion
inside the step. A filter that takes a new Q at every step gets Γ Q Γᵀ; one that knows a constant Q only, or draws sigma
points, gets η and ξ as ten states more that are forgotten and drawn anew (35 states). *Force balance*: ten constant
coefficients, five readings s_k = Φ_k θ + noise; a linear model.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import sympy as sp
from numba import types

from filters import joint_model, record, scenarios
from windsysid import Turbine
from windsysid.filters import EKF
from windsysid.identification.estimate.force_balance import (
    MeasuredMotion,
    analysis_band,
    balance_forces,
    balance_statespace,
    measured_motion,
)
from windsysid.identification.model.prior import identifiable
from windsysid.kernels.jit import JACOBIAN, VALUE, compiled, inlined
from windsysid.models import Prior, StateSpace
from windsysid.signals import rotor_inputs
from windsysid.simulation.record import simulate_record
from windsysid.statespace.workspace import BLOCKS

__all__ = ["Balance", "Differences", "Kernels", "Problem", "Written"]

Array = np.ndarray

TINY = 1e-30
"""Length of a complex step: the imaginary part over it is the derivative, without a difference that cancels."""


class Problem:
    """The model in the peers' form.

    Its state is [x | z | θ | η | ξ] over `size`; its readings are over the standard deviation of their noise. `noise`
    is the covariance of (η, ξ).
    """

    def __init__(self, turbine: Turbine, samples: int) -> None:
        machine, start, lead_in, motion = scenarios(turbine)["reference"]
        self.model: StateSpace = joint_model(machine, motion, seed=0)
        self.inputs, self.readings = (array[:samples] for array in record(machine, start, lead_in, seed=0))
        self.turbine = machine
        blocks = self.model.blocks
        self.n, self.noise = len(self.model.states), noise_of(self.model)
        self.drawn = len(self.noise)
        self.Q = np.zeros((self.n + self.drawn,) * 2)
        self.Q[self.n :, self.n :] = self.noise
        self.unit = np.sqrt(blocks.noise)
        self.mean = np.concatenate([self.model.mean, np.zeros(self.drawn)])
        self.cov = self.Q.copy()
        self.cov[: self.n, : self.n] = self.model.cov
        _, info = EKF.run(self.model, EKF.init(self.model), self.inputs, self.readings)
        self.size = np.concatenate([info.std[-1], np.sqrt(np.diag(self.noise))])

    def scaled(self, cov: np.ndarray) -> np.ndarray:
        return cov / np.outer(self.size, self.size)


def noise_of(model: StateSpace) -> np.ndarray:
    """Covariance of the noise (η, ξ) that reaches the motion within a step: the loads' Q, and the identity."""
    nz, rough = model.blocks.load_within[0].shape
    noise = np.eye(nz + rough)
    noise[:nz, :nz] = model.blocks.load_noise[0]
    return noise


class Balance:
    """The force balance of a simulated record, scaled to unit noise and unit uncertainty.

    `regressors` Φ are (T, m, n), `readings` s (T, m).
    """

    def __init__(self, turbine: Turbine, samples: int) -> None:
        rate, band = 100.0, analysis_band(turbine)
        record = simulate_record(turbine, duration=samples / rate + 60.0, rate=rate, seed=0)
        rotor = rotor_inputs(record, turbine.rotor_speed)
        names = identifiable(turbine)
        motion = measured_motion(record, turbine, cutoff=band[0] / 2.0)
        balance = balance_forces(turbine, MeasuredMotion(motion, rotor, None, rate), names, band)
        parameters = Prior(spread=1.0).parameters(turbine, names, linear=True)
        model, inputs = balance_statespace(balance, turbine.model.coordinates, parameters, rate=rate, band=band)
        first = int(np.flatnonzero(np.isfinite(balance.force).all(axis=1))[0])
        self.model, self.inputs = model, inputs[first : first + samples]
        self.force = balance.force[first : first + samples]
        _, info = EKF.run(model, EKF.init(model), self.inputs, self.force)
        self.size, unit = info.std[-1], np.sqrt(model.blocks.noise)
        regressors = self.inputs.reshape(samples, len(unit), -1) * model.blocks.reference
        self.regressors = regressors * self.size / unit[:, None]
        self.readings = self.force / unit
        self.mean, self.cov = model.mean / self.size, model.cov / np.outer(self.size, self.size)


class Written:
    """The joint model's step and readings as Python has them without windsysid: SymPy's equations for NumPy.

    Derivatives are exact, by complex steps: one evaluation goes along all directions at once.
    """

    def __init__(self, problem: Problem) -> None:
        model = problem.model
        equations = problem.turbine.model.equations()
        arguments = (equations.states, equations.inputs, equations.parameters, equations.loads)
        self.n, self.drawn, self.m = problem.n, problem.drawn, len(model.readings)
        self.noise = problem.noise
        self.blocks, self.sizes = model.blocks, (len(equations.states), len(equations.inputs))
        self._motion = sp.lambdify(arguments, [*equations.mass, *equations.force], "numpy", cse=True)
        self._rates = sp.lambdify((*arguments, equations.accelerations), list(equations.rates), "numpy", cse=True)
        readings = problem.turbine.model.readings(problem.turbine.sensors)
        self._reading = sp.lambdify((*arguments, equations.accelerations), readings, "numpy", cse=True)

    def step(self, state: Array, before: Array, after: Array) -> tuple[Array, Array, Array]:
        """The state one step on (n,), F (n, n), Γ (n, n_η + n_ξ)."""
        whole = np.concatenate([state, np.zeros(self.drawn)])
        end, slopes = self._linearised(lambda points: self._moved(points, before, after), whole)
        return end, slopes[:, : self.n], slopes[:, self.n :]

    def read(self, state: Array, at: Array) -> tuple[Array, Array]:
        """The readings of a state (m,), H (m, n)."""
        return self._linearised(lambda points: self._readings(points, at), state)

    def _linearised(self, function: Callable[[Array], Array], at: Array) -> tuple[Array, Array]:
        values = function(at[:, None] + 1j * TINY * np.eye(len(at)))
        return values[:, 0].real.copy(), values.imag / TINY

    def _moved(self, points: Array, before: Array, after: Array) -> Array:
        """Points (n + n_η + n_ξ, k) one step on (n, k)."""
        nx, nu = self.sizes
        h, H, R = self.blocks.step[0], self.blocks.load_output[0], self.blocks.load_within[0]
        nz = len(R)
        x, z, theta, eta, xi = np.split(points, [nx, nx + nz, self.n, self.n + nz])
        p, z1, within = self._parameters(theta), self.blocks.load_transition[0] @ z + eta, R @ xi
        w0, w1 = before[nu:, None] + H @ (z + within), after[nu:, None] + H @ (z1 + within)
        middle, w = 0.5 * (before[:nu] + after[:nu]), 0.5 * (w0 + w1)
        k1 = self._slope(x, before[:nu], p, w0)
        k2 = self._slope(x + 0.5 * h * k1, middle, p, w)
        k3 = self._slope(x + 0.5 * h * k2, middle, p, w)
        k4 = self._slope(x + h * k3, after[:nu], p, w1)
        return np.concatenate([x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), z1, theta])

    def _readings(self, points: Array, at: Array) -> Array:
        """Readings (m, k) of points (n, k)."""
        nx, nu = self.sizes
        x, z, theta = np.split(points, [nx, nx + int(self.blocks.sizes[1])])
        p, w = self._parameters(theta), at[nu:, None] + self.blocks.load_output[0] @ z
        return _rows(self._reading(x, at[:nu], p, w, self._accelerations(x, at[:nu], p, w)), points)

    def _parameters(self, theta: Array) -> list[Any]:
        blocks, p = self.blocks, list(self.blocks.p)
        for which, reference, logarithmic, value in zip(
            blocks.chosen, blocks.reference, blocks.logarithmic, theta, strict=True
        ):
            p[which] = reference * (np.exp(value) if logarithmic else value)
        return p

    def _accelerations(self, x: Array, u: Array, p: list[Any], w: Array) -> Array:
        size = len(w)
        rows = _rows(self._motion(x, u, p, w), x)
        mass, force = rows[: size * size].T.reshape(-1, size, size), rows[size * size :].T
        return np.linalg.solve(mass, force[:, :, None])[:, :, 0].T

    def _slope(self, x: Array, u: Array, p: list[Any], w: Array) -> Array:
        return _rows(self._rates(x, u, p, w, self._accelerations(x, u, p, w)), x)


def _rows(expressions: list[Any], like: Array) -> Array:
    """Lambdified expressions (r, k), constants spread out."""
    rows = np.empty((len(expressions), like.shape[1]), dtype=like.dtype)
    for row, expression in zip(rows, expressions, strict=True):
        row[:] = expression
    return rows


class Differences(Written):
    """Kernel with derivatives by central differences, for users who have the equations only as a function."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self._widths = 0.01 * problem.size

    def _linearised(self, function: Callable[[Array], Array], at: Array) -> tuple[Array, Array]:
        slopes = []
        for off, width in zip(np.diag(self._widths[: len(at)]), self._widths, strict=False):
            high, low = function((at + off)[:, None]), function((at - off)[:, None])
            slopes.append((high - low) / (2.0 * width))
        return function(at[:, None])[:, 0], np.hstack(slopes)


class Kernels:
    """The joint model's step and readings, compiled: with Jacobians, and of many points at once."""

    def __init__(self, model: Any) -> None:
        blocks, of = model.blocks, model.compiled
        self.n, self.m, self.noise = len(model.states), len(model.readings), noise_of(model)
        self.drawn = len(self.noise)
        jacobian, value = types.FunctionType(JACOBIAN), types.FunctionType(VALUE)
        vector, matrix = types.float64[::1], types.float64[:, ::1]
        step = compiled(_step, types.void(jacobian, BLOCKS, *(vector,) * 4, matrix, matrix))
        read = compiled(_read, types.void(jacobian, BLOCKS, *(vector,) * 3, matrix))
        step_points = compiled(_step_points, types.void(value, BLOCKS, matrix, vector, vector, matrix))
        read_points = compiled(_read_points, types.void(value, BLOCKS, matrix, vector, matrix))
        rates_jacobian, reading_jacobian, rates, reading = of.rates_jacobian, of.reading_jacobian, of.rates, of.reading
        # with the model as a constant a call takes 5 µs; handing over its fifteen arrays takes 30 more
        warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
        self._step = numba.njit(lambda *rest: step(rates_jacobian, blocks, *rest))
        self._read = numba.njit(lambda *rest: read(reading_jacobian, blocks, *rest))
        self._step_points = numba.njit(lambda *rest: step_points(rates, blocks, *rest))
        self._read_points = numba.njit(lambda *rest: read_points(reading, blocks, *rest))

    def step(self, state: Array, before: Array, after: Array) -> tuple[Array, Array, Array]:
        """The state one step on (n,), F (n, n), Γ (n, n_η + n_ξ)."""
        end, F, gain = np.empty(self.n), np.zeros((self.n, self.n)), np.zeros((self.n, self.drawn))
        self._step(state, before, after, end, F, gain)
        return end, F, gain

    def read(self, state: Array, at: Array) -> tuple[Array, Array]:
        """The readings of a state (m,), H (m, n)."""
        y, H = np.empty(self.m), np.empty((self.m, self.n))
        self._read(state, at, y, H)
        return y, H

    def step_points(self, points: Array, before: Array, after: Array) -> Array:
        """Points (k, n + n_η + n_ξ) one step on; their η and ξ end at zero."""
        ends = np.zeros(points.shape)
        self._step_points(np.ascontiguousarray(points), before, after, ends)
        return ends

    def read_points(self, points: Array, at: Array) -> Array:
        """The readings (k, m) of points (k, n + n_η + n_ξ)."""
        y = np.empty((len(points), self.m))
        self._read_points(np.ascontiguousarray(points), at, y)
        return y


@inlined
def _parameters(blocks: Any, theta: Any, p: Any, slope: Any) -> None:
    """Physical parameters and their derivatives."""
    p[:] = blocks.p
    for j in range(theta.size):
        value = slope[j] = blocks.reference[j]
        if blocks.logarithmic[j] == 1:
            value = slope[j] = blocks.reference[j] * np.exp(theta[j])
        else:
            value *= theta[j]
        p[blocks.chosen[j]] = value


def _step(rates_jacobian: Any, blocks: Any, state: Any, before: Any, after: Any, end: Any, F: Any, gain: Any) -> None:
    nx, nz, _, nt, nu, nw = blocks.sizes
    n, rest, h = state.size, state.size - nt, blocks.step[0]
    phi, H, R = blocks.load_transition[0], blocks.load_output[0], blocks.load_within[0]
    wide = n + nz + R.shape[1]
    p, slope = np.empty(blocks.p.size), np.empty(nt)
    _parameters(blocks, state[rest:], p, slope)
    # the loads at either end, and all derivatives along (state, η, ξ)
    end[nx:] = state[nx:]
    w0, w1 = before[nu:].copy(), after[nu:].copy()
    dw0, dw1 = np.zeros((nw, wide)), np.zeros((nw, wide))
    for i in range(nz):
        end[nx + i] = 0.0
        for j in range(nz):
            end[nx + i] += phi[i, j] * state[nx + j]
    for i in range(nw):
        for j in range(nz):
            w0[i] += H[i, j] * state[nx + j]
            w1[i] += H[i, j] * end[nx + j]
            dw0[i, nx + j] = H[i, j]
            dw1[i, n + j] = H[i, j]
            for k in range(nz):
                dw1[i, nx + k] += H[i, j] * phi[j, k]
            for k in range(R.shape[1]):
                dw0[i, n + nz + k] += H[i, j] * R[j, k]
                dw1[i, n + nz + k] += H[i, j] * R[j, k]
    x, rate, total = state[:nx].copy(), np.empty(nx), np.zeros(nx)
    A, B, G = np.zeros((nx, nx)), np.zeros((nx, nt)), np.zeros((nx, nw))
    dx, dk, dtotal = np.zeros((nx, wide)), np.zeros((nx, wide)), np.zeros((nx, wide))
    for i in range(nx):
        dx[i, i] = 1.0
    for stage in range(4):
        at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        u = before[:nu] + at * (after[:nu] - before[:nu])
        rates_jacobian(x, u, p, w0 + at * (w1 - w0), rate, A, B, G)
        for i in range(nx):
            for c in range(wide):
                dk[i, c] = 0.0
            for j in range(nt):
                dk[i, rest + j] = B[i, j] * slope[j]
            for j in range(nw):
                if G[i, j] != 0.0:
                    for c in range(nx, wide):
                        dk[i, c] += G[i, j] * ((1.0 - at) * dw0[j, c] + at * dw1[j, c])
            for j in range(nx):
                if A[i, j] != 0.0:
                    for c in range(wide):
                        dk[i, c] += A[i, j] * dx[j, c]
        for i in range(nx):
            total[i] += weight * rate[i]
            x[i] = state[i] + ahead * rate[i]
            for c in range(wide):
                dtotal[i, c] += weight * dk[i, c]
                dx[i, c] = ahead * dk[i, c]
            dx[i, i] += 1.0
    for i in range(nx):
        end[i] = state[i] + total[i]
        F[i] = dtotal[i, :n]
        F[i, i] += 1.0
        gain[i] = dtotal[i, n:]
    for i in range(nz):
        F[nx + i, nx : nx + nz] = phi[i]
        gain[nx + i, i] = 1.0
    for i in range(nx + nz, n):
        F[i, i] = 1.0


def _read(reading_jacobian: Any, blocks: Any, state: Any, at: Any, y: Any, slopes: Any) -> None:
    nx, nz, _, nt, nu, nw = blocks.sizes
    m, rest, H = y.size, state.size - nt, blocks.load_output[0]
    p, slope = np.empty(blocks.p.size), np.empty(nt)
    _parameters(blocks, state[rest:], p, slope)
    w = at[nu:].copy()
    for i in range(nw):
        for j in range(nz):
            w[i] += H[i, j] * state[nx + j]
    C, D, E = np.zeros((m, nx)), np.zeros((m, nt)), np.zeros((m, nw))
    reading_jacobian(state[:nx], at[:nu], p, w, y, C, D, E)
    for i in range(m):
        slopes[i, :nx] = C[i]
        for j in range(nz):
            slopes[i, nx + j] = 0.0
            for k in range(nw):
                slopes[i, nx + j] += E[i, k] * H[k, j]
        for j in range(nt):
            slopes[i, rest + j] = D[i, j] * slope[j]


def _step_points(rates: Any, blocks: Any, points: Any, before: Any, after: Any, ends: Any) -> None:
    nx, nz, _, nt, nu, nw = blocks.sizes
    phi, H, R = blocks.load_transition[0], blocks.load_output[0], blocks.load_within[0]
    n, h = nx + nz + nt, blocks.step[0]
    p, slope, rate, x = np.empty(blocks.p.size), np.empty(nt), np.empty(nx), np.empty(nx)
    w0, w1, w, within = np.empty(nw), np.empty(nw), np.empty(nw), np.empty(nz)
    u0, u1, middle = before[:nu], after[:nu], 0.5 * (before[:nu] + after[:nu])
    for k in range(points.shape[0]):
        state, end = points[k], ends[k]
        _parameters(blocks, state[n - nt : n], p, slope)
        end[:n] = state[:n]
        for i in range(nz):
            end[nx + i] = state[n + i]
            for j in range(nz):
                end[nx + i] += phi[i, j] * state[nx + j]
        within[:] = 0.0
        for j in range(nz):
            for c in range(R.shape[1]):
                within[j] += R[j, c] * state[n + nz + c]
        for i in range(nw):
            w0[i], w1[i] = before[nu + i], after[nu + i]
            for j in range(nz):
                w0[i] += H[i, j] * (state[nx + j] + within[j])
                w1[i] += H[i, j] * (end[nx + j] + within[j])
            w[i] = 0.5 * (w0[i] + w1[i])
        x[:] = state[:nx]
        for stage in range(4):
            u = u0 if stage == 0 else (u1 if stage == 3 else middle)
            rates(x, u, p, w0 if stage == 0 else (w1 if stage == 3 else w), rate)
            weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
            ahead = h if stage == 2 else 0.5 * h
            for i in range(nx):
                end[i] += weight * rate[i]
                x[i] = state[i] + ahead * rate[i]


def _read_points(reading: Any, blocks: Any, points: Any, at: Any, y: Any) -> None:
    nx, nz, _, nt, nu, nw = blocks.sizes
    n, H = nx + nz + nt, blocks.load_output[0]
    p, slope, w = np.empty(blocks.p.size), np.empty(nt), np.empty(nw)
    for k in range(points.shape[0]):
        state = points[k]
        _parameters(blocks, state[n - nt : n], p, slope)
        for i in range(nw):
            w[i] = at[nu + i]
            for j in range(nz):
                w[i] += H[i, j] * state[nx + j]
        reading(state[:nx], at[:nu], p, w, y[k])
