"""The structural benchmarks: the truth is SciPy's, bad starts come home, what locks in does so, and the bands hold."""

from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
from validation.benchmarks import (
    ON_LINE,
    RESULT,
    STRONG,
    TOLD,
    Benchmark,
    Comparison,
    bouc_wen,
    compare,
    difference_to_scipy,
    figure,
    main,
    read_ground,
    record_of,
    respond,
    synthetic_ground,
    two_storey,
)

from validation import benchmarks
from windsysid.errors import WindsysidError
from windsysid.filters import FILTERS
from windsysid.identification.fit_equations import fit
from windsysid.identification.model import equations_problem as fitting
from windsysid.records.record import Record

EL_CENTRO = Path(__file__).parents[3] / "shared" / "data" / "elcentro" / "elcentro_NS.dat"
needs_el_centro = pytest.mark.skipif(not EL_CENTRO.is_file(), reason="El Centro is not beside this checkout")

GROUNDS = [
    pytest.param(synthetic_ground, id="synthetic"),
    pytest.param(lambda: read_ground(EL_CENTRO), id="El Centro", marks=needs_el_centro),
]
EKF = "extended Kalman filter"


def hysteretic(x: np.ndarray, ground: float) -> tuple[list[float], list[float]]:
    """Rates and readings of the Bouc–Wen benchmark, written without SymPy."""
    _, v, z = x
    absolute = -(0.3 * v + 9.0 * z)
    return [v, absolute - ground, v - 2.0 * abs(v) * abs(z) * z - v * z * z], [absolute]


def sheared(x: np.ndarray, ground: float) -> tuple[list[float], list[float]]:
    """Those of the frame."""
    K, C = np.array([[22.0, -10.0], [-10.0, 10.0]]), np.array([[1.1, -0.5], [-0.5, 0.5]])
    absolute = -(K @ x[:2] + C @ x[2:])
    return [*x[2:], *(absolute - ground)], list(absolute)


