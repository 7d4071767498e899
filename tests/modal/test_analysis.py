"""Modes in the fixed frame: isolated limits, published rotors, and Floquet's theory as an independent judge."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment

from windsysid.mechanics import CompiledModel, RotorModel, compile_model
from windsysid.modal.analysis import analyse, modes, modes_with_slopes
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.mode import Mode
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


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


OPENFAST = ([0.3155, 0.8955, 1.1112, 1.3052], [0.349, 0.582, 0.482, 0.404])
"""Frequencies [Hz] and damping ratios [%] of OpenFAST's linearisation at 12.1 rpm; side-side and edgewise free."""


@pytest.mark.parametrize("method", ["Coleman", "Floquet"])
def test_nrel5mw_has_the_modes_of_the_openfast_linearisation(method: Literal["Coleman", "Floquet"]):
    # ../shared/data/README.md: first-order values of another program, given to four and three digits.
    nrel = load_turbine("nrel5mw")
    found = analyse(nrel.model, *compiled(nrel), nrel.rotor_speed, method=method)
    assert found.names == ("tower x", "lag backward", "lag collective", "lag forward")
    np.testing.assert_allclose(found.frequency, OPENFAST[0], rtol=2e-4)
    np.testing.assert_allclose(100 * found.damping, OPENFAST[1], rtol=4e-3)


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
    # The monodromy matrix knows nothing of multi-blade coordinates: its exponents are the modes' eigenvalues but for
    # multiples of iΩ. The imbalance of verne555 leaves a trace of azimuth in the fixed frame, averaged by `modes`: 2e-7
    # there.
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


def isotropic_hub(turbine: Turbine) -> Turbine:
    """The y of the support made like its x."""
    return turbine.with_values({f"{to}_y": turbine.values[f"{to}_x"] for to in ("hub_mass", "k", "c")})


@pytest.mark.parametrize("rpm", [20, 100, 160, 240, 300, 500])
@pytest.mark.parametrize("damping", [0.0, 1.0])
@pytest.mark.parametrize("method", ["Coleman", "Floquet"])
def test_hammond_on_an_isotropic_hub_has_the_roots_of_colemans_characteristic_equation(
    rpm: int, damping: float, method: Literal["Coleman", "Floquet"]
):
    # With z = x + i y and Z = ξ_c + i ξ_s, the hub and the whirling lag of N blades obey (derived by hand, turned to
    # the fixed frame) M z″ + c z′ + k z + i (N/2) S Z″ = 0, I (Z″ − 2iΩ Z′ − Ω² Z) + c_β (Z′ − iΩ Z) + (k_β + S d Ω²) Z
    # − i S z″ = 0: a quartic in λ.
    hammond = isotropic_hub(load_turbine("hammond"))
    hammond = hammond.with_values(
        {name: damping * hammond.values[name] for name in ("c_x", "c_y", *(f"c_beta_{i}" for i in range(1, 5)))}
    )
    v, N, Omega = hammond.values, 4, rpm * math.pi / 30
    hub = np.array([v["hub_mass_x"] + N * v["blade_mass_1"], v["c_x"], v["k_x"]])
    turned = np.poly1d([1.0, -1j * Omega])
    stiffness = v["k_beta_1"] + v["blade_first_moment_1"] * v["hinge_offset"] * Omega**2
    lag = v["blade_inertia_1"] * turned**2 + v["c_beta_1"] * turned + stiffness
    quartic = np.poly1d(hub) * lag - np.poly1d([N / 2 * v["blade_first_moment_1"] ** 2, 0, 0, 0, 0])
    whirling = quartic.roots
    alone = np.roots([v["blade_inertia_1"], v["c_beta_1"], stiffness])
    expected = np.concatenate(
        [whirling, whirling.conj(), alone, alone]
    )  # collective and differential lag are the blade alone
    expected = expected[expected.imag > 1e-6]
    found = analyse(hammond.model, *compiled(hammond), Omega, method=method)
    assert len(found.exponents) == len(expected)
    distance = np.abs(found.exponents[:, None] - expected)
    assert distance[linear_sum_assignment(distance)].max() < 1e-6 * Omega
    assert found.growth == pytest.approx(max(whirling.real.max(), alone.real.max()), abs=1e-6 * Omega)


def two_blades() -> Turbine:
    """Half of Hammond's helicopter, heavier, its blades on springs, in a vertical plane."""
    hammond = load_turbine("hammond")
    return hammond.with_model(RotorModel(2)).with_values(
        {
            "gravity": 9.81,
            "c_x": 4e3,
            "c_y": 4e3,
            "k_beta_1": 4e5,
            "k_beta_2": 4e5,
            "c_beta_1": 400.0,
            "c_beta_2": 400.0,
        }
    )


