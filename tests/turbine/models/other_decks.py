"""One small machine, made up for the tests, as HAWC2 and as windIO of both versions have it: 2 MW on 70 m."""

import math
from collections.abc import Mapping
from pathlib import Path

YOUNG, SHEAR, DENSITY = 2.1e11, 8.08e10, 7850.0
DIAMETER, WALL, HEIGHT = 4.0, 0.03, 70.0
AREA = math.pi / 4.0 * (DIAMETER**2 - (DIAMETER - 2.0 * WALL) ** 2)
SECOND = math.pi / 64.0 * (DIAMETER**4 - (DIAMETER - 2.0 * WALL) ** 4)
BLADE_MASS, FLAP, EDGE, SPAN, TWIST = 150.0, 4e8, 9e8, 38.0, 8.0

HTC = """; made up for the tests
begin new_htc_structure;
  begin main_body;
    name tower; type timoschenko; this is a comment
    type timoschenko;
    nbodies 1;
    node_distribution c2_def;
    damping_posdef 0 0 0 2e-3 2e-3 1e-3;
    begin timoschenko_input;
      filename ./data/tower_st.dat;
      set 1 1;
    end timoschenko_input;
    begin c2_def;
      nsec 3;
      sec 1 0 0 0 0;
      sec 2 0 0 -35 0;
      sec 3 0 0 -70 0;
    end c2_def;
  end main_body;
  continue_in_file ./parts/nacelle.htc;
  begin main_body;
    name blade1;
    type timoschenko;
    damping_aniso 0 0 0 1e-3 2e-3 1e-3;
    begin timoschenko_input;
      filename ./data/blade_st.dat;
      set 1 2;
    end timoschenko_input;
    begin c2_def;
      nsec 2;
      sec 1 0 0 0 -8;
      sec 2 0 0 38 0;
    end c2_def;
  end main_body;
  begin main_body;
    name blade2;
    copy_main_body blade1;
  end main_body;
  begin main_body;
    name blade3;
    copy_main_body blade1;
  end main_body;
  begin orientation;
    begin base;
      body tower;
      inipos 0 0 0;
      body_eulerang 0 0 0;
    end base;
    begin relative;
      body1 tower last;
      body2 shaft 1;
      body2_eulerang 90 0 0;
      body2_eulerang 5 0 0;
      body2_ini_rotvec_d1 0 0 -1 1.7;
    end relative;
{blades}
  end orientation;
  begin constraint;
    begin fix0;
      body tower;
    end fix0;
  end constraint;
end new_htc_structure;
begin aero;
  nblades 3;
  link 1 mbdy_c2_def blade1;
  link 2 mbdy_c2_def blade2;
  link 3 mbdy_c2_def blade3;
end aero;
exit;
"""

RELATIVE = """    begin relative;
      body1 shaft last;
      body2 hub{i} 1;
      body2_eulerang -90 0 0;
      body2_eulerang 0 {angle} 0;
      body2_eulerang 2 0 0;
    end relative;
    begin relative;
      body1 hub{i} last;
      body2 blade{i} 1;
      body2_eulerang 0 0 0;
    end relative;"""

NACELLE = """  begin main_body;
    name shaft;
    type timoschenko;
    concentrated_mass 1 0.1 -1.5 -1 60000 4e5 5e5 6e5;
    concentrated_mass 2 0 0 0 15000 0 0 9e4;
    begin timoschenko_input;
      filename ./data/stiff_st.dat;
      set 1 1;
    end timoschenko_input;
    begin c2_def;
      nsec 2;
      sec 1 0 0 0 0;
      sec 2 0 0 4 0;
    end c2_def;
  end main_body;
  begin main_body;
    name hub1;
    type timoschenko;
    begin timoschenko_input;
      filename ./data/stiff_st.dat;
      set 1 1;
    end timoschenko_input;
    begin c2_def;
      nsec 2;
      sec 1 0 0 0 0;
      sec 2 0 0 1.5 0;
    end c2_def;
  end main_body;
  begin main_body;
    name hub2;
    copy_main_body hub1;
  end main_body;
  begin main_body;
    name hub3;
    copy_main_body hub1;
  end main_body;
exit;
"""


def _row(r: float, mass: float, about_x: float, about_y: float, area: float) -> str:
    return (
        f"{r} {mass:.9e} 0 0 1 1 0 0 {YOUNG:.9e} {SHEAR:.9e} {about_x / YOUNG:.9e} {about_y / YOUNG:.9e} 1 0.53 0.53 "
        f"{area:.9e} 0 0 0"
    )


def write_hawc2(folder: Path, changes: Mapping[str, tuple[str, str]] | None = None) -> Path:
    """Write a deck of HAWC2 and return its main file; `changes` by file name: a text and what takes its place."""
    bent = YOUNG * SECOND
    blades = "\n".join(RELATIVE.format(i=i, angle=angle) for i, angle in ((1, 180), (2, 60), (3, -60)))
    full = f"1e9 0 0 0 0 0 1e9 0 0 0 0 1e10 0 0 0 {FLAP} 0 0 {EDGE} 0 1e8"
    rows = [f"{r} {BLADE_MASS} 0 0 1 1 0 0 0 {full}" for r in (0, SPAN)]
    files = {
        "htc/main.htc": HTC.format(blades=blades), "parts/nacelle.htc": NACELLE,
        "data/tower_st.dat": "#1 tower\n$1 2\n"
        + "\n".join(_row(r, DENSITY * AREA, bent, bent, AREA) for r in (0.0, HEIGHT)) + "\n",
        "data/stiff_st.dat": "#1\n$1 2\n" + "\n".join(_row(r, 1e-3, 1e17, 1e17, 1.0) for r in (0.0, 1.0)) + "\n",
        "data/blade_st.dat": "1 sets\n#1 blade\n$1 2\n0\n$2 2 flexible\n" + "\n".join(rows) + "\n",
    }  # fmt: skip
    for name, (old, new) in (changes or {}).items():
        assert old in files[name]
        files[name] = files[name].replace(old, new, 1)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "htc/main.htc"


