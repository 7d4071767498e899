"""Damping far from the file's is found, and the prior that held it is said to be wide now."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest

from tests.findings import codes, only, reasons
from tests.identification.fits import identify_without_effects
from windsysid.identification.estimate import prior_conflict
from windsysid.identification.estimate.prior_conflict import find_held, note_wide_priors, one_by_one
from windsysid.results.finding import Finding
from windsysid.simulation.record import simulate_record
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine


def found_of(times: float, seed: int, formulation: Literal["auto", "joint"] = "auto", duration: float = 600.0):
    tower = load_turbine("tower")
    true = tower.with_values({"c_side_side": times * tower.values["c_side_side"]})
    record = simulate_record(true, duration=duration, rate=8.0, seed=seed)
    return true, identify_without_effects(record, tower, formulation=formulation)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("formulation", ["auto", pytest.param("joint", marks=pytest.mark.slow)])
def test_four_times_the_damping_of_the_file_is_found(seed: int, formulation: Literal["auto", "joint"]):
    """The prior of half the file's damping held it at half of the truth, six standard deviations off and trusted."""
    true, found = found_of(4.0, seed, formulation)
    c = found["c_side_side"]
    assert abs(c.estimate - true.values["c_side_side"]) < 3.0 * c.std
    assert only(found.findings, "prior_widened").data["factor"] == pytest.approx(4.0)


def test_damping_that_no_prior_like_the_files_could_have_is_found_and_not_trusted():
    true, found = found_of(9.0, 3)
    c = found["c_side_side"]
    assert abs(c.estimate - true.values["c_side_side"]) < 3.0 * c.std
    assert not found.diagnosis.trusted
    assert (reasons(found)[0].code, reasons(found)[0].quantities) == ("prior_conflict", ("c_side_side",))


def test_a_prior_is_not_widened_where_the_search_was_too_expensive(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(prior_conflict, "MAX_REPEATED_ELEMENTS", 0.0)
    _, found = found_of(4.0, 1, "joint", 150.0)
    assert "prior_widened" not in codes(found.findings)
    assert "search_exhausted" in codes(reasons(found))
    assert found["c_side_side"].grade == "C"


@pytest.mark.slow
def test_damping_as_in_the_file_keeps_its_prior():
    _, found = found_of(1.0, 4)
    assert "prior_widened" not in codes(found.findings)


@pytest.mark.parametrize(("likeliest", "held"), [(1.1, ()), (2.0, ("c",)), (0.3, ("c",))])
def test_a_prior_holds_what_the_likelihood_wants_elsewhere(likeliest: float, held: tuple[str, ...]):
    """A likelihood of ln c with a standard deviation of a quarter, and a prior of 1 ± 0.1."""
    c = Parameter("c_x", 1.0, 0.1, logarithmic=False, kind="damping")

    def log_likelihood(unknowns: np.ndarray) -> float:
        return -0.5 * float(np.log(unknowns[0] / likeliest) / 0.25) ** 2

    grid = np.linspace(0.2, 3.0, 5000)
    mode = grid[np.argmax([log_likelihood(np.array([x])) - 0.5 * ((x - 1.0) / 0.1) ** 2 for x in grid])]
    found = find_held(one_by_one(log_likelihood), np.array([mode]), np.array([[0.01]]), [c])
    assert found == tuple("c_x" for _ in held)


class _Ended(NamedTuple):
    """As much of an outcome as the note reads."""

    model: Any
    priors: tuple[Parameter, ...]
    theta: np.ndarray
    cov: np.ndarray
    notes: tuple[Finding, ...] = ()
    doubts: tuple[Finding, ...] = ()


@pytest.mark.parametrize(("estimate", "doubted"), [(9.0, True), (-5.0, True), (3.2, False), (0.8, False)])
def test_an_estimate_far_from_the_prior_that_was_given_is_a_doubt_on_either_side(estimate: float, doubted: bool):
    """Prior 2 ± 1, made four times as wide; the readings know the coefficient to 0.1."""
    given = Parameter("c_x", 2.0, 1.0, False, 1.0, "damping")
    model = SimpleNamespace(parameters=(replace(given, spread=4.0),))
    told = note_wide_priors(_Ended(model, (given,), np.array([estimate]), 0.01 * np.eye(1)))  # type: ignore[arg-type]
    assert len(told.notes) == 1
    assert bool(told.doubts) is doubted
