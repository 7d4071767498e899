"""The filters that benchmarks compare with are windsysid's: in C, and on the model as other libraries take it."""

import importlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from windsysid import load_turbine
from windsysid.filters import EKF
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.model.turbine_problem import pose
from windsysid.models import Prior
from windsysid.simulation.record import simulate_record

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def benchmark_modules(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, ModuleType]]:
    """Modules of benchmarks/, whose names are not a package's; they are forgotten afterwards."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield {name: importlib.import_module(name) for name in ("models", "roofline", "speed")}
    for name in set(sys.modules) - before:
        if (BENCHMARKS / f"{name}.py").exists():
            del sys.modules[name]


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the C reference is compiled with gcc")
def test_the_c_reference_computes_what_windsysid_computes(benchmark_modules: dict[str, ModuleType], tmp_path: Path):
    """In every output of every sample, readings missing, with loads that go on within a step."""
    speed = benchmark_modules["speed"]
    turbine = load_turbine("verne555").exact()
    problem = pose(simulate_record(turbine, duration=3.0, rate=100.0, seed=1), turbine, turbine.sensors, Prior())
    readings = problem.readings.copy()
    readings[50:80, 1] = readings[100:105] = np.nan
    model = problem.model
    assert model.blocks.load_within.any()
    found = speed.Reference(model, tmp_path / "reference.so", ("-O1",)).run(problem.inputs, readings)
    expected = EKF.run(model, EKF.init(model), problem.inputs, readings)[1]
    assert speed.farthest_apart(found, expected) < speed.AGREES


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="the C reference is compiled with gcc")
def test_the_c_reference_in_lanes_computes_what_the_bank_computes(
    benchmark_modules: dict[str, ModuleType], tmp_path: Path
):
    """Every innovation and its standard deviation, with missing readings."""
    speed = benchmark_modules["speed"]
    turbine = load_turbine("verne555").exact()
    problem = pose(simulate_record(turbine, duration=3.0, rate=100.0, seed=1), turbine, turbine.sensors, Prior())
    readings = problem.readings.copy()
    readings[50:80, 1] = readings[100:105] = np.nan
    model = problem.build(problem.prior[0])
    reference = speed.LanesReference(model, tmp_path / "lanes.so")
    expected = run_bank(bank_of([model] * speed.LANES), problem.inputs, readings)[1]
    for found, wanted in zip(reference.score(problem.inputs, readings), expected[:2], strict=True):
        np.testing.assert_allclose(found, wanted[..., : reference.lanes], atol=speed.AGREES)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the C reference is compiled with gcc")
@pytest.mark.parametrize(("m", "r"), [(2, 1), pytest.param(4, 2, marks=pytest.mark.slow)])
def test_the_spectral_likelihood_in_c_is_windsysids(
    benchmark_modules: dict[str, ModuleType], tmp_path: Path, m: int, r: int
):
    """Value, gradient and information of a band."""
    roofline = benchmark_modules["roofline"]
    modes, band = roofline.band_of(m, r)
    found = roofline.SpectralReference(tmp_path, m, r).run(modes, band)
    assert roofline.apart(found, roofline.scores(modes, band)) < 1e-9


def test_the_model_of_the_peers_is_windsysids(benchmark_modules: dict[str, ModuleType]):
    """A textbook filter in NumPy on the equations, noise and derivatives that the peers get."""
    models = benchmark_modules["models"]
    problem = models.Problem(load_turbine("verne555").exact(), 40)
    model, written = problem.model, models.Written(problem)
    mean, cov, R = model.mean, model.cov, np.diag(model.blocks.noise)
    before = problem.inputs[0]
    for k, (at, reading) in enumerate(zip(problem.inputs, problem.readings, strict=True)):
        if k:
            mean, F, gain = written.step(mean, before, at)
            cov = F @ cov @ F.T + gain @ problem.noise @ gain.T
        expected, H = written.read(mean, at)
        K = np.linalg.solve(H @ cov @ H.T + R, H @ cov).T
        mean, cov, before = mean + K @ (reading - expected), cov - K @ H @ cov, at
    ours = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)[0]
    std = np.sqrt(np.diag(ours.cov))
    assert np.max(np.abs(mean - ours.mean) / std) < 1e-7
    assert np.max(np.abs(np.sqrt(np.diag(cov)) / std - 1.0)) < 1e-7
