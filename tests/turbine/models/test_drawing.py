"""Tables of a drawing."""

import math
import re
from pathlib import Path

import pytest

from windsysid.errors import ConfigurationError
from windsysid.turbine.models.drawing import read_drawing
from windsysid.turbine.models.motion import tower_modes
from windsysid.turbine.models.read import turbine_from

DRAWING = """# the tower of the NREL 5 MW turbine
top_mass = 350 t
top_height = 1.9 m
rotor_speed = 12.1 rpm
damping = 1 %
height [m], diameter [m], wall [mm]
0, 6.0, 35.1
87.6, 3.87, 24.7
"""


def drawing(folder: Path, text: str = DRAWING) -> Path:
    path = folder / "tower.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_drawing_gives_the_tower_of_the_published_machine(tmp_path: Path):
    """0.32 Hz and 0.35 % are published for NREL's 5 MW turbine; the drawing lacks what its rotor adds."""
    found = turbine_from(drawing(tmp_path))
    assert found.natural_frequency("side_side") / (2.0 * math.pi) == pytest.approx(0.32, rel=0.03)
    ratio = found.damping("side_side") / found.critical_damping("side_side")
    assert ratio - 0.002 == pytest.approx(0.0035, rel=0.05)
    assert found.values["mass_side_side"] == pytest.approx(350e3 + 85e3, rel=0.03)


def test_stiffness_and_mass_take_the_place_of_a_wall(tmp_path: Path):
    tube = read_drawing(drawing(tmp_path))
    rows = [
        f"{z}, {k}, {m}" for z, k, m in zip(tube.support.z, tube.support.stiffness[0], tube.support.mass, strict=True)
    ]
    head = DRAWING.split("height [m]")[0]
    text = head + "top_inertia = 1e7 kg*m^2\nheight [m], stiffness [N*m^2], mass [kg/m]\n" + "\n".join(rows) + "\n"
    found = read_drawing(drawing(tmp_path, text))
    assert found.support.stiffness[0, ::10] == pytest.approx(tube.support.stiffness[0])
    assert tower_modes(found, 0)[0].frequency < tower_modes(tube, 0)[0].frequency


def test_a_foundation_that_rocks_lowers_the_frequency(tmp_path: Path):
    soft = DRAWING.replace("damping", "base_rocking = 5e10 N*m/rad\ndamping")
    firm, soft_one = read_drawing(drawing(tmp_path)), read_drawing(drawing(tmp_path, soft))
    hard = read_drawing(drawing(tmp_path, soft.replace("5e10", "5e15")))
    assert tower_modes(soft_one, 0)[0].frequency < 0.95 * tower_modes(firm, 0)[0].frequency
    assert tower_modes(hard, 0)[0].frequency == pytest.approx(tower_modes(firm, 0)[0].frequency, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("top_mass = 350 t\n", "", r"tower\.csv:5: expected a line 'top_mass = … kg' before the table"),
        ("350 t", "350", r"tower\.csv:2: top_mass: the unit is missing.*, got '350'"),
        ("350 t", "350 m", r"tower\.csv:2: top_mass: .*got '350 m'"),
        ("damping", "dampening", r"tower\.csv:5: unknown key 'dampening'"),
        ("[mm]", "[kg]", r"tower\.csv:6: wall: expected a unit such as \[m\], got '\[kg\]'"),
        ("[mm]", "", r"tower\.csv:6: wall: expected a unit such as \[m\]"),
        ("diameter", "width", r"tower\.csv:6: unknown column 'width'"),
        ("87.6, 3.87", "-1, 3.87", r"tower\.csv:8: height: expected two or more heights that ascend"),
        ("87.6, 3.87", "# top\n\n-1, 3.87", r"tower\.csv:10: height: expected two or more heights that ascend"),
        ("87.6, 3.87, 24.7", "87.6, 3.87", r"tower\.csv:8: expected 3 numbers, got '87\.6, 3\.87'"),
        ("87.6, 3.87, 24.7", "87.6, 3.87, nan", r"tower\.csv:8: expected 3 numbers"),
        ("[mm]", "[m]", r"tower\.csv:7: wall: expected more than 0 and less than half of the diameter"),
        ("0, 6.0, 35.1\n87.6, 3.87, 24.7\n", "", r"tower\.csv:6: height: expected two or more heights"),
        ("height [m], diameter [m], wall [mm]\n0, 6.0, 35.1\n87.6, 3.87, 24.7\n", "", r"tower\.csv:5: expected a"),
    ],
)  # fmt: skip
def test_faults_of_a_drawing_are_named_with_file_and_line(tmp_path: Path, old: str, new: str, message: str):
    with pytest.raises(ConfigurationError, match=message):
        read_drawing(drawing(tmp_path, DRAWING.replace(old, new)))


def test_a_tower_that_buckles_is_refused(tmp_path: Path):
    text = DRAWING.replace("350 t", "90000 t")
    with pytest.raises(ConfigurationError, match="the tower buckles side-side under its own weight"):
        turbine_from(drawing(tmp_path, text))


def test_a_drawing_has_no_rotor_of_its_own(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="the model has no blades: expected kind='tower'"):
        turbine_from(drawing(tmp_path), "rotor")


@pytest.mark.parametrize(
    ("new", "message"),
    [
        ("top_mass = 100 t\n", "tower.csv:3: top_mass: expected one line of it, got another one in line 2"),
        ("top_inertia = -1e9 kg*m^2\n", "tower.csv:3: top_inertia: expected a value of 0 or more"),
        ("blades = 2.5\n", "tower.csv:3: blades: expected a whole number above 0"),
        ("damping = 120 %\n", "tower.csv:3: damping: expected more than 0 and up to 99 %"),
    ],
)
def test_a_line_that_would_give_a_wrong_machine_is_refused(tmp_path: Path, new: str, message: str):
    text = DRAWING.replace("damping = 1 %\n", "").replace("top_height", f"{new}top_height")
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        read_drawing(drawing(tmp_path, text))


def test_a_drawing_may_come_from_a_spreadsheet(tmp_path: Path):
    """It writes a byte-order mark, and as many commas in each line as the table has."""
    path = tmp_path / "sheet.csv"
    path.write_text(DRAWING.replace("350 t", "350 t,,").replace("1.9 m", "1.9 m,,"), encoding="utf-8-sig")
    assert read_drawing(path).top.masses[0][0] == pytest.approx(350e3)
