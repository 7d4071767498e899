"""The packaged turbines against what is published about them, and turbine files that are wrong."""

import math
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from windsysid.errors import ConfigurationError
from windsysid.mechanics import RotorModel, TowerModel, compile_model
from windsysid.turbine.entries import RANGES, read_quantity
from windsysid.turbine.file import load_turbine, packaged_turbines, write_turbine
from windsysid.turbine.tables import as_tables
from windsysid.turbine.turbine import Turbine


def test_the_packaged_turbines_load_by_name():
    assert packaged_turbines() == ("hammond", "nrel5mw", "nrel5mw_full", "tower", "verne555")
    for name in packaged_turbines():
        turbine = load_turbine(name)
        assert turbine.name == name
        assert turbine.description
        assert turbine.source
        assert turbine.sensors
        assert [load.load for load in turbine.loads if not load.harmonic] == list(turbine.model.loads)
        assert set(turbine.coefficients) == set(turbine.model.coefficients)


def test_verne555_honours_what_is_published(verne555: Turbine):
    assert verne555.model == RotorModel(3)
    assert verne555.rotor_speed / (2 * math.pi) == pytest.approx(1.16, rel=1e-12)
    assert verne555.coefficients["k_y"] == 1650.0
    for name in verne555.model.coordinates:
        frequency = verne555.natural_frequency(name) / (2 * math.pi)
        assert frequency > 1.16, f"{name}: {frequency} Hz"
    assert verne555.inertia("x") == verne555.inertia("y") == pytest.approx(14.5, rel=1e-14)
    arm = 0.2 + 2.5 / 2
    assert verne555.values["blade_first_moment_2"] == pytest.approx(2.5 * arm)
    assert verne555.inertia("beta_2") == pytest.approx(2.5 * ((2.5**2 + 0.2**2) / 12 + arm**2))


def test_verne555_marks_as_assumed_what_nobody_published(verne555: Turbine):
    assert {"k_x", "c_x", "c_y", "k_beta", "c_beta", "blade mass", "loads", "noise"} <= set(verne555.assumed)
    assert "k_y" not in verne555.assumed


def test_nrel5mw_is_the_equivalent_hinge_of_the_openfast_model():
    # The record's own truth, in tip coordinates, to the digits with which it is given.
    turbine = load_turbine("nrel5mw")
    v, lever, speed = turbine.values, turbine.tip_lever, turbine.rotor_speed
    S, I, d = v["blade_first_moment_1"], v["blade_inertia_1"], v["hinge_offset"]  # noqa: E741
    assert I / lever**2 == pytest.approx(1441.16, rel=1e-4)
    assert S / lever == pytest.approx(3198.5, rel=1e-4)
    assert S * d * speed**2 / lever**2 == pytest.approx(1083.7, rel=1e-4)
    assert abs(v["kappa"] * (I + S * d) / lever) == pytest.approx(2599.4, rel=1e-4)
    assert v["kappa"] < 0.0
    assert turbine.inertia("x") == pytest.approx(449_214.6, rel=1e-4)
    assert v["k_beta_1"] / lever**2 == pytest.approx(66_822.1, rel=1e-4)
    assert v["c_beta_1"] / lever**2 == pytest.approx(93.37, rel=1e-4)
    assert turbine.coefficients["k_x"] == 1_773_892.0
    assert turbine.coefficients["c_x"] == 6283.98
    assert turbine.natural_frequency("beta_1") ** 2 * I / lever**2 == pytest.approx(67_905.8, rel=1e-4)


