"""The iterated filter finds the mode of bent readings, never runs away, and else equals the extended filter."""

import numpy as np
import pytest
import scipy.optimize
import sympy as sp

from tests.filters.test_protocol import assert_same, record, rotor_with_everything
from tests.filters.textbook import composed, simulated
from tests.mechanics.models import Reads, symbols
from windsysid.filters import EKF, IEKF
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.parameter import Parameter

NOISE = 0.02


def bent(*, spread: float = 0.4, gate: float | None = None) -> StateSpace:
    """Two uncertain numbers, read as a product, a sine of both and a saturating difference."""
    a, b = symbols("a b")
    return compose(
        Equations("bent", (), (), (a, b), (), ()),
        rate=1.0,
        values={},
        parameters=[Parameter("a", 1.0, spread, False), Parameter("b", 0.5, spread, False)],
        sensors=(
            Reads("product", a * b, NOISE),
            Reads("sine", sp.sin(a + 2 * b), NOISE),
            Reads("saturating", sp.tanh(3 * (a - b)), NOISE),
        ),
        gate=gate,
    )


def readings_of(a: float, b: float) -> np.ndarray:
    return np.array([a * b, np.sin(a + 2 * b), np.tanh(3 * (a - b))])


def cost(x: np.ndarray, readings: np.ndarray, spread: float) -> float:
    off = (readings - readings_of(*x))[~np.isnan(readings)]
    return float(0.5 * np.sum((x - [1.0, 0.5]) ** 2) / spread**2 + 0.5 * np.sum(off**2) / NOISE**2)


@pytest.mark.parametrize("missing", [(), (0,), (1, 2)])
@pytest.mark.parametrize("truth", [(1.3, 0.7), (0.6, 0.9), (1.1, 0.2)])
def test_the_update_ends_at_the_mode_that_scipy_finds(truth: tuple[float, float], missing: tuple[int, ...]):
    model, readings = bent(), readings_of(*truth)
    readings[list(missing)] = np.nan
    belief, _ = IEKF.update(model, IEKF.init(model), readings)
    found = scipy.optimize.minimize(cost, belief.mean, (readings, 0.4), method="Nelder-Mead", tol=1e-12)
    once, _ = EKF.update(model, EKF.init(model), readings)
    assert np.all(np.abs(belief.mean - found.x) < 0.02 * np.sqrt(np.diag(belief.cov)))
    assert cost(belief.mean, readings, 0.4) <= (1.0 if missing else 0.1) * cost(once.mean, readings, 0.4)


def test_the_log_likelihood_is_laplaces():
    # At the mode, with Gauss–Newton's curvature: log p ≈ −J − ½ log det(I + Pᵀ Hᵀ R⁻¹ H) − Σ log √(2π r).
    model, readings = bent(), readings_of(1.3, 0.7)
    belief, info = IEKF.update(model, IEKF.init(model), readings)
    a, b = belief.mean
    c, s = np.cos(a + 2 * b), 3.0 / np.cosh(3 * (a - b)) ** 2
    H = np.array([[b, a], [c, 2 * c], [s, -s]])
    curvature = np.eye(2) + 0.4**2 * H.T @ H / NOISE**2
    expected = (
        -cost(belief.mean, readings, 0.4) - 0.5 * np.linalg.slogdet(curvature)[1] - 1.5 * np.log(2 * np.pi * NOISE**2)
    )
    assert info.log_likelihood[0] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("start", [-1.5, 0.5, 2.0, 8.0])
def test_a_step_that_overshoots_is_shortened(start: float):
    # tanh x read as 0 from |x| > 1.09: full Gauss–Newton steps run away from x = 0, further each time.
    (x,) = symbols("x")
    model = compose(
        Equations("flat", (), (), (x,), (), ()),
        rate=1.0,
        values={},
        parameters=[Parameter("x", start, 100.0, False)],
        sensors=(Reads("flat", sp.tanh(x), 0.1),),
    )

    def J(at: float) -> float:
        return float(0.5 * (at - start) ** 2 / 100.0**2 + 0.5 * np.tanh(at) ** 2 / 0.1**2)

    prior = IEKF.init(model)
    iterated, once = (f.update(model, prior, np.zeros(1))[0].mean.item() for f in (IEKF, EKF))
    assert J(iterated) <= J(start)
    if abs(start) < 3.0:
        assert abs(iterated) < 0.1
    if abs(start) > 1.0:
        assert J(once) > J(start) * 0.99 or abs(once) > abs(start)


def test_a_gated_reading_does_not_pull():
    model, watchful, readings = bent(spread=0.1), bent(spread=0.1, gate=6.0), readings_of(1.1, 0.55)
    readings[1] += 5.0
    belief, info = IEKF.update(watchful, IEKF.init(watchful), readings)
    assert info.gated.tolist() == [[False, True, False]]
    readings[1] = np.nan
    assert_same(belief, IEKF.update(model, IEKF.init(model), readings)[0])


def test_what_is_known_exactly_stays_known():
    # P⁻ is singular: b has no uncertainty, and no inverse is asked for.
    model = bent()
    cov = np.diag([0.16, 0.0])
    belief, _ = IEKF.update(model, IEKF.init(model)._replace(cov=cov), readings_of(1.3, 0.5))
    assert belief.mean[1] == 0.5
    np.testing.assert_array_equal(belief.cov[1], 0.0)
    assert belief.mean[0] == pytest.approx(1.3, abs=4 * NOISE)


def test_straight_readings_are_the_extended_filters_bit_for_bit():
    model = composed()
    inputs, readings = simulated(model, 200, seed=36)
    for iterated, once in zip(*(f.run(model, f.init(model), inputs, readings) for f in (IEKF, EKF)), strict=True):
        assert_same(iterated, once)


def test_the_rotor_is_iterated_only_while_it_is_badly_known():
    model = rotor_with_everything()
    inputs, readings = record(model)
    assert np.any(
        IEKF.run(model, IEKF.init(model), inputs, readings)[0].mean
        != EKF.run(model, EKF.init(model), inputs, readings)[0].mean
    )
    sure = EKF.init(model)._replace(cov=1e-6 * model.cov)
    for iterated, once in zip(
        *(f.run(model, sure, inputs[:10], 0.01 * readings[:10]) for f in (IEKF, EKF)), strict=True
    ):
        assert_same(iterated, once)
