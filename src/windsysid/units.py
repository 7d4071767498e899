"""Units at the edge of the house: inside, everything is SI and radians.

`to_si` turns a value written in an engineer's unit into SI. Only units that appear on wind-turbine records
and data sheets are known; an unlisted unit is an error, never a guess.
"""

import math
import re
from collections import Counter
from functools import cache

from windsysid.errors import ConfigurationError

__all__ = [
    "RPM", "UNITS", "canonical", "engineering", "engineering_unit", "is_same_quantity", "parse_quantity", "si_unit",
    "significant_digits", "spell", "to_si", "unit_text", "with_half_width",
]  # fmt: skip

RPM = 30.0 / math.pi
"""Revolutions per minute in one radian per second."""

_TURN = 2.0 * math.pi
_DEGREE = math.pi / 180.0
_G = 9.80665

UNITS: dict[str, tuple[str, float]] = {
    # unit: (the SI unit of the same quantity, factor)
    "1": ("1", 1.0), "-": ("1", 1.0), "": ("1", 1.0), "%": ("1", 0.01), "V/V": ("1", 1.0),
    "mV/V": ("1", 1e-3), "µV/V": ("1", 1e-6), "strain": ("1", 1.0), "microstrain": ("1", 1e-6), "ue": ("1", 1e-6),
    "µε": ("1", 1e-6), "mε": ("1", 1e-3), "ε": ("1", 1.0), "µm/m": ("1", 1e-6), "mm/m": ("1", 1e-3), "m/m": ("1", 1.0),
    "µin/in": ("1", 1e-6), "in/in": ("1", 1.0), "ppm": ("1", 1e-6), "‰": ("1", 1e-3),
    "s": ("s", 1.0), "ns": ("s", 1e-9), "µs": ("s", 1e-6), "ms": ("s", 1e-3),
    "min": ("s", 60.0), "h": ("s", 3600.0), "d": ("s", 86400.0),
    "m": ("m", 1.0), "µm": ("m", 1e-6), "mm": ("m", 1e-3), "cm": ("m", 1e-2), "km": ("m", 1e3),
    "m/s": ("m/s", 1.0), "cm/s": ("m/s", 1e-2), "mm/s": ("m/s", 1e-3), "µm/s": ("m/s", 1e-6),
    "km/h": ("m/s", 1.0 / 3.6),
    "m/s^2": ("m/s^2", 1.0), "mm/s^2": ("m/s^2", 1e-3), "g": ("m/s^2", _G), "mg": ("m/s^2", 1e-3 * _G),
    "µg": ("m/s^2", 1e-6 * _G), "µm/s^2": ("m/s^2", 1e-6), "cm/s^2": ("m/s^2", 1e-2), "Gal": ("m/s^2", 1e-2),
    "rad": ("rad", 1.0), "deg": ("rad", _DEGREE), "mrad": ("rad", 1e-3), "µrad": ("rad", 1e-6),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", _DEGREE), "rpm": ("rad/s", _TURN / 60.0), "Hz": ("Hz", 1.0),
    "rad/s^2": ("rad/s^2", 1.0), "deg/s^2": ("rad/s^2", _DEGREE),
    "rad/m": ("rad/m", 1.0), "deg/m": ("rad/m", _DEGREE),
    "kg": ("kg", 1.0), "t": ("kg", 1e3), "kg*m": ("kg*m", 1.0), "kg*m^2": ("kg*m^2", 1.0),
    "t*m^2": ("kg*m^2", 1e3), "kg/m": ("kg/m", 1.0), "t/m": ("kg/m", 1e3), "kg/m^3": ("kg/m^3", 1.0),
    "N": ("N", 1.0), "kN": ("N", 1e3), "MN": ("N", 1e6),
    "N*m": ("N*m", 1.0), "kN*m": ("N*m", 1e3), "MN*m": ("N*m", 1e6),
    "N*m^2": ("N*m^2", 1.0), "MN*m^2": ("N*m^2", 1e6), "GN*m^2": ("N*m^2", 1e9),
    "N/m": ("N/m", 1.0), "kN/m": ("N/m", 1e3), "MN/m": ("N/m", 1e6),
    "N*s": ("N*s", 1.0), "N*s/m": ("N*s/m", 1.0), "kN*s/m": ("N*s/m", 1e3),
    "N*m/rad": ("N*m/rad", 1.0), "kN*m/rad": ("N*m/rad", 1e3),
    "MN*m/rad": ("N*m/rad", 1e6), "GN*m/rad": ("N*m/rad", 1e9),
    "N*m*s/rad": ("N*m*s/rad", 1.0), "kN*m*s/rad": ("N*m*s/rad", 1e3),
    "W": ("W", 1.0), "kW": ("W", 1e3), "MW": ("W", 1e6), "degC": ("degC", 1.0),
    "Pa": ("Pa", 1.0), "hPa": ("Pa", 100.0), "mbar": ("Pa", 100.0), "kPa": ("Pa", 1e3), "MPa": ("Pa", 1e6),
    "GPa": ("Pa", 1e9), "bar": ("Pa", 1e5),
    "V": ("V", 1.0), "mV": ("V", 1e-3), "µV": ("V", 1e-6), "A": ("A", 1.0), "mA": ("A", 1e-3),
}  # fmt: skip