def test_nrel5mw_has_the_tower_and_edgewise_modes_of_the_linearisation():
    # Modes at 12.1 rpm from the compiled equations, in the fixed frame by a multi-blade transformation: collective
    # stays, the whirl modes appear at f ∓ Ω. 0.3155, 0.8955, 1.1112, 1.3052 Hz within 1e-3.
    turbine = load_turbine("nrel5mw")
    model = compile_model(turbine.model, (), turbine.model.coefficients)
    p = np.array([turbine.values[name] for name in model.parameters])
    n, h, speed = 4, 1e-6, turbine.rotor_speed
    A, B, G, rates = np.zeros((8, 8)), np.zeros((8, 8)), np.zeros((8, 4)), np.empty(8)

    def turned(psi: float) -> np.ndarray:
        angles = psi + 2 * np.pi * np.arange(3) / 3
        T = np.eye(4)
        T[1:, 1:] = np.column_stack([np.ones(3), np.cos(angles), np.sin(angles)])
        return T

    def fixed_frame(psi: float) -> np.ndarray:
        A[:] = 0.0
        values = p.copy()
        values[model.parameters.index("gravity")] = 0.0
        model.rates_jacobian(np.zeros(8), np.array([psi, speed, 0.0]), values, np.zeros(4), rates, A, B, G)
        T = turned(psi)
        T1 = speed * (turned(psi + h) - turned(psi - h)) / (2 * h)
        T2 = np.zeros((4, 4))
        T2[1:, 2:] = -(speed**2) * T[1:, 2:]
        inverse = np.linalg.inv(T)
        K, C = A[n:, :n], A[n:, n:]
        return np.block([
            [np.zeros((n, n)), np.eye(n)],
            [inverse @ (K @ T + C @ T1 - T2), inverse @ (C @ T - 2 * T1)],
        ])  # fmt: skip

    system = fixed_frame(0.4)
    np.testing.assert_allclose(system, fixed_frame(1.3), atol=1e-6 * np.abs(system).max())  # no azimuth left in it
    eigenvalues = np.linalg.eigvals(system)
    frequencies = np.sort(np.abs(eigenvalues[eigenvalues.imag > 0]) / (2 * np.pi))
    np.testing.assert_allclose(frequencies, [0.3155, 0.8955, 1.1112, 1.3052], rtol=1e-3)


def test_hammond_has_the_published_values():
    turbine = load_turbine("hammond")
    v = turbine.values
    assert turbine.model == RotorModel(4)
    published = {
        "blade_mass": 94.9, "blade_first_moment": 289.1, "blade_inertia": 1084.7, "k_beta": 0.0, "c_beta": 4067.5
    }  # fmt: skip
    for i in (1, 2, 3, 4):
        assert {name: v[f"{name}_{i}"] for name in published} == published
    support = {
        "hub_mass_x": 8026.6, "hub_mass_y": 3283.6, "k_x": 1_240_481.8, "k_y": 1_240_481.8, "c_x": 51_078.7,
        "c_y": 25_539.35, "hinge_offset": 0.3048, "gravity": 0.0,
    }  # fmt: skip
    assert {name: v[name] for name in support} == support
    assert turbine.inertia("y") == pytest.approx(3283.6 + 4 * 94.9)


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=[pytest.mark.slow] * (one not in ("verne555", "tower"))) for one in packaged_turbines()],
)
def test_effective_inertias_are_the_diagonal_of_the_mass_matrix(name: str):
    # `inertia` is written by hand; the equations know it too.
    turbine = load_turbine(name)
    equations = turbine.model.equations()
    values = {symbol: turbine.values[symbol.name] for symbol in equations.parameters}
    values |= dict.fromkeys((*equations.states, *equations.inputs), 0.0)
    diagonal = [equations.mass[i, i].subs(values) for i in range(len(turbine.model.coordinates))]
    for coordinate, expected in zip(turbine.model.coordinates, diagonal, strict=True):
        assert turbine.inertia(coordinate) == pytest.approx(float(expected), rel=1e-12)


def test_other_values_and_other_freedom_make_another_turbine(verne555: Turbine):
    softer = verne555.with_values({"k_x": 1000.0})
    assert (softer.coefficients["k_x"], verne555.coefficients["k_x"]) == (1000.0, 1800.0)
    locked = verne555.with_model(RotorModel(3, lag="locked"))
    assert list(locked.coefficients) == ["k_x", "c_x", "k_y", "c_y"]
    with pytest.raises(ConfigurationError, match="turbine 'verne555' has no parameter 'k_z'"):
        verne555.with_values({"k_z": 1.0})


