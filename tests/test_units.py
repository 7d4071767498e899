"""Units at the edge: one spelling, one factor, and no guesses."""

import math
from fractions import Fraction

import pytest

from windsysid.errors import ConfigurationError
from windsysid.records.formats.contents.columns import SUFFIXES
from windsysid.units import UNITS, canonical, is_same_quantity, parse_quantity, si_unit, to_si, unit_text


@pytest.mark.parametrize(
    ("spellings", "unit"),
    [
        (("kN-m", "(kN·m)", "[kN*m]", "kN m", "kNm", " kN⋅m "), "kN*m"),
        (("m/s²", "m/s^2", "m/s2", "m/s**2", "m/s/s", "m/sec^2"), "m/s^2"),
        (("RPM", "rev/min", "1/min", "r/min", "U/min", "min^-1", "min-1", "rpm"), "rpm"),
        (("°", "degrees", "deg"), "deg"),
        (("Ns/m", "N-s/m", "N·s/m"), "N*s/m"),
        (("µε", "με", "uε", "µϵ", "µe", "Âµε"), "µε"),
        (("ustrain", "µstrain", "μStrain", "Microstrain", "MICROSTRAIN", "micro strain", "ustr"), "microstrain"),
        (("um/m", "µm/m", "μm/m", "um\\m", "µm\\m", "(um/m)", "µm / m"), "µm/m"),
        (("mstrain", "mε"), "mε"),
        (("kN\ufffdm", "kNÂ·m"), "kN*m"),
        (("sec", "seconds", "(s)", "Seconds", "SEC", "Sec"), "s"),
        (("m s-2", "m s^-2", "m s**-2", "m*s^-2", "m.s-2", "ms-2", "m·s⁻²", "m/(s^2)", "m/second^2"), "m/s^2"),
        (("s-2 m", "m s-1 s-1", "m / s2", "meters/second^2"), "m/s^2"),
        (("cm/s2", "cm s-2", "cms-2"), "cm/s^2"),
        (("Gal", "gal"), "Gal"),
        (("rad s-1", "rads-1", "rad.s^-1", "rad·s⁻¹"), "rad/s"),
        (("deg s-1", "°/s", "degrees/s", "degrees s-1"), "deg/s"),
        (("N m", "N·m", "N.m", "m*N"), "N*m"),
        (("N s m-1", "N.s/m", "N/m*s"), "N*s/m"),
        (("kN m s rad-1", "kN*m*s/rad"), "kN*m*s/rad"),
        (("kg m2", "kg*m2", "kg.m^2"), "kg*m^2"),
        (("MINUTES", "Min", "minute"), "min"),
        (("um s-1", "µm s^-1", "um/s"), "µm/s"),
    ],
)
def test_one_unit_has_many_spellings(spellings: tuple[str, ...], unit: str):
    assert {canonical(spelling) for spelling in spellings} == {unit}


@pytest.mark.parametrize(
    "unit",
    [
        "furlong",
        "N/s",
        "M",
        "kn",
        "m\\s",
        "m/s^3",
        "m s2",
        "m/s-2",
        "ms2",
        "S",
        "H",
        "m1",
        "1/s",
        "s-1",
        "m s-3",
        "m//s",
        "m/s/",
        "G",
        "V.V",
        "m-1",
        "N m m-1",
    ],
)
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


PI = Fraction(3141592653589793238462643383279502884197, 10**39)
DEGREE = PI / 180  # SI brochure, 9th edition, table 8
G = Fraction(980665, 100000)  # m/s², exact: 3rd CGPM (1901)