_EXAMPLES = ("m/s^2", "g", "mm", "deg", "rpm", "kN*m", "N/m")

# Two letters look like µ, and three like ε: the Greek μ becomes the micro sign, ϵ and ɛ the letter ε. UTF-8 that was
# read as Latin-1 has an Â before such a letter; the dot of kN·m may have become U+FFFD.
_SPELLINGS = str.maketrans(
    {"·": "*", "⋅": "*", "•": "*", "∙": "*", "\ufffd": "*", "²": "^2", "¹": "^1", "⁻": "^-", "μ": "µ", "ϵ": "ε",
     "ɛ": "ε", "Â": None, "\xa0": " "}
)  # fmt: skip
_PIECES = (
    ("**", "^"),
    ("^-^", "^-"),
    ("m\\m", "m/m"),
    ("N-m", "N*m"),
    ("Nm", "N*m"),
    ("kg-m", "kg*m"),
    ("kgm", "kg*m"),
    ("N-s", "N*s"),
    ("Ns/", "N*s/"),
    ("°", "deg"),
)
_WORDS = {
    "sec": "s", "seconds": "s", "second": "s", "degrees": "deg", "degree": "deg", "RPM": "rpm",
    "rev/min": "rpm", "1/min": "rpm", "r/min": "rpm", "U/min": "rpm", "tr/min": "rpm", "min^-1": "rpm", "min-1": "rpm",
    "m/ss": "m/s^2", "gal": "Gal",
    "microstrains": "microstrain", "micro-strain": "microstrain", "ustrain": "microstrain", "µstrain": "microstrain",
    "ustr": "microstrain", "µstr": "microstrain", "uStrain": "microstrain", "µStrain": "microstrain",
    "µe": "µε", "mstrain": "mε", "millistrain": "mε", "strains": "strain", "none": "1",
    "us": "µs", "day": "d", "days": "d", "hours": "h", "hour": "h",
    "minutes": "min", "minute": "min", "mins": "min", "secs": "s", "msec": "ms", "millis": "ms",
    "millisecond": "ms", "milliseconds": "ms", "usec": "µs", "micros": "µs", "microsecond": "µs", "microseconds": "µs",
    "nanos": "ns", "nsec": "ns", "nanosecond": "ns", "nanoseconds": "ns",
    "DegC": "degC", "Deg": "deg", "Degrees": "deg",
    "Volts": "V", "volts": "V", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
}  # fmt: skip
_FACTOR = re.compile(r"([*/]?)([a-zA-Zµ]+)(?:\^?(-[1-9]|[2-9]))?")
"""A factor of a product: how it is joined to the one before, its unit, and its exponent."""


def canonical(unit: str) -> str:
    """One spelling for a unit: ``kN-m``, ``(kN·m)`` and ``kN*m`` are the same, so are ``m/s²`` and ``m/s^2``.

    Parameters
    ----------
    unit : str
        The unit as somebody wrote it; brackets around it and spaces are ignored.

    Returns
    -------
    str
        A key of `UNITS`.

    Raises
    ------
    ConfigurationError
        If the unit is not known.
    """
    text = unit.strip()
    if len(text) > 1 and text[0] + text[-1] in ("()", "[]"):
        text = text[1:-1]
    spaced = text.translate(_SPELLINGS)
    text = spaced.replace(" ", "")
    if text not in UNITS:
        for written, spelt in _PIECES:
            text, spaced = text.replace(written, spelt), spaced.replace(written, spelt)
        text = _known_spelling(text)
    if text not in UNITS:
        text = _product(spaced) or text
    if text not in UNITS:
        raise ConfigurationError(
            f"unknown unit '{unit[:40]}': expected one of the units windsysid knows (such as "
            f"{', '.join(_EXAMPLES)}); "
            "write the value in one of those"
        )
    return text


def _known_spelling(text: str) -> str:
    """Key of `UNITS` for another spelling (words, strain in capitals, ``u`` for ``µ``); else the text itself."""
    tried = [_WORDS.get(text, text), "µ" + text[1:] if text[:1] == "u" else text]
    small = text.lower()
    if "strain" in small:
        tried.append(_WORDS.get(small, small))
    if len(small) > 2 and UNITS.get(word := _WORDS.get(small, small), ("", 1.0))[0] == "s":  # SEC, Minutes; not S or H
        tried.append(word)
    return next((one for one in tried if one in UNITS), text)


def _product(text: str) -> str | None:
    """The key of `UNITS` that is the same product of powers, as ``m s-2`` is ``m/s^2``; None where there is none."""
    text = re.sub(r"\s*([*/.^])\s*", r"\1", text.strip())
    text = re.sub(r"[\s.]+|-(?=[^\W\d])", "*", re.sub(r"\(([^()*/.]*)\)", r"\1", text))
    parted = re.sub(r"(?<=[^\W\d])s(?=\^?-\d)", "*s", text)  # ms-2, where no unit is per square millisecond
    return next((_products()[key] for one in (text, parted) if (key := _powers(one)) in _products()), None)


