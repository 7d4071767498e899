"""Small decks of OpenFAST in the formats of its versions: a machine of 2 MW on 70 m, made up for the tests."""

from collections.abc import Mapping
from pathlib import Path

SHAPES = "\n".join(
    f"{value}  {stem}{bracket} - coefficient"
    for stem, values in {
        "BldFl1Sh": (0.06, 1.7, -3.2, 4.7, -2.26),
        "BldFl2Sh": (-0.6, 1.2, -15.5, 29.7, -13.8),
        "BldEdgSh": (0.36, 2.5, -3.5, 2.3, -0.66),
    }.items()
    for bracket, value in zip(("(2)", "(3)", "(4)", "(5)", "(6)"), values, strict=True)
)

TOWER_SHAPES = "\n".join(
    f"{value}  Tw{side}M{mode}Sh({power}) - coefficient"
    for side in ("FA", "SS")
    for mode, values in ((1, (1.2, -0.2, 0.0, 0.0, 0.0)), (2, (-20.0, 25.0, -4.0, 0.0, 0.0)))
    for power, value in zip(range(2, 7), values, strict=True)
)

TOWER = """------- ELASTODYN V1.00.* TOWER INPUT FILE ----
made up
4 NTwInpSt - Number of stations
1.0 TwrFADmp(1) - %
1.0 TwrFADmp(2) - %
1.0 TwrSSDmp(1) - %
1.0 TwrSSDmp(2) - %
1 FAStTunr(1) - tuner
1 FAStTunr(2) - tuner
1 SSStTunr(1) - tuner
1 SSStTunr(2) - tuner
1 AdjTwMa - factor
1 AdjFASt - factor
1 AdjSSSt - factor
  HtFract  TMassDen  TwFAStif  TwSSStif{more}
   (-)      (kg/m)    (Nm^2)    (Nm^2){units}
0.0 3000 1.6e11 1.6e11{extra}
0.4 2500 1.1e11 1.1e11{extra}
0.8 2000 0.7e11 0.7e11{extra}
1.0 1800 0.5e11 0.5e11{extra}
---- SHAPES ----
"""

BLADE = """------- ELASTODYN V1.00.* INDIVIDUAL BLADE INPUT FILE ---
made up
3 NBlInpSt - Number of stations
0.5 BldFlDmp{a} - %
0.5 BldFlDmp{b} - %
0.5 BldEdDmp{a} - %
1 FlStTunr{a} - tuner
1 FlStTunr{b} - tuner
1 AdjBlMs - factor
1 AdjFlSt - factor
1 AdjEdSt - factor
 BlFract {pitch} StrcTwst BMassDen FlpStff EdgStff
 (-) {unit} (deg) (kg/m) (Nm^2) (Nm^2)
0.0 {value} 12 300 5e9 5e9
0.5 {value} 4 150 6e8 1.5e9
1.0 {value} 0 20 1e6 1e7
"""

DYN = """True FlapDOF1 - flag
False PtfmSgDOF - flag
16.0 RotSpeed - rpm
3 NumBl - blades
40 TipRad - m
1.5 HubRad - m
-2 {cone} - deg
-2 {cone2} - deg
-2 {cone3} - deg
0 HubCM - m
-4 OverHang - m
-5 ShftTilt - deg
1 NacCMxn - m
0 NacCMyn - m
1.5 NacCMzn - m
-2 NcIMUxn - m
0 NcIMUyn - m
1.8 NcIMUzn - m
1.8 Twr2Shft - m
70 TowerHt - m
16000 HubMass - kg
3.0e4 HubIner - kg m^2
300 GenIner - kg m^2
80000 NacMass - kg
{nodes}
"blade.dat" BldFile{one} - file
"blade.dat" BldFile{two} - file
"blade.dat" BldFile{three} - file
"tower.dat" TwrFile - file
20 TwrNodes - nodes
 OutList - list
"YawBrTAgxp, YawBrTAgyp" - top
"TipALgyb1"
"TipALgyb2"
"TipALgyb3"
END of input file
"""

MAIN = """------- OpenFAST INPUT FILE ----
made up
1 CompElast - switch
{water} CompHydro - switch
{sub} CompSub - switch
9.80665 Gravity - m/s^2
1025 WtrDens - kg/m^3
0 MSL2SWL - m
"ed.dat" EDFile - file
"sd.dat" SubFile - file
"hd.dat" HydroFile - file
"""

