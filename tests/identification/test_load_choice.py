"""Which load model: the evidence, and whether loads matter, against closed forms."""

import math

import numpy as np
import pytest
import scipy.linalg
from scipy.stats import multivariate_normal

from tests.mechanics.models import Reads, symbols
from windsysid.filters.protocol import empty_info
from windsysid.identification.condition.readings import usable_sensors
from windsysid.identification.estimate.load_selection import Question, _loads_matter, _log_evidence, choose
from windsysid.identification.estimate.online import begin, finish
from windsysid.identification.estimate.time_domain import first_estimate, identify_jointly, load_models
from windsysid.identification.model.prior import Prior
from windsysid.mechanics.equations import Equations
from windsysid.simulation.record import simulate_record
from windsysid.statespace.compose import compose
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.file import load_turbine


def test_the_evidence_of_a_linear_model_is_the_density_of_its_readings():
    rng = np.random.default_rng(3)
    rows, noise = rng.standard_normal((6, 2)), np.diag(rng.uniform(0.5, 2.0, 6))
    prior_mean, prior_cov = np.array([0.3, -1.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    readings = rng.standard_normal(6)
    precision = np.linalg.inv(prior_cov) + rows.T @ np.linalg.solve(noise, rows)
    pull = np.linalg.solve(prior_cov, prior_mean) + rows.T @ np.linalg.solve(noise, readings)
    mode = np.linalg.solve(precision, pull)
    known = begin(prior_mean, prior_cov, 1, (0, 1))._replace(theta=mode, precision=precision)
    found = _log_evidence(float(multivariate_normal(rows @ mode, noise).logpdf(readings)), known)
    # Laplace's approximation counts (2π)^(n/2) of the prior against that of the posterior: they cancel.
    whole = multivariate_normal(rows @ prior_mean, rows @ prior_cov @ rows.T + noise)
    assert found == pytest.approx(float(whole.logpdf(readings)), rel=1e-12)


def test_loads_matter_from_a_tenth_of_the_motion_on():
    # An oscillator under a first-order load: the variance that the load makes, by Lyapunov's equation.
    mass, stiffness, damping, rms, tau = 2.0, 800.0, 16.0, 5.0, 0.5
    x, v, w = symbols("x v w")
    model = compose(
        Equations("mass", (x, v), (), (), (w,), (v, (w - stiffness * x - damping * v) / mass)),
        rate=50.0, values={}, loads=[GaussMarkov("w", rms, tau)], sensors=(Reads("position", x, 0.001),),
    )  # fmt: skip
    drift = np.array([[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, 1.0 / mass], [0.0, 0.0, -1.0 / tau]])
    noise = np.diag([0.0, 0.0, 2.0 * rms**2 / tau])
    made = math.sqrt(scipy.linalg.solve_continuous_lyapunov(drift, -noise)[0, 0])
    samples = 3000  # 60 s, of which the way from rest is a hundredth
    for share, matters in ((0.09, False), (0.11, True), (0.3, True), (0.03, False)):
        motion = np.zeros((samples, len(model.states)))
        motion[:, 0] = made / share
        info = empty_info(samples, len(model.states), 1)._replace(mean=motion)
        assert _loads_matter(model, np.zeros((samples, 1)), info) == matters, share


@pytest.mark.parametrize(
    ("loads", "chosen"), [("second-order", "second-order"), pytest.param("random", "broadband", marks=pytest.mark.slow)]
)
def test_under_a_rigid_rotor_the_evidence_decides_between_load_models(loads: str, chosen: str):
    tower = load_turbine("tower")
    record = simulate_record(tower, duration=200.0, rate=20.0, seed=3, loads=loads)
    question = Question(record, tower, usable_sensors(record, tower, None), Prior(), None)
    choice = choose(question, load_models(record, tower, "auto"), first_estimate(tower, record.rate))
    assert choice.best.problem.loads.name == chosen
    assert choice.why.data["reason"] == "evidence"
    assert all(gain > 0.0 for gain in choice.why.data["rivals"].values())
    assert choice.best.log_evidence > 0.0


def test_a_record_shorter_than_the_first_block_is_searched_once_on_line():
    """The choice made the estimate on line, threw it away, and the search made it again."""
    tower = load_turbine("tower")
    record = simulate_record(tower, duration=25.0, rate=20.0, seed=3)
    sensors = usable_sensors(record, tower, None)
    first = first_estimate(tower, record.rate)
    assert record.samples < first
    best = choose(Question(record, tower, sensors, Prior(), None), ("broadband",), first).best
    assert best.online.samples == record.samples
    assert len(finish(best.problem.build, best.online, best.problem.start)[1].samples) == 0
    found = identify_jointly(record, tower, sensors, Prior(), loads="broadband")
    assert np.array_equal(found.history_mean[-1], best.online.theta[: len(found.theta)])
