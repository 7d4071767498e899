"""The blades of a real turbine by spectra: the tables, and one of OpenFAST's records beside the truth."""

from pathlib import Path

import pytest
from validation.field import FILES, LAGS, ROTOR, WINDY
from validation.field_spectral import Seen, coverage_table, look, truth_of, whole_table, window_table, windows

from windsysid import load_turbine, read_record

DATA = Path(__file__).parents[3] / "shared" / "data" / "openfast"
recorded = pytest.mark.skipif(
    not all((DATA / name).is_file() for name in FILES.values()),
    reason="the records of OpenFAST are not beside this checkout",
)
NAMES = ("tower", *LAGS, "k_x")


def seen(error: float, *, trusted: bool, section: tuple[float, float] = WINDY) -> Seen:
    errors = dict.fromkeys(NAMES, error)
    deviations = dict.fromkeys(NAMES, 1000.0 * error)
    return Seen("c2", section, 0, errors, deviations, {"tower": 1.1}, (0.0, 0.01), trusted, (), 1.0)


def test_the_table_shows_the_prior_that_errs_most():
    rows = whole_table([seen(0.001, trusted=True), seen(-0.002, trusted=True)])
    assert rows[0] == ("c2", "tower", "-0.20 %", "-2.0", "1.10")


def test_windows_are_pooled_by_length():
    parts = [seen(error, trusted=True, section=(60.0, 180.0)) for error in (0.003, -0.004)]
    assert window_table(parts)[0] == ("c2", "120 s", "tower", "2", "0.35 %", "3.54", "2")
    assert windows(270.0) == [(60.0, 330.0), (330.0, 600.0)]


def test_coverage_is_counted_for_the_trusted_by_themselves():
    rows = coverage_table([seen(0.001, trusted=True), seen(0.005, trusted=False)])
    held = {row[:2] + row[3:4]: row[4:6] for row in rows}
    assert held["c2", "all", "modes"] == ("50.0 %", "50.0 %")
    assert held["c2", "trusted", "modes"] == ("100.0 %", "100.0 %")


@recorded
@pytest.mark.slow
@pytest.mark.parametrize("label", ["c2", "d1"])
def test_rotor_of_openfast_in_wind_is_found_and_trusted(label: str):
    record, turbine = read_record(DATA / FILES[label]), load_turbine(ROTOR)
    found = look(label, record, WINDY, turbine, truth_of(label), 0)
    assert max(abs(z) for z in found.deviations.values()) < 3.0
    assert abs(found.errors["tower"]) < 0.0035
    assert max(abs(found.errors[name]) for name in LAGS) < 0.005
    assert found.trusted
