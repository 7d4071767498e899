"""Formats of templates beyond Python's."""

import pytest

from windsysid.results.sentences.template import LIKELY_MACHINE, fill


@pytest.mark.parametrize(
    ("template", "value", "text"),
    [
        ("{a}", ["x", "y", "z"], "x, y, z"),
        ("{a:and}", ["x", "y"], "x and y"),
        ("{a:sample(s)}", 1, "1 sample"),
        ("{a:sample(s)}", 3, "3 samples"),
        ("{a:.3g %}", 0.01234, "1.23 %"),
        ("{a:|.1f|}", -4.26, "4.3"),
        ("{a:.2f}", 4.256, "4.26"),
    ],
)
def test_a_field_is_written_as_its_format_says(template: str, value: object, text: str):
    assert fill(template, {"a": value}) == text


def test_a_function_makes_its_own_text():
    assert fill(lambda d: f"<{d['a']}>", {"a": 2}) == "<2>"
    assert fill("x" + LIKELY_MACHINE, {}) == "x: likely a machine or waves; choose a section without it"


def test_a_field_without_data_is_an_error():
    with pytest.raises(KeyError):
        fill("{a}", {})
