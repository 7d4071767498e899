"""Generated kernels: exact Jacobians, models of any kind, errors for what cannot be compiled, the cache."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import sympy as sp

from tests.mechanics.models import CHAIN_VALUES, Reads, bouc_wen, chain, chain_sensors, duffing, symbols
from windsysid.errors import ConfigurationError
from windsysid.kernels.jit import LANE_JACOBIAN
from windsysid.kernels.simd import LANES, vectors
from windsysid.mechanics import CompiledModel, RotorModel, compile_model
from windsysid.mechanics.equations import Equations, lagrange
from windsysid.mechanics.sensors import (
    Accelerometer,
    AngularRateSensor,
    DisplacementSensor,
    MomentSensor,
    PlacedSensor,
    StrainGauge,
    VelocitySensor,
)
from windsysid.simulation.integrate import integrate
from windsysid.turbine.file import load_turbine, packaged_turbines
from windsysid.turbine.turbine import Turbine

RICH: tuple[PlacedSensor, ...] = (
    Accelerometer(channel="a", point="tower", axis="x", frame="tower_top", position=(0.4, -0.3),
           feels_gravity=True, noise=1.0),
    Accelerometer(channel="b", point="tower", axis="y", noise=1.0),
    Accelerometer(channel="c", point="blade_1", axis="tangential", frame="blade",
           position=(1.7, 0.2), deflection=1.9, slope=1.6, feels_gravity=True, noise=1.0),
    Accelerometer(channel="d", point="blade_2", axis="span", frame="blade", position=(1.1, -0.1),
           gain=-2.5, noise=1.0),
    Accelerometer(channel="e", point="blade_1", axis="x", position=(1.1, 0.0), noise=1.0),
    VelocitySensor(channel="f", point="blade_2", axis="y", frame="tower_top", position=(0.9, 0.1),
    noise=1.0), DisplacementSensor(channel="g", point="blade_2", axis="lag", noise=1.0),
    AngularRateSensor(channel="h", point="blade_1", axis="lag", noise=1.0),
    AngularRateSensor(channel="i", point="tower", axis="x", noise=1.0),
    MomentSensor(channel="j", point="blade_2", axis="lag", noise=1.0),
    StrainGauge(channel="k", point="tower", axis="x", gain=3e-3, noise=1.0),
)  # fmt: skip

ROTORS = [
    RotorModel(3, roll="tied"), RotorModel(4, roll="locked"), RotorModel(3, lag="locked"),
    *(
        pytest.param(rotor, marks=pytest.mark.slow)
        for rotor in (
            RotorModel(2, roll="free"), RotorModel(2, roll="tied"), RotorModel(2, roll="locked"),
            RotorModel(2, y="locked", roll="tied"),
            RotorModel(3, roll="free"), RotorModel(3, roll="locked"), RotorModel(3, y="locked", roll="free"),
            RotorModel(3, x="locked", roll="free"), RotorModel(4, roll="free"), RotorModel(4, roll="tied"),
        )
    ),
]  # fmt: skip


every_roll = pytest.mark.parametrize(
    "rotor",
    [
        RotorModel(3, roll="tied"),
        *(pytest.param(RotorModel(blades, roll="free"), marks=pytest.mark.slow) for blades in (2, 3, 4)),
    ],
    ids=lambda rotor: name_of(rotor),
)


def name_of(model: RotorModel) -> str:
    locked = "".join(f"-{n}_locked" for n in ("x", "y", "lag") if getattr(model, n) == "locked")
    return f"{model.blades}-roll_{model.roll}{locked}"


def in_numpy(model: CompiledModel) -> dict[str, Any]:
    """The generated Python itself, undecorated, with NumPy's functions, so that it takes complex numbers."""
    assert model.module.__file__ is not None
    return _in_numpy(model.module.__file__)


@cache
def _in_numpy(path: str) -> dict[str, Any]:
    namespace: dict[str, Any] = {}
    exec(compile(Path(path).read_text(encoding="utf-8"), path, "exec"), namespace)
    namespace.update({name: getattr(np, name) for name in ("cos", "exp", "log", "sin", "sqrt", "tan", "tanh")})
    return namespace


def everything_identified(model: RotorModel) -> CompiledModel:
    sensors = RICH if model.lag == "free" else tuple(s for s in RICH if s.quantity not in ("moment", "strain"))
    if model.x == "locked":
        sensors = tuple(s for s in sensors if s.quantity != "strain")
    return compile_model(model, sensors, tuple(model.kinematics.parameters))