BLADE = """[blade]
mass = "2.5 kg"
length = "2.5 m"
width = "0.2 m"
k_beta = "4150 N*m/rad"
c_beta = "6 N*m*s/rad"
"""
GOOD = f"""
name = "mine"
description = "a turbine of my own"
source = "made up"

[model]
blades = 3

[rotor]
speed = "69.6 rpm"
hinge_offset = "20 cm"

[support]
hub_mass_x = "7 kg"
hub_mass_y = "7 kg"
k_x = "1.8 kN/m"
c_x = "12 N*s/m"
k_y = "1650 N/m"
c_y = "-1 N*s/m"

{BLADE}
[loads]
time_constant = "1 s"
hub_rms = "15 N"
blade_rms = "15 N*m"
"""
MOMENTS = BLADE.replace('length = "2.5 m"\nwidth = "0.2 m"', 'first_moment = "3 kg*m"\ninertia = "6 kg*m^2"')


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def several(*blades: str) -> str:
    return GOOD.replace(BLADE, "\n".join(blade.replace("[blade]", "[[blade]]") for blade in blades))


def test_a_turbine_file_is_read_in_its_own_units(tmp_path: Path):
    turbine = load_turbine(written(tmp_path, GOOD))
    assert turbine.values["k_x"] == 1800.0
    assert turbine.values["hinge_offset"] == pytest.approx(0.2)
    assert turbine.values["c_y"] == -1.0  # negative damping is what must be seen
    assert turbine.values["gravity"] == 9.80665
    assert turbine.spread == (0.3, 0.3)
    assert turbine.sensors == ()


