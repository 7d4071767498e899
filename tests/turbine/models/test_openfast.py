"""Decks of OpenFAST: versions, substructures, and what is wrong with a deck."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.turbine.models.decks import write_deck
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.motion import machine_modes, tower_modes
from windsysid.turbine.models.openfast import read_openfast


@pytest.mark.parametrize("version", [7, 8])
def test_a_machine_is_the_same_in_the_formats_of_all_versions(tmp_path: Path, version: int):
    new, old = read_openfast(write_deck(tmp_path / "5")), read_openfast(write_deck(tmp_path / "old", version))
    assert old.blade is not None
    assert new.blade is not None
    for one, other in zip(old.support[:5], new.support[:5], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(old.blade.stiffness, new.blade.stiffness)
    np.testing.assert_array_equal(old.top.apex, new.top.apex)
    assert (old.rotor_speed, old.gravity, old.top.cone) == (new.rotor_speed, new.gravity, new.top.cone)
    assert old.outputs == new.outputs == ("YawBrTAgxp", "YawBrTAgyp", "TipALgyb1", "TipALgyb2", "TipALgyb3")


def test_sources_name_file_and_lines(tmp_path: Path):
    path = write_deck(tmp_path)
    sources = read_openfast(path).sources
    lines = (tmp_path / "ed.dat").read_text(encoding="utf-8").splitlines()
    name, _, number = sources["rotor_speed"].partition(":")
    assert name == "ed.dat"
    assert lines[int(number) - 1] == "16.0 RotSpeed - rpm"
    rows = (tmp_path / "tower.dat").read_text(encoding="utf-8").splitlines()
    first, last = sources["tower"].split(",")[0].removeprefix("tower.dat:").split("-")
    assert rows[int(first) - 1].startswith("0.0 3000")
    assert rows[int(last) - 1].startswith("1.0 1800")


def fast_7_in_the_sea(folder: Path, model: int = 2, surge: bool = False) -> Path:
    """A deck of FAST 7 whose tower begins 20 m below the water, as one on a monopile does."""
    text = f'{model} PtfmModel - switch\n"platform.dat" PtfmFile - file\n'
    path = write_deck(folder, 7, changes={"main.fst": ("made up\n", f"made up\n{text}")})
    (folder / "platform.dat").write_text(
        f"platform\nmade up\n{surge} PtfmSgDOF - flag\nFalse PtfmRDOF - flag\n20.0 TwrDraft - m\n1 TwrLdMod - switch\n"
        "5.0 TwrDiam - m\n0.8 TwrCA - (-)\n1000.0 WtrDens - kg/m^3\n0.0 PtfmMass - kg\n",
        encoding="utf-8",
    )
    return path


def test_a_tower_of_fast_7_begins_where_its_platform_says(tmp_path: Path):
    """FAST 7 has the platform in a file of its own: a floating one was taken as a clamped tower."""
    found = read_openfast(fast_7_in_the_sea(tmp_path / "sea"))
    assert found.support.z[0] == -20.0
    wet = found.support.water[(found.support.z > -20.0) & (found.support.z <= 0.0)]
    np.testing.assert_allclose(wet, 0.8 * 1000.0 * np.pi / 4.0 * 25.0)
    assert not found.support.water[found.support.z > 1e-6].any()
    assert found.offshore
    with pytest.raises(ConfigurationError, match=r"platform\.dat:3: PtfmSgDOF: .*floating machines are not read"):
        read_openfast(fast_7_in_the_sea(tmp_path / "floating", 3, surge=True))


def test_furling_machines_are_refused(tmp_path: Path):
    path = write_deck(tmp_path, changes={"ed.dat": ("made up\n", "made up\nTrue Furling - flag\n")})
    with pytest.raises(ConfigurationError, match=r"ed\.dat:3: Furling: expected False, got True"):
        read_openfast(path)


def test_all_sections_and_coefficients_of_the_water_count(tmp_path: Path):
    """Two members, of 5 m and 6 to 4 m, whose coefficient is simple and by depth; the lower one is filled to −12 m."""
    text = """------- HydroDyn ---
