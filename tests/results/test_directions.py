"""Singular directions in words, against models whose singular directions are known by construction."""

import numpy as np
import pytest

from windsysid.checks.identifiability import describe_directions, describe_information, standard_deviations

NAMES = ("k_x", "c_x", "hub_mass_x", "load_rms")


def seen(*combinations: tuple[float, ...], sigma: float = 0.01) -> np.ndarray:
    """Information of data that see each combination (in ln p) to `sigma`, and nothing else."""
    rows = np.array(combinations) / sigma
    return rows.T @ rows


def test_standard_deviations_are_the_cramer_rao_bound_of_a_regular_information():
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((20, 5)) * [1.0, 10.0, 1e3, 1e-2, 1.0]  # badly scaled, well conditioned
    information = rows.T @ rows
    np.testing.assert_allclose(
        standard_deviations(information), np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-9
    )
    assert describe_information("abcde", information) == []


def test_what_is_mixed_up_has_no_standard_deviation_and_the_rest_keeps_its_own():
    # ln k − ln m is seen to 1 %, ln c to 2 %, the load not at all.
    information = seen((1, 0, -1, 0)) + seen((0, 1, 0, 0), sigma=0.02)
    np.testing.assert_allclose(standard_deviations(information), [np.inf, 0.02, np.inf, np.inf])


@pytest.mark.parametrize(
    ("names", "combinations", "expected"),
    [
        (("k_x", "m"), [(1, -1)], ["k_x and m: only their ratio k_x/m is determined"]),
        (("m", "k_x"), [(-1, 1)], ["m and k_x: only their ratio m/k_x is determined"]),
        (("k_x", "m"), [(1, -2)], ["k_x and m: only k_x/m² is determined"]),
        (("a", "b"), [(1, 1)], ["a and b: only their product a·b is determined"]),
        (("a", "b", "c"), [(2, -1, -1)], ["a, b and c: only a²/(b·c) is determined"]),
        (("a", "b"), [(3, 2)], ["a and b: only a³·b² is determined"]),
        (("c_beta_1", "c_beta_2", "c_beta_3"), [(1, 1, 1)],
        ["c_beta_1, c_beta_2 and c_beta_3: only their sum is determined"]),
        (("a", "b"), [(1, 0)], ["b is not determined by the data at all"]),
        (
            NAMES,
            [(1, 0, -1, 0), (0, 1, -1, 0), (0, 0, 1, -1)],
            [
                "k_x, c_x, hub_mass_x and load_rms: only the proportion between them (not their common factor) is"
                " determined"
            ],
        ),
        (("k_x", "m"), [(1, -0.4826)], ["k_x +4.8 % and m +10 % together: no effect on the readings"]),
        (
            ("a", "b", "c", "d"),
            [(1, -1, 0, 0), (0, 0, 1, 1)],
            ["a and b: only their ratio a/b is determined", "c and d: only their product c·d is determined"],
        ),
        (
            ("a", "b", "c", "d", "e"),
            [(1, -1, 0, 0, 0), (0, 0, 1, 0, 0), (0, 0, 0, 1, 0)],
            ["a and b: only their ratio a/b is determined", "e is not determined by the data at all"],
        ),
    ],
)  # fmt: skip
def test_what_is_not_seen_is_said_in_words(names, combinations, expected):
    assert [str(one) for one in describe_information(names, seen(*combinations))] == expected


def test_words_do_not_depend_on_how_well_the_rest_is_seen():
    # The same combinations seen with σ from 10⁻⁴ to 1, and correlated with each other.
    mix = np.array([[1.0, 0.3, 0.0], [0.0, 0.01, 0.002], [0.5, 0.0, 1e-4]])
    rows = np.linalg.solve(mix, np.array([[1.0, 0, -1, 0], [0, 1.0, -1, 0], [0, 0, 1.0, -1]]))
    (found,) = describe_information(NAMES, rows.T @ rows)
    assert (found.code, found.quantities) == ("unseen_combination", NAMES)
    assert found.data["seen"].startswith("the proportion between them")


@pytest.mark.parametrize("noise", [1e-9, 1e-5])
def test_rounding_of_the_differences_is_not_taken_for_information(noise):
    rng = np.random.default_rng(1)
    rows = np.array([[1.0, -1.0]]) * rng.standard_normal((500, 1)) + noise * rng.standard_normal((500, 2))
    (found,) = describe_information(("k_x", "m"), 1e4 * rows.T @ rows)
    assert (found.code, found.data["seen"]) == ("unseen_combination", "their ratio k_x/m")


def test_what_is_hardly_told_apart_is_said_with_both_bands():
    # The ratio to σ = 0.5 %, the common factor to σ = 40 %: ±2σ of each is 80 %.
    information = seen((1, -1), sigma=0.005) + seen((0.5, 0.5), sigma=0.4)
    (found,) = describe_information(("k_x", "m"), information)
    assert (found.code, found.data["seen"]) == ("hard_to_tell_apart", "their ratio k_x/m")
    assert found.data["std"] == pytest.approx(0.005, rel=0.01)
    text = "k_x and m are hard to distinguish: their ratio k_x/m is known to ±1 %, each alone to ±80 % (95 % interval)"
    assert str(found) == text