@pytest.mark.parametrize(
    ("benchmark", "equations", "within"), [(bouc_wen(STRONG), hysteretic, 1e-5), (two_storey(), sheared, 1e-8)]
)
def test_the_simulated_truth_is_scipys(benchmark: Benchmark, equations, within: float):
    # |v| and |z| have kinks, at which fixed steps fall back to low order
    ground, response = respond(benchmark, synthetic_ground(duration=6.0))
    acceleration, h = ground["ground"], 1.0 / ground.rate
    x, worst = np.zeros(len(benchmark.equations.states)), 0.0
    for a, b, found in zip(acceleration, acceleration[1:], response.readings[1:], strict=False):
        rates = lambda t, x, a=a, b=b: equations(x, a + (b - a) * t / h)[0]  # noqa: E731
        x = scipy.integrate.solve_ivp(rates, (0.0, h), x, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        worst = max(worst, np.max(np.abs(found - equations(x, b)[1])))
    rms = np.sqrt(np.mean(response.readings**2))
    assert worst < within * rms
    assert difference_to_scipy(benchmark, ground, response) < 2.0 * within


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize(
    ("benchmark", "within"),
    # relative, parameter by parameter: four of the standard deviations that the bands claim on El Centro, rounded up
    [
        (bouc_wen(STRONG), {"k": 0.005, "c": 0.04, "beta": 0.08, "gamma": 0.12, "n": 0.06}),
        (two_storey(), {"k_1": 0.005, "k_2": 0.01, "c_1": 0.03, "c_2": 0.04}),
    ],
    ids=["Bouc-Wen", "frame"],
)
@pytest.mark.parametrize("stiffness", [pytest.param(2.0, marks=pytest.mark.slow), 5.0])
def test_bad_starts_come_home(benchmark: Benchmark, within: dict[str, float], ground, stiffness: float):
    moved, response = respond(benchmark, ground())
    record, noise = record_of(benchmark, moved, response, 11)
    found = fit(
        benchmark.equations, record, parameters=benchmark.starts(stiffness), values=benchmark.known,
        sensors=benchmark.sensors(TOLD * noise), cov=1e-6 * np.eye(len(benchmark.equations.states)),
    )  # fmt: skip
    assert found.diagnosis is not None
    assert found.diagnosis.trusted
    for name, share in within.items():
        true = benchmark.truth[name]
        assert found[name].estimate == pytest.approx(true, rel=share), name
        assert abs(found[name].estimate - true) < 4.0 * found[name].std, name
    for statistic, s in zip(found.statistics, noise, strict=True):
        assert statistic.estimate == pytest.approx(s, rel=0.1)


def strays(benchmark: Benchmark, ground: Record, seeds: range) -> int:
    """How many of the records are not identified when the sensors are said to be a hundred times too quiet."""
    moved, response = respond(benchmark, ground)
    lost = 0
    for seed in seeds:
        record, noise = record_of(benchmark, moved, response, seed)
        try:
            found = fit(
                benchmark.equations, record, parameters=benchmark.starts(2.0), values=benchmark.known,
                sensors=benchmark.sensors(0.01 * noise), cov=1e-6 * np.eye(len(benchmark.equations.states)),
            )  # fmt: skip
        except WindsysidError:
            lost += 1
        else:
            lost += any(abs(e.estimate - benchmark.truth[e.name]) > 5.0 * e.std for e in found.estimates)
    return lost


@pytest.mark.slow
def test_sensors_said_to_be_far_too_quiet_do_not_lead_astray(monkeypatch: pytest.MonkeyPatch):
    # told so, the joint filter locks in at once; with all noise 10 and 100 times as loud it finds the way
    ground = synthetic_ground(duration=10.0)
    assert strays(two_storey(), ground, range(4)) == 0
    monkeypatch.setattr(fitting, "NOISE_FACTORS", (1.0,))
    assert strays(two_storey(), ground, range(4)) > 0


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return compare(bouc_wen(), synthetic_ground(), 4)


@pytest.mark.slow
def test_the_joint_filter_locks_in_and_the_fit_does_not(comparison: Comparison):
    assert comparison.names == ("k", "c", "beta", "gamma", "n")
    assert comparison.deviations[EKF].shape == (4, 5)
    assert np.max(np.abs(comparison.deviations[EKF])) > 6.0
    for method in (RESULT, ON_LINE):
        assert np.max(np.abs(comparison.deviations[method])) < 4.0
    assert comparison.warned == 0


@pytest.mark.slow
def test_a_comparison_prints_and_draws_every_method(
    comparison: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from windsysid.output.console import render

    monkeypatch.setenv("COLUMNS", "200")
    text = render(comparison.table())
    for method in (*(f.name for f in FILTERS), RESULT, ON_LINE):
        assert method in text
        assert method in comparison.errors
    drawing = figure(comparison)
    drawing.savefig(tmp_path / "figure.png")
    assert len(drawing.axes) == 6
    assert drawing.axes[5].get_ylabel() == "z [m]"


@pytest.mark.slow
def test_the_command_writes_one_figure_per_benchmark(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    ground = synthetic_ground(duration=3.0)
    table = np.column_stack([ground.time, ground["ground"] / 9.80665])
    np.savetxt(tmp_path / "ground.dat", table)
    assert main(["--ground", str(tmp_path / "ground.dat"), "--output", str(tmp_path / "out"), "--runs", "1"]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "bouc_wen.png", "bouc_wen_5g.png", "two_storey.png",
    ]  # fmt: skip
    assert capsys.readouterr().out.count("rms from SciPy's") == 3
    np.testing.assert_allclose(read_ground(tmp_path / "ground.dat")["ground"], ground["ground"], rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give El Centro, or any other, with --ground FILE"),
        (["--ground", "nowhere.dat"], "nowhere.dat: no such file"),
    ],
)
def test_a_missing_ground_is_told_in_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]):
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1


def test_the_synthetic_ground_is_the_same_for_a_seed_and_has_its_peak():
    first, again, other = synthetic_ground(1), synthetic_ground(1), synthetic_ground(2)
    np.testing.assert_array_equal(first.values, again.values)
    assert not np.array_equal(first.values, other.values)
    assert isinstance(first, Record)
    assert np.max(np.abs(first["ground"])) == pytest.approx(3.0)


@needs_el_centro
def test_el_centro_is_the_record_that_everyone_uses():
    ground = read_ground(EL_CENTRO)
    assert ground.rate == pytest.approx(50.0)
    assert np.max(np.abs(ground["ground"])) / 9.80665 == pytest.approx(0.349, abs=1e-3)


@pytest.mark.slow
@needs_el_centro
@pytest.mark.parametrize("benchmark", [bouc_wen(), bouc_wen(STRONG), two_storey()], ids=lambda b: b.name)
def test_the_bands_hold_the_truth(benchmark: Benchmark, monkeypatch: pytest.MonkeyPatch):
    # ±2σ holds 95.45 %; the parameters of a record count as about one, so that 200 records have a standard error of 1.5
    # %
    monkeypatch.setattr(benchmarks, "FILTERS", ())
    found = compare(benchmark, read_ground(EL_CENTRO), 200)
    for method in (RESULT, ON_LINE):
        assert 0.91 < found.covers(method).mean() < 0.99
        assert np.all(found.covers(method) > 0.89)
