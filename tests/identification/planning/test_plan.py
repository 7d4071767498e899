"""Options of a plan that make no record are refused in one line."""

from typing import Any

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.identification.planning.plan import Plan, plan

OPTIONS: list[tuple[dict[str, Any], str]] = [
    ({"within": 0.0}, "within: expected a positive number of at most 10, got 0"),
    ({"load_scale": float("nan")}, "load scale: expected a positive number of at most 1e\\+06, got nan"),
    ({"rate": -1.0}, "rate: expected a positive number"),
    ({"rate": 0.5}, "rate: expected at least .* samples per second for a mode at"),
    ({"duration": 1.0}, "duration: expected .* to ten years, got 1 s"),
    ({"rotor_speed": -1.0}, r"rotor speed: expected a number from 0 \(parked\)"),
    ({"sensors": ()}, "the sensor list is empty"),
    ({"formulation": "both"}, "formulation: expected auto, joint, spectral; got 'both'"),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_a_record_that_cannot_be_planned_is_refused(options: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message) as caught:
        plan("tower", **options)
    assert "\n" not in str(caught.value)


def test_bands_shrink_with_the_square_root_of_time_and_the_wish_is_met_where_they_say():
    names, nothing, growth = ("k", "noise"), np.zeros((2, 2)), np.diag([4.0, 1.0])
    found = Plan(
        "tower", ("a",), 0.0, 10.0, 100.0, 0.05, names, 1, ("k",), 0.0, nothing, growth, 0.0, (), ()
    )  # fmt: skip
    assert found.band("k") == pytest.approx(2.0 / np.sqrt(4.0 * 100.0))
    assert found.band("k", 400.0) == pytest.approx(0.5 * found.band("k"))