def test_three_that_are_hardly_told_apart_are_said_as_a_move():
    information = seen((1, -1, 0), (0, 1, -1)) + seen((1, 1, 1), sigma=3.0)
    (found,) = describe_information("abc", information)
    assert (found.code, found.quantities) == ("direction_hardly_seen", ("a", "b", "c"))
    assert found.data["direction"] == "a +10 %, b +10 % and c +10 %"
    assert str(found).startswith("a, b and c are hard to distinguish: a +10 %, b +10 % and c +10 % together")


def test_strong_correlations_are_named_and_nuisances_are_not_spoken_of_on_their_own():
    covariance = np.array([[1.0, 0.95, 0.0], [0.95, 1.0, 0.0], [0.0, 0.0, 1.0]])
    information = np.linalg.inv(covariance)
    for aside in ("", "bc"):
        (found,) = describe_information("abc", information, aside=aside)
        assert (found.code, found.quantities) == ("correlated_estimates", ("a", "b"))
        assert found.data["correlation"] == pytest.approx(0.95)
    assert describe_information("abc", information, aside="ab") == []
    ratio = seen((1, -1, 0), (0, 0, 1))
    assert describe_information("abc", ratio, aside="ab") == []
    (found,) = describe_information("abc", ratio, aside="b")
    assert (found.code, found.quantities) == ("unseen_combination", ("a", "b"))


def posterior(prior_std, *data):
    """Posterior and prior covariance of a Gaussian prior and data that see combinations of θ: (row, σ)."""
    prior = np.diag(np.square(prior_std))
    information = np.linalg.inv(prior) + sum(np.outer(row, row) / sigma**2 for row, sigma in data)
    return np.linalg.inv(information), prior


def test_a_band_that_is_the_priors_is_said_to_be_with_the_share_of_the_data():
    # Prior 0.3, data 0.9: 1/0.9² of 1/0.9² + 1/0.3² is 10 %. The other is known to 0.01.
    cov, prior = posterior([0.3, 0.3], ([1.0, 0.0], 0.01), ([0.0, 1.0], 0.9))
    (found,) = describe_directions(("k_x", "c_x"), cov, prior, (True, False), np.array([0.0, 0.04]))
    assert (found.code, found.severity, found.quantities) == ("prior_dominates", "remark", ("c_x",))
    assert found.data["share"] == pytest.approx(0.1)


def test_of_stiffness_and_mass_only_the_ratio_comes_from_the_data():
    cov, prior = posterior([0.3, 0.3], ([1.0, -1.0], 0.01))
    ratio, correlated = describe_directions(("k_x", "hub_mass_x"), cov, prior, (True, True))
    assert (ratio.code, ratio.quantities) == ("prior_dominates", ("k_x", "hub_mass_x"))
    assert ratio.data["seen"] == "their ratio k_x/hub_mass_x"
    assert ratio.data["share"] == pytest.approx(0.0, abs=0.005)
    assert (correlated.code, correlated.quantities) == ("correlated_estimates", ("k_x", "hub_mass_x"))
    assert correlated.data["correlation"] == pytest.approx(1.0, abs=0.005)


def test_proportional_coordinates_count_relative_to_where_they_are():
    # θ of the damper is 0.04; along k, c, m by a common factor nothing is seen: d(ln k, θ_c, ln m) = (1, 0.04, 1).
    cov, prior = posterior([0.3, 0.012, 0.3], ([1.0, 0.0, -1.0], 0.01), ([0.0, 25.0, -1.0], 0.02))
    found = describe_directions(("k", "c", "m"), cov, prior, (True, False, True), np.array([0.0, 0.04, 0.0]))[0]
    assert found.quantities == ("k", "c", "m")
    assert found.data["seen"] == "the proportion between them (not their common factor)"


def test_several_bands_that_are_the_priors_are_told_one_by_one():
    # Rotated among themselves by a weak correlation, the eigenvectors mix them; the words must not.
    cov, prior = posterior([0.3, 0.3, 0.3], ([1.0, 0.1, 0.0], 2.0), ([0.1, 1.0, 0.1], 2.0), ([0.0, 0.1, 1.0], 2.0))
    found = describe_directions("abc", cov, prior, (True,) * 3)
    assert [one.quantities for one in found] == [("a",), ("b",), ("c",)]
    assert {one.code for one in found} == {"prior_dominates"}


def test_nothing_is_said_where_the_data_rule():
    cov, prior = posterior([0.3, 0.3], ([1.0, 0.0], 0.01), ([0.0, 1.0], 0.1))
    assert describe_directions(("k_x", "c_x"), cov, prior, (True, False), np.array([0.0, 0.04])) == []