SUBDYN = """----------- SubDyn v1.01.x ---
made up
2 NJoints - joints
JointID JointXss JointYss JointZss JointType
(-) (m) (m) (m) (-)
1 0 0 -20 1
2 0 0 0 1
1 NReact - joints
RJointID RctTDXss RctTDYss RctTDZss RctRDXss RctRDYss RctRDZss SSIfile
(-) (flag) (flag) (flag) (flag) (flag) (flag) (string)
1 {fixed} {fixed} {fixed} {fixed} {fixed} {fixed} {soil}
1 NMembers - members
MemberID MJointID1 MJointID2 MPropSetID1 MPropSetID2 MType
(-) (-) (-) (-) (-) (-)
1 1 2 1 1 1c
1 NPropSets - sets
PropSetID YoungE ShearG MatDens XsecD XsecT
(-) (N/m2) (N/m2) (kg/m3) (m) (m)
1 2.1e11 8.08e10 7850 5.0 0.05
0 NCmass - masses
"""

SOIL = "1e9 Kxx\n1e9 Kyy\n4e9 Kytx\n-4e9 Kxty\n8e10 Ktxtx\n8e10 Ktyty\n"

HYDRO = """------- HydroDyn ---
2 NJoints - joints
JointID Jointxi Jointyi Jointzi
(-) (m) (m) (m)
1 0 0 -20
2 0 0 0
1 NPropSetsCyl - sets
PropSetID PropD PropThck
(-) (m) (m)
1 5.0 0.05
SimplCd SimplCdMG SimplCa SimplCaMG
(-) (-) (-) (-)
1.0 1.0 1.0 1.0
1 NMembers - members
MemberID MJointID1 MJointID2 MPropSetID1 MPropSetID2 MDivSize MCoefMod
(-) (-) (-) (-) (-) (m) (-)
1 1 2 1 1 0.5 1
1 NFillGroups - groups
FillNumM FillMList FillFSLoc FillDens
(-) (-) (m) (kg/m^3)
1 1 0.0 DEFAULT
"""


def write_deck(
    folder: Path, version: int = 5, pile: str = "", changes: Mapping[str, tuple[str, str]] | None = None
) -> Path:
    """Write a deck and return its main file.

    Parameters
    ----------
    folder
        For the files.
    version
        5 (OpenFAST), 8 (FAST 8, ElastoDyn 1.00 with brackets) or 7 (one main file).
    pile
        ``clamped`` or ``soil``: a monopile below the tower.
    changes
        By file name, a text and what takes its place.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bracket = "{}" if version == 5 else "({})"
    names = dict(zip(("one", "two", "three"), (bracket.format(i) for i in (1, 2, 3)), strict=True))
    cones = dict(zip(("cone", "cone2", "cone3"), (f"PreCone({i})" for i in (1, 2, 3)), strict=True))
    dyn = DYN.format(**names, **cones, nodes="20 BldNodes - nodes" if version != 7 else '"ad.ipt" ADFile - file')
    foot = "0 TowerBsHt - m\n" if version != 7 else "0.0 TwrRBHt - m\n"
    foot += "" if version == 5 else "9.80665 Gravity - m/s^2\n"
    old = version == 7
    tower = TOWER.format(more=" TwGJStif" if old else "", units=" (Nm^2)" if old else "", extra=" 1e11" if old else "")
    pitch = ("AeroCent", "(-)", "0.25") if old else ("PitchAxis", "(-)", "0.25")
    blade = BLADE.format(
        a=bracket.format(1), b=bracket.format(2), **dict(zip(("pitch", "unit", "value"), pitch, strict=True))
    )
    files = {"tower.dat": tower + TOWER_SHAPES + "\n", "blade.dat": blade + SHAPES + "\n"}
    if old:
        files |= {
            "main.fst": "---- FAST certification test ----\nmade up\n" + foot + dyn,
            "ad.ipt": "20 BldNodes - nodes\n",
        }
    else:
        files["main.fst"] = MAIN.format(sub=int(bool(pile)), water=int(bool(pile)))
        if version == 8:
            files["main.fst"] = files["main.fst"].replace("9.80665 Gravity - m/s^2\n", "")
        files["ed.dat"] = f"------- ELASTODYN v1.0{3 if version == 5 else 0}.* INPUT FILE ---\nmade up\n" + foot + dyn
    if pile:
        soil = {"fixed": "1", "soil": ""} if pile == "clamped" else {"fixed": "0", "soil": '"soil.dat"'}
        files |= {"sd.dat": SUBDYN.format(**soil), "hd.dat": HYDRO, "soil.dat": SOIL}
    for name, (old_text, new_text) in (changes or {}).items():
        assert old_text in files[name]
        files[name] = files[name].replace(old_text, new_text, 1)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "main.fst"
