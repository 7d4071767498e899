"""What loads do within a step, against loads and motion discretised together (Van Loan), and against Lyapunov."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray

from tests.filters.textbook import LOADS
from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.filters import EKF, UKF, Belief, smooth
from windsysid.filters.bank import bank_of, run_bank
from windsysid.filters.particles.filter import ParticleFilter
from windsysid.filters.protocol import Filter
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads, draw_within_steps
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.process import LoadBlock, load_on, rational, second_order
from windsysid.statespace.within_step import within_step

STEP = 0.005
Array = NDArray[np.float64]


def model(*, continuous: bool = True, step: float = STEP) -> StateSpace:
    """The chain of masses with two random loads."""
    return compose(
        chain(),
        rate=1.0 / step,
        values=CHAIN_VALUES,
        loads=LOADS,
        continuous=continuous,
        sensors=chain_sensors(),
        cov=1e-6 * np.eye(6),
    )


def together() -> tuple[Array, Array]:
    """A and the density of the noise of motion and loads together (8, 8), written out from the springs."""
    m, k, c = (np.array([CHAIN_VALUES[f"{n}_{i}"] for i in (1, 2, 3)]) for n in "mkc")

    def assemble(s: Array) -> Array:
        return np.array([[s[0] + s[1], -s[1], 0.0], [-s[1], s[1] + s[2], -s[2]], [0.0, -s[2], s[2]]])

    A, density = np.zeros((8, 8)), np.zeros((8, 8))
    A[:3, 3:6] = np.eye(3)
    A[3:6, :3], A[3:6, 3:6] = -assemble(k) / m[:, None], -assemble(c) / m[:, None]
    for j, load in enumerate(LOADS):
        mass = int(load.load[-1]) - 1
        A[3 + mass, 6 + j] = 1.0 / m[mass]
        A[6 + j, 6 + j] = -1.0 / load.time_constant
        density[6 + j, 6 + j] = 2.0 * load.rms**2 / load.time_constant
    return A, density


def van_loan(step: float) -> tuple[Array, Array]:
    """F and Q over a step."""
    A, density = together()
    n = len(A)
    whole = scipy.linalg.expm(np.block([[-A, density], [np.zeros((n, n)), A.T]]) * step)
    F = whole[n:, n:].T
    return F, F @ whole[:n, n:]


@pytest.mark.parametrize("filter_", [EKF, UKF], ids=["EKF", "UKF"])
def test_a_step_adds_what_van_loan_adds(filter_: Filter):
    # From a state that is known: velocities to a thousandth, positions to 3 % (1/36 + 1/48 instead of 1/20 of L h⁵). A
    # straight line between the ends of a step moves velocities by three quarters of the variance.
    known = Belief(np.zeros(8), np.zeros((8, 8)), np.zeros(3), 1)
    exact = van_loan(STEP)[1]
    found = filter_.predict(model(), known, np.zeros(3)).cov
    straight = filter_.predict(model(continuous=False), known, np.zeros(3)).cov
    driven = [3 + int(load.load[-1]) - 1 for load in LOADS]
    for i in driven:
        assert found[i, i] == pytest.approx(exact[i, i], rel=2e-3)
        assert straight[i, i] == pytest.approx(0.75 * exact[i, i], rel=5e-3)
        assert found[i - 3, i] == pytest.approx(exact[i - 3, i], rel=5e-3)
        assert found[i - 3, i - 3] == pytest.approx(exact[i - 3, i - 3], rel=0.03)
    np.testing.assert_allclose(found[6:, 6:], exact[6:, 6:], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found[6:, 3:6], exact[6:, 3:6], rtol=2e-3, atol=1e-3 * abs(exact[6:, 3:6]).max())


@pytest.mark.slow
def test_long_steps_leave_the_motion_as_strong_as_it_is():
    # Steps of a twentieth of the fastest mode's period: the stationary covariance is Lyapunov's. With straight lines
    # the mode that is as fast loses a hundredth of its power.
    A, density = together()
    exact = np.asarray(scipy.linalg.solve_continuous_lyapunov(A, -density), dtype=np.float64)
    fastest = np.abs(np.linalg.eigvals(A).imag).max()
    step = 0.31 / fastest
    ends = {}
    for continuous in (True, False):
        space = model(continuous=continuous, step=step)
        belief = Belief(np.zeros(8), exact.copy(), np.zeros(3), 1)
        for _ in range(round(60.0 / step)):
            belief = EKF.predict(space, belief, np.zeros(3))
        ends[continuous] = np.diag(belief.cov)[3:6] / np.diag(exact)[3:6] - 1.0
    assert np.abs(ends[True]).max() < 1e-3
    assert ends[False].min() < -2e-3


def test_banks_and_smoothers_take_the_same_step():
    space, rng = model(), np.random.default_rng(3)
    inputs, readings = np.zeros((200, 3)), rng.standard_normal((200, len(space.readings)))
    readings[50:60] = np.nan
    linear = EKF.run(space, EKF.init(space), inputs, readings)[1]
    unscented = UKF.run(space, UKF.init(space), inputs, readings)[1]
    np.testing.assert_allclose(unscented.log_likelihood, linear.log_likelihood, rtol=1e-8, atol=1e-8)
    whitened = run_bank(bank_of([space] * 3), inputs, readings)[1].whitened
    np.testing.assert_allclose(whitened[..., 1], np.nan_to_num(linear.whitened), rtol=1e-8, atol=1e-8)
    one, other = (smooth(space, inputs, readings, filter_) for filter_ in (EKF, UKF))
    np.testing.assert_allclose(other.mean, one.mean, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(other.std, one.std, rtol=1e-6)
    straight = EKF.run(model(continuous=False), EKF.init(space), inputs, readings)[1]
    assert np.abs(straight.log_likelihood - linear.log_likelihood).sum() > 0.1  # it is another model


def test_particles_take_the_same_step():
    # Of loads that do thirty times as much within a step, the variances of 65 536 particles are within four standard
    # errors of the filter's.
    space = model()
    blocks = space.blocks._replace(load_within=30.0 * space.blocks.load_within)
    space = replace(space, blocks=blocks, cov=np.diag([1e-20] * 6 + [*np.diag(space.cov)[6:]]))
    quiet = replace(space, blocks=blocks._replace(load_within=np.zeros((1, 2, 0))))
    inputs, nothing = np.zeros((2, 3)), np.full((2, len(space.readings)), np.nan)
    expected = EKF.run(space, EKF.init(space), inputs, nothing)[0].cov
    cloud = ParticleFilter(particles=65_536, seed=5)
    found = np.cov(cloud.run(space, cloud.init(space), inputs, nothing)[0].particles)
    driven = [3 + int(load.load[-1]) - 1 for load in LOADS]
    assert np.all(EKF.run(quiet, EKF.init(quiet), inputs, nothing)[0].cov[driven, driven] < 0.9 * found[driven, driven])
    np.testing.assert_allclose(found[driven, driven], expected[driven, driven], rtol=4.0 * math.sqrt(2.0 / 65_536))


def test_a_simulation_moves_as_the_filter_expects():
    # Mean squares of velocities within four standard errors, which 40
    # parts tell, of Lyapunov's.
    A, density = together()
    exact = np.diag(scipy.linalg.solve_continuous_lyapunov(A, -density))
    step = 0.31 / np.abs(np.linalg.eigvals(A).imag).max()
    space, samples, rng = model(step=step), 200_000, np.random.default_rng(8)
    names = space.compiled.loads
    w = draw_loads(LOADS, names, samples, 1.0 / step, rng)
    within = draw_within_steps(LOADS, names, samples, 1.0 / step, rng)
    moved = integrate(
        space.compiled, space.blocks.p, w, rate=1.0 / step, start=np.zeros(6), substeps=1, within=within
    ).states[4000:, 3:]
    parts = np.square(moved[: len(moved) // 40 * 40]).reshape(40, -1, 3).mean(axis=1)
    error = parts.std(axis=0, ddof=1) / math.sqrt(40)
    assert np.all(np.abs(parts.mean(axis=0) - exact[3:6]) < 4.0 * error)


def test_what_stays_within_a_step_is_the_density_of_the_noise():
    load = GaussMarkov("load_x", 15.0, 0.5)
    assert within_step(load, 0.002).ravel() == pytest.approx(math.sqrt(2.0 * 15.0**2 / 0.5 * 0.002 / 12.0), rel=1e-3)
    process = load_on("load_x", rational(3.0, [-1.0, -5.0], [-3.0]))  # two poles and a zero: rough
    value, L = process.process.value, within_step(process, 0.001)
    high = 2e3
    assert float((value @ L)[0] ** 2) * 12.0 / 0.001 == pytest.approx(
        float(process.process.spectrum(high)[0]) * (2.0 * math.pi * high) ** 2, rel=1e-3
    )
    two = np.array([[2.0, 1.0], [1.0, 3.0]])  # both states driven by noises that are alike
    rows = {"load_x": np.array([[1.0, 0.0]]), "load_y": np.array([[0.0, 1.0]])}
    R = within_step(LoadBlock(("a", "b"), -np.eye(2), two, rows), 0.002)
    np.testing.assert_allclose(R @ R.T, 2.0 * two * 0.002 / 12.0, rtol=1e-3)


@pytest.mark.parametrize("memory", [0.002, 0.01, 0.03, 0.1, 0.3, 1.0, 10.0])
def test_a_mode_that_steps_follow_is_pushed_as_hard_as_it_is(memory: float):
    # The power of what pushes a mode over that of the load itself, both at its frequency: samples' spectrum, which is
    # an aliased one, along straight lines, and the constants within steps. Ten steps for a turn of the mode at most.
    h = 0.02
    load, omega = GaussMarkov("load_x", 1.0, memory), 0.31 / h
    kept = np.exp(-h / memory + 1j * omega * h)
    samples = h * (2.0 * np.real(1.0 / (1.0 - kept)) - 1.0)
    line, constant = np.sinc(omega * h / (2.0 * np.pi)) ** 2, np.sinc(omega * h / (2.0 * np.pi))
    within = float(np.sum(np.square(within_step(load, h))))
    pushes = samples * line**2 + within * h * constant**2
    power = 2.0 * memory / (1.0 + (omega * memory) ** 2)
    straight = samples * line**2 / power - 1.0
    off = pushes / power - 1.0
    assert abs(off) <= max(0.003, straight if omega * memory < 1.0 else 0.0)
    assert abs(off) <= abs(straight) + 1e-12


def test_smooth_loads_run_along_a_straight_line():
    assert within_step(load_on("load_x", second_order(3.0, 1.5, 0.2)), 0.02).shape == (2, 0)
    behind = GaussMarkov("load_x", 15.0, 0.5, low_pass=10.0)
    assert within_step(behind, 0.02).shape == (3, 0)
