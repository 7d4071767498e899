"""Sentences about estimates."""

import math

import pytest

from windsysid.results.sentences import sentence
from windsysid.results.sentences.estimates import ESTIMATES


def test_a_damping_that_is_not_positive_is_listed_with_its_value_and_its_mode():
    data = {
        "coefficients": [["c_x", -0.1, True], ["c_y", -20000.0, False, "N*s/m"]],
        "modes": [["lag forward", -0.002, False]],
    }
    text = sentence("damping_not_positive", data)
    assert "c_x is -0.1 (negative over its whole interval), c_y is -20 kN·s/m, lag forward has -0.2 %." in text


@pytest.mark.parametrize(
    ("group", "estimate", "std", "text"),
    [
        ("clock", -2e-3, 1e-4, "the logger a is 2.00 ± 0.10 ms early"),
        ("gain", 0.021, 0.004, "the gain of a is 2.10 ± 0.40 % larger than its file says"),
        ("masses", -0.03, 0.01, "the mass of a is 3.0 ± 1.0 % smaller than its file says"),
        ("alignment", math.radians(5.0), math.radians(0.2), "a is rotated by +5.00 ± 0.20°"),
    ],
)
def test_a_tolerance_has_two_digits_of_its_standard_deviation(group: str, estimate: float, std: float, text: str):
    data = {"group": group, "of": "a", "estimate": estimate, "std": std, "contradicted": False}
    assert sentence("tolerance_off", data) == f"{text}: the estimates take it into account"
    assert sentence("tolerance_off", data | {"contradicted": True}).startswith(f"{text}, according to the model")


def test_two_coefficients_that_are_hard_to_tell_apart_have_the_bands_of_their_ratio_and_of_each():
    data = {"seen": "their ratio k_x/m", "std": 0.01, "low": 0.04, "high": 0.05}
    expected = (
        "k_x and m are hard to distinguish: their ratio k_x/m is known to ±2 %, each alone to ±8 % … ±10 %"
        " (95 % interval)"
    )
    assert sentence("hard_to_tell_apart", data, ("k_x", "m")) == expected
    alike = data | {"high": 0.041}
    assert sentence("hard_to_tell_apart", alike, ("k_x", "m")).endswith("each alone to ±8 % (95 % interval)")


def test_a_prior_that_dominates_is_said_of_one_of_several_and_of_a_combination():
    data = {"share": 0.4, "seen": "", "direction": "k_x +10 % and m +10 %"}
    text = "k_x: 40 % from the data, its interval comes mostly from the prior"
    assert sentence("prior_dominates", data, ("k_x",)) == text
    assert sentence("prior_dominates", data, ("k_x", "m")).startswith("k_x +10 % and m +10 % together: 40 %")
    seen = sentence("prior_dominates", data | {"seen": "their sum"}, ("k_x", "m"))
    assert seen.startswith("k_x and m: the data determine only their sum")


def test_signs_are_left_out_of_distances():
    text = sentence("prior_conflict", {"sigmas": -4.26}, ("c_x",))
    assert "they are 4.3 standard deviations apart" in text
    assert set(ESTIMATES) >= {"prior_conflict", "wider_intervals", "line_influence", "no_history"}