WINDIO = {
    1: """name: made up for the tests
assembly: {{number_of_blades: 3, rotor_orientation: Upwind}}
components:
  blade:
    outer_shape_bem:
      reference_axis: &axis
        x: {{grid: [0.0, 1.0], values: [0.0, 0.0]}}
        y: {{grid: [0.0, 1.0], values: [0.0, 0.0]}}
        z: {{grid: [0.0, 1.0], values: [0.0, {span}]}}
      twist: {{grid: [0.0, 1.0], values: [{twist}, 0.0]}}
    elastic_properties_mb:
      six_x_six:
        stiff_matrix:
          grid: [0.0, 1.0]
          values:
          - [1e9, 0, 0, 0, 0, 0, 1e9, 0, 0, 0, 0, 1e10, 0, 0, 0, {edge}, 0, 0, {flap}, 0, 1e8]
          - [1e9, 0, 0, 0, 0, 0, 1e9, 0, 0, 0, 0, 1e10, 0, 0, 0, {edge}, 0, 0, {flap}, 0, 1e8]
        inertia_matrix:
          grid: [0.0, 1.0]
          values:
          - [{mass}, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
          - [{mass}, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
  hub:
    diameter: 3.0
    cone_angle: {cone}
    elastic_properties_mb: {{system_mass: 15000., system_inertia: [9e4, 0, 0, 0, 0, 0]}}
  nacelle:
    drivetrain:
      uptilt: {tilt}
      overhang: {overhang}
      distance_tt_hub: {rise}
      elastic_properties_mb:
        system_mass: 60000.
        system_center_mass: {centre}
        system_inertia: {inertia}
  tower:
    outer_shape_bem:
      reference_axis: &tower
        z: {{grid: [0.0, 1.0], values: [0.0, 70.0]}}
      outer_diameter: {{grid: [0.0, 1.0], values: [4.0, 4.0]}}
    internal_structure_2d_fem:
      layers:
      - name: wall
        material: steel
        thickness: {{grid: [0.0, 1.0], values: [0.03, 0.03]}}
materials:
- {{name: steel, E: 2.1e11, G: 8.08e10, rho: 7850}}
control: {{torque: {{VS_maxspd: 1.7}}}}
""",
    2: """windIO_version: '2.0'
name: made up for the tests
assembly: {{number_of_blades: 3, rotor_orientation: upwind}}
components:
  blade:
    reference_axis:
      x: {{grid: [0.0, 1.0], values: [0.0, 0.0]}}
      y: {{grid: [0.0, 1.0], values: [0.0, 0.0]}}
      z: {{grid: [0.0, 1.0], values: [0.0, {span}]}}
    outer_shape:
      twist: {{grid: [0.0, 1.0], values: [{twist}, 0.0]}}
    structure:
      elastic_properties:
        stiffness_matrix: {{grid: [0.0, 1.0], K33: [1e10, 1e10], K44: [{flap}, {flap}], K55: [{edge}, {edge}]}}
        inertia_matrix: {{grid: [0.0, 1.0], mass: [{mass}, {mass}]}}
        structural_damping: {{mu: [1e-3, 2e-3, 1e-3, 0, 0, 0]}}
  hub:
    diameter: 3.0
    cone_angle: {cone}
    elastic_properties: {{mass: 15000., inertia: [9e4, 0, 0], location: [0.0, 0.0, 0.0]}}
  drivetrain:
    outer_shape: {{uptilt: {tilt}, overhang: {overhang}, distance_tt_hub: {rise}}}
    elastic_properties: {{mass: 60000., location: {centre}, inertia: {inertia}}}
  tower:
    reference_axis:
      z: {{grid: [0.0, 1.0], values: [0.0, 70.0]}}
    outer_shape:
      outer_diameter: {{grid: [0.0, 1.0], values: [4.0, 4.0]}}
    structure:
      layers:
      - name: wall
        material: steel
        thickness: {{grid: [0.0, 1.0], values: [0.03, 0.03]}}
      elastic_properties:
        structural_damping: {{mu: [2e-3, 2e-3, 1e-3, 0, 0, 0]}}
materials:
- {{name: steel, E: 2.1e11, G: 8.08e10, rho: 7850}}
control: {{rated_rotor_speed: {speed}}}
""",
}


def write_windio(folder: Path, version: int, change: tuple[str, str] = ("name", "name")) -> Path:
    """Write a windIO file of version 1 or 2; `change`: a text and what takes its place."""
    tilt, degree = math.radians(5.0), 1.0 if version == 2 else math.pi / 180.0
    c, s = math.cos(tilt), math.sin(tilt)
    centre = [1.5 * s + c, 0.1, 1.5 * c - s]
    inertia = [5e5 * s**2 + 6e5 * c**2, 4e5, 5e5 * c**2 + 6e5 * s**2]
    cone, speed = 2.0 * degree, 1.7 * 30.0 / math.pi
    text = WINDIO[version].format(
        span=SPAN, twist=TWIST * degree, edge=EDGE, flap=FLAP, mass=BLADE_MASS, cone=cone, tilt=5.0 * degree,
        overhang=4.0 * c, rise=4.0 * s, centre=centre, inertia=inertia, speed=speed,
    )  # fmt: skip
    assert change[0] in text
    path = folder / f"v{version}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    return path