def arguments(model: CompiledModel, rng: np.random.Generator) -> list[np.ndarray]:
    """Random x, u, p, w of order one with a positive definite mass matrix (I > S²/m)."""
    p = rng.uniform(0.5, 1.5, len(model.parameters))
    for i, name in enumerate(model.parameters):
        if name.startswith(("hub_mass", "roll_inertia", "blade_mass", "blade_inertia")):
            p[i] += 2.0
    return [
        rng.uniform(-1.0, 1.0, len(model.states)),
        rng.uniform(-3.0, 3.0, len(model.inputs)),
        p,
        rng.uniform(-1.0, 1.0, len(model.loads)),
    ]


def sizes(model: CompiledModel, kernel: str) -> int:
    return len(model.states) if kernel == "rates" else model.readings


def by_complex_step(
    model: CompiledModel, kernel: str, args: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """∂/∂x, ∂/∂p (identified), ∂/∂w of a value kernel, exact to rounding."""
    function = in_numpy(model)[kernel]
    rows = sizes(model, kernel)
    blocks = []
    for which, columns in (
        (0, range(len(model.states))),
        (2, [model.parameters.index(name) for name in model.identified]),
        (3, range(len(model.loads))),
    ):
        block = np.empty((rows, len(columns)))
        for j, column in enumerate(columns):
            moved = [a.astype(complex) for a in args]
            moved[which][column] += 1e-40j
            value = np.empty(rows, dtype=complex)
            function(*moved, value)
            block[:, j] = value.imag / 1e-40
        blocks.append(block)
    return blocks[0], blocks[1], blocks[2]


def jacobians(
    model: CompiledModel, kernel: str, args: list[np.ndarray], function: Any = None
) -> tuple[np.ndarray, list[np.ndarray]]:
    rows = sizes(model, kernel)
    value = np.empty(rows)
    blocks = [np.zeros((rows, n)) for n in (len(model.states), len(model.identified), len(model.loads))]
    (function or in_numpy(model)[f"{kernel}_jacobian"])(*args, value, *blocks)
    return value, blocks


@pytest.mark.parametrize("kernel", ["rates", "reading"])
@pytest.mark.parametrize("rotor", ROTORS, ids=name_of)
def test_jacobians_equal_complex_step_derivatives(rotor: RotorModel, kernel: str):
    model = everything_identified(rotor)
    rng = np.random.default_rng(4)
    for _ in range(3):
        args = arguments(model, rng)
        _, blocks = jacobians(model, kernel, args)
        for block, exact in zip(blocks, by_complex_step(model, kernel, args), strict=True):
            # 1e-10 relative; what is small beside its own column is held to 1e-10 of that column's size at most
            size = np.abs(exact).max(axis=0, keepdims=True, initial=0.0)
            assert np.all(np.abs(block - exact) <= 1e-10 * np.maximum(np.abs(exact), 1e-3 * size))


@pytest.mark.parametrize("kernel", ["rates", "reading"])
@pytest.mark.parametrize("rotor", ROTORS, ids=name_of)
def test_value_kernels_equal_the_values_of_jacobian_kernels(rotor: RotorModel, kernel: str):
    model = everything_identified(rotor)
    args = arguments(model, np.random.default_rng(5))
    alone = np.empty(sizes(model, kernel))
    in_numpy(model)[kernel](*args, alone)
    together, _ = jacobians(model, kernel, args)
    # another order of common subexpressions: rounding only
    np.testing.assert_allclose(together, alone, rtol=1e-14, atol=1e-14 * np.abs(alone).max())


@every_roll
def test_every_parameter_of_the_rotor_is_seen_by_the_rates_or_the_readings(rotor: RotorModel):
    # Otherwise the Jacobian test would compare zeros with zeros.
    model = everything_identified(rotor)
    args = arguments(model, np.random.default_rng(6))
    seen = sum(np.abs(jacobians(model, kernel, args)[1][1]).max(axis=0) for kernel in ("rates", "reading"))
    unseen = {name for name, slope in zip(model.identified, seen, strict=True) if slope == 0.0}
    assert unseen == ({"k_roll", "c_roll"} if rotor.roll == "tied" else set())


def test_compiled_kernels_compute_what_the_generated_python_says(verne555: Turbine):
    model = compile_model(verne555.model, verne555.sensors, verne555.model.coefficients)
    args = arguments(model, np.random.default_rng(7))
    for kernel in ("rates", "reading"):
        value, blocks = jacobians(model, kernel, args)
        compiled_value, compiled_blocks = jacobians(model, kernel, args, getattr(model, f"{kernel}_jacobian"))
        np.testing.assert_allclose(compiled_value, value, rtol=1e-12, atol=1e-13)
        for one, other in zip(compiled_blocks, blocks, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)
        alone = np.empty(sizes(model, kernel))
        getattr(model, kernel)(*args, alone)
        np.testing.assert_allclose(alone, compiled_value, rtol=1e-13, atol=1e-14)


_f1, _f2, _f3 = (numba.types.Array(numba.types.float64, d, "C") for d in (1, 2, 3))


@numba.njit(numba.types.void(numba.types.FunctionType(LANE_JACOBIAN), _f2, _f1, _f2, _f2, _f2, _f3, _f3, _f3))  # once
def of_lanes(kernel, x, u, p, w, value, dx, dp, dw):
    kernel(
        vectors(x), u, vectors(p), vectors(w), vectors(value), vectors(dx), vectors(dp), vectors(dw)
    )  # fmt: skip


def everything() -> Equations:
    """Every function that vectors have, of states and of inputs."""
    x, v, u, a, b, w = symbols("x v u a b w")
    branch = sp.Piecewise((sp.exp(-x), (x > 0) & (v < 1)), (x * v, x < -0.5), (1, True))
    return Equations(
        "everything", (x, v), (u,), (a, b), (w,),
        (
            sp.exp(-(x**2)) * abs(v) ** a + sp.tanh(b * v) + sp.sin(x + u) * sp.cos(u) ** 2 / (2 + sp.cos(3 * x)),
            sp.Max(x, u) ** 3 + sp.sqrt(a + v**2) * sp.log(b) - sp.Heaviside(v) * sp.atan2(v,
            a) + sp.sign(x) * branch + w,
        ),
    )  # fmt: skip


PACKAGED = [load_turbine(name) for name in packaged_turbines()]


@pytest.mark.parametrize(
    ("model", "sensors"),
    [
        *(
            pytest.param(
                turbine.model, turbine.sensors, marks=[pytest.mark.slow] if turbine.name.startswith("nrel5mw") else []
            )
            for turbine in PACKAGED
        ),
        pytest.param(RotorModel(3, roll="tied"), RICH, marks=pytest.mark.slow),
        (chain(), chain_sensors()), (duffing(), ()), (bouc_wen(), ()), (everything(), ()),
    ],
    ids=lambda value: getattr(value, "name", None),
)  # fmt: skip
def test_kernels_of_lanes_compute_what_the_kernels_say(model: Any, sensors: tuple[Any, ...]):
    compiled = compile_model(model, sensors)
    rng = np.random.default_rng(9)
    lanes = [arguments(compiled, rng) for _ in range(LANES)]
    u = lanes[0][1]
    x, _, p, w = (np.ascontiguousarray(np.stack(arrays, axis=-1)) for arrays in zip(*lanes, strict=True))
    for kernel in ("rates", "reading"):
        rows = sizes(compiled, kernel)
        found = [
            np.zeros((rows, *columns, LANES)) for columns in ((), (len(compiled.states),), (0,), (len(compiled.loads),))
        ]
        of_lanes(getattr(compiled, f"{kernel}_of_lanes"), x, u, p, w, *found)
        for lane, (own_x, _, own_p, own_w) in enumerate(lanes):
            value, blocks = jacobians(
                compiled, kernel, [own_x, u, own_p, own_w], getattr(compiled, f"{kernel}_jacobian")
            )
            for one, other in zip(found, (value, *blocks), strict=True):
                np.testing.assert_allclose(
                    one[..., lane], other, rtol=1e-12, atol=1e-12 * np.abs(other).max(initial=1.0)
                )


@every_roll
def test_implicit_accelerations_solve_the_equations_of_motion(rotor: RotorModel):
    # The kernel's own factorisation against numpy.linalg.solve of the symbolic M and F.
    equations, model = rotor.equations(), everything_identified(rotor)
    n = len(equations.accelerations)
    args = arguments(model, np.random.default_rng(8))
    flat = sp.lambdify(
        [(*equations.states, *equations.inputs, *equations.parameters, *equations.loads)],
        [equations.mass, equations.force],
        "numpy",
    )
    mass, force = flat(np.concatenate(args))
    rates = np.empty(len(model.states))
    in_numpy(model)["rates"](*args, rates)
    np.testing.assert_allclose(rates[n:], np.linalg.solve(mass, force).ravel(), rtol=1e-11)
    np.testing.assert_array_equal(rates[:n], args[0][n:])


def test_a_users_chain_of_masses_moves_as_the_matrix_exponential():
    model = compile_model(chain(), chain_sensors(), ("k_1", "m_2", "c_3"))
    p = np.array([CHAIN_VALUES[name] for name in model.parameters])
    A = np.zeros((6, 6))
    G = np.zeros((6, 3))
    rows, B = np.empty(6), np.zeros((6, 3))
    model.rates_jacobian(np.zeros(6), np.zeros(0), p, np.zeros(3), rows, A, B, G)
    m, k, c = (np.array([CHAIN_VALUES[f"{n}_{i}"] for i in (1, 2, 3)]) for n in "mkc")
    assemble = lambda s: np.array([[s[0] + s[1], -s[1], 0], [-s[1], s[1] + s[2], -s[2]], [0, -s[2], s[2]]])  # noqa: E731
    expected = np.block([[np.zeros((3, 3)), np.eye(3)], [-assemble(k) / m[:, None], -assemble(c) / m[:, None]]])
    np.testing.assert_allclose(A, expected, rtol=1e-14, atol=1e-12)
    start = np.array([0.1, -0.05, 0.2, 0.0, 1.0, -0.5])
    load = np.array([3.0, 0.0, -2.0])
    response = integrate(model, p, np.tile(load, (201, 1)), rate=100.0, start=start, substeps=40)
    exact = scipy.linalg.expm(2.0 * np.block([[expected, (G @ load)[:, None]], [np.zeros((1, 7))]])) @ [*start, 1.0]
    np.testing.assert_allclose(response.states[-1], exact[:6], rtol=1e-8, atol=1e-9)
    assert response.readings[0, 0] == pytest.approx((expected[3] @ start) + load[0] / m[0], rel=1e-13)


def test_a_duffing_oscillator_agrees_with_scipy():
    equations = duffing()
    q, _ = equations.states
    model = compile_model(equations, (Reads("cubed", q**3),), ("b",))
    a, b, c = 4.0, 30.0, 0.3
    time = np.arange(1001) * 0.01
    force = 5.0 * (time / 5.0) - 2.0  # a ramp, exact between samples
    response = integrate(model, [a, b, c], force[:, None], rate=100.0, start=[0.5, 0.0], substeps=8)
    exact = scipy.integrate.solve_ivp(
        lambda t, x: [x[1], t - 2.0 - c * x[1] - a * x[0] - b * x[0] ** 3],
        (0.0, 10.0), [0.5, 0.0], method="DOP853", t_eval=time, rtol=1e-10, atol=1e-12,
    ).y.T  # fmt: skip
    np.testing.assert_allclose(response.states, exact, atol=1e-7 * np.abs(exact).max())
    np.testing.assert_allclose(response.readings[:, 0], response.states[:, 0] ** 3, rtol=1e-14)


def test_a_hysteretic_oscillator_agrees_with_scipy_and_dissipates():
    model = compile_model(bouc_wen(), (), ("alpha", "beta", "gamma"))
    p = np.array([1.0, 0.1, 10.0, 0.2, 1.0, 3.0, 2.0])
    time = np.arange(1001) * 0.01
    load = np.zeros((1001, 1))
    start = np.array([0.0, 3.0, 0.0])
    response = integrate(model, p, load, rate=100.0, start=start, substeps=20)
    m, c, k, alpha, A, beta, gamma = p

    def rates(_: float, x: np.ndarray) -> list[float]:
        q, v, z = x
        return [
            v,
            (-c * v - alpha * k * q - (1 - alpha) * k * z) / m,
            A * v - beta * abs(v) * abs(z) * z - gamma * v * z * z,
        ]

    exact = scipy.integrate.solve_ivp(rates, (0.0, 10.0), start, method="DOP853", t_eval=time, rtol=1e-10, atol=1e-12)
    # |v| has kinks, at which a fixed step falls back to low order: 1e-6 instead of 1e-9
    np.testing.assert_allclose(response.states, exact.y.T, atol=2e-6 * np.abs(exact.y).max())
    x, v, value = np.array([0.4, -0.7, 0.2]), np.zeros(0), np.empty(3)
    J = [np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 1))]
    model.rates_jacobian(x, v, p, np.array([0.3]), value, *J)
    for j in range(3):
        ahead, behind = np.empty(3), np.empty(3)
        for sign, out in ((1.0, ahead), (-1.0, behind)):
            model.rates(x + sign * 1e-6 * np.eye(3)[j], v, p, np.array([0.3]), out)
        np.testing.assert_allclose(J[0][:, j], (ahead - behind) / 2e-6, rtol=1e-7, atol=1e-8)


