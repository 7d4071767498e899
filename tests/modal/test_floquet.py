"""Floquet's theory against Mathieu functions, systems whose exponents are known on paper, and SciPy's integrator."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_b

from windsysid.errors import ConfigurationError
from windsysid.modal.floquet import about_periodic_motion, floquet, interpolate, resolve

System = Callable[[np.ndarray], np.ndarray]


def mathieu(a: float, q: float, damping: float = 0.0) -> System:
    """y″ + 2δ y′ + (a − 2q cos 2t) y = 0, period π."""

    def matrices(time: np.ndarray) -> np.ndarray:
        A = np.zeros((len(time), 2, 2))
        A[:, 0, 1], A[:, 1, 1] = 1.0, -2.0 * damping
        A[:, 1, 0] = 2.0 * q * np.cos(2.0 * time) - a
        return A

    return matrices


@pytest.mark.parametrize("q", [0.5, 2.0, 8.0])
@pytest.mark.parametrize(
    ("order", "family"), [(0, mathieu_a), (1, mathieu_a), (1, mathieu_b), (2, mathieu_b), (3, mathieu_a)]
)
def test_multipliers_are_one_on_the_boundaries_of_mathieus_equation(order: int, family: Callable[..., float], q: float):
    # On a characteristic value there is a solution of period π (even order) or 2π (odd): the multipliers sum to 2 or
    # −2.
    found = floquet(mathieu(float(family(order, q)), q), math.pi)
    total = np.exp(found.exponents * math.pi).sum()
    assert total == pytest.approx(2.0 * (-1.0) ** order, abs=1e-9)


@pytest.mark.parametrize("q", [0.5, 2.0])
def test_mathieus_equation_grows_between_its_boundaries_and_not_beside_them(q: float):
    low, high = float(mathieu_b(1, q)), float(mathieu_a(1, q))
    growth = [
        floquet(mathieu(a, q), math.pi).exponents.real.max() for a in (low - 1e-6, low + 1e-6, high - 1e-6, high + 1e-6)
    ]
    assert [g > 1e-5 for g in growth] == [False, True, True, False]


def turning(rate: float) -> tuple[System, np.ndarray]:
    """ẋ = A x seen from a frame that turns: A(t) = Ṡ S⁻¹ + S M S⁻¹ has the exponents of M, whatever the frame."""
    M = np.array([[-0.1, 2.0], [-2.3, -0.2]])

    def matrices(time: np.ndarray) -> np.ndarray:
        c, s = np.cos(rate * time), np.sin(rate * time)
        S = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
        return np.asarray(rate * np.array([[0.0, -1.0], [1.0, 0.0]]) + S @ M @ np.swapaxes(S, 1, 2))

    return matrices, M


def test_exponents_do_not_see_the_frame():
    system, M = turning(1.3)
    found = floquet(system, 2.0 * math.pi / 1.3)
    expected = np.exp(np.linalg.eigvals(M) * 2.0 * math.pi / 1.3)
    np.testing.assert_allclose(
        np.sort_complex(np.exp(found.exponents * 2.0 * math.pi / 1.3)), np.sort_complex(expected), atol=1e-11
    )


def test_a_frequency_is_raised_to_that_of_its_largest_harmonic():
    # In the turning frame the nearly circular orbit is moved by Ω; back in the fixed frame it stands at its own
    # frequency.
    rate = 1.3
    system, M = turning(rate)
    found = floquet(system, 2.0 * math.pi / rate)
    c, s = np.cos(rate * found.time), np.sin(rate * found.time)
    fixed = np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0) @ found.shapes
    multiples, shapes = resolve(fixed, np.ones(2))
    expected, vectors = np.linalg.eig(M)
    np.testing.assert_allclose(
        np.sort_complex(found.exponents + 1j * rate * multiples), np.sort_complex(expected), atol=1e-11
    )
    for shape in shapes.T:
        alike = np.abs(np.conj(vectors.T) @ shape) / np.linalg.norm(shape)
        assert alike.max() == pytest.approx(1.0, abs=1e-11)


def test_exponents_of_a_system_without_structure_are_scipys():
    rng = np.random.default_rng(1)
    steady, cosine, sine = rng.normal(size=(3, 5, 5))

    def system(time: np.ndarray) -> np.ndarray:
        c, s = np.cos(time)[:, None, None], np.sin(2.0 * time)[:, None, None]
        return np.asarray(steady + c * cosine + s * sine)

    end = solve_ivp(
        lambda t, x: (system(np.array([t]))[0] @ x.reshape(5, 5)).ravel(), (0.0, 2.0 * math.pi), np.eye(5).ravel(),
        method="DOP853", rtol=1e-13, atol=1e-13,
    ).y[:, -1].reshape(5, 5)  # fmt: skip
    expected = np.linalg.eigvals(end)
    got = np.exp(floquet(system, 2.0 * math.pi).exponents * 2.0 * math.pi)
    np.testing.assert_allclose(
        np.sort_complex(got), np.sort_complex(expected), rtol=1e-8, atol=1e-9 * np.abs(expected).max()
    )


def test_a_push_is_answered_by_the_settled_motion():
    system = mathieu(3.0, 0.7, damping=0.15)
    found = floquet(system, math.pi)
    push = np.zeros((len(found.time), 2, 1))
    push[:, 1, 0] = np.cos(4.0 * found.time) + 0.5
    settled = solve_ivp(
        lambda t, x: system(np.array([t]))[0] @ x + np.array([0.0, math.cos(4.0 * t) + 0.5]), (0.0, 80.0 * math.pi),
        np.zeros(2),
        method="DOP853", rtol=1e-11, atol=1e-12, t_eval=79.0 * math.pi + found.time,
    ).y.T  # fmt: skip
    np.testing.assert_allclose(found.response(push)[:, :, 0], settled, atol=1e-8)


def pendulum(time: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A damped pendulum on a shaken pivot: x″ + 0.2 x′ + (4 + 0.8 cos t) sin x = 0.9 cos t."""
    stiffness = 4.0 + 0.8 * np.cos(time)
    value = np.column_stack([x[:, 1], -0.2 * x[:, 1] - stiffness * np.sin(x[:, 0]) + 0.9 * np.cos(time)])
    slope = np.zeros((len(time), 2, 2))
    slope[:, 0, 1], slope[:, 1, 1], slope[:, 1, 0] = 1.0, -0.2, -stiffness * np.cos(x[:, 0])
    return value, slope