def test_blades_may_differ_and_be_given_by_their_moments(tmp_path: Path):
    heavier = BLADE.replace("2.5 kg", "3 kg")
    turbine = load_turbine(written(tmp_path, several(BLADE, heavier, MOMENTS)))
    assert [turbine.values[f"blade_mass_{i}"] for i in (1, 2, 3)] == [2.5, 3.0, 2.5]
    assert (turbine.values["blade_first_moment_3"], turbine.values["blade_inertia_3"]) == (3.0, 6.0)
    arm = load_turbine(written(tmp_path, GOOD.replace('width = "0.2 m"', 'width = "0.2 m"\narm = "1 m"')))
    assert arm.values["blade_first_moment_1"] == 2.5


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            GOOD.replace("1650 N/m", "1650 N*s/m"),
            r"support\.k_y: expected a unit of the same quantity as N/m, got '1650 N\*s/m'",
        ),
        (
            GOOD.replace("1650 N/m", "1650 furlong"),
            r"support\.k_y: unknown unit 'furlong': expected .* got '1650 furlong'",
        ),
        (GOOD.replace("1650 N/m", "1650"), r"support\.k_y: the unit is missing: .*1650 N/m.*, got '1650'"),
        (
            GOOD.replace('"1650 N/m"', "1650"),
            r"support\.k_y: expected a value with its unit, such as \"1\.5 N/m\", got 1650",
        ),
        (GOOD.replace("1650 N/m", "much N/m"), r"support\.k_y: expected a number and a unit, .* got 'much N/m'"),
        (GOOD.replace("1650 N/m", "inf N/m"), r"support\.k_y: expected a finite number, .* got 'inf N/m'"),
        (GOOD.replace("1650 N/m", "nan N/m"), r"support\.k_y: expected a finite number, .* got 'nan N/m'"),
        (GOOD.replace("1650 N/m", "-5 N/m"), r"support\.k_y: .* greater than or equal to 0, got '-5 N/m'"),
        (
            GOOD.replace('hub_mass_x = "7 kg"', 'hub_mass_x = "-7 kg"'),
            r"support\.hub_mass_x: .* greater than 0, got '-7 kg'",
        ),
        (GOOD.replace("2.5 kg", "-2.5 kg"), r"blade\.1\.mass: .* greater than 0, got '-2\.5 kg'"),
        (GOOD.replace("2.5 kg", "0 kg"), r"blade\.1\.mass: .* greater than 0, got '0 kg'"),
        (GOOD.replace('length = "2.5 m"', 'length = "0 m"'), r"blade\.1\.length: .* greater than 0, got '0 m'"),
        (GOOD.replace("k_y =", "k_z ="), r"unknown key 'support\.k_z': remove it or correct its spelling"),
        (GOOD + "[colour]\n", "unknown key 'colour'"),
        (GOOD.replace('k_y = "1650 N/m"\n', ""), r"'support\.k_y' is missing: add it"),
        (GOOD.replace('k_beta = "4150 N*m/rad"\n', ""), r"'blade\.1\.k_beta' is missing: add it"),
        (GOOD.replace(BLADE, ""), "'blade' is missing: add it"),
        (GOOD.replace('name = "mine"', ""), "'name' is missing: add it"),
        (
            GOOD.replace("[blade]", '[blade]\nfirst_moment = "3 kg*m"\ninertia = "6 kg*m^2"'),
            (
                r"blade\.1: expected either 'first_moment' and 'inertia', or 'length' and 'width'.* got first_moment,"
                r" inertia, length"
            ),
        ),
        (GOOD.replace('length = "2.5 m"\nwidth = "0.2 m"\n', ""), r"blade\.1: expected either .* got none of them"),
        (GOOD.replace('width = "0.2 m"', 'inertia = "6 kg*m^2"'), r"blade\.1: expected either .* got inertia, length"),
        (
            GOOD.replace("[blade]", '[blade]\ninertia = "6 kg*m^2"'),
            r"blade\.1: expected either .* got inertia, length, width",
        ),
        (
            GOOD.replace(BLADE, MOMENTS.replace("6 kg*m^2", "3.5 kg*m^2")),
            r"blade\.1: 'inertia' about the link must be at least first_moment²/mass = 3\.6 kg\*m\^2, got 3\.5",
        ),
        (several(BLADE, BLADE), r"expected one \[blade\] table or 3 \[\[blade\]\] tables, got 2"),
        (several(BLADE, BLADE, BLADE, BLADE), r"expected one \[blade\] table or 3 \[\[blade\]\] tables, got 4"),
        (several(BLADE, BLADE.replace("2.5 kg", "-1 kg"), BLADE), r"blade\.2\.mass: .* greater than 0, got '-1 kg'"),
        (several(BLADE, BLADE, BLADE.replace("mass", "mas")), r"unknown key 'blade\.3\.mas'"),
        (GOOD.replace("blades = 3", "blades = 0"), r"model\.blades: .* got 0"),
        (
            GOOD.replace("blades = 3", 'blades = 3\nroll = "loose"'),
            r"model\.roll: .* 'free', 'locked' or 'tied', got 'loose'",
        ),
        (GOOD.replace("blades = 3", 'blades = 3\nroll = "tied"\nx = "locked"'), "roll is tied to x, but x is locked"),
        (GOOD + "[prior]\nstiffness = nan\n", r"prior\.stiffness: .* got nan"),
        (GOOD + "[prior]\nstiffness = 50\n", r"prior\.stiffness: .* got 50"),
        (GOOD + '[[sensor]]\nchannel = "a"\n', "sensor 1: 'quantity' is missing"),
        (GOOD + '[sensor]\nchannel = "a"\n', r"expected \[\[sensor\]\] tables"),
        ('site = "lake"\n' + GOOD, r"site: .* 'onshore' or 'offshore', got 'lake'"),
        (GOOD + "[odds]\nwaves = 0\n", r"odds\.waves: .* greater than 0, got 0"),
        (GOOD + "[odds]\nwaves = inf\n", r"odds\.waves: .*got inf"),
        ("sensor = 3\n" + GOOD, r"expected \[\[sensor\]\] tables, one per channel, got 3"),
        ("", "'name' is missing"),
        ("no TOML at all", "expected TOML, got: "),
        ("\x00\x01\x02", "expected TOML, got: "),
    ],
)
def test_a_wrong_turbine_file_is_one_clear_line(tmp_path: Path, text: str, complaint: str):
    assert text != GOOD
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        load_turbine(written(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert "_Blade" not in str(caught.value)


TOWER = """
name = "mine"
description = "a tower of my own"
source = "made up"

[model]
kind = "tower"

[rotor]
speed = "12 rpm"

[side_side]
modal_mass = "400 t"
frequency = "0.3 Hz"
damping_ratio = "0.5 %"

[fore_aft]
modal_mass = "420 t"
frequency = "0.31 Hz"
damping_ratio = "-1 %"

[loads]
time_constant = "2 s"
side_side_rms = "10 kN"
fore_aft_rms = "50 kN"

[blade_passing]
time_constant = "10 s"
side_side_rms = "1 kN"
fore_aft_rms = "5 kN"
"""


def test_a_tower_file_speaks_of_frequency_and_damping_ratio(tmp_path: Path):
    turbine = load_turbine(written(tmp_path, TOWER))
    omega = 2.0 * math.pi * 0.3
    assert turbine.model == TowerModel(3)
    assert turbine.inertia("fore_aft") == 420e3
    assert turbine.natural_frequency("side_side") == pytest.approx(omega)
    assert turbine.coefficients["k_side_side"] == pytest.approx(400e3 * omega**2)
    assert turbine.coefficients["c_side_side"] == pytest.approx(2 * 0.005 * 400e3 * omega)
    assert turbine.coefficients["c_fore_aft"] < 0.0
    assert [(load.load, load.rms, load.time_constant, load.harmonic) for load in turbine.loads] == [
        ("load_side_side", 10e3, 2.0, 0),
        ("load_fore_aft", 50e3, 2.0, 0),
        ("load_side_side", 1e3, 10.0, 3),
        ("load_fore_aft", 5e3, 10.0, 3),
    ]
    assert (turbine.values["tilt"], turbine.values["gravity"]) == (0.0, 9.80665)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (('kind = "tower"', 'kind = "monopile"'), r"model\.kind: expected 'rotor' or 'tower', got 'monopile'"),
        (('kind = "tower"', 'kind = "tower"\nlag = "free"'), r"unknown key 'model\.lag'"),
        (('modal_mass = "400 t"\n', ""), r"'side_side\.modal_mass' is missing: add it"),
        (("0.31 Hz", "0.31 rpm"), r"fore_aft\.frequency: expected a unit of the same quantity as Hz, got '0\.31 rpm'"),
        (("0.5 %", "0.5"), r"side_side\.damping_ratio: the unit is missing: .*0\.5 %.*, got '0\.5'"),
        (("0.5 %", "120 %"), r"side_side\.damping_ratio: expected a size of 1e-09 … 1 .*got '120 %'"),
        (("0.5 %", "0 %"), r"side_side\.damping_ratio: expected a size other than 0 %"),
    ],
)
def test_a_wrong_tower_file_is_one_clear_line(tmp_path: Path, change: tuple[str, str], complaint: str):
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        load_turbine(written(tmp_path, TOWER.replace(*change)))
    assert "\n" not in str(caught.value)