def simulated(turbine: Turbine, speed: float, start: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The nonlinear equations of motion in SciPy's hands: states (T, n)."""
    model, p = compiled(turbine)
    out, loads = np.empty(len(model.states)), np.zeros(len(model.loads))

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        model.rates(np.ascontiguousarray(x), np.array([speed * t, speed, 0.0]), p, loads, out)
        return out.copy()

    return np.asarray(
        solve_ivp(rates, (0.0, time[-1]), start, method="DOP853", rtol=1e-11, atol=1e-14, t_eval=time).y.T
    )


@pytest.mark.slow
def test_two_blades_vibrate_as_their_nonlinear_equations_do():
    # Neighbours of the periodic motion, a turn later, make the monodromy matrix without any Jacobian.
    turbine, speed = two_blades(), 24.0
    turn = 2 * math.pi / speed
    n = 2 * len(turbine.model.coordinates)
    settled = simulated(turbine, speed, np.zeros(n), np.array([0.0, 200 * turn]))[-1]
    step = 1e-5
    turns = np.array([turn])
    monodromy = np.column_stack([
        (simulated(turbine, speed, settled + d, turns)[-1] - simulated(turbine, speed, settled - d, turns)[-1])
        / (2 * step)
        for d in step * np.eye(n)
    ])  # fmt: skip
    found = analyse(turbine.model, *compiled(turbine), speed)
    assert found.method == "Floquet"
    multipliers = np.exp(np.concatenate([found.exponents, found.exponents.conj()]) * turn)
    distance = np.abs(multipliers[:, None] - np.linalg.eigvals(monodromy))
    assert len(multipliers) == n
    assert distance[linear_sum_assignment(distance)].max() < 1e-6


@pytest.mark.slow
def test_two_blades_are_felt_where_the_notes_say():
    # A free decay of the blades against each other: they feel f; the ground feels f + Ω forward, f − Ω backward (Ω − f
    # forward where f < Ω).
    turbine = isotropic_hub(two_blades())
    for speed in (12.0, 24.0):
        found = analyse(turbine.model, *compiled(turbine), speed)
        f = float(found.frequency[found.names.index("lag differential")])
        turning = speed / (2 * math.pi)
        start, time = np.zeros(8), np.arange(0.0, 20.0, 0.01)
        start[2:4] = 1e-3, -1e-3
        motion = simulated(turbine, speed, start, time) - simulated(turbine, speed, np.zeros(8), time)
        frequency = np.fft.fftfreq(8 * len(time), 0.01)
        blades, ground = (
            np.abs(np.fft.fft(np.hanning(len(time)) * v, 8 * len(time)))
            for v in (motion[:, 2] - motion[:, 3], motion[:, 0] + 1j * motion[:, 1])
        )
        assert abs(frequency[np.argmax(blades)]) == pytest.approx(f, abs=0.03)
        for line in (turning + f, turning - f):
            near, mirrored = np.abs(frequency - line) < 0.3, np.abs(frequency + line) < 0.3
            assert frequency[near][np.argmax(ground[near])] == pytest.approx(line, abs=0.05)
            assert ground[near].max() > 10 * ground[mirrored].max()


def test_floquet_and_coleman_meet_where_the_rotor_stands_still(verne555: Turbine):
    # As the turn slows down, what gravity does to the blades averages out.
    arguments = (verne555.model, *compiled(verne555))
    slow, standing = analyse(*arguments, 0.2), analyse(*arguments, 0.0, method="Coleman")
    np.testing.assert_allclose(slow.frequency[:3], standing.frequency[:3], rtol=2e-4)
    assert analyse(*arguments, 0.0).method == "constant"


@pytest.mark.parametrize("speed", [0.0, 7.0])
@pytest.mark.parametrize("blades", [2, 3])
def test_slopes_are_the_differences_of_exponents(verne555: Turbine, blades: int, speed: float):
    turbine = verne555.with_model(RotorModel(blades))
    model, p = compiled(turbine)
    directions = np.zeros((3, len(p)))
    for row, name in enumerate(("k_x", "c_beta_1", "blade_inertia_2")):
        directions[row, model.parameters.index(name)] = turbine.values[name]
    found = analyse(turbine.model, model, p, speed, directions)
    for i, direction in enumerate(directions):
        above, below = (analyse(turbine.model, model, p + e * direction, speed).exponents for e in (1e-5, -1e-5))
        np.testing.assert_allclose(found.slopes[:, i], (above - below) / 2e-5, atol=1e-5 * np.abs(found.slopes).max())


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, []),
        ({"gravity": 9.81}, ["gravity in the rotor plane"]),
        ({"c_beta_1": 0.0}, ["blades differ in c_beta"]),
        ({"eccentricity": 0.1, "blade_mass_2": 90.0}, ["blades differ in blade_mass", "an eccentric hub"]),
    ],
)
def test_where_colemans_transform_does_not_apply_is_said_in_words(changed: dict[str, float], why: list[str]):
    hammond = load_turbine("hammond").with_values(changed)
    assert hammond.model.modes().obstacles(hammond.values) == why
    assert analyse(hammond.model, *compiled(hammond), 25.0).method == ("Floquet" if why else "Coleman")
    assert RotorModel(2).modes().obstacles(hammond.values)[0] == "2 blades"
    assert RotorModel(4, lag="locked").modes().obstacles(hammond.values) == []