def test_powers_of_a_magnitude_have_derivatives_where_it_vanishes():
    # d/dz |z|ⁿ⁻¹ z = n |z|ⁿ⁻¹ and d/dn |z|ⁿ = |z|ⁿ log |z| go to 0 with z; written naively they are 0/0 and 0 · −∞
    # there
    z, v = symbols("z v")
    n = sp.Symbol("n", positive=True)
    model = compile_model(
        Equations("power", (z, v), (), (n,), (), (v - abs(v) * abs(z) ** (n - 1) * z, -v * abs(z) ** n)), (), ("n",)
    )
    for at, power in ((0.0, 2.0), (0.0, 1.1), (0.3, 1.7), (-0.3, 1.7)):
        value, J = np.empty(2), [np.zeros((2, 2)), np.zeros((2, 1)), np.zeros((2, 0))]
        model.rates_jacobian(np.array([at, 0.8]), np.zeros(0), np.array([power]), np.zeros(0), value, *J)
        size = abs(at)
        np.testing.assert_allclose(value, [0.8 * (1.0 - np.sign(at) * size**power), -0.8 * size**power], atol=1e-15)
        np.testing.assert_allclose(
            J[0][:, 0],
            [-0.8 * power * size ** (power - 1.0), -0.8 * power * np.sign(at) * size ** (power - 1.0)],
            atol=1e-2 if at == 0.0 else 1e-14,
        )
        slope = size**power * np.log(size) if size else 0.0
        np.testing.assert_allclose(J[1][:, 0], [-0.8 * np.sign(at) * slope, -0.8 * slope], atol=1e-14)


