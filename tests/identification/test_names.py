"""Checks of a structure whose author names coefficients and coordinates as he likes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
import sympy as sp

import windsysid as ws
from windsysid.checks.estimates import doubt_damping
from windsysid.identification.estimate.prior_conflict import find_held
from windsysid.identification.job import Formulation
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.identification.verdict.conclude import _late
from windsysid.loads.statistics import load_groups, to_logarithms
from windsysid.mechanics.equations import lagrange
from windsysid.results.identification import Identification
from windsysid.spectral.rotor.problem import RotorQuestion, damped_start

JOINT: Formulation = "joint"
SPECTRAL: Formulation = "spectral"

PLACES: tuple[tuple[str, Literal["x", "y", "lag"]], ...] = (
    ("tower", "x"), ("tower", "y"), ("blade_1", "lag"), ("blade_2", "lag"),
)  # fmt: skip

LATIN = {"q": "x", "m": "m_x", "k": "k_x", "c": "c_x"}
GREEK = {"q": "ξ", "m": "μ_1", "k": "κ_1", "c": "δ_1"}


class Mast(ws.models.MechanicalModel):
    """A mast that sways in one direction."""

    names: ClassVar[Mapping[str, str]]

    @property
    def freedoms(self) -> tuple[ws.models.Coordinate, ...]:
        return (ws.models.Coordinate(self.names["q"], "m", "mast"),)

    @property
    def parameters(self) -> tuple[ws.models.Coefficient, ...]:
        q, m, k, c = self.names.values()
        return (
            ws.models.Coefficient(m, "inertia", "kg", q), ws.models.Coefficient(k, "stiffness", "N/m", q),
            ws.models.Coefficient(c, "damping", "N*s/m", q),
        )  # fmt: skip

    @property
    def signature(self) -> str:
        return f"Mast {self.names}"

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        return values[self.names["m"]]

    def stiffness(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        return values[self.names["k"]]

    def symbols(self) -> list[sp.Symbol]:
        q, m, k, c = self.names.values()
        return [sp.Symbol(name, real=True) for name in (q, f"{q}_rate", f"{q}_acc", m, k, c)]

    def equations(self) -> ws.models.Equations:
        q, v, a, m, k, c = self.symbols()
        return lagrange(
            "mast", lagrangian=m * v**2 / 2 - k * q**2 / 2, dissipation=c * v**2 / 2, coordinates=[(q, v, a)],
            loads=[sp.Symbol(self.loads[0], real=True)], inputs={}, parameters=(m, k, c),
        )  # fmt: skip

    def readings(self, sensors: Sequence[Any]) -> list[sp.Expr]:
        return [sensor.gain * self.symbols()[2] for sensor in sensors]


@dataclass(frozen=True)
class LatinMast(Mast):
    kind: ClassVar[str] = "latin-mast"
    names: ClassVar[Mapping[str, str]] = LATIN


@dataclass(frozen=True)
class GreekMast(Mast):
    kind: ClassVar[str] = "greek-mast"
    names: ClassVar[Mapping[str, str]] = GREEK


def mast(model: Mast, *, damping: float = 1000.0) -> ws.Turbine:
    """A mast of 0.5 Hz and about 0.5 % of critical damping."""
    _, m, k, c = model.names.values()
    q = model.freedoms[0]
    return ws.Turbine(
        name="mast", description="a mast", source="made up", assumed=(), model=model,
        values={m: 32000.0, k: 32000.0 * math.pi**2, c: damping}, rotor_speed=0.0, spread=(0.2, 0.3),
        loads=(ws.models.GaussMarkov(q.load, 500.0, 5.0),),
        sensors=(ws.models.Accelerometer(channel="top", point="tower", axis="x", noise=0.003),),
    ).exact()  # fmt: skip


@pytest.fixture(params=[LatinMast(), GreekMast()], ids=["latin", "greek"])
def turbine(request: pytest.FixtureRequest) -> ws.Turbine:
    return mast(request.param)


def identified(turbine: ws.Turbine) -> tuple[ws.models.Parameter, ...]:
    return Prior().parameters(turbine, identifiable(turbine), linear=False)


def test_a_parameter_has_the_kind_and_the_part_of_its_coefficient(turbine: ws.Turbine):
    q = turbine.model.coordinates[0]
    assert [(one.kind, one.part) for one in identified(turbine)] == [("stiffness", q), ("damping", q)]


def test_damping_that_is_not_positive_is_a_reason(turbine: ws.Turbine):
    found = doubt_damping(identified(turbine), np.array([0.0, -0.01]), np.diag([1e-4, 1e-6]), (), {})
    assert [one.code for one in found if one.severity == "reason"] == ["damping_not_positive"]


def test_a_prior_of_damping_that_holds_an_estimate_is_found(turbine: ws.Turbine):
    parameters = identified(turbine)
    mean, std = parameters[1].prior
    at = np.array([0.0, mean + std])
    held = find_held(lambda points: [float(u[1]) / std for u in points], at, np.diag([1e-4, std**2]), parameters)
    assert held == (parameters[1].name,)


def test_a_search_of_spectra_begins_with_positive_damping(turbine: ws.Turbine):
    start = damped_start(turbine, identified(turbine), np.array([0.0, -1.0]), np.array([0.2, 0.01]))
    assert start.tolist() == [0.0, 0.003]


def test_the_narrowest_resonance_is_known(turbine: ws.Turbine):
    nothing = np.empty((0, 0))
    question = RotorQuestion(turbine, turbine.sensors, nothing, 10.0, nothing, None, (), ())  # type: ignore[arg-type]
    assert question.narrowest == pytest.approx(1000.0 / 32000.0 / (4.0 * math.pi))


def test_level_and_time_constant_of_a_load_are_told_apart(turbine: ws.Turbine):
    statistics = load_groups(turbine.loads, turbine.model)
    assert [one.kind for one in statistics] == ["level", "shape"]
    assert to_logarithms(statistics).tolist() == [[1.0, 0.5], [0.0, 1.0]]


def test_a_structure_without_a_rotor_does_not_turn(turbine: ws.Turbine):
    """It has no azimuth and no speed among its inputs; spectra took the first two columns for these: IndexError."""
    nothing = np.empty((0, 0))
    question = RotorQuestion(turbine, turbine.sensors, nothing, 10.0, np.empty((4, 0)), None, (), ())  # type: ignore[arg-type]
    assert question.azimuth.tolist() == question.speed.tolist() == [0.0] * 4


def test_a_late_logger_is_looked_for_whatever_channels_are_called(verne555: ws.Turbine):
    record = ws.simulate(verne555, duration=20.0, rate=50.0, seed=1)
    whitened = np.random.default_rng(1).standard_normal((record.samples, 4))
    sensors = tuple(
        ws.models.Accelerometer(channel=f"a{i}", point=point, axis=axis, noise=0.1)
        for i, (point, axis) in enumerate(PLACES)
    )  # fmt: skip
    found: Any = SimpleNamespace(
        final=SimpleNamespace(whitened=whitened), sensors=sensors, turbine=verne555, tolerances=(),
    )  # fmt: skip
    assert _late(found, record) is not None
    assert _late(SimpleNamespace(**{**vars(found), "sensors": sensors[:2]}), record) is None  # type: ignore[arg-type]


@pytest.mark.slow
def test_greek_names_get_every_finding_that_latin_names_get():
    """A mast with three times the damping of its file, and one whose spring hardens: same numbers, same findings."""
    found: dict[str, list[Identification]] = {}
    for model in (LatinMast(), GreekMast()):
        damped = mast(model, damping=3000.0)
        record = ws.simulate(damped, duration=900.0, rate=10.0, seed=1)
        top = record["top"]
        bent = record.with_channels({"top": (top + 0.4 * top**3 / np.std(top) ** 2, "m/s^2")})
        found[model.kind] = [
            ws.identify(one, mast(model), formulation=by)
            for one, by in ((record, JOINT), (record, SPECTRAL), (bent, JOINT))
        ]
    for latin, greek in zip(*found.values(), strict=True):
        assert [e.estimate for e in greek.estimates] == pytest.approx([e.estimate for e in latin.estimates], rel=1e-6)
        assert greek.diagnosis.trusted == latin.diagnosis.trusted
        assert [len(part) for part in (greek.diagnosis.reasons, greek.notes)] == [
            len(part) for part in (latin.diagnosis.reasons, latin.notes)
        ]
    assert any("c_x" in note and "4 times as wide" in note for note in found["latin-mast"][0].notes)
    assert any("δ_1" in note and "4 times as wide" in note for note in found["greek-mast"][0].notes)