def test_a_file_may_say_where_its_turbine_stands_and_what_is_likely_there(tmp_path: Path):
    plain = load_turbine(written(tmp_path, TOWER))
    assert (plain.site, plain.odds) == ("onshore", {})
    assert not {"site", "odds"} & set(as_tables(plain))
    found = load_turbine(written(tmp_path, 'site = "offshore"\n' + TOWER + "\n[odds]\nstep = 0.01\n"))
    assert (found.site, found.odds) == ("offshore", {"step": 0.01})
    write_turbine(found, tmp_path / "again.toml")
    again = load_turbine(tmp_path / "again.toml")
    assert (again.site, again.odds) == (found.site, found.odds)
    assert plain.at("offshore").site == "offshore"
    assert found.at(None) == found


def test_a_locked_direction_may_have_no_damping(tmp_path: Path):
    text = TOWER.replace('kind = "tower"', 'kind = "tower"\nside_side = "locked"').replace("0.5 %", "0 %")
    assert load_turbine(written(tmp_path, text)).values["c_side_side"] == 0.0


@pytest.mark.parametrize("name", packaged_turbines())
def test_a_turbine_that_is_written_comes_back(tmp_path: Path, name: str):
    turbine = load_turbine(name)
    write_turbine(turbine, str(tmp_path / "new" / "again.toml"))
    again = load_turbine(tmp_path / "new" / "again.toml")
    assert (again.model, again.loads, again.sensors, again.spread) == (
        turbine.model,
        turbine.loads,
        turbine.sensors,
        turbine.spread,
    )
    assert again.values == pytest.approx(dict(turbine.values), rel=1e-12)