@pytest.mark.parametrize("name", ["atan", "asin", "acos", "erf", "tanh", "sqrt", "sign", "Heaviside"])
def test_functions_of_friction_and_saturation_compile(name: str):
    x = symbols("x")[0]
    expression = getattr(sp, name)(x)
    model = compile_model(Equations("curve", (x,), (), (), (), (expression,)))
    value = np.empty(1)
    model.rates(np.array([0.4]), np.zeros(0), np.zeros(0), np.zeros(0), value)
    assert value[0] == pytest.approx(float(expression.subs(x, 0.4)), rel=1e-14)


def test_a_derivative_that_is_no_function_is_refused_in_one_line():
    x = sp.Symbol("x")  # not declared real: d|x|/dx is no function then
    with pytest.raises(ConfigurationError, match="declared with real=True") as error:
        compile_model(Equations("complex", (x,), (), (), (), (-abs(x),)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["class", "two words", "pi", "sin", "_hidden", "k-1", "1st"])
def test_a_name_that_is_no_python_variable_is_refused(name: str):
    x, k = symbols("x")[0], sp.Symbol(name, real=True)
    with pytest.raises(ConfigurationError, match="expected names fit for Python variables, got"):
        Equations("odd", (x,), (), (k,), (), (-k * x,))
    with pytest.raises(ConfigurationError, match="expected names fit for Python variables, got"):
        Equations("odd", (x,), (), (), (), (k,), (k,), sp.eye(1), sp.ones(1, 1))


def test_text_is_never_executed_as_an_expression(tmp_path: Path):
    x, v, a = symbols("x v a")
    trap = tmp_path / "sprung"
    code = f"__import__('pathlib').Path({str(trap)!r}).touch()"
    attempts = (
        lambda: Equations("text", (x,), (), (), (), (code,)),
        lambda: Equations("text", (code,), (), (), (), (x,)),
        lambda: Equations("text", (x,), (), (), (), (sp.Symbol(code),)),
        lambda: Equations("text", (x,), (), (), (), (sp.Function(code)(x),)),
        lambda: Equations("text", (x,), (), (), (), (a,), (a,), code, sp.ones(1, 1)),
        lambda: lagrange("text", lagrangian=code, dissipation=v**2, coordinates=[(x, v, a)], loads=[0], inputs={},
        parameters=()),
        lambda: lagrange("text", lagrangian=v**2, dissipation=code, coordinates=[(x, v, a)], loads=[0], inputs={},
        parameters=()),
        lambda: compile_model(Equations("text", (x,), (), (), (), (-x,)), (Reads("reads", code),)),
        lambda: compile_model(Equations("text", (x,), (), (), (), (-x,)), (Reads("reads", sp.Symbol(code)),)),
        lambda: Equations(f'"""\n{code}\n"""', (x,), (), (), (), (x,)),
    )  # fmt: skip
    for attempt in attempts:
        with pytest.raises(ConfigurationError) as refusal:
            attempt()
        assert "\n" not in str(refusal.value)
        assert not trap.exists()
    compile_model(Equations(f'""" {code}; """', (x,), (), (), (), (-x,)))  # a name may hold anything that prints
    assert not trap.exists()


def test_symbols_that_only_look_alike_are_refused():
    # SymPy takes them for two: derivatives to the declared one would silently be zero
    x = symbols("x")[0]
    with pytest.raises(ConfigurationError, match="use the same SymPy symbol"):
        Equations("alike", (x,), (), (), (), (-sp.Symbol("x"),))
    with pytest.raises(ConfigurationError, match="'k' in an expression is no state"):
        Equations("undeclared", (x,), (), (), (), (-sp.Symbol("k", real=True) * x,))
    with pytest.raises(ConfigurationError, match="got 'x' twice"):
        Equations("twice", (x,), (), (x,), (), (-x,))


def test_an_unknown_or_repeated_parameter_to_identify_is_refused():
    with pytest.raises(ConfigurationError, match="no parameter 'k_4' to identify: expected one of m_1"):
        compile_model(chain(), (), ("k_4",))
    with pytest.raises(ConfigurationError, match="listed twice"):
        compile_model(chain(), (), ("k_1", "k_1"))


def test_equations_of_unequal_length_are_refused():
    x, v = symbols("x v")
    with pytest.raises(ValueError, match="expected one rate per state, got 1 rates for 2 states"):
        Equations("short", (x, v), (), (), (), (v,))
    with pytest.raises(ValueError, match="expected M 1 × 1 and F 1 × 1"):
        Equations("short", (x,), (), (), (), (v,), accelerations=(v,))


COMPILE = """
import sys
from windsysid.mechanics import compile_model
from windsysid.turbine.file import load_turbine
turbine = load_turbine("verne555")
model = compile_model(turbine.model, turbine.sensors, turbine.model.coefficients)
print(len(model.states), model.readings, "sympy" in sys.modules)
"""


def in_a_fresh_process(cache: Path) -> str:
    environment = os.environ | {"WINDSYSID_CACHE": str(cache)}
    shown = subprocess.run([sys.executable, "-c", COMPILE], capture_output=True, text=True, check=True, env=environment)
    return shown.stdout.strip()


def test_a_cached_model_is_not_derived_again(tmp_path: Path):
    assert in_a_fresh_process(tmp_path) == "10 5 True"
    assert in_a_fresh_process(tmp_path) == "10 5 False"
    assert len(list(tmp_path.glob("model_*.py"))) == 1
    assert not list(tmp_path.glob("*.tmp"))


@pytest.mark.slow
def test_without_a_cache_folder_models_are_compiled_all_the_same(tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    assert in_a_fresh_process(tmp_path / "file" / "cache") == "10 5 True"


def test_models_that_differ_do_not_share_a_kernel(verne555: Turbine):
    first = verne555.sensors[0]
    models = [
        compile_model(verne555.model, (first,)),
        compile_model(verne555.model, (first.model_copy(update={"gain": 2.0}),)),
        compile_model(verne555.model, (first,), ("k_x",)),
        compile_model(RotorModel(3, datum="unstressed"), (first,)),
    ]
    assert len({id(model.module) for model in models}) == 4
    quieter = first.model_copy(update={"noise": 9.0, "channel": "other"})
    assert compile_model(verne555.model, (quieter,)) is models[0]


def test_the_same_request_gives_the_same_object():
    assert compile_model(chain(), chain_sensors(), ("k_1",)) is compile_model(chain(), chain_sensors(), ("k_1",))


def test_models_with_other_sensors_share_the_kernels_that_are_the_same(verne555: Turbine):
    """A model with fewer channels was compiled whole."""
    every, fewer = (compile_model(verne555.model, sensors) for sensors in (verne555.sensors, verne555.sensors[:3]))
    assert fewer.rates is every.rates
    assert fewer.rates_jacobian is every.rates_jacobian
    assert fewer.rates_of_lanes is every.rates_of_lanes is not every.rates_jacobian
    assert fewer.reading is not every.reading
