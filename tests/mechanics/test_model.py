"""What a mechanical model says of its parameters, and what is refused of one's own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest
import sympy as sp

from windsysid.errors import ConfigurationError
from windsysid.mechanics import MechanicalModel, RotorModel, TowerModel, compile_model
from windsysid.mechanics.equations import Equations
from windsysid.mechanics.generate import generate_source
from windsysid.mechanics.model import Coefficient, Coordinate


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(RotorModel(3, roll="free", air_couples=True), marks=pytest.mark.slow),
        RotorModel(2, lag="locked"),
        TowerModel(),
    ],
)
def test_a_model_says_what_its_equations_have(model: MechanicalModel):
    equations = model.equations()
    for what in ("states", "inputs", "loads"):
        assert getattr(model, what) == tuple(symbol.name for symbol in getattr(equations, what))
    assert [known.name for known in model.parameters] == [symbol.name for symbol in equations.parameters]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("k_x", "N/m"), ("k_y", "N/m"), ("k_beta_1", "N*m/rad"), ("k_roll", "N*m/rad"), ("c_x", "N*s/m"),
        ("c_y", "N*s/m"), ("c_beta_2", "N*m*s/rad"), ("hub_mass_x", "kg"), ("blade_mass_1", "kg"),
        ("blade_first_moment_1", "kg*m"), ("blade_inertia_1", "kg*m^2"),
    ],
)  # fmt: skip
def test_a_parameter_has_the_unit_of_its_equation(name: str, unit: str):
    """Force = k x + c v for a translation, moment = k θ + c ω for an angle."""
    assert RotorModel(3).coefficient(name).unit == unit


def test_the_units_of_loads_are_those_of_their_degrees_of_freedom():
    units = {freedom.load: freedom.load_unit for freedom in RotorModel(2, roll="free").freedoms}
    assert units == {"load_x": "N", "load_y": "N", "load_roll": "N*m", "load_beta_1": "N*m", "load_beta_2": "N*m"}


def test_stiffness_and_damping_of_what_is_locked_do_not_act():
    model = RotorModel(3, lag="locked")
    assert model.coefficients == ("k_x", "c_x", "k_y", "c_y")
    assert [model.acts(name) for name in ("k_x", "k_beta_1", "c_roll", "hub_mass_x", "no_such")] == [
        True,
        False,
        False,
        True,
        False,
    ]
    with pytest.raises(
        ConfigurationError, match="no parameter 'k_z' in a model of the kind 'rotor': expected one of hub_mass_x"
    ):
        model.coefficient("k_z")
    with pytest.raises(ConfigurationError, match="no degree of freedom or load 'load_beta_1': expected one of x, y"):
        model.freedom("load_beta_1")


@dataclass(frozen=True)
class Swing(MechanicalModel):
    """A mass on a spring, `factor` of which acts, or with a parameter too many."""

    factor: float = 1.0
    more: tuple[Coefficient, ...] = ()
    kind: ClassVar[str] = "swing"

    @property
    def freedoms(self) -> tuple[Coordinate, ...]:
        return (Coordinate("q", "m", "q"),)

    @property
    def parameters(self) -> tuple[Coefficient, ...]:
        return (Coefficient("mass", "inertia", "kg", "q"), Coefficient("k", "stiffness", "N/m", "q"), *self.more)

    @property
    def signature(self) -> str:
        return "swing"

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        return values["mass"]

    def stiffness(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        return self.factor * values["k"]

    def equations(self) -> Equations:
        q, v, w, m, k = sp.symbols("q q_rate load_q mass k", real=True)
        return Equations("swing", (q, v), (), (m, k), (w,), (v, (w - self.factor * k * q) / m))

    def readings(self, sensors: Sequence[Any]) -> list[sp.Expr]:
        return []


def test_a_model_that_misnames_what_its_equations_have_is_refused():
    with pytest.raises(
        ConfigurationError, match="model 'swing': its parameters are mass, k, c, those of its equations mass, k"
    ):
        generate_source(Swing(more=(Coefficient("c", "damping", "N*s/m", "q"),)), (), ())


def test_equations_from_elsewhere_are_compiled_anew_when_their_code_changes_and_their_signature_does_not():
    one, two = (compile_model(Swing(factor)) for factor in (1.0, 2.0))
    assert one.module.__name__ != two.module.__name__
    assert compile_model(Swing(1.0)) is one