def test_a_tower_has_no_rotor_of_its_own(verne555: Turbine):
    assert verne555.rotor is verne555.model
    with pytest.raises(
        ConfigurationError, match="turbine 'tower' is of the kind 'tower': expected a rotor with blades of its own"
    ):
        _ = load_turbine("tower").rotor


def test_a_turbine_that_is_not_there_is_one_clear_line(tmp_path: Path):
    with pytest.raises(
        ConfigurationError,
        match=r"no turbine 'verne': expected one of hammond, nrel5mw, nrel5mw_full, tower, verne555, or",
    ):
        load_turbine("verne")
    with pytest.raises(ConfigurationError, match=r"nowhere\.toml: no such file, expected a turbine file"):
        load_turbine(tmp_path / "nowhere.toml")
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    with pytest.raises(ConfigurationError, match="is a folder, expected a turbine file"):
        load_turbine(folder)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(128, 256)))
    with pytest.raises(ConfigurationError, match="is not a turbine file") as caught:
        load_turbine(binary)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("size", ["1e300", "1e-300", "1e12", "-1e300"])
@pytest.mark.parametrize(
    ("name", "key", "unit", "said"),
    [
        ("tower", "loads.time_constant", "s", "0.0001 … 1e+06 s"),
        ("tower", "blade_passing.time_constant", "s", "0.0001 … 1e+06 s"),
        ("tower", "loads.side_side_rms", "N", "1e-09 … 1e+10 N"),
        ("tower", "blade_passing.fore_aft_rms", "N", "1e-09 … 1e+10 N"),
        ("tower", "side_side.modal_mass", "kg", "1e-06 … 1e+09 kg"),
        ("tower", "side_side.frequency", "Hz", "0.0001 … 25000 Hz"),
        ("tower", "fore_aft.damping_ratio", "1", "1e-09 … 1 (as a ratio"),
        ("tower", "top.tilt", "rad/m", "1e-09 … 1000 rad/m"),
        ("tower", "rotor.speed", "rad/s", "1e-06 … 10000 rad/s"),
        ("verne555", "loads.hub_rms", "N", "1e-09 … 1e+10 N"),
        ("verne555", "loads.time_constant", "s", "0.0001 … 1e+06 s"),
        ("tower", "prior.stiffness", "", "a relative standard deviation of 1e-06 … 3"),
        ("tower", "prior.damping", "", "a relative standard deviation of 1e-06 … 10"),
    ],
)
def test_a_number_that_no_turbine_has_is_refused_with_its_key_and_range(
    tmp_path: Path, name: str, key: str, unit: str, said: str, size: str
):
    tables = as_tables(load_turbine(name))
    table, entry = key.split(".")
    tables[table][entry] = f"{size} {unit}" if unit else float(size)
    path = written(tmp_path, tomli_w.dumps(tables))
    with pytest.raises(ConfigurationError) as refused:
        load_turbine(path)
    text = str(refused.value)
    assert text.startswith(f"turbine file {path}: {key}: expected ")
    assert said in text
    assert text.count("\n") == 0


@pytest.mark.parametrize("key", ["noise", "bias", "gain", "drift", "clock_tolerance"])
@pytest.mark.parametrize("size", [1e300, 1e-300, 1e15])
def test_a_number_that_no_sensor_has_is_refused_with_its_key_and_range(tmp_path: Path, key: str, size: float):
    tables = as_tables(load_turbine("tower"))
    tables["sensor"][1][key] = size
    path = written(tmp_path, tomli_w.dumps(tables))
    with pytest.raises(ConfigurationError) as refused:
        load_turbine(path)
    assert f"turbine file {path}: sensor 2: {key}: expected a size of 1e-12 … 1e+12" in str(refused.value)


def test_the_ends_of_every_range_and_zero_are_read():
    for unit, (low, high, why) in RANGES.items():
        assert [read_quantity(f"{value!r} {unit}", unit) for value in (low, -high, 0.0)] == [low, -high, 0.0]
        assert why
        for value in (0.99 * low, -1.01 * high):
            with pytest.raises(ConfigurationError, match="expected a size of"):
                read_quantity(f"{value!r} {unit}", unit)
    assert read_quantity("1e40 W", "W") == 1e40  # a unit of somebody's own model
