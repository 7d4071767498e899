"""The equations of motion against the paper, against an independent derivation, and against conservation laws."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import eigh

from windsysid.errors import ConfigurationError
from windsysid.mechanics import RotorModel, compile_model
from windsysid.mechanics.equations import Equations, lagrange
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

# The paper's own letters (section 2).
m_H, m_B, h, w, d, e, eps, g, Omega, psi = sp.symbols("m_H m_B h w d e epsilon g Omega psi", real=True)  # noqa: N816
k_x, c_x, k_y, c_y, k_beta, c_beta = sp.symbols("k_x c_x k_y c_y k_beta c_beta", real=True)


def real(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)


def in_the_papers_letters(expression: sp.Expr, blades: int = 3) -> sp.Expr:
    """All blades alike and rectangular, both hub masses alike, Ω constant: what the paper assumes."""
    arm = d + h / 2
    meaning = {
        real("hub_mass_x"): m_H, real("hub_mass_y"): m_H, real("eccentricity"): e, real("eccentricity_angle"): eps,
        real("gravity"): g, real("hinge_offset"): d, real("rotor_speed"): Omega, real("rotor_azimuth"): psi,
        real("rotor_acceleration"): 0,
    }  # fmt: skip
    for i in range(1, blades + 1):
        meaning |= {
            real(f"blade_mass_{i}"): m_B,
            real(f"blade_first_moment_{i}"): m_B * arm,
            real(f"blade_inertia_{i}"): m_B * ((h**2 + w**2) / 12 + arm**2),
            real(f"k_beta_{i}"): k_beta,
            real(f"c_beta_{i}"): c_beta,
        }
    return expression.subs(meaning)


def the_papers_equations(plate: sp.Expr, blades: int = 3) -> list[sp.Expr]:
    """Left side minus right side of Eqs (11), (12) and (20) as PAPER_NOTES corrects them, plus our loads."""
    x, y, vx, vy, ax, ay = (real(n) for n in ("x", "y", "x_rate", "y_rate", "x_acc", "y_acc"))
    total, arm = blades * m_B + m_H, d + h / 2
    sum_11 = sum_12 = sp.Integer(0)
    lag_equations = []
    for i in range(1, blades + 1):
        beta, v, a = (real(f"beta_{i}{end}") for end in ("", "_rate", "_acc"))
        angle = 2 * sp.pi * (i - 1) / blades + psi + beta
        sum_11 += a * sp.sin(angle) + (Omega + v) ** 2 * sp.cos(angle)
        sum_12 += a * sp.cos(angle) - (Omega + v) ** 2 * sp.sin(angle)
        left = (
            (plate + arm**2) * m_B * a + c_beta * v + k_beta * beta
            + m_B * arm * d * Omega**2 * sp.sin(beta) + m_B * g * arm * sp.cos(angle)
        )  # fmt: skip
        lag_equations.append(left - m_B * arm * (ax * sp.sin(angle) - ay * sp.cos(angle)) - real(f"load_beta_{i}"))
    eq_11 = total * ax + c_x * vx + k_x * x - e * m_H * Omega**2 * sp.cos(eps + psi) - m_B * arm * sum_11
    eq_12 = total * ay + c_y * vy + k_y * y + total * g - e * m_H * Omega**2 * sp.sin(eps + psi) + m_B * arm * sum_12
    return [eq_11 - real("load_x"), eq_12 - real("load_y"), *lag_equations]


def residual(equations: Equations) -> sp.Matrix:
    """M a − F."""
    return equations.mass * sp.Matrix(equations.accelerations) - equations.force


def test_the_equations_are_the_papers_11_12_and_20():
    ours = residual(RotorModel(3, datum="unstressed").equations())
    corrected = the_papers_equations(plate=(h**2 + w**2) / 12)
    for row, paper in zip(ours, corrected, strict=True):
        assert sp.expand(sp.expand_trig(in_the_papers_letters(row) - paper)).simplify() == 0


def test_from_static_equilibrium_only_the_weight_on_y_is_gone():
    difference = residual(RotorModel(3, datum="unstressed").equations()) - residual(RotorModel(3).equations())
    expected = (0, (3 * m_B + m_H) * g, 0, 0, 0)
    assert [sp.simplify(in_the_papers_letters(row) - only) for row, only in zip(difference, expected, strict=True)] == [
        0
    ] * 5


def test_the_printed_inertia_is_larger_by_m_h_w_over_6(verne555: Turbine):
    lag = in_the_papers_letters(residual(RotorModel(3, datum="unstressed").equations())[2])
    ours = sp.expand(lag).coeff(real("beta_1_acc"))
    printed = sp.expand(the_papers_equations(plate=(h + w) ** 2 / 12)[2]).coeff(real("beta_1_acc"))
    assert sp.expand(printed - ours - m_B * h * w / 6) == 0
    scale_model = {m_B: 2.5, h: 2.5, w: 0.2, d: 0.2}
    assert float(ours.subs(scale_model)) == pytest.approx(6.566_666_667, rel=1e-9)
    assert float(printed.subs(scale_model)) == pytest.approx(6.775, rel=1e-12)
    assert verne555.values["blade_inertia_1"] == pytest.approx(float(ours.subs(scale_model)), rel=1e-14)


@pytest.mark.parametrize("rolling", ["tied", pytest.param("free", marks=pytest.mark.slow)])
def test_newton_and_euler_give_the_same_for_a_roll_that_leans_and_a_varying_speed(rolling: Literal["tied", "free"]):
    # d'Alembert with rigid bodies: Σ (m a · ∂r/∂q + I_c α ∂θ/∂q) is the generalised force. No Lagrangian, no first
    # moment and no moment about the link: each blade is a mass at S/m from its link with I − S²/m about its centre.
    t = sp.Symbol("t", real=True)
    model = RotorModel(2, roll=rolling, datum="unstressed")
    q = {name: sp.Function(name)(t) for name in model.coordinates}
    azimuth = sp.Function("rotor_azimuth")(t)
    roll = real("kappa") * q["x"] + q.get("roll", 0)
    external = {name: real(f"load_{name}") for name in q}
    for name, function in q.items():
        external[name] += -real(f"k_{name}") * function - real(f"c_{name}") * sp.diff(function, t)

    bodies = []  # (mass felt along x, along y, weight's mass, position, inertia about the centre, angle)
    unbalance = azimuth + roll + real("eccentricity_angle")
    hub = (
        q["x"] + real("eccentricity") * sp.cos(unbalance),
        q["y"] + real("eccentricity") * sp.sin(unbalance),
    )
    bodies.append((real("hub_mass_x"), real("hub_mass_y"), hub, real("roll_inertia"), roll))
    for i in (1, 2):
        mass, first, inertia = (real(f"blade_{n}_{i}") for n in ("mass", "first_moment", "inertia"))
        link, angle = azimuth + roll + sp.pi * (i - 1), azimuth + roll + sp.pi * (i - 1) + q[f"beta_{i}"]
        centre = (
            q["x"] + real("hinge_offset") * sp.cos(link) + first / mass * sp.cos(angle),
            q["y"] + real("hinge_offset") * sp.sin(link) + first / mass * sp.sin(angle),
        )
        bodies.append((mass, mass, centre, inertia - first**2 / mass, angle))

    independent = []
    for name, function in q.items():
        balance = -external[name]
        for mass_x, mass_y, (px, py), inertia, angle in bodies:
            balance += mass_x * sp.diff(px, t, 2) * sp.diff(px, function)
            balance += mass_y * (sp.diff(py, t, 2) + real("gravity")) * sp.diff(py, function)
            balance += inertia * sp.diff(angle, t, 2) * sp.diff(angle, function)
        independent.append(balance)

    plain: list[tuple[sp.Expr, sp.Symbol]] = []
    for derivative in (2, 1, 0):
        for name, function in q.items():
            end = ("", "_rate", "_acc")[derivative]
            plain.append((sp.diff(function, t, derivative) if derivative else function, real(name + end)))
        name = ("rotor_azimuth", "rotor_speed", "rotor_acceleration")[derivative]
        plain.append((sp.diff(azimuth, t, derivative) if derivative else azimuth, real(name)))
    equations = model.equations()
    ours = residual(equations)
    names = sorted({s.name for row in ours for s in row.free_symbols} | {"roll_inertia"})
    both = sp.lambdify([real(n) for n in names], [list(ours), [row.subs(plain) for row in independent]], "numpy")
    rng = np.random.default_rng(1)
    for _ in range(20):
        one, other = both(*rng.uniform(0.5, 2.0, len(names)))
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("rolling", ["locked", "tied", pytest.param("free", marks=pytest.mark.slow)])
def test_air_that_falls_with_a_sections_velocity_couples_hub_and_blades_by_its_virtual_work(
    rolling: Literal["locked", "tied", "free"],
):
    # The force −c_a v t on each blade, c_a = c/R, acts at R = I/S from the link of the blade; t is the tangent there
    # and v the velocity along it. Its work on a displacement of q is −c_a v t·∂r/∂q, with v = Σ t·∂r/∂q q̇. The
    # position r is written here and differentiated numerically, without the model's velocities. The model has the part
    # between hub and blades; the rest is in c_x … c_β.
    model = RotorModel(3, roll=rolling, air_couples=True)
    equations, names = model.equations(), model.coordinates
    rng = np.random.default_rng(5)
    symbols_of = (*equations.states, *equations.inputs, *equations.parameters, *equations.loads)
    values = {symbol.name: float(rng.uniform(0.5, 1.5)) for symbol in symbols_of}
    values |= {"kappa": -0.4, "c_hub_blade": 0.7, **{f"beta_{i}": 0.0 for i in (1, 2, 3)}}
    force = sp.lambdify([symbols_of], list(equations.force), "numpy")
    with_air, without = (
        np.array(force([(values | {"c_hub_blade": c})[symbol.name] for symbol in symbols_of])) for c in (0.7, 0.0)
    )

    def place(i: int, q: dict[str, float]) -> np.ndarray:
        lever = values[f"blade_inertia_{i}"] / values[f"blade_first_moment_{i}"]
        roll = q.get("roll", 0.0) + (0.0 if rolling == "locked" else values["kappa"] * q["x"])
        link = values["rotor_azimuth"] + 2.0 * math.pi * (i - 1) / 3.0 + roll
        along, leading = (np.array([math.cos(a), math.sin(a)]) for a in (link, link + q[f"beta_{i}"]))
        return np.array([q["x"], q["y"]]) + values["hinge_offset"] * along + lever * leading

    q = {name: values[name] for name in names}
    expected = np.zeros(len(names))
    for i in (1, 2, 3):
        turned = place(i, q) - [q["x"], q["y"]]
        tangent = np.array([-turned[1], turned[0]]) / np.linalg.norm(turned)
        slopes = np.array(
            [tangent @ (place(i, q | {n: q[n] + 1e-5}) - place(i, q | {n: q[n] - 1e-5})) / 2e-5 for n in names]
        )
        rates = np.array([values[f"{n}_rate"] for n in names])
        blade = np.array([n == f"beta_{i}" for n in names])
        c_a = 0.7 * values[f"blade_first_moment_{i}"] / values[f"blade_inertia_{i}"]
        hub_feels, blade_feels = c_a * (slopes[blade] @ rates[blade]), c_a * (slopes[~blade] @ rates[~blade])
        expected -= np.where(blade, slopes * blade_feels, slopes * hub_feels)
    np.testing.assert_allclose(with_air - without, expected, rtol=1e-8, atol=1e-9)
    assert np.abs(expected).min() > 0.01


def test_blades_that_lead_move_as_blades_further_round_whose_torque_is_held():
    # A torque k β₀ from outside holds each blade at the mean lag angle β₀, so that the spring works on what is beyond.
    plain, leading = RotorModel(2, roll="tied"), RotorModel(2, roll="tied", leads=True)
    ours, theirs = leading.equations(), plain.equations()
    rng = np.random.default_rng(11)
    symbols_of = (*ours.states, *ours.inputs, *ours.parameters, *ours.loads)
    values = {symbol.name: float(rng.uniform(0.5, 1.5)) for symbol in symbols_of}
    turned = values | {f"beta_{i}": values[f"beta_{i}"] + values["mean_lag_angle"] for i in (1, 2)}

    def found(equations: Equations, at: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        symbols = (*equations.states, *equations.inputs, *equations.parameters, *equations.loads)
        both = sp.lambdify([symbols], [list(equations.force), equations.mass.tolist()], "numpy")
        force, mass = both([at[symbol.name] for symbol in symbols])
        return np.array(force), np.array(mass)

    (force, mass), (other, same) = found(ours, values), found(theirs, turned)
    held = [values["mean_lag_angle"] * values.get(f"k_{name}", 0.0) for name in plain.coordinates]
    held = [torque if name.startswith("beta") else 0.0 for name, torque in zip(plain.coordinates, held, strict=True)]
    np.testing.assert_allclose(force, other + held, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(mass, same, rtol=1e-12, atol=1e-12)


def with_shaft_as_coordinate(model: RotorModel) -> tuple[Equations, sp.Expr]:
    """The rotor with ψ and Ω as states and the work done on it as one more, and its energy T + V.

    As a coordinate ψ has the generalised momentum ∂T/∂ψ̇, and the shaft's torque follows from Lagrange's equation
    for it.
    """
    kinematics, rotor = model.kinematics, model.equations()
    T, V = kinematics.kinetic_energy(), kinematics.potential_energy()
    torque = kinematics.rate(sp.diff(T, kinematics.omega)) - sp.diff(T, kinematics.psi) + sp.diff(V, kinematics.psi)
    load_power = sum(load * v for load, (_, v, _) in zip(rotor.loads, kinematics.triples, strict=True))
    return (
        replace(
            rotor,
            name="power",
            states=(*rotor.states, kinematics.psi, kinematics.omega, real("work")),
            rates=(*rotor.rates, kinematics.omega, kinematics.omega_dot, torque * kinematics.omega + load_power),
            inputs=(kinematics.omega_dot,),
        ),
        T + V,
    )


@pytest.mark.slow
def test_energy_changes_by_the_work_of_shaft_and_loads(verne555: Turbine):
    # Undamped, gravity on, roll free, Ω varying, loads on everything. All inputs are linear between samples, hence the
    # defect is the integrator's alone: of order 4, so it falls by 2⁴ or more when the step is halved.
    model = RotorModel(2, roll="free")
    equations, energy = with_shaft_as_coordinate(model)
    compiled = compile_model(equations)
    values = {**verne555.values, "roll_inertia": 3.0, "k_roll": 9000.0, "kappa": -0.3}
    values |= {name: 0.0 for name in values if name.startswith("c_")}
    p = [values[name] for name in compiled.parameters]
    rng = np.random.default_rng(2)
    samples, rate = 201, 20.0
    inputs = np.column_stack([rng.normal(0.0, 1.0, samples), rng.normal(0.0, 10.0, (samples, 5))])
    start = np.concatenate([0.02 * rng.standard_normal(10), [0.3, verne555.rotor_speed, 0.0]])
    stored = sp.lambdify([(*equations.states, *equations.parameters)], energy, "numpy")

    def imbalance(substeps: int) -> tuple[float, float]:
        states = integrate(compiled, p, inputs, rate=rate, start=start, substeps=substeps).states
        E = stored([*states.T, *p])
        return float(np.abs(E - E[0] - states[:, -1]).max()), float(np.ptp(states[:, -1]))

    defects, exchanged = zip(*(imbalance(substeps) for substeps in (32, 64, 128)), strict=True)
    assert defects[-1] < 1e-7 * exchanged[-1]
    for coarse, fine in pairwise(defects):
        assert coarse / fine > 2**4


@pytest.mark.parametrize("blades", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_the_jacobi_integral_is_conserved_over_1000_revolutions_and_energy_is_not(verne555: Turbine, blades: int):
    # Isotropic, gravity-free, undamped, unloaded: seen from the turning frame nothing depends on time, so
    # J = E − Ω (∂T/∂ψ̇ + x p_y − y p_x) is constant; Ω is prescribed, so the shaft does work and E is not.
    model = RotorModel(blades)
    kinematics = model.kinematics
    T, V = kinematics.kinetic_energy(), kinematics.potential_energy()
    (x, vx, _), (y, vy, _) = kinematics.triples[:2]
    spin = sp.diff(T, kinematics.omega) + x * sp.diff(T, vy) - y * sp.diff(T, vx)
    compiled = compile_model(model)
    values = {**verne555.values, "gravity": 0.0, "k_y": verne555.values["k_x"]}
    values |= {
        name.replace("_1", f"_{i}"): value
        for name, value in verne555.values.items()
        for i in range(1, blades + 1)
        if name.endswith("_1")
    }
    values |= {name: 0.0 for name in values if name.startswith("c_")}
    p = [values[name] for name in compiled.parameters]
    rate = 20.0
    revolutions = constant_speed_inputs(verne555.rotor_speed, 1000 * 2 * math.pi / verne555.rotor_speed, rate)
    inputs = np.column_stack([revolutions, np.zeros((len(revolutions), blades + 2))])
    rng = np.random.default_rng(3)
    n = len(model.coordinates)
    start = np.concatenate([0.02 * rng.standard_normal(n), 0.2 * rng.standard_normal(n)])
    arguments = (*compiled.states, *compiled.inputs, *compiled.parameters)
    both = sp.lambdify([[real(name) for name in arguments]], [T + V, T + V - kinematics.omega * spin], "numpy")

    def spans(substeps: int) -> tuple[float, float]:
        states = integrate(compiled, p, inputs, rate=rate, start=start, substeps=substeps).states
        E, J = both([*states.T, *revolutions.T, *p])
        return float(np.ptp(E)), float(np.ptp(J))

    # Measured for three blades: J drifts by 0.042, 0.0013, 0.000041 J; E swings by 59 J.
    (energy, coarse), (_, fine), (_, finer) = (spans(substeps) for substeps in (10, 20, 40))
    assert coarse / fine > 2**4
    assert fine / finer > 2**4
    assert finer < 1e-5 * energy


def test_at_rest_a_partly_free_roll_has_the_modes_of_a_mass_matrix_written_by_hand():
    # Small motion about ψ = 0.4 without gravity: T = ½ m_x ẋ² + ½ J r² + Σ ½ I β̇² + β̇ [(I + d S) ṙ − S sin θ ẋ] with
    # ṙ = κ ẋ + ρ̇; the hub's own coupling of x and ṙ is Σ −(d m + S) sin θ = 0. V is diagonal.
    turbine = load_turbine("nrel5mw_full").with_values({"gravity": 0.0})
    v, psi = turbine.values, 0.4
    d, kappa, m, S, inertia = (
        v[n] for n in ("hinge_offset", "kappa", "blade_mass_1", "blade_first_moment_1", "blade_inertia_1")
    )
    turning = v["roll_inertia"] + 3 * (inertia + 2 * d * S + m * d**2)
    lean = np.array([[1.0, 0.0], [kappa, 1.0]])  # (x, ρ) to (x, r)
    mass = np.zeros((5, 5))
    mass[:2, :2] = np.diag([v["hub_mass_x"] + 3 * m, turning])
    mass[2:, 2:] = inertia * np.eye(3)
    mass[2:, 0] = -S * np.sin(psi + 2 * np.pi * np.arange(3) / 3)
    mass[2:, 1] = inertia + d * S
    mass[:2, 2:] = mass[2:, :2].T
    to_r = np.eye(5)
    to_r[:2, :2] = lean
    by_hand = eigh(np.diag([v["k_x"], v["k_roll"], *[v["k_beta_1"]] * 3]), to_r.T @ mass @ to_r, eigvals_only=True)

    model = compile_model(turbine.model)
    p = np.array([v[name] for name in model.parameters])
    A, B, G = np.zeros((10, 10)), np.zeros((10, 0)), np.zeros((10, 5))
    model.rates_jacobian(np.zeros(10), np.array([psi, 0.0, 0.0]), p, np.zeros(5), np.empty(10), A, B, G)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(-A[5:, :5]).real), by_hand, rtol=1e-10)
    for k, name in enumerate(("x", "roll")):
        assert turbine.inertia(name) == pytest.approx((lean.T @ mass[:2, :2] @ lean)[k, k], rel=1e-12)


def test_every_combination_of_free_and_locked_has_its_states_and_loads():
    model = RotorModel(2, y="locked", roll="free")
    assert model.coordinates == ("x", "roll", "beta_1", "beta_2")
    assert model.states == (*model.coordinates, "x_rate", "roll_rate", "beta_1_rate", "beta_2_rate")
    assert model.loads == ("load_x", "load_roll", "load_beta_1", "load_beta_2")
    assert RotorModel(3).coefficients == (
        "k_x", "c_x", "k_y", "c_y", "k_beta_1", "c_beta_1", "k_beta_2", "c_beta_2", "k_beta_3", "c_beta_3"
    )  # fmt: skip
    equations = model.equations()
    assert tuple(s.name for s in equations.states) == model.states
    assert tuple(s.name for s in equations.loads) == model.loads


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"blades": 0}, "expected 1 or more, got 0"),
        ({"roll": "tied", "x": "locked"}, "x is locked"),
        ({"x": "locked", "y": "locked", "lag": "locked"}, "every degree of freedom is locked"),
    ],
)
def test_a_rotor_that_cannot_be_is_refused(options: dict[str, object], complaint: str):
    with pytest.raises(ConfigurationError, match=complaint):
        RotorModel(**options)  # type: ignore[arg-type]


def test_damping_is_passive_work_in_every_degree_of_freedom():
    model = RotorModel(2, roll="free")
    equations = model.equations()
    undamped = equations.force.subs({real(name): 0 for name in model.coefficients if name.startswith("c_")})
    expected = [-real(f"c_{name}") * real(f"{name}_rate") for name in model.coordinates]
    assert list((equations.force - undamped).expand()) == expected


def test_lagrange_gives_a_pendulum_whose_pivot_is_driven():
    # Pivot height s(t) is an input: (g + s̈) takes the place of g.
    phi, v, a, length, s, s1, s2, load = (real(n) for n in ("phi", "v", "a", "length", "s", "s1", "s2", "load"))
    height, speed = s - length * sp.cos(phi), s1 + length * v * sp.sin(phi)
    L = ((length * v * sp.cos(phi)) ** 2 + speed**2) / 2 - real("g") * height
    pendulum = lagrange(
        "pendulum",
        lagrangian=L,
        dissipation=sp.Integer(0),
        coordinates=[(phi, v, a)],
        loads=[load],
        inputs={s: s1, s1: s2, s2: sp.Integer(0)},
        parameters=[length, real("g")],
    )
    expected = length**2 * a + length * (real("g") + s2) * sp.sin(phi) - load
    assert sp.simplify(residual(pendulum)[0] - expected) == 0


def test_the_packaged_turbines_have_a_value_for_every_parameter():
    for name in ("verne555", "nrel5mw", "nrel5mw_full", "hammond"):
        turbine = load_turbine(name)
        assert set(turbine.rotor.kinematics.parameters) == set(turbine.values)
        assert all(isinstance(load, GaussMarkov) for load in turbine.loads)