# Written from the SI brochure (BIPM, 9th edition): prefixes of table 7, units of tables 4 and 8, and no factor of the
# package.
BROCHURE: dict[str, tuple[str, Fraction | int]] = {
    "1": ("1", 1), "-": ("1", 1), "": ("1", 1), "%": ("1", Fraction(1, 100)), "V/V": ("1", 1),
    "mV/V": ("1", Fraction(1, 1000)),
    "strain": ("1", 1), "microstrain": ("1", Fraction(1, 10**6)), "ue": ("1", Fraction(1, 10**6)),
    "µε": ("1", Fraction(1, 10**6)), "mε": ("1", Fraction(1, 1000)), "ε": ("1", 1), "ppm": ("1", Fraction(1, 10**6)),
    "µm/m": ("1", Fraction(1, 10**6)), "mm/m": ("1", Fraction(1, 1000)), "m/m": ("1", 1), "‰": ("1", Fraction(1, 1000)),
    "µin/in": ("1", Fraction(1, 10**6)), "in/in": ("1", 1), "µV/V": ("1", Fraction(1, 10**6)),
    "µm": ("m", Fraction(1, 10**6)), "µm/s": ("m/s", Fraction(1, 10**6)), "µm/s^2": ("m/s^2", Fraction(1, 10**6)),
    "µg": ("m/s^2", G / 10**6), "µrad": ("rad", Fraction(1, 10**6)), "µV": ("V", Fraction(1, 10**6)),
    "s": ("s", 1), "ns": ("s", Fraction(1, 10**9)), "µs": ("s", Fraction(1, 10**6)), "ms": ("s", Fraction(1, 1000)),
    "min": ("s", 60),
    "h": ("s", 60 * 60),
    "d": ("s", 24 * 60 * 60),
    "m": ("m", 1), "mm": ("m", Fraction(1, 1000)), "cm": ("m", Fraction(1, 100)), "km": ("m", 1000),
    "cm/s": ("m/s", Fraction(1, 100)), "cm/s^2": ("m/s^2", Fraction(1, 100)), "Gal": ("m/s^2", Fraction(1, 100)),
    "m/s": ("m/s", 1), "mm/s": ("m/s", Fraction(1, 1000)), "km/h": ("m/s", Fraction(1000, 3600)),
    "m/s^2": ("m/s^2", 1), "mm/s^2": ("m/s^2", Fraction(1, 1000)), "g": ("m/s^2", G), "mg": ("m/s^2", G / 1000),
    "rad": ("rad", 1), "deg": ("rad", DEGREE), "mrad": ("rad", Fraction(1, 1000)),
    "rad/s": ("rad/s", 1), "deg/s": ("rad/s", DEGREE), "rpm": ("rad/s", 2 * PI / 60), "Hz": ("Hz", 1),
    "rad/s^2": ("rad/s^2", 1), "deg/s^2": ("rad/s^2", DEGREE), "rad/m": ("rad/m", 1), "deg/m": ("rad/m", DEGREE),
    "kg": ("kg", 1), "t": ("kg", 1000), "kg*m": ("kg*m", 1), "kg*m^2": ("kg*m^2", 1),
    "t*m^2": ("kg*m^2", 1000), "kg/m": ("kg/m", 1), "t/m": ("kg/m", 1000), "kg/m^3": ("kg/m^3", 1),
    "N*m^2": ("N*m^2", 1), "MN*m^2": ("N*m^2", 10**6), "GN*m^2": ("N*m^2", 10**9),
    "MN*m/rad": ("N*m/rad", 10**6), "GN*m/rad": ("N*m/rad", 10**9), "GPa": ("Pa", 10**9),
    "N": ("N", 1), "kN": ("N", 1000), "MN": ("N", 10**6),
    "N*m": ("N*m", 1), "kN*m": ("N*m", 1000), "MN*m": ("N*m", 10**6),
    "N/m": ("N/m", 1), "kN/m": ("N/m", 1000), "MN/m": ("N/m", 10**6),
    "N*s/m": ("N*s/m", 1), "kN*s/m": ("N*s/m", 1000),
    "N*m/rad": ("N*m/rad", 1), "kN*m/rad": ("N*m/rad", 1000),
    "N*s": ("N*s", 1), "N*m*s/rad": ("N*m*s/rad", 1), "kN*m*s/rad": ("N*m*s/rad", 1000),
    "W": ("W", 1), "kW": ("W", 1000), "MW": ("W", 10**6), "degC": ("degC", 1),
    "Pa": ("Pa", 1), "hPa": ("Pa", 100), "mbar": ("Pa", 100), "kPa": ("Pa", 1000), "MPa": ("Pa", 10**6),
    "bar": ("Pa", 10**5),
    "V": ("V", 1), "mV": ("V", Fraction(1, 1000)), "A": ("A", 1), "mA": ("A", Fraction(1, 1000)),
}  # fmt: skip


def test_the_table_of_the_si_brochure_lists_every_unit():
    assert set(BROCHURE) == set(UNITS)


def test_every_unit_has_the_factor_of_the_si_brochure():
    assert {unit: si_unit(unit) for unit in BROCHURE} == {unit: si for unit, (si, _) in BROCHURE.items()}
    factors = {unit: float(factor) for unit, (_, factor) in BROCHURE.items()}
    assert {unit: to_si(1.0, unit) for unit in BROCHURE} == pytest.approx(factors, rel=4e-16)


def test_every_ending_of_a_name_is_the_unit_that_it_spells():
    for ending, unit in SUFFIXES.items():
        spelt = ending[1:].replace("_per_", "/").replace("Nm", "N*m")
        for written, meant in (
            ("m_s", "m/s"),
            ("m_m", "m/m"),
            ("km_h", "km/h"),
            ("rad_s", "rad/s"),
            ("deg_s", "deg/s"),
        ):
            spelt = spelt.replace(written, meant)
        assert canonical(spelt.replace("s2", "s^2")) == unit, ending


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


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("10 min", "s", 600.0),
        ("600s", "s", 600.0),
        ("1e3s", "s", 1000.0),
        (" -2.5\tm/s^2", "m/s^2", -2.5),
        (".5h", "s", 1800.0),
    ],
)
def test_a_quantity_is_a_number_and_its_unit_with_or_without_a_space(text: str, unit: str, value: float):
    assert parse_quantity(text, unit) == pytest.approx(value)


@pytest.mark.parametrize("text", ["", "s", "5", "nan s", "1.2.3 s", "5 m", "5 5 s", "1.5 s\nx"])
def test_what_is_no_quantity_is_refused(text: str):
    with pytest.raises(ConfigurationError):
        parse_quantity(text, "s")


def test_quantities_are_told_apart():
    assert is_same_quantity("kN/m", "N/m")
    assert not is_same_quantity("N/m", "N*s/m")
    assert not is_same_quantity("rad", "1")