def test_a_round_whirl_of_the_support_is_named():
    hammond = isotropic_hub(load_turbine("hammond"))
    names = analyse(hammond.model, *compiled(hammond), 45.0).names
    assert {"tower forward", "tower backward"} <= set(names)


def test_bands_follow_from_the_covariance_by_the_delta_method(verne555: Turbine):
    # Locked blades: f = √(k/m) / 2π and ζ = c / 2√(km) have derivatives on paper.
    locked = verne555.with_model(RotorModel(3, lag="locked", y="locked")).with_values({"eccentricity": 0.0})
    model, p = compiled(locked)
    k, c, scale = 1800.0, 12.0, 300.0
    parameters = (Parameter("k_x", k, 0.3), Parameter("c_x", c, 4.0, False, scale))
    theta = np.array([0.0, c / scale])
    cov = np.array([[4e-4, 1e-5], [1e-5, 1e-5]])
    (mode,), _ = modes_with_slopes(locked.model, model, p, locked.rotor_speed, parameters, theta, cov)
    frequency, damping = math.sqrt(k / 14.5) / (2 * math.pi), c / (2 * math.sqrt(k * 14.5))
    to_frequency = np.array([frequency / 2, 0.0])
    to_damping = np.array([-damping / 2, damping * scale / c])
    assert mode.name == "tower x"
    for one, expected, slope in (
        (mode.frequency, frequency, to_frequency), (mode.damping_ratio, damping, to_damping)
    ):  # fmt: skip
        std = math.sqrt(slope @ cov @ slope)
        assert (one.estimate, one.reference) == pytest.approx((expected, expected), rel=1e-9)
        assert one.std == pytest.approx(std, rel=1e-3)
        assert (one.high - one.low) / 2 == pytest.approx(2.0 * one.std, rel=1e-9)
        assert (one.high + one.low) / 2 == pytest.approx(one.estimate, rel=1e-9)


def test_a_mode_speaks_in_plain_values_and_in_text():
    f = IntervalEstimate(1.0, 0.9, 1.1, 0.05, "Hz", "B", 1.01)
    mode = Mode("tower x", f, IntervalEstimate(0.02, 0.01, 0.03, 0.005, "1", "C"))
    assert mode.summary() == {
        "name": "tower x",
        "frequency": {
            "estimate": 1.0, "low": 0.9, "high": 1.1, "std": 0.05, "unit": "Hz", "grade": "B", "reference": 1.01,
        },
        "damping_ratio": {"estimate": 0.02, "low": 0.01, "high": 0.03, "std": 0.005, "unit": "1", "grade": "C"},
    }  # fmt: skip
    assert mode.cells() == ("tower x", "1.0000 ± 0.1000", "B", "2.00 ± 1.00", "C")
    small = replace(mode, damping_ratio=IntervalEstimate.normal(0.005, 0.0005, "1"))
    assert small.cells()[3:] == ("0.500 ± 0.100", "")
    vague = replace(small, damping_ratio=replace(IntervalEstimate.lognormal(0.0031, 1.4, "1"), grade="C"))
    assert vague.cells()[3:] == ("0.310 ± —", "C")
    wide = replace(small, damping_ratio=replace(IntervalEstimate.lognormal(0.0031, 0.7, "1"), grade="B"))
    assert wide.cells()[3:] == ("0.310 (0.076 … 1.257)", "B")
    assert (mode.trusted, small.trusted) == (False, True)
    assert mode.reference_cell() == "1.0100"
    assert replace(mode, frequency=replace(f, reference=None)).reference_cell() == ""
    assert "grade" not in small.summary()["damping_ratio"]
