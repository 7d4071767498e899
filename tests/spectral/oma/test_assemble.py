"""Units and spectra of the result."""

import pytest

from windsysid.spectral.oma.assemble import acceleration_unit


@pytest.mark.parametrize(
    ("unit", "order", "expected"),
    [("m/s^2", 2, "m/s^2"), ("m/s", 1, "m/s^2"), ("m", 0, "m/s^2"), ("N m", 0, "N m/s^2"), ("1", 0, "1/s^2")],
)
def test_shapes_have_the_units_of_accelerations(unit: str, order: int, expected: str):
    assert acceleration_unit(unit, order) == expected