@pytest.mark.slow
def test_the_periodic_motion_is_the_settled_one_and_its_modes_are_those_of_neighbouring_motions():
    x, found = about_periodic_motion(pendulum, 2.0 * math.pi, 2)

    def run(start: np.ndarray, length: float) -> np.ndarray:
        rates = lambda t, z: pendulum(np.array([t]), z[None])[0][0]  # noqa: E731
        return np.asarray(solve_ivp(rates, (0.0, length), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1])

    np.testing.assert_allclose(run(np.zeros(2), 200.0 * math.pi), x[0], atol=1e-7)
    assert np.abs(x[:, 0]).max() > 0.3
    np.testing.assert_allclose(interpolate(x, found.time)[3], x[3], atol=1e-12)
    step = 1e-5
    monodromy = np.column_stack(
        [(run(x[0] + d, 2.0 * math.pi) - run(x[0] - d, 2.0 * math.pi)) / (2.0 * step) for d in step * np.eye(2)]
    )
    got = np.exp(found.exponents * 2.0 * math.pi)
    np.testing.assert_allclose(np.sort_complex(got), np.sort_complex(np.linalg.eigvals(monodromy)), atol=1e-7)


def test_what_dies_out_within_a_turn_and_a_forced_undamped_resonance_are_refused():
    with pytest.raises(ConfigurationError, match="dies out within a single turn"):
        floquet(lambda time: np.tile([[0.0, 1.0], [-9.0, -2.0]], (len(time), 1, 1)), 100.0)

    def resonance(time: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = np.tile([[0.0, 1.0], [-1.0, 0.0]], (len(time), 1, 1))
        return np.column_stack([x[:, 1], np.cos(time) - x[:, 0]]), slope

    with pytest.raises(ConfigurationError, match="no periodic motion"):
        about_periodic_motion(resonance, 2.0 * math.pi, 2)
