"""What moved between two records, against Gaussian algebra and integrals done by SciPy."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from windsysid import cli
from windsysid.comparison import MOVED, TYPICAL, Comparison, compare
from windsysid.errors import ConfigurationError
from windsysid.identification import identify
from windsysid.result import Posterior, load_posterior
from windsysid.simulate import simulate_record
from windsysid.statespace import Parameter
from windsysid.turbine import Turbine, load_turbine

SPREAD = 0.3


@pytest.fixture(scope="module")
def verne555() -> Turbine:
    return load_turbine("verne555")


def posterior(
    turbine: Turbine, names: list[str], said: np.ndarray, cov: np.ndarray, spread: float = SPREAD
) -> Posterior:
    """What a prior on the references and a likelihood N(said, cov) in ln k leave together."""
    parameters = tuple(Parameter(name, turbine.values[name], spread) for name in names)
    information = np.linalg.inv(cov) + np.eye(len(names)) / spread**2
    theta = np.linalg.solve(information, np.linalg.solve(cov, said))
    values = {q.name: float(q.physical(t)) for q, t in zip(parameters, theta, strict=True)}
    known = np.asarray(theta, dtype=np.float64), np.asarray(np.linalg.inv(information), dtype=np.float64)
    return Posterior(turbine.with_values(values), parameters, *known, "record", True)


def test_the_change_is_that_of_the_likelihoods_alone(verne555):
    names, rng = ["k_x", "k_y"], np.random.default_rng(1)
    covs = [a @ a.T for a in 0.02 * rng.standard_normal((2, 2, 3))]
    said = 0.1 * rng.standard_normal((2, 2))
    found = compare(*(posterior(verne555, names, m, c, spread=30.0) for m, c in zip(said, covs, strict=True)))
    for i, change in enumerate(found.coefficients):
        sigma = math.sqrt(covs[0][i, i] + covs[1][i, i])
        delta = said[1, i] - said[0, i]
        assert math.log1p(change.percent / 100.0) == pytest.approx(delta, abs=2e-3 * sigma)
        assert math.log1p(change.high / 100.0) - math.log1p(change.low / 100.0) == pytest.approx(4.0 * sigma, rel=2e-3)
        assert change.chance == pytest.approx(2.0 * norm.sf(abs(delta) / sigma), rel=2e-2)


@pytest.mark.parametrize("moved", [0.0, 0.03, 0.1])
def test_the_odds_are_the_ratio_of_the_evidences(verne555, moved):
    sigma_a, sigma_b, tau = 0.015, 0.02, TYPICAL["k"]
    a, b = (
        posterior(verne555, ["k_x"], np.array([at]), np.array([[sigma**2]]))
        for at, sigma in ((0.01, sigma_a), (0.01 + moved, sigma_b))
    )

    def evidence(change: float) -> float:
        """∫ N(y_A | θ) N(y_B | θ + δ) π(θ) dθ"""
        return quad(
            lambda t: norm.pdf(0.01, t, sigma_a) * norm.pdf(0.01 + moved, t + change, sigma_b) * norm.pdf(t, 0.0, SPREAD),
            -0.2, 0.2, points=[0.01], epsabs=1e-10,
        )[0]  # fmt: skip

    with_change = quad(
        lambda d: evidence(d) * norm.pdf(d, 0.0, tau), -0.6, 0.6, points=[moved], epsabs=1e-8, limit=200
    )[0]
    (change,) = compare(a, b).coefficients
    assert math.exp(change.log_odds) == pytest.approx(with_change / evidence(0.0), rel=1e-4)


def test_false_alarms_are_as_rare_as_the_odds_promise_and_bands_hold(verne555):
    rng, sigma = np.random.default_rng(2), np.array([0.01, 0.02, 0.005])
    names, alarms, held, runs = ["k_x", "k_y", "k_beta_1"], 0, 0, 400
    for _ in range(runs):
        a, b = (posterior(verne555, names, sigma * rng.standard_normal(3), np.diag(sigma**2)) for _ in range(2))
        found = compare(a, b).coefficients
        alarms += sum(change.moved for change in found)
        held += sum(change.low < 0.0 < change.high for change in found)
    assert alarms <= 3 * runs / MOVED
    assert held / (3 * runs) == pytest.approx(0.954, abs=0.02)


def test_what_no_record_sees_has_not_moved(verne555):
    blind = posterior(verne555, ["k_x", "k_y"], np.zeros(2), np.diag([1e-4, 1e12]))
    change = compare(blind, blind).coefficients[1]
    assert change.high - change.low > 100.0
    assert change.log_odds == pytest.approx(0.0, abs=1e-3)


def test_records_without_a_common_coefficient_are_refused(verne555):
    a, b = (posterior(verne555, [name], np.zeros(1), np.eye(1)) for name in ("k_x", "k_y"))
    with pytest.raises(ConfigurationError, match="expected coefficients that both identified, got k_x and k_y"):
        compare(a, b)


@pytest.fixture(scope="module")
def results(verne555: Turbine, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two results, the tower of the second a fifth softer."""
    folders = []
    for seed, k in ((1, 1.0), (2, 0.8)):
        truth = verne555.with_values({"k_x": k * verne555.values["k_x"]})
        found = identify(simulate_record(truth, duration=40.0, rate=100.0, seed=seed), verne555)
        folders.append(tmp_path_factory.mktemp(f"result_{seed}"))
        found.save(folders[-1])
    return folders


def test_a_softer_tower_is_found_and_nothing_else(results):
    found: Comparison = compare(*map(load_posterior, results))
    assert [change.name for change in found.coefficients if change.moved] == ["k_x"]
    assert found.coefficients[0].low < -20.0 < found.coefficients[0].high
    assert "moved: k_x fell by" in found.sentence
    by_mode = {change.name: change for change in found.modes}
    assert by_mode["tower x"].high < 0.0
    assert found.doubts == ()


def test_the_command_says_it_and_writes_it(results, tmp_path, monkeypatch, capsys):
    output = tmp_path / "comparison"
    monkeypatch.setattr(sys, "argv", ["windsysid", "compare", *map(str, results), "--output", str(output)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code in (0, None)
    assert "moved: k_x fell by" in capsys.readouterr().out
    assert sorted(path.name for path in output.glob("[!.]*")) == ["changes.png", "report.html", "summary.json"]
    assert json.loads((output / "summary.json").read_text())["moved"] == ["k_x"]


def test_a_folder_without_a_result_is_refused_in_one_line(results, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["windsysid", "compare", str(results[0]), str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    (line,) = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2
    assert "expected a folder that windsysid identify wrote" in line
