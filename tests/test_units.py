"""Units at the edge: one spelling, one factor, and no guesses."""

import math

import pytest

from windsysid.errors import ConfigurationError
from windsysid.units import UNITS, canonical, is_same_quantity, si_unit, to_si, unit_text


@pytest.mark.parametrize(
    ("spellings", "unit"),
    [
        (("kN-m", "(kN·m)", "[kN*m]", "kN m", "kNm", " kN⋅m "), "kN*m"),
        (("m/s²", "m/s^2", "m/s2", "m/s**2", "m/s/s", "m/sec^2"), "m/s^2"),
        (("RPM", "rev/min", "1/min", "rpm"), "rpm"),
        (("°", "degrees", "deg"), "deg"),
        (("Ns/m", "N-s/m", "N·s/m"), "N*s/m"),
        (("µε", "με"), "µε"),
        (("sec", "seconds", "(s)"), "s"),
    ],
)
def test_one_unit_has_many_spellings(spellings: tuple[str, ...], unit: str):
    assert {canonical(spelling) for spelling in spellings} == {unit}


@pytest.mark.parametrize("unit", ["furlong", "N/s", "M", "kn", "m\\s", "m/s^3"])
def test_an_unknown_unit_is_an_error_and_never_a_guess(unit: str):
    with pytest.raises(
        ConfigurationError, match=r"unknown unit .* expected one of the units windsysid knows"
    ) as caught:
        canonical(unit)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (12.1, "rpm", 12.1 * 2 * math.pi / 60), (180.0, "deg", math.pi), (2.0, "g", 19.6133), (3.6, "km/h", 1.0),
        (1.0, "mm", 1e-3), (1.0, "MN/m", 1e6), (100.0, "microstrain", 1e-4), (5.0, "%", 0.05), (1.0, "t", 1000.0),
    ],
)  # fmt: skip
def test_values_become_si(value: float, unit: str, expected: float):
    assert to_si(value, unit) == pytest.approx(expected, rel=1e-14)


def test_every_unit_leads_to_an_si_unit_that_leads_to_itself():
    for unit, (si, factor) in UNITS.items():
        assert UNITS[si] == (si, 1.0), unit
        assert factor > 0.0
        assert si_unit(unit) == si
        assert canonical(canonical(unit)) == canonical(unit)


def test_printed_units_are_read_again():
    for unit in UNITS:
        assert to_si(1.0, unit_text(unit)) == to_si(1.0, unit), unit
    assert unit_text("N*m*s/rad") == "N·m·s/rad"
    assert unit_text("m/s^2") == "m/s²"


def test_quantities_are_told_apart():
    assert is_same_quantity("kN/m", "N/m")
    assert not is_same_quantity("N/m", "N*s/m")
    assert not is_same_quantity("rad", "1")
