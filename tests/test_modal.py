"""Modes in the fixed frame: isolated limits, published rotors, and Floquet's theory as an independent judge."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment

from windsysid.mechanics import CompiledModel, RotorModel, compile_model
from windsysid.modal import Mode, modes, modes_with_bands
from windsysid.statespace import Parameter
from windsysid.turbine import Turbine, load_turbine


def compiled(turbine: Turbine) -> tuple[CompiledModel, np.ndarray]:
    model = compile_model(turbine.model, (), turbine.model.coefficients)
    return model, np.array([turbine.values[name] for name in model.parameters])


def modes_of(turbine: Turbine, rotor_speed: float | None = None) -> list[tuple[str, float, float]]:
    return modes(turbine.model, *compiled(turbine), turbine.rotor_speed if rotor_speed is None else rotor_speed)


def test_with_locked_blades_the_support_vibrates_on_its_own(verne555: Turbine):
    locked = verne555.with_model(RotorModel(3, lag="locked")).with_values({"eccentricity": 0.0})
    found = {name: (f, z) for name, f, z in modes_of(locked)}
    assert set(found) == {"tower x", "tower y"}
    for axis in "xy":
        k, c, m = locked.values[f"k_{axis}"], locked.values[f"c_{axis}"], 7.0 + 3 * 2.5
        assert found[f"tower {axis}"][0] == pytest.approx(math.sqrt(k / m) / (2 * math.pi), rel=1e-9)
        assert found[f"tower {axis}"][1] == pytest.approx(c / (2 * math.sqrt(k * m)), rel=1e-9)


def test_on_a_stiff_support_the_blades_vibrate_on_their_own_seen_from_the_ground(verne555: Turbine):
    # f of the collective mode, f ∓ Ω of the whirling ones; with ω² = (k_β + S d Ω²) / I.
    stiff = verne555.with_model(RotorModel(3, x="locked", y="locked")).with_values(
        {f"c_beta_{i}": 0.0 for i in (1, 2, 3)}
    )
    alone = stiff.natural_frequency("beta_1") / (2 * math.pi)
    found = {name: f for name, f, _ in modes_of(stiff)}
    turn = verne555.rotor_speed / (2 * math.pi)
    assert found == pytest.approx(
        {"lag collective": alone, "lag backward": alone - turn, "lag forward": alone + turn}, rel=1e-9
    )


def test_nrel5mw_has_the_modes_of_the_openfast_linearisation():
    # ../shared/data/README.md: first-order values of another program, given to four and three digits.
    found = modes_of(load_turbine("nrel5mw"))
    assert [name for name, _, _ in found] == ["tower x", "lag backward", "lag collective", "lag forward"]
    np.testing.assert_allclose([f for _, f, _ in found], [0.3155, 0.8955, 1.1112, 1.3052], rtol=2e-4)
    np.testing.assert_allclose([100 * z for _, _, z in found], [0.349, 0.582, 0.482, 0.404], rtol=4e-3)


@pytest.mark.parametrize("rpm", range(20, 401, 20))
def test_hammond_is_stable_with_every_damper_working(rpm: int):
    # Hammond (1974): stable from 20 to 400 rpm.
    assert min(damping for _, _, damping in modes_of(load_turbine("hammond"), rpm * math.pi / 30)) > 0.005


def test_hammond_without_dampers_is_unstable_where_lag_and_support_coalesce():
    hammond = load_turbine("hammond")
    bare = hammond.with_values({"c_x": 0.0, "c_y": 0.0} | {f"c_beta_{i}": 0.0 for i in (1, 2, 3, 4)})
    least = {rpm: min(z for _, _, z in modes_of(bare, rpm * math.pi / 30)) for rpm in (60, 160, 240, 380)}
    assert least[160] < -0.05  # the regressive lag mode meets the support in x
    assert least[240] < -0.05  # and in y
    assert abs(least[60]) < 1e-9
    assert abs(least[380]) < 1e-9  # above both: neutral again
    ground = modes_of(bare, 240 * math.pi / 30)
    pair = [f for _, f, z in ground if abs(z) > 0.05]
    assert pair[0] == pytest.approx(pair[1], rel=1e-6)  # two modes, one frequency: one grows, the other decays


@pytest.mark.parametrize(("name", "tolerance"), [("nrel5mw", 1e-9), ("verne555", 1e-6), ("hammond", 1e-9)])
def test_modes_are_the_floquet_exponents_of_one_revolution(name: str, tolerance: float):
    # The monodromy matrix knows nothing of multi-blade coordinates: its exponents are the modes' eigenvalues but for multiples
    # of iΩ. The imbalance of verne555 leaves a trace of azimuth in the fixed frame, averaged by `modes`: 2e-7 there.
    turbine = load_turbine(name)
    model, p = compiled(turbine)
    p[model.parameters.index("gravity")] = 0.0
    n, speed = len(model.states), turbine.rotor_speed
    period = 2 * math.pi / speed

    def rates(time: float, fundamental: np.ndarray) -> np.ndarray:
        A = np.zeros((n, n))
        rest, loads = np.zeros(n), np.zeros(len(model.loads))
        B, G = np.zeros((n, len(model.identified))), np.zeros((n, len(model.loads)))
        model.rates_jacobian(rest, np.array([speed * time, speed, 0.0]), p, loads, np.empty(n), A, B, G)
        return np.asarray((A @ fundamental.reshape(n, n)).ravel())

    end = solve_ivp(rates, (0.0, period), np.eye(n).ravel(), method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    exponents = np.log(np.linalg.eigvals(end.reshape(n, n)).astype(complex)) / period

    found = np.array([2 * math.pi * f * complex(-z, math.sqrt(1 - z**2)) for _, f, z in modes_of(turbine)])
    found = np.concatenate([found, found.conj()])
    assert len(found) == n
    distance = np.abs(np.exp(found[:, None] * period) - np.exp(exponents * period))
    mine, theirs = linear_sum_assignment(distance)
    difference = found[mine] - exponents[theirs]
    assert np.abs(difference.real).max() < tolerance * speed
    turns = difference.imag / speed
    assert np.abs(turns - np.round(turns)).max() < tolerance
    assert np.any(np.abs(np.round(turns)) > 0)  # the turning frame was really left


def test_two_blades_have_no_constant_coordinates(verne555: Turbine):
    two = RotorModel(2)
    model = compile_model(two)
    assert modes(two, model, np.array([verne555.values[name] for name in model.parameters]), 7.0) == []


def test_bands_follow_from_the_covariance_by_the_delta_method(verne555: Turbine):
    # Locked blades: f = √(k/m) / 2π and ζ = c / 2√(km) have derivatives on paper.
    locked = verne555.with_model(RotorModel(3, lag="locked", y="locked")).with_values({"eccentricity": 0.0})
    model, p = compiled(locked)
    k, c, scale = 1800.0, 12.0, 300.0
    parameters = (Parameter("k_x", k, 0.3), Parameter("c_x", c, 4.0, False, scale))
    theta = np.array([0.0, c / scale])
    cov = np.array([[4e-4, 1e-5], [1e-5, 1e-5]])
    (mode,) = modes_with_bands(locked.model, model, p, locked.rotor_speed, parameters, theta, cov, p)
    frequency, damping = math.sqrt(k / 14.5) / (2 * math.pi), c / (2 * math.sqrt(k * 14.5))
    to_frequency = np.array([frequency / 2, 0.0])
    to_damping = np.array([-damping / 2, damping * scale / c])
    assert mode.name == "tower x"
    for (value, low, high), expected, slope in (
        (mode.frequency_hz, frequency, to_frequency), (mode.damping_ratio, damping, to_damping)
    ):  # fmt: skip
        half = 2.0 * math.sqrt(slope @ cov @ slope)
        assert value == pytest.approx(expected, rel=1e-9)
        assert (high - low) / 2 == pytest.approx(half, rel=1e-3)
        assert (high + low) / 2 == pytest.approx(value, rel=1e-9)
    assert mode.reference == pytest.approx((frequency, damping))


def test_a_mode_speaks_in_plain_values_and_in_text():
    mode = Mode("tower x", (1.0, 0.9, 1.1), (0.02, 0.01, 0.03), (1.01, 0.021))
    assert mode.summary() == {
        "name": "tower x",
        "frequency_hz": {"estimate": 1.0, "low": 0.9, "high": 1.1, "reference": 1.01},
        "damping_ratio": {"estimate": 0.02, "low": 0.01, "high": 0.03, "reference": 0.021},
    }
    assert mode.cells() == ("tower x", "1.0000", "0.9000 … 1.1000", "2.000", "1.000 … 3.000")
    assert mode.reference_cells() == ("1.0100", "2.100")
    assert mode._replace(reference=None).reference_cells() == ("", "")
    assert "reference" not in mode._replace(reference=None).summary()["frequency_hz"]
