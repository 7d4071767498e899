"""Models of HAWC2 and windIO: one machine in three formats, closed forms, and what is wrong with a file."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from tests.turbine.models.other_decks import (
    AREA,
    BLADE_MASS,
    DENSITY,
    EDGE,
    HEIGHT,
    SECOND,
    SPAN,
    YOUNG,
    write_hawc2,
    write_windio,
)
from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.turbine.models.blade import blade_of_beam
from windsysid.turbine.models.hawc2.read import read_hawc2
from windsysid.turbine.models.machine import Machine
from windsysid.turbine.models.motion import machine_modes, tower_modes
from windsysid.turbine.models.read import model_files, turbine_file_from
from windsysid.turbine.models.windio import read_windio


def modes_of(machine: Machine) -> list[float]:
    return [mode.frequency for mode in machine_modes(machine, machine.rotor_speed) if mode is not None]


def test_a_machine_is_the_same_in_hawc2_and_in_both_versions_of_windio(tmp_path: Path):
    hawc2 = read_hawc2(write_hawc2(tmp_path))
    assert hawc2.rotor_speed == 1.7
    for version in (1, 2):
        other = read_windio(write_windio(tmp_path, version))
        np.testing.assert_allclose(modes_of(other), modes_of(hawc2), rtol=3e-4 if version == 1 else 1e-5)
        np.testing.assert_allclose(other.top.apex, hawc2.top.apex, atol=1e-9)
        np.testing.assert_allclose(other.top.inertia, hawc2.top.inertia, rtol=1e-9, atol=1e-6)
        assert other.rotor_speed == pytest.approx(hawc2.rotor_speed)
        assert math.degrees(other.top.cone) == pytest.approx(math.degrees(hawc2.top.cone)) == pytest.approx(-2.0)


def test_a_tower_under_a_rigid_mass_has_its_closed_form(tmp_path: Path):
    """Frequency and stiffness-proportional damping ζ = βω/2 of a cantilever with a mass on top, by Rayleigh."""
    machine = read_hawc2(write_hawc2(tmp_path))
    machine = machine._replace(gravity=0.0, top=machine.top._replace(masses=((1e7, np.zeros(3)),)), blade=None)
    mode = tower_modes(machine, 1)[0]
    stiffness, mass = 3.0 * YOUNG * SECOND / HEIGHT**3, 1e7 + 33.0 / 140.0 * DENSITY * AREA * HEIGHT
    omega = 2.0 * math.pi * mode.frequency
    assert omega == pytest.approx(math.sqrt(stiffness / mass), rel=3e-3)
    assert mode.damping == pytest.approx(2e-3 * omega / 2.0, rel=1e-6)
    assert mode.mass == pytest.approx(mass, rel=1e-3)


def test_a_blade_of_a_uniform_beam_has_its_closed_form():
    count = 60
    length, mass = np.full(count, SPAN / count), np.full(count, BLADE_MASS * SPAN / count)
    bending = np.tile(np.diag([EDGE / 4.0, EDGE]), (count, 1, 1))
    blade = blade_of_beam(length, mass, bending, 1e-3 * bending, 1.5)
    modal = np.einsum("p,pkd,pkd->k", blade.mass, blade.displacement, blade.displacement)
    found = np.sqrt(np.diag(blade.stiffness) / modal)
    edge = 1.8751**2 * math.sqrt(EDGE / BLADE_MASS / SPAN**4)
    np.testing.assert_allclose(found, edge * np.array([0.5, 1.0, 0.5 * 6.267]), rtol=2e-3)
    assert blade.edge == 1
    np.testing.assert_allclose(blade.damping, 1e-3 * blade.stiffness, atol=1e-6 * blade.stiffness.max())
    assert blade.tip_slope * SPAN == pytest.approx(1.3765, rel=1e-3)


def test_damping_of_a_blade_has_its_share_of_the_mass(tmp_path: Path):
    of_stiffness = read_hawc2(write_hawc2(tmp_path / "stiffness")).blade
    both = read_hawc2(
        write_hawc2(tmp_path, {"htc/main.htc": ("damping_aniso 0 0 0", "damping_aniso 0.02 0.02 0")})
    ).blade
    assert of_stiffness is not None
    assert both is not None
    modal = np.einsum("p,pkd,pld->kl", both.mass, both.displacement, both.displacement)
    np.testing.assert_allclose(both.damping - of_stiffness.damping, 0.02 * modal, rtol=1e-9, atol=1e-9 * modal.max())


def test_a_pile_in_soil_and_water(tmp_path: Path):
    """A stiff pile on uniform springs k: a body that moves and rocks under a heavy tower top."""
    k = 5e7
    changes = {
        "htc/main.htc": ("begin new_htc_structure;", HTC_PILE),
        "data/stiff_st.dat": ("#1\n", "#2\n$1 2\n0 8000 0 0 1 1 0 0 1e16 1e15 1 1 1 .5 .5 1 0 0 0\n"
                              "30 8000 0 0 1 1 0 0 1e16 1e15 1 1 1 .5 .5 1 0 0 0\n#1\n"),
    }  # fmt: skip
    path = write_hawc2(tmp_path, changes)
    text = path.read_text(encoding="utf-8")
    text = text.replace("      body tower;\n      inipos 0 0 0;", "      body pile;\n      inipos 0 0 30;")
    text = text.replace("    begin relative;\n      body1 tower", LINK + "    begin relative;\n      body1 tower", 1)
    text = text.replace("    begin fix0;\n      body tower;\n    end fix0;\n", "").replace(
        "begin aero;", SOIL + "begin aero;"
    )
    path.write_text(text, encoding="utf-8")
    (tmp_path / "data/soil.dat").write_text(
        f"made up\n#1\nlateral\n2 2 nrow ndefl\n0 0.5 x1 x2\n20 0 {0.5 * k / 1e3}\n30 0 {0.5 * k / 1e3}\n",
        encoding="utf-8",
    )
    machine = read_hawc2(path)
    support = machine.support
    assert support.soil is not None
    assert support.soil[0] == pytest.approx(k)
    assert support.z[0] == -30.0
    assert machine.offshore
    assert "soil curves in kN per metre" in machine.assumed
    assert support.water[(support.z > -20.0) & (support.z <= 0.0)] == pytest.approx(1000.0 * 1.0 * 12.0)
    heavy = machine._replace(
        gravity=0.0, blade=None, top=machine.top._replace(masses=((1e9, np.zeros(3)),), inertia=np.zeros((2, 2))),
        support=support._replace(water=0.0 * support.water),
    )  # fmt: skip
    arm = HEIGHT + 25.0
    flexible = 1.0 / (10.0 * k) + arm**2 / (k * 10.0**3 / 12.0) + HEIGHT**3 / (3.0 * YOUNG * SECOND)
    expected = math.sqrt(1.0 / flexible / 1e9) / (2.0 * math.pi)
    assert tower_modes(heavy, 0)[0].frequency == pytest.approx(expected, rel=0.01)


HTC_PILE = """begin new_htc_structure;
  begin main_body;
    name pile;
    type timoschenko;
    begin timoschenko_input;
      filename ./data/stiff_st.dat;
      set 2 1;
    end timoschenko_input;
    begin c2_def;
      nsec 3;
      sec 1 0 0 0 0;
      sec 2 0 0 -10 0;
      sec 3 0 0 -30 0;
    end c2_def;
  end main_body;
