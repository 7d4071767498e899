"""Parts of a record against each other: against drawn scores, a step of a parameter, and noise of other size."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import gammainccinv, ndtri

from windsysid._types import Array
from windsysid.checks.constancy import (
    Constancy,
    Part,
    chances,
    doubt_constancy,
    doubt_halves,
    doubt_scatter,
    join_parts,
    judge_constancy,
)
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, SCATTER_FALSE_ALARM_PROBABILITY
from windsysid.results.finding import Finding

SLOPES = np.array([1.0, 0.3, 2.0])
SPREAD = 0.7


def parts_of(rng: np.random.Generator, theta: Array, *, parts: int = 16, samples: int = 40) -> list[Part]:
    """What parts of y = X θ + e say of θ (3,) at zero; θ is a row for each part (parts, 3)."""
    found = []
    for own in theta if theta.ndim == 2 else [theta] * parts:
        X = rng.standard_normal((samples, 3)) * SLOPES
        y = X @ own + rng.standard_normal(samples)
        found.append(Part(samples, X.T @ y, X.T @ X))
    return found


def judged(parts: list[Part]):
    """At the mode of a posterior with a prior of standard deviation `SPREAD`."""
    fisher, gradient = sum(part.fisher for part in parts), sum(part.gradient for part in parts)
    step = np.linalg.solve(fisher + np.eye(3) / SPREAD**2, gradient)
    return judge_constancy(parts, np.diag(np.full(3, SPREAD**2)), np.asarray(step, dtype=np.float64))


def test_halves_of_true_models_differ_by_chance_and_parts_scatter_as_fisher_information_tells():
    rng = np.random.default_rng(20261125)
    found = [judged(parts_of(rng, SPREAD * rng.standard_normal(3))) for _ in range(1500)]
    apart, scatter, freedom = (np.array([one[i] for one in found]) for i in range(3))
    assert np.std(apart, axis=0) == pytest.approx(np.ones(3), abs=0.06)
    assert np.mean(apart, axis=0) == pytest.approx(np.zeros(3), abs=0.08)
    assert np.mean(scatter, axis=0) == pytest.approx(np.ones(3), abs=0.04)
    assert np.var(scatter, axis=0) == pytest.approx(2.0 / np.mean(freedom, axis=0), rel=0.25)
    halves, parts = (np.array([chances(one, 3)[i] for one in found]) for i in range(2))
    assert np.mean(halves < 0.05) == pytest.approx(0.05, abs=0.012)
    assert np.mean(parts < 0.05) == pytest.approx(0.05, abs=0.015)


def test_a_step_of_a_parameter_halfway_is_told_with_its_name():
    rng = np.random.default_rng(1)
    theta = np.zeros((16, 3))
    theta[8:, 1] = 1.2
    doubt = doubt_constancy(("k_x", "k_y", "c_x"), judged(parts_of(rng, theta)))[0]
    assert (doubt.code, doubt.quantities) == ("halves_disagree", ("k_y",))


def test_a_parameter_that_goes_up_and_down_scatters():
    rng = np.random.default_rng(2)
    theta = np.zeros((20, 3))
    theta[:, 0] = 0.5 * (-1.0) ** (np.arange(20) // 2)
    found = judged(parts_of(rng, theta))
    (doubt,) = doubt_constancy(("k_x", "k_y", "c_x"), found)
    assert (doubt.code, doubt.quantities) == ("segments_scatter", ("k_x",))
    assert doubt.data["ratio"] == pytest.approx(np.sqrt(found.scatter[0]))
    assert found.scatter[0] > 3.0


def test_a_model_that_is_true_is_not_doubted_and_one_in_a_thousand_may_be():
    rng = np.random.default_rng(3)
    doubted = sum(bool(doubt_constancy(("a", "b", "c"), judged(parts_of(rng, np.zeros(3))))) for _ in range(1000))
    assert doubted <= 8  # of two expected


def test_what_the_record_does_not_know_is_not_asked():
    rng = np.random.default_rng(4)
    parts = [Part(40, part.gradient * [1, 1, 0], part.fisher * np.outer([1, 1, 0], [1, 1, 0])) for part in
             parts_of(rng, np.zeros(3))]  # fmt: skip
    found = judged(parts)
    assert (found.apart[2], found.scatter[2], found.freedom[2]) == (0.0, 1.0, 0.0)
    assert doubt_constancy((), found) == doubt_constancy(("a",), None) == []


def test_many_parts_are_taken_together_in_the_order_of_time():
    parts = [Part(10, np.array([float(i)]), np.array([[1.0]])) for i in range(150)]
    joined = join_parts(parts)
    assert len(joined) <= 64
    assert sum(part.samples for part in joined) == 1500
    assert sum(float(part.gradient[0]) for part in joined) == sum(range(150))
    assert [part.gradient[0] / part.samples for part in joined] == sorted(
        part.gradient[0] / part.samples for part in joined
    )


@pytest.mark.parametrize("count", [1, 2, 3])
def test_too_few_parts_say_nothing_of_their_scatter(count: int):
    found = judged(parts_of(np.random.default_rng(5), np.zeros(3), parts=count))
    assert not found.freedom.any()
    assert found.apart.any() == (count > 1)


@pytest.mark.parametrize("names", [("k_x",), ("k_x", "k_y"), ("k_x", "k_y", "c_x")])
@pytest.mark.parametrize("doubt", [doubt_halves, doubt_scatter])
def test_the_chance_of_a_false_doubt_is_shared_by_all_parameters(
    doubt: Callable[..., list[Finding]], names: tuple[str]
):
    """Bonferroni: of n parameters each may be condemned by the n-th part of the chance."""
    chance = {doubt_halves: FALSE_ALARM_PROBABILITY, doubt_scatter: SCATTER_FALSE_ALARM_PROBABILITY}[doubt]
    n, freedom = len(names), 9.0

    def as_rare_as(p: float) -> Constancy:
        apart, scatter = -ndtri(0.5 * p), gammainccinv(0.5 * freedom, p) / (0.5 * freedom)
        others = np.zeros(n - 1)
        return Constancy(
            np.array([apart, *others]), np.array([scatter, *(1.0 + others)]), np.array([freedom, *(freedom + others)])
        )

    assert doubt(names, as_rare_as(0.95 * chance / n))
    assert doubt(names, as_rare_as(1.05 * chance / n)) == []


def test_halves_of_which_one_tells_nearly_all_differ_by_chance():
    """A decay: the mode has moved with its first half, which leaves that half little to say against it."""
    rng = np.random.default_rng(20261126)
    fisher, found = (9.0, 1.0, 1.0, 1.0), []
    for _ in range(2000):
        own = [f * (0.3 + rng.standard_normal() / np.sqrt(f)) for f in fisher]
        step = np.array([sum(own) / (sum(fisher) + 1e-6)])
        parts = [Part(10, np.array([g]), np.array([[f]])) for g, f in zip(own, fisher, strict=True)]
        found.append(judge_constancy(parts, np.array([[1e6]]), step).apart[0])
    assert np.std(found) == pytest.approx(1.0, abs=0.06)
