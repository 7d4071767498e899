"""The first screen: 24 lines at 80 columns, what matters first, and all of it with --verbose."""

from pathlib import Path

import pytest

import windsysid as ws
from windsysid.cli.screen import first_screen
from windsysid.output.console import render
from windsysid.output.table import Table
from windsysid.units import engineering


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")


@pytest.mark.parametrize(
    ("turbine", "rate", "duration"), [pytest.param("tower", 10.0, 600.0, marks=pytest.mark.slow), ("tower", 10.0, 40.0)]
)
def test_identify_prints_a_screen_and_everything_where_asked(
    run, tmp_path: Path, turbine: str, rate: float, duration: float
):
    path = tmp_path / "record.csv"
    ws.write_record(ws.simulate(turbine, duration=duration, rate=rate, seed=1), path)
    identify = ("identify", path, "--turbine", turbine)
    short, whole = run(*identify).out, run(*identify, "--verbose", "--no-report").out
    lines = short.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines[:-1])) <= 80 or "trust: NO" in short
    assert lines[2].startswith("mode ")
    for words in ("95 % interval", "trust: ", "k_side_side", "results: "):
        assert words in short
    assert "Uncertainty budget" in whole
    assert "Uncertainty budget" not in short


def test_two_columns_of_coefficients_fit_the_screen(run, tmp_path: Path):
    path = tmp_path / "record.csv"
    ws.write_record(ws.simulate("verne555", duration=10.0, rate=50.0, seed=1), path)
    joint = ("--formulation", "joint", "--loads", "broadband")
    shown = run("identify", path, "--turbine", "verne555", "--no-report", *joint).out
    assert len(shown.splitlines()) <= 24
    for name in ("k_x", "c_y", "k_beta_3", "c_beta_3"):
        assert name in shown


def test_what_does_not_fit_is_cut_after_whole_rows():
    table = Table(("number", "word"), [(str(k), "word " * 20) for k in range(30)])
    shown = first_screen(["title", table, "end"], lines=12)
    assert len(shown.splitlines()) <= 12
    assert shown.endswith("… more: --verbose, or the page")
    assert "end" not in shown
    assert first_screen(["title", "end"], lines=12) == "title\nend"


def test_a_table_that_a_screen_can_hold_is_never_cut():
    """Two of four measured modes were left out below a table of the model's modes."""
    model, measured = (
        Table((name, "Hz"), [(f"{name} {k}", "1") for k in range(count)]) for name, count in (("A", 8), ("B", 4))
    )
    shown = first_screen(["title", model, "trust: NO, because", measured, "end"], lines=12)
    assert all(f"A {k}" in shown for k in range(8))
    folded = Table(("A", "text"), [(f"A {k}", "word " * 60) for k in range(4)], words=(0, 1))
    assert all(f"A {k}" in first_screen([folded, "end"], lines=12) for k in range(4))
    shown = first_screen(["title", "word", "word", model, measured, "end"], lines=18)
    assert all(f"B {k}" in shown for k in range(4))
    assert shown.endswith("… more: --verbose, or the page")


def test_a_verdict_follows_a_table_that_is_cut():
    """Twenty modes of grade C filled the screen, and no line said why."""
    table = Table(("mode", "grade"), [(f"mode {k}", "C") for k in range(30)])
    reasons = ["  the record is a transient", *(f"  mode {k}: a line" for k in range(9))]
    shown = first_screen([table, "trust: NO, because", *reasons, "end"], lines=20).splitlines()
    assert len(shown) <= 20
    at = shown.index("trust: NO, because")
    assert any("mode 3 " in line for line in shown[:at])
    assert shown[at + 1] == reasons[0]
    assert shown[-1].startswith("… more")
    assert "end" not in shown


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1784100.0, "N/m", "1.784 MN/m"), (-9543.0, "N*s/m", "-9.543 kN·s/m"), (12.3, "N*m/rad", "12.3 N·m/rad"),
        (4e9, "N/m", "4 GN/m"), (8e5, "kg", "8e+05 kg"),
    ],
)  # fmt: skip
def test_coefficients_are_in_engineering_units(value: float, unit: str, text: str):
    assert " ".join(engineering(unit, value)) == text


def test_a_direction_that_no_channel_sees_is_on_the_first_screen(run, tmp_path: Path):
    """A misspelt channel halved the answer, and the screen said that every number may be used."""
    path = tmp_path / "record.csv"
    ws.write_record(ws.simulate("tower", duration=120.0, rate=10.0, seed=1), path)
    path.write_text(path.read_text(encoding="utf-8").replace("tower_x_accel", "tower_x_acel"), encoding="utf-8")
    shown = run("identify", path, "--turbine", "tower", "--no-report", "--formulation", "spectral").out
    assert "no channel measures side-side: it is locked" in shown


def test_a_table_that_is_too_wide_is_shown_in_parts_with_its_first_column():
    heads = ["name", *(f"quantity_{i}" for i in range(9))]
    shown = render(Table(heads, [["k_side_side", *"123456789"]], "wide"), width=80)
    assert shown.count("k_side_side") == 2
    assert all(head in shown for head in heads)
    assert max(map(len, shown.splitlines())) <= 80


def test_numbers_and_names_of_a_wide_table_stay_on_one_line():
    """Cells such as -47.2 ± 0.3 % were broken before the %, and names between their words."""
    heads = ("mode", "f [Hz]", "ζ [%]", "from 1P", "from 3P", "from 6P", "note")
    row = ["tower side-side", "0.3161 ± 0.0017", "0.63 ± 0.37", "+42.5 ± 0.8 %", "-42.0 ± 0.3 %", "-71.0 ± 0.2 %"]
    row.append("a b " * 30)
    shown = render(Table(heads, [row], "modes", words=(0, 6)), width=80)
    assert all(len(line) <= 80 for line in shown.splitlines())
    assert all(any(cell in line for line in shown.splitlines()) for cell in row[:6])