"""

LINK = """    begin relative;
      body1 pile last;
      body2 tower 1;
      body2_eulerang 0 0 0;
    end relative;
"""

SOIL = """begin soil;
  begin soil_element;
    mbdy_name pile;
    datafile ./data/soil.dat;
    soilsections uniform 10;
    set 1;
  end soil_element;
end soil;
begin hydro;
  begin water_properties;
    rho 1000;
    gravity 9.81;
    mwl 0;
  end water_properties;
  begin hydro_element;
    body_name pile;
    sec 10 1 1 12 12 4;
    sec 30 1 1 12 12 4;
  end hydro_element;
end hydro;
"""


def test_sources_name_file_and_line_of_every_number(tmp_path: Path):
    lines = (write_hawc2(tmp_path)).read_text(encoding="utf-8").splitlines()
    found = read_hawc2(tmp_path / "htc/main.htc").sources
    name, number = found["rotor_speed"].split(" ")[0].split(":")
    assert name == "main.htc"
    assert lines[int(number) - 1].split()[-1] == "1.7;"
    assert found["tower"] == "tower_st.dat:3-4"
    assert found["blade"] == "blade_st.dat:6-7"
    assert found["top"] == "nacelle.htc:4, nacelle.htc:5"
    text = turbine_file_from(write_windio(tmp_path, 2))
    rows = (tmp_path / "v2.yaml").read_text(encoding="utf-8").splitlines()
    speed = re.search(r"speed = .* # v2.yaml:(\d+)", text)
    assert speed is not None
    assert "rated_rotor_speed" in rows[int(speed[1]) - 1]
    assert turbine_file_from(tmp_path / "htc/main.htc", "rotor").count("[[sensor]]") == 4


def test_all_files_of_a_model_are_its_files(tmp_path: Path):
    path = write_hawc2(tmp_path)
    names = {file.name for file in model_files(path)}
    assert names == {"main.htc", "nacelle.htc", "tower_st.dat", "stiff_st.dat", "blade_st.dat"}


WRONG_HAWC2 = [
    (
        "htc/main.htc",
        "end timoschenko_input",
        "end timo",
        r"main\.htc:\d+: end: expected the end of 'timoschenko_input'",
    ),
    (
        "htc/main.htc",
        "set 1 1",
        "set 3 1",
        r"tower_st\.dat:1: expected set 3 with subset 1 \(main\.htc:11\), found none",
    ),
    ("htc/main.htc", "sec 2 0 0 -35 0", "sec 3 0 0 -35 0", r"main\.htc:\d+: sec: expected section 2, got 3"),
    ("htc/main.htc", "damping_posdef", "damping_new", r"main\.htc:8: damping_new: expected damping or .* not known"),
    ("htc/main.htc", "type timoschenko;\n    nbodies", "type super;\n    nbodies", r"main\.htc:5: type: expected timo"),
    ("htc/main.htc", "body1 shaft last", "body1 axle last", r"main\.htc:\d+: body1: unknown body 'axle'"),
    ("htc/main.htc", "parts/nacelle.htc", "parts/gone.htc", r"gone\.htc \(named in main\.htc:20\): no such file"),
    (
        "htc/main.htc",
        "    begin fix0;\n      body tower;\n    end fix0;\n",
        "",
        r"expected 'fix0' of tower or its soil",
    ),
    ("htc/main.htc", "body2_eulerang 90 0 0", "body2_eulerpar 1 0 0 0", r"body2_eulerpar: expected mbdy2_eulerang"),
    ("htc/main.htc", "link 3 mbdy_c2_def blade3", "nothing", r"expected 3 blades, got 2"),
    ("htc/main.htc", "2e-3 2e-3", "[factor] 2e-3", r"main\.htc:8: damping_posdef: expected a number, got '\[factor\]'"),
    (
        "data/tower_st.dat",
        "70.0 ",
        "0.0 ",
        r"tower_st\.dat:4: expected rows of one width and ascending distances, got 0 after 0",
    ),
    ("data/tower_st.dat", "70.0 ", "60.0 ", r"tower_st\.dat:4: body tower: expected sections up to its length of 70 m"),
    ("data/tower_st.dat", "$1 2", "$1 3", r"tower_st\.dat:5: expected a row of 19 or 30 numbers, 3 rows in all, got 0"),
    ("data/stiff_st.dat", "#1\n", "#2\n", r"stiff_st\.dat:1: expected set 1 with subset 1"),
    (
        "parts/nacelle.htc",
        "concentrated_mass 2 0 0 0",
        "concentrated_mass 3 0 0 0",
        r"nacelle\.htc:5: .* node from 1 to 2",
    ),
    (
        "parts/nacelle.htc",
        "60000",
        "-6e4",
        r"nacelle\.htc:4: concentrated_mass: expected mass and inertia of 0 or more",
    ),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), WRONG_HAWC2)
def test_what_is_wrong_with_a_deck_of_hawc2_is_one_line(tmp_path: Path, name: str, old: str, new: str, message: str):
    path = write_hawc2(tmp_path, {name: (old, new)})
    with pytest.raises(ConfigurationError, match=message) as caught:
        turbine_file_from(path)
    assert "\n" not in str(caught.value)


WRONG_WINDIO = [
    (2, "'2.0'", "'3.1'", r"v2\.yaml:1: windIO_version: expected version 1 or 2, got '3\.1'"),
    (2, "number_of_blades: 3", "number_of_blades: 2", r"v2\.yaml:3: .*expected 3 blades, got 2"),
    (
        2,
        "mass: 60000.,",
        "weight: 60000.,",
        r"v2\.yaml:\d+: components\.drivetrain.elastic_properties: expected 'mass'",
    ),
    (
        1,
        "      elastic_properties_mb:\n        system_mass",
        "      masses:\n        system_mass",
        r"v1\.yaml:29: .*'elastic",
    ),
    (1, "values: [0.0, 70.0]", "values: [70.0, 0.0]", r"v1\.yaml:\d+: .*both ascending from the foot"),
    (1, "values: [4.0, 4.0]", "values: [4.0]", r"v1\.yaml:\d+: .*outer_diameter\.values: expected 2 or more numbers"),
    (1, "values: [0.03, 0.03]", "values: [30, 30]", r"v1\.yaml:\d+: .*thickness: expected walls .* \[m\]"),
    (1, "E: 2.1e11", "E: 210", r"v1\.yaml:\d+: components\.tower: stiffness over mass .* check units"),
    (1, "material: steel", "material: wood", r"v1\.yaml:\d+: .*expected one of the materials, got 'wood'"),
    (
        2,
        "rated_rotor_speed: ",
        "rated_rotor_speed: fast",
        r"v2\.yaml:\d+: control\.rated_rotor_speed: expected a number, got 'fast",
    ),
    (2, "  tower:", "  monopile: {}\n  tower:", r"v2\.yaml:\d+: components\.monopile: expected 'reference_axis\.z'"),
    (1, "name: made", "name: [made", r"v1\.yaml:\d+: no YAML: "),
]


@pytest.mark.parametrize(("version", "old", "new", "message"), WRONG_WINDIO)
def test_what_is_wrong_with_a_file_of_windio_is_one_line(
    tmp_path: Path, version: int, old: str, new: str, message: str
):
    path = write_windio(tmp_path, version, (old, new))
    with pytest.raises(ConfigurationError, match=message) as caught:
        turbine_file_from(path)
    assert "\n" not in str(caught.value)


LOOP = """    begin relative;
      body1 blade1 last;
      body2 tower 1;
    end relative;
  end orientation"""


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("data/blade_st.dat", "900000000.0", "0", "main.htc: the model failed in a numerical operation .LinAlgError"),
        ("htc/main.htc", "sec 2 0 0 38 0", "sec 2 0 0 0 0", "main.htc: the model failed in a numerical operation"),
        ("htc/main.htc", "  end orientation", LOOP, r"main\.htc:\d+: body2: body tower: expected one place, got two"),
    ],
)
def test_what_cannot_be_computed_of_a_deck_is_one_line(tmp_path: Path, name: str, old: str, new: str, message: str):
    path = write_hawc2(tmp_path, {name: (old, new)})
    for read in (model_files, turbine_file_from):
        with pytest.raises(WindsysidError, match=message):
            read(path)


def test_characters_that_yaml_does_not_have_are_one_line(tmp_path: Path):
    path = write_windio(tmp_path, 2, ("made", "\x00made"))
    with pytest.raises(ConfigurationError, match=r"v2\.yaml:1: no YAML: unacceptable character"):
        read_windio(path)


def test_a_pile_of_windio_ends_at_the_sea_bed(tmp_path: Path):
    pile = """  monopile:
    transition_piece_mass: 5000
    reference_axis:
      z: {grid: [0.0, 1.0], values: [-60.0, 0.0]}
    outer_shape:
      outer_diameter: {grid: [0.0, 1.0], values: [5.0, 5.0]}
    structure:
      layers:
      - {name: wall, material: steel, thickness: {grid: [0.0, 1.0], values: [0.05, 0.05]}}
  tower:"""
    path = write_windio(tmp_path, 2, ("  tower:", pile))
    with pytest.raises(ConfigurationError, match=r"height of the sea bed: add 'environment: \{water_depth: …\}'"):
        read_windio(path)
    path.write_text(path.read_text(encoding="utf-8") + "environment: {water_depth: 20.0}\n", encoding="utf-8")
    found = read_windio(path)
    assert found.support.z[0] == -20.0
    assert found.support.water[0] == pytest.approx(1025.0 * math.pi / 4.0 * 25.0)
    assert [point.mass for point in found.support.points] == [5000.0]
    assert "no soil: clamped at the sea bed" in found.assumed


def test_a_table_in_other_units_is_refused(tmp_path: Path):
    path = write_hawc2(tmp_path)
    table = tmp_path / "data/tower_st.dat"
    table.write_text(table.read_text(encoding="utf-8").replace("e+11 ", "e+02 "), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"tower_st\.dat:3: body tower: stiffness over mass .* check units"):
        read_hawc2(path)