@cache
def _products() -> dict[frozenset[tuple[tuple[str, bool], int]], str]:
    """The units that are products, by their factors."""
    return {powers: unit for unit in UNITS if (powers := _powers(unit))}


def _powers(text: str) -> frozenset[tuple[tuple[str, bool], int]]:
    """The factors of a product, each with whether it multiplies and its power; empty where it is no product."""
    found: Counter[tuple[str, bool]] = Counter()
    at = 0
    while at < len(text):
        factor = _FACTOR.match(text, at)
        if factor is None or (factor[1] == "") != (at == 0):
            return frozenset()
        power = int(factor[3] or 1) * (-1 if factor[1] == "/" else 1)
        found[_known_spelling(factor[2]), power > 0] += abs(power)
        at = factor.end()
    return frozenset(found.items()) if len(found) > 1 else frozenset()


def si_unit(unit: str) -> str:
    """The SI unit of the quantity that `unit` measures: ``si_unit("rpm") == "rad/s"``."""
    return UNITS[canonical(unit)][0]


def to_si(value: float, unit: str) -> float:
    """`value` in `unit`, expressed in SI."""
    return value * UNITS[canonical(unit)][1]


def is_same_quantity(unit: str, other: str) -> bool:
    """Test whether two units measure the same quantity, so that one can be converted into the other."""
    return si_unit(unit) == si_unit(other)


_NUMBER = re.compile(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?|\S*)\s*(.*)", re.DOTALL)
"""A number, then what is behind it, with or without a space."""


def parse_quantity(text: str, unit: str) -> float:
    """A number with its unit, such as ``"1800 N/m"``, in SI.

    Raises
    ------
    ConfigurationError
        If there is no finite number or no unit, or the unit measures another quantity than `unit`.
    """
    number, written = _NUMBER.fullmatch(text.strip()).groups()  # type: ignore[union-attr]  # it matches any text
    try:
        amount = float(number)
    except ValueError:
        raise ConfigurationError(f'expected a number and a unit, such as "1.5 {unit}"') from None
    if not math.isfinite(amount):
        raise ConfigurationError(f'expected a finite number, such as "1.5 {unit}"')
    if not written.strip():
        usual = "rpm" if unit == "rad/s" else unit
        raise ConfigurationError(f'the unit is missing: write it behind the number, such as "{number} {usual}"')
    if not is_same_quantity(written, unit):
        raise ConfigurationError(f"expected a unit of the same quantity as {unit}")
    return to_si(amount, written)


def unit_text(unit: str) -> str:
    """A unit as it is printed: ``N*m/rad`` → N·m/rad, ``m/s^2`` → m/s²."""
    return unit.replace("*", "·").replace("^2", "²")


_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"))


def significant_digits(value: float, half: float, least: int = 4) -> int:
    """Significant digits of a value that show half of its interval to two digits."""
    if not 0.0 < half * abs(value) < math.inf:
        return least
    return max(2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(half)), least)


def engineering(unit: str, *values: float | None, digits: int = 4) -> tuple[str, ...]:
    """Values in an engineer's unit to some significant digits, then that unit, chosen by the first; "" for None.

    Examples
    --------
    >>> engineering("N/m", 1784100.0, 980000.0, None)
    ('1.784', '0.98', '', 'MN/m')
    """
    size, text = engineering_unit(unit, values[0] or 0.0)
    return (*("" if value is None else f"{value / size:.{digits}g}" for value in values), text)


def engineering_unit(unit: str, value: float) -> tuple[float, str]:
    """Size [SI] and text of the unit in which an engineer reads a value.

    Examples
    --------
    >>> engineering_unit("N*s/m", 11303.0), engineering_unit("m/s^2", 11303.0)
    ((1000.0, 'kN·s/m'), (1.0, 'm/s²'))
    """
    prefixes = _PREFIXES if unit.startswith("N") else ()
    size, prefix = next((one for one in prefixes if abs(value) >= one[0]), (1.0, ""))
    return size, prefix + unit_text(unit)


def with_half_width(value: float, half: float, decimals: int) -> str:
    """A value with half of its interval, with more decimals than given where that half would be shown as zero.

    Examples
    --------
    >>> with_half_width(0.31549, 0.0017, 4), with_half_width(0.31549, 0.000012, 4)
    ('0.3155 ± 0.0017', '0.31549 ± 0.00001')
    """
    if 0.0 < half < 10.0**-decimals:
        decimals = min(math.ceil(-math.log10(half)), 7)
    return f"{value:.{decimals}f} ± {half:.{decimals}f}"


def spell(seconds: float, digits: int = 3) -> str:
    """A duration in words: ``45 s``, ``9.3 min``, ``5.2 h``, ``12 d``."""
    for unit, size, most in (
        ("s", 1.0, 120.0),
        ("min", 60.0, 7200.0),
        ("h", 3600.0, 172800.0),
        ("d", 86400.0, math.inf),
    ):
        if seconds < most:
            return f"{float(f'{seconds / size:.{digits}g}'):g} {unit}"
    return "never"
