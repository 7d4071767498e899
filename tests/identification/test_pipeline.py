"""The loop of an identification: what fails on the way leaves the fit that stands, and is said."""

from collections.abc import Sequence

import numpy as np
import pytest

from tests.findings import only
from windsysid.errors import RecordError
from windsysid.identification import automatic_choice, pipeline
from windsysid.identification.identify import identify
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.effect import Detection, Effect
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.regressor import Regressors
from windsysid.identification.pipeline import run
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


class Included:
    """An inclusion that changes nothing, or that cannot be taken in."""

    code = "hum"

    def __init__(self, error: str = "") -> None:
        self.error = error

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        if self.error:
            raise RecordError(self.error)
        return record, tuple(sensors)

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        return ()


class Hum(Effect):
    """An effect that is always warranted."""

    code = "hum"

    def __init__(self, error: str = "") -> None:
        self.error = error

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        return Detection(fit, Included(self.error), 9.0, fit)


class Failing(Effect):
    """An effect whose test fails."""

    code = "failing"

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        raise np.linalg.LinAlgError("singular matrix")


@pytest.fixture(scope="module")
def job() -> Job:
    made = simulate_record("tower", duration=120.0, rate=4.0, seed=1)
    return Job(made, made, load_turbine("tower"), None, None, None, None, "broadband")


@pytest.fixture(scope="module")
def plain(job: Job) -> FittedJob:
    return run(job, effects=())[1]


def test_nothing_is_included_in_a_fit_whose_search_was_too_expensive_to_end(
    job: Job, plain: FittedJob, monkeypatch: pytest.MonkeyPatch
):
    ended = plain.doubted(Finding("search_exhausted", "reason", {"steps": 6}))
    monkeypatch.setattr(pipeline, "estimate", lambda *given: ended)
    assert run(job, effects=((Hum(),),)) == (job, ended)


def test_an_effect_that_cannot_be_tested_leaves_the_fit(job: Job, plain: FittedJob):
    _, fit = run(job, effects=((Failing(),),))
    assert np.array_equal(fit.outcome.theta, plain.outcome.theta)
    said = only(fit.outcome.notes, "effect_not_tested")
    assert (said.data["effect"], said.data["error"]) == ("failing", "singular matrix")


def test_an_effect_that_cannot_be_included_leaves_the_fit_and_speaks_against_it(job: Job, plain: FittedJob):
    answered, fit = run(job, effects=((Hum("the hum cannot be removed"),),))
    assert np.array_equal(fit.outcome.theta, plain.outcome.theta)
    assert not [one for one in answered.effects if one.code == "hum"]
    said = only(fit.unmodelled, "effect_not_included")
    assert said.severity == "reason"
    assert (said.data["effect"], said.data["error"]) == ("hum", "the hum cannot be removed")


def test_an_effect_still_warranted_after_the_last_extension_speaks_against_the_fit(
    job: Job, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(pipeline, "MAX_EXTENSIONS", 2)
    _, fit = run(job, effects=((Hum(),),))
    assert only(fit.unmodelled, "effect_not_included").data["error"] == "2 effects are included"


@pytest.mark.parametrize("failing", ["joint", pytest.param("spectral", marks=pytest.mark.slow)])
def test_a_cross_check_that_fails_leaves_the_result(monkeypatch: pytest.MonkeyPatch, failing: str):
    """Filters that fail beside spectra, and spectra that fail with what filters found, end nothing."""
    calls: list[str] = []

    def run_or_fail(job: Job, *args: object, **options: object) -> tuple[Job, FittedJob]:
        calls.append(job.formulation)
        if job.formulation == failing and (failing == "joint" or calls.count("spectral") > 1):
            raise RecordError("not today")
        return run(job, *args, **options)  # type: ignore[arg-type]

    made = simulate_record("tower", duration=300.0, rate=4.0, seed=5)
    channel = "tower_z_acceleration"
    made = made.with_channels({channel: (made[channel] + 0.03 * (made.time > 165.0), made.unit(channel))})
    monkeypatch.setattr(automatic_choice, "run", run_or_fail)
    found = identify(made, "tower")
    assert found.formulation == ("spectral" if failing == "joint" else "joint")
    assert "not today" in " ".join(str(one) for one in found.findings)


def test_filters_answer_where_spectra_fail_with_what_filters_found(
    job: Job, plain: FittedJob, monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: object) -> None:
        raise RecordError("not today")

    monkeypatch.setattr(automatic_choice, "run", fail)
    step = Regressors("step", lambda terms: {})
    spectral = plain._replace(outcome=plain.outcome._replace(turns=False))
    found = automatic_choice._cross_checked(job.including(step), plain, job, spectral)
    assert np.array_equal(found.outcome.theta, plain.outcome.theta)
    assert only(found.outcome.notes, "joint_as_spectra_do_not_apply").data["error"] == "not today"


@pytest.mark.parametrize(
    ("name", "rate", "seconds", "loads"),
    [
        ("verne555", 100.0, 9.0, "auto"), ("verne555", 20.0, 9.0, "auto"), ("verne555", 100.0, 11.0, "broadband"),
        ("verne555", 20.0, 11.0, "broadband"), ("nrel5mw", 100.0, 11.0, "auto"),
        ("nrel5mw_full", 100.0, 28.0, "broadband"),
    ],
)  # fmt: skip
def test_filters_have_the_loads_of_wind_where_a_search_is_cheap(name: str, rate: float, seconds: float, loads: str):
    """220 readings at 20 Hz are 1100 steps of the equations, and each updates the covariance of 60 states: 2900 steps
    took a minute. The 5 MW turbine without roll has 56."""
    record = simulate_record(name, duration=seconds, rate=rate, seed=1)
    job = Job(record, record, load_turbine(name), None, None, None, None, "auto")
    assert automatic_choice._affordable(job).loads == loads
