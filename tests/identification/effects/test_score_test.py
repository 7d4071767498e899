"""Rao's score test: its level on records without an effect, its power, and its influence against a refit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.findings import only
from windsysid.filters import EKF
from windsysid.identification.effects import EFFECTS
from windsysid.identification.effects.regression import Regression
from windsysid.identification.effects.score_test import RegressorCandidate, log_tail_of_f, newton_step, score_tests
from windsysid.identification.effects.step import Step, likeliest_change
from windsysid.identification.estimate.fitted.linearisation import (
    Linearisation,
    RegressorColumn,
    RegressorSums,
    linearise,
)
from windsysid.identification.formulations import estimate
from windsysid.identification.identify import identify
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.regressor import Constant, Legendre, StepAt, Waveform
from windsysid.identification.model.turbine_problem import pose
from windsysid.identification.pipeline import run
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

DURATION, RATE = 300.0, 4.0


@pytest.fixture(scope="module")
def tower() -> Turbine:
    """A tower whose sensors have no bias."""
    packaged = load_turbine("tower")
    return replace(packaged, sensors=tuple(one.model_copy(update={"bias": 0.0}) for one in packaged.sensors))


def added(made: Record, channel: str, wave: Waveform, size: float) -> Record:
    return made.with_channels({channel: (made[channel] + size * wave(made.time), made.unit(channel))})


def job_of(made: Record, turbine: Turbine) -> Job:
    return Job(made, made, turbine, None, None, None, None, "broadband")


def at_the_truth(turbine: Turbine, made: Record) -> Linearisation:
    """The filter of the simulated turbine itself, whose unknowns are known: nothing follows a regressor."""
    problem = pose(made, turbine, turbine.sensors, Prior(), None, "broadband")
    unknowns = problem.wide_prior[0]
    model = problem.build(unknowns)
    info = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)[1]
    cov = 1e-12 * np.eye(len(unknowns))
    return Linearisation(problem, made.time, problem.readings, problem.inputs, unknowns, cov, info.whitened)


def slow_candidates(at: Linearisation) -> list[RegressorCandidate]:
    first, last = float(at.time[0]), float(at.time[-1])
    trend = [Legendre(order, first, last) for order in range(1, 5)]
    middle = StepAt(0.5 * (first + last))
    waves: dict[str, list[Waveform]] = {"bias": [Constant()], "trend": list(trend), "step": [middle]}
    return [
        RegressorCandidate(code, channel, tuple(RegressorColumn(row, wave) for wave in of))
        for code, of in waves.items()
        for row, channel in enumerate(at.channels)
    ]


def p_values(turbine: Turbine, seed: int) -> dict[tuple[str, str], float]:
    made = simulate_record(turbine, duration=DURATION, rate=RATE, seed=seed)
    at = at_the_truth(turbine, made)
    tests = score_tests(at, slow_candidates(at))
    return {(one.candidate.code, one.candidate.channel): 10.0**one.log10_p for one in tests}


def check_level(found: list[dict[tuple[str, str], float]], nominal: float, bound: float) -> None:
    """Within so many standard errors."""
    for of in found[0]:
        share = float(np.mean([one[of] < nominal for one in found]))
        assert abs(share - nominal) < bound * np.sqrt(nominal * (1.0 - nominal) / len(found)) + 1e-12, (of, share)


def test_the_tail_of_f_is_that_of_scipy_and_goes_on_where_that_ends():
    for statistic, count, freedom in [(0.3, 1, 40.0), (3.0, 2, 10.0), (20.0, 4, 53.6)]:
        assert log_tail_of_f(statistic, count, freedom) == pytest.approx(stats.f.logsf(statistic, count, freedom))
    far = log_tail_of_f(1e12, 2, 400.0)  # (1 + 2x/n)^(−n/2)
    assert far == pytest.approx(-200.0 * np.log1p(2e12 / 400.0), rel=1e-6)


def test_columns_answer_as_differences_of_filters_do(tower: Turbine):
    """Independently: filter the record with the waveform and without."""
    made = simulate_record(tower, duration=100.0, rate=RATE, seed=4)
    at = at_the_truth(tower, made)
    columns = [RegressorColumn(1, StepAt(40.0)), RegressorColumn(2, Constant())]  # a reading, and a load
    sums = at.sums(columns)
    model, z = at.problem.build(at.unknowns), at.innovations
    changed = at.readings.copy()
    changed[:, 1] += 1e-4 * StepAt(40.0)(made.time)
    in_reading = (EKF.run(model, EKF.init(model), at.inputs, changed)[1].whitened - z) / 1e-4
    inputs = at.inputs.copy()
    inputs[:, len(at.problem.model.compiled.inputs)] -= 1.0  # of a known load, readings would have to be as much larger
    in_load = EKF.run(model, EKF.init(model), inputs, at.readings)[1].whitened - z
    assert sums.gradient == pytest.approx([np.sum(in_reading * z), np.sum(in_load * z)], rel=1e-3)
    assert np.diag(sums.information) == pytest.approx([np.sum(in_reading**2), np.sum(in_load**2)], rel=1e-3)


def test_a_gap_is_no_reading(tower: Turbine):
    made = simulate_record(tower, duration=100.0, rate=RATE, seed=4)
    made.values[100:160] = np.nan
    at = at_the_truth(tower, made)
    at = replace(at, innovations=np.nan_to_num(at.innovations))
    assert np.isfinite(score_tests(at, slow_candidates(at))[0].log10_p)


def test_the_chance_of_a_statistic_is_uniform_without_an_effect(tower: Turbine):
    check_level([p_values(tower, 46_000 + seed) for seed in range(15)], 0.2, 2.0)


@pytest.mark.slow
def test_false_alarms_are_as_many_as_nominal(tower: Turbine):
    """1000 records, seeds not looked at before. Six tests are all within z standard errors as often as one is within
    two; 1.8 % are narrower than two standard errors of 400 records, 2.2 %."""
    found = [p_values(tower, 46_300_000 + seed) for seed in range(1000)]
    all_six = float(stats.norm.isf(0.5 * (1.0 - (1.0 - 2.0 * stats.norm.sf(2.0)) ** (1.0 / 6.0))))
    check_level(found, 0.05, all_six)


def test_a_step_is_found_where_it_is():
    rng = np.random.default_rng(1)
    values = rng.standard_normal(2000) + 0.5 * (np.arange(2000) >= 1300)
    values[50:80] = np.nan
    assert abs(likeliest_change(values) - 1300) < 30


@pytest.mark.parametrize(
    ("code", "wave", "size"),
    [
        ("trend", Legendre(2, 0.0, DURATION), 0.02),
        ("bias", Constant(), 0.01),
        pytest.param("step", StepAt(0.6 * DURATION), 0.03, marks=pytest.mark.slow),
    ],
)
def test_the_largest_statistic_names_the_cause(tower: Turbine, code: str, wave: Waveform, size: float):
    channel = "tower_z_acceleration"
    made = added(simulate_record(tower, duration=DURATION, rate=RATE, seed=21), channel, wave, size)
    fit = estimate(job_of(made, tower))
    at = linearise(job_of(made, tower), fit)
    assert at is not None
    regression = EFFECTS[-1]
    assert isinstance(regression, Regression)
    tests = score_tests(at, [one for effect in regression.effects.values() for one in effect.candidates(at)])
    best = min(tests, key=lambda one: one.log10_p)
    assert (best.candidate.code, best.candidate.channel) == (code, channel)


def fitted(made: Record, turbine: Turbine) -> tuple[Job, FittedJob]:
    return run(job_of(made, turbine), effects=((EFFECTS[-1],),))


@pytest.mark.slow
def test_an_included_trend_gives_the_result_of_the_record_without_it(tower: Turbine):
    """Its influence against a refit: the estimates are those of the clean record."""
    made = simulate_record(tower, duration=DURATION, rate=RATE, seed=22)
    trending = added(made, "tower_z_acceleration", Legendre(1, 0.0, DURATION), 0.05)
    clean, job = estimate(job_of(made, tower)).outcome, job_of(trending, tower)
    spoiled = estimate(job).outcome
    answered, fit = fitted(trending, tower)
    assert [one.code for one in answered.effects] == ["trend"]
    std = np.sqrt(np.diag(clean.cov))
    assert np.abs((fit.outcome.theta - clean.theta) / std).max() < 0.3
    assert np.abs((spoiled.theta - clean.theta) / std).max() > 0.4
    (term, *_) = answered.effects[0].terms  # type: ignore[attr-defined]
    assert abs(term.size - 0.05) < 3.0 * term.std < 0.02
    assert only(fit.outcome.notes, "trend").channels == ("tower_z_acceleration",)


@pytest.mark.slow
def test_a_record_without_effects_is_left_as_it_is(tower: Turbine):
    made = simulate_record(tower, duration=DURATION, rate=RATE, seed=23)
    answered, fit = fitted(made, tower)
    assert answered.effects == ()
    assert np.array_equal(fit.outcome.theta, estimate(job_of(made, tower)).outcome.theta)


def test_steps_are_looked_for_in_sensors_without_a_random_walk(tower: Turbine):
    made = simulate_record(tower, duration=60.0, rate=RATE, seed=2)
    walking = replace(tower, sensors=tuple(one.model_copy(update={"drift": 0.01}) for one in tower.sensors))
    assert len(Step().candidates(at_the_truth(tower, made))) == 2
    assert not Step().candidates(at_the_truth(walking, made))


def test_the_automatic_choice_says_what_filters_found():
    """A step of a channel was in no note where spectra answered."""
    made = simulate_record("tower", duration=DURATION, rate=RATE, seed=5)
    found = identify(added(made, "tower_z_acceleration", StepAt(165.0), 0.03), "tower")
    assert found.formulation == "spectral"
    step = only(found.findings, "step")
    assert step.data["size"] == pytest.approx(0.03, abs=4.0 * step.data["std"])
    assert step.data["time"] == pytest.approx(165.0, abs=5.0)


class Summed:
    """A linearisation of one unknown whose sums are known."""

    channels = ("y",)
    fisher = np.array([[24.0]])

    def __init__(self, gradient: float, information: float, mixed: float) -> None:
        self.innovations = np.random.default_rng(0).standard_normal((4000, 1))
        self.cov, self.of = np.eye(1), (gradient, information, mixed)

    def sums(self, columns: object) -> RegressorSums:
        gradient, information, mixed = self.of
        return RegressorSums(
            np.array([gradient]), np.array([[information]]), np.array([[mixed]]), self.fisher, np.array([[information]])
        )


@pytest.mark.parametrize("mixed", [10.0 - 1e-7, 10.0 + 1e-7, 12.0], ids=["nearly", "beyond", "far beyond"])
def test_what_the_unknowns_explain_is_no_effect(mixed: float):
    """The information that is left is nearly nothing, or negative by what a linearisation is off: z of a tenth of a
    standard deviation was 1e4 σ, or its logarithm did not exist."""
    candidate = RegressorCandidate("bias", "y", (RegressorColumn(0, Constant()),))
    (found,) = score_tests(Summed(1.0, 100.0, mixed), [candidate])  # type: ignore[arg-type]
    assert 0.5 < 10.0**found.log10_p <= 1.0
    assert np.isfinite(found.cov).all()
    assert found.cov[0, 0] > 1.0 / 100.0


def test_what_no_reading_shows_is_not_tested():
    candidate = RegressorCandidate("bias", "y", (RegressorColumn(0, Constant()),))
    assert score_tests(Summed(0.0, 0.0, 0.0), [candidate]) == []  # type: ignore[arg-type]
    assert score_tests(Summed(np.nan, 100.0, 0.0), [candidate]) == []  # type: ignore[arg-type]


def test_a_step_has_the_information_of_its_own_point():
    """18.6 N of an imbalance became 43.7 N: the covariance of the fit's last evaluation belongs to another point, and
    less than a twentieth of the information is left."""
    information, mixed = 4.0, 9.8
    at, columns = Summed(0.5, information, mixed), [RegressorColumn(0, np.ones_like)]
    size, cov, shift, _ = newton_step(at, columns, np.eye(1))  # type: ignore[arg-type]
    both = np.linalg.inv([[information, -mixed], [-mixed, Summed.fisher.item() + 1.0]])
    assert cov.item() == pytest.approx(both[0, 0])
    assert size.item() == pytest.approx(0.5 * both[0, 0])
    assert shift.item() == pytest.approx(0.5 * both[1, 0])
