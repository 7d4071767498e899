"""Sentences about innovations."""

import pytest

from windsysid.results.sentences import names_cause, sentence
from windsysid.results.sentences.innovations import INNOVATIONS


def test_a_peak_is_said_with_its_harmonic_and_the_other_channels():
    data = {"channels": ["x", "y", "z"], "frequency": 3.48, "rotor_frequency": 1.16, "level": 3.21}
    expected = (
        "the model does not explain x around 3.48 Hz = 3.0P: the power of its prediction errors is 3.2 times that"
        " expected (also y, z)"
    )
    assert sentence("unexplained_peak", data).startswith(expected)
    assert "3.48 Hz: the power" in sentence("unexplained_peak", data | {"rotor_frequency": 0.0})


@pytest.mark.parametrize(
    ("law", "sigmas", "grows", "cause"),
    [
        ("stiffness", 5.0, "grows", "hardens"),
        ("stiffness", -5.0, "falls", "softens"),
        ("damping", 5.0, "falls", "dry friction"),
        ("damping", -5.0, "grows", "nonlinear damping"),
    ],
)
def test_the_sign_says_whether_a_coefficient_grows_with_amplitude_and_why(
    law: str, sigmas: float, grows: str, cause: str
):
    text = sentence("amplitude_dependence", {"law": law, "sigmas": sigmas, "coordinates": ["x", "y"]})
    assert text.startswith(f"{law} of x and y {grows} with amplitude (5.0 standard deviations): likely ")
    assert cause in text


def test_innovations_too_large_or_too_small_make_bands_too_narrow_or_too_wide():
    data = {"mean_square": 1.44, "low": 0.98, "high": 1.02}
    assert sentence("innovation_level", data | {"ratio": 1.2}).endswith("all intervals are too narrow")
    assert sentence("innovation_level", data | {"ratio": 0.8}).endswith("all intervals are too wide")


def test_a_level_that_varies_in_one_channel_is_likely_an_instrument():
    data = {"channel": "x", "variation": 0.31}
    assert "31 % over the record: likely an instrument" in sentence("nonstationary_level", data | {"alone": True})
    assert "likely loads of varying strength" in sentence("nonstationary_level", data | {"alone": False})


def test_shares_are_percent_and_reasons_name_a_cause():
    assert sentence("missing_samples", {"channel": "x", "share": 0.6}) == "x is missing in 60 % of the samples"
    assert {code for code in INNOVATIONS if names_cause(code)} >= {"channel_level", "spectral_line", "late_blades"}