3 NJoints - joints
JointID Jointxi Jointyi Jointzi
(-) (m) (m) (m)
1 0 0 -20
2 0 0 -10
3 0 0 0
3 NPropSetsCyl - sets
PropSetID PropD PropThck
(-) (m) (m)
1 5.0 0.05
2 6.0 0.05
3 4.0 0.05
SimplCd SimplCdMG SimplCa SimplCaMG
(-) (-) (-) (-)
1.0 1.0 0.9 1.0
2 NCoefDpthCyl - depths
Dpth DpthCd DpthCdMG DpthCa
(m) (-) (-) (-)
0 1 1 0.5
10 1 1 1.0
2 NMembers - members
MemberID MJointID1 MJointID2 MPropSetID1 MPropSetID2 MDivSize MCoefMod
(-) (-) (-) (-) (-) (m) (-)
1 1 2 1 1 0.5 1
2 2 3 2 3 0.5 2
1 NFillGroups - groups
FillNumM FillMList FillFSLoc FillDens
(-) (-) (m) (kg/m^3)
1 1 -12.0 1100
"""
    path = write_deck(tmp_path, pile="clamped")
    (tmp_path / "hd.dat").write_text(text, encoding="utf-8")
    support = read_openfast(path).support

    def water(z: float) -> float:
        return float(np.interp(z, support.z, support.water))

    assert water(-15.0) == pytest.approx(np.pi / 4.0 * (0.9 * 1025.0 * 25.0 + 1100.0 * 4.9**2))
    assert water(-11.0) == pytest.approx(0.9 * 1025.0 * np.pi / 4.0 * 25.0)
    assert water(-5.0) == pytest.approx(0.75 * 1025.0 * np.pi / 4.0 * 25.0, rel=1e-3)


def test_members_of_fast_8_have_no_type(tmp_path: Path):
    new = read_openfast(write_deck(tmp_path / "new", pile="clamped")).support
    path = write_deck(tmp_path / "old", pile="clamped")
    sub = tmp_path / "old/sd.dat"
    text = sub.read_text(encoding="utf-8").replace(" MType", " COSMID").replace(" 1c", "")
    sub.write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(read_openfast(path).support.stiffness, new.stiffness)


def test_adjustments_of_a_deck_count(tmp_path: Path):
    plain = read_openfast(write_deck(tmp_path / "a")).support
    changed = read_openfast(
        write_deck(tmp_path / "b", changes={"tower.dat": ("1 SSStTunr(1)", "0.9 SSStTunr(1)")})
    ).support
    np.testing.assert_allclose(changed.stiffness[0], 0.9 * plain.stiffness[0])
    np.testing.assert_array_equal(changed.stiffness[1], plain.stiffness[1])


def test_a_pile_has_its_own_mass_water_and_soil(tmp_path: Path):
    found = read_openfast(write_deck(tmp_path, pile="soil"))
    support = found.support
    assert found.offshore
    assert support.z[0] == -20.0
    assert support.foot == 0.0
    assert support.base is not None
    np.testing.assert_allclose(support.base[0], [[1e9, -4e9], [-4e9, 8e10]])
    np.testing.assert_allclose(support.base[1], [[1e9, -4e9], [-4e9, 8e10]])
    assert support.mass[0] == pytest.approx(7850 * np.pi / 4 * (5.0**2 - 4.9**2))
    assert support.water[0] == pytest.approx(1025 * np.pi / 4 * (5.0**2 + 4.9**2))
    assert support.water[-1] == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ed.dat": ('"tower.dat" TwrFile', '"other.dat" TwrFile')}, r"other\.dat \(named in .*ed\.dat:\d+\): no such"),
        ({"ed.dat": ("70 TowerHt", "70 Height")}, r"ed\.dat: expected a line 'value  TowerHt', found none"),
        ({"ed.dat": ("70 TowerHt", "tall TowerHt")}, r"ed\.dat:\d+: TowerHt: expected a number, got 'tall'"),
        ({"ed.dat": ("70 TowerHt", "nan TowerHt")}, r"ed\.dat:\d+: TowerHt: expected a number, got 'nan'"),
        ({"ed.dat": ("ELASTODYN v1.03", "ELASTODYN v4.00")}, r"ed\.dat:1: expected ElastoDyn v1\.xx"),
        ({"ed.dat": ("3 NumBl", "2 NumBl")}, r"ed\.dat:\d+: NumBl: expected 3 blades, got 2"),
        ({"ed.dat": ("80000 NacMass", "-1 NacMass")}, r"ed\.dat:\d+: NacMass: expected a number above 0"),
        ({"ed.dat": ("False PtfmSg", "True PtfmSg")}, r"ed\.dat:\d+: PtfmSgDOF: .*floating machines are not read"),
        ({"main.fst": ("1 CompElast", "3 CompElast")}, r"main\.fst:3: CompElast: expected 1"),
        ({"tower.dat": ("0.4 2500", "0.9 2500")}, r"tower\.dat:19: HtFract: expected ascending stations, got 0\.8"),
        ({"tower.dat": ("0.0 3000", "0.1 3000")}, r"tower\.dat:17: HtFract: expected stations from 0 to 1"),
        ({"tower.dat": ("4 NTwInpSt", "5 NTwInpSt")}, r"tower\.dat:21: expected a row of 4 numbers, got '---- SHAPES"),
        ({"tower.dat": ("(kg/m)", "(t/m)")}, r"tower\.dat:16: TMassDen: expected the unit \(kg/m\), got \(t/m\)"),
        ({"tower.dat": ("TwSSStif", "TwSS")}, r"tower\.dat:15: expected a column TwSSStif beside HtFract"),
        ({"tower.dat": ("1.2  TwSSM1Sh(2)", "3.2  TwSSM1Sh(2)")}, r"tower\.dat:\d+: TwSSM1Sh: .* add up to 1, got 3"),
        ({"blade.dat": ("0.5 0.25 4 150", "0.5 0.25 4 heavy")}, r"blade\.dat:\d+: expected a row of \d numbers, got"),
    ],
)  # fmt: skip
def test_faults_of_a_deck_are_named_with_file_and_line(
    tmp_path: Path, changes: dict[str, tuple[str, str]], message: str
):
    with pytest.raises(ConfigurationError, match=message) as caught:
        read_openfast(write_deck(tmp_path, changes=changes))
    assert "\n" not in str(caught.value)


def test_stiffness_in_another_unit_is_found_by_the_size_of_the_section(tmp_path: Path):
    path = write_deck(tmp_path)
    text = (tmp_path / "tower.dat").read_text(encoding="utf-8")
    (tmp_path / "tower.dat").write_text(text.replace("e11", "e8"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"tower\.dat:17: TwSSStif: stiffness over mass .* check units"):
        read_openfast(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sd.dat": ("2 0 0 0 1\n", "2 3 0 0 1\n")}, r"sd\.dat:7: joint 2: expected joints in one vertical line"),
        ({"sd.dat": ("2 0 0 0 1\n", "2 0 0 -2 1\n")}, r"sd\.dat:6: expected members up to the tower's foot at 0 m"),
        ({"sd.dat": (" 1c\n", " 2\n")}, r"sd\.dat:\d+: member 1: expected a round beam"),
        ({"sd.dat": ('"soil.dat"', '"none"')}, r"sd\.dat:\d+: joint 1 is free: expected a soil file"),
        ({"sd.dat": ("1 1 2 1 1 1c", "1 1 2 1 9 1c")}, r"sd\.dat:\d+: member 1: joint 2 or section 9 is not in"),
        ({"soil.dat": ("1e9 Kxx", "0 Kxx")}, r"soil\.dat:1: Kxx: expected a stiffness above 0, got 0"),
    ],
)
def test_faults_of_a_substructure_are_named_with_file_and_line(
    tmp_path: Path, changes: dict[str, tuple[str, str]], message: str
):
    with pytest.raises(ConfigurationError, match=message):
        read_openfast(write_deck(tmp_path, pile="soil", changes=changes))


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("tower.dat", ("1.0 TwrSSDmp(1)", "-1.0 TwrSSDmp(1)"), "tower.dat:6: TwrSSDmp1: expected a damping ratio"),
        ("tower.dat", ("1.0 TwrFADmp(1)", "500 TwrFADmp(1)"), "tower.dat:4: TwrFADmp1: expected a damping ratio"),
        ("blade.dat", ("0.5 BldEdDmp", "-0.5 BldEdDmp"), "BldEdDmp1: expected a damping ratio"),
        ("blade.dat", ("1 AdjEdSt", "0 AdjEdSt"), "AdjEdSt: expected a number above 0, got 0"),
        ("main.fst", ("0 CompSub", "2 CompSub"), "CompSub: expected 0 or 1, got 2"),
        ("main.fst", ("1 CompElast", "1 CompSoil - switch\n1 CompElast"), "CompSoil: expected 0, got 1"),
    ],
)
def test_what_would_give_a_wrong_machine_is_refused(tmp_path: Path, name: str, change: tuple[str, str], message: str):
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        read_openfast(write_deck(tmp_path, changes={name: change}))


def test_text_of_a_title_is_not_a_value(tmp_path: Path):
    title = {"ed.dat": ("made up", "350000 NacMass instead of 80000 is under test")}
    assert read_openfast(write_deck(tmp_path, changes=title)).top.masses[1][0] == 80000.0


def test_masses_of_the_tip_count(tmp_path: Path):
    plain = read_openfast(write_deck(tmp_path / "plain")).blade
    heavy = {"ed.dat": ("16000 HubMass", "300 TipMass(1) - kg\n16000 HubMass")}
    blade = read_openfast(write_deck(tmp_path / "heavy", changes=heavy)).blade
    assert plain is not None
    assert blade is not None
    assert blade.mass.sum() - plain.mass.sum() == pytest.approx(300.0)
    assert blade.radius[-1] == 40.0
    shape = np.sqrt(np.sum(blade.displacement[-1, blade.edge] ** 2))
    assert shape == pytest.approx(1.0, abs=0.02)


def test_a_transition_piece_counts_on_a_clamped_pile(tmp_path: Path):
    piece = {"ed.dat": ("16000 HubMass", "1e5 PtfmMass - kg\n16000 HubMass")}
    support = read_openfast(write_deck(tmp_path, pile="clamped", changes=piece)).support
    assert [point.mass for point in support.points] == [1e5]


def test_a_blade_that_the_model_replaces_is_named(tmp_path: Path):
    machine = read_openfast(write_deck(tmp_path, changes={"main.fst": ("1 CompElast", "2 CompElast")}))
    assert "BeamDyn" in machine.sources["blade"]


def test_the_fore_aft_mode_of_a_light_top_is_not_the_second_one(tmp_path: Path):
    hub = "16{} HubMass - kg\n3.0e4 HubIner - kg m^2\n300 GenIner - kg m^2\n80{} NacMass"
    light = {"ed.dat": (hub.format("000", "000"), hub.format("", "")), "blade.dat": ("1 AdjFlSt", "0.11 AdjFlSt")}
    machine = read_openfast(write_deck(tmp_path, changes=light))
    found, rigid = machine_modes(machine, machine.rotor_speed), tower_modes(machine, 1, 1)[0].frequency
    assert found.fore_aft.frequency == pytest.approx(rigid, rel=0.3)
