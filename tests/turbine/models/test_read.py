"""Turbine files from models, and models in the place of turbine files."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import windsysid as ws
from tests.conftest import Ended
from tests.turbine.models.decks import write_deck
from windsysid.turbine.models.motion import machine_modes
from windsysid.turbine.models.openfast import read_openfast
from windsysid.turbine.models.read import turbine_file_from


def test_a_tower_file_has_the_modes_and_the_damping_of_the_machine(tmp_path: Path):
    path = write_deck(tmp_path)
    machine = read_openfast(path)
    modes, turbine = machine_modes(machine, machine.rotor_speed), ws.turbine_from(path)
    for name, air in (("side_side", 0.002), ("fore_aft", 0.05)):
        mode = getattr(modes, name)
        assert turbine.natural_frequency(name) / (2.0 * math.pi) == pytest.approx(mode.frequency, rel=1e-6)
        ratio = turbine.damping(name) / turbine.critical_damping(name)
        assert ratio == pytest.approx(mode.damping + air, rel=1e-6)
    assert turbine.rotor_speed == pytest.approx(16.0 * math.pi / 30.0)
    assert turbine.spread[1] == turbine.states["parked"].damping_spread == 0.8
    assert [s.channel for s in turbine.sensors] == ["tower_x_acceleration", "tower_z_acceleration"]


def test_every_number_that_is_not_assumed_names_its_file_and_line(tmp_path: Path):
    text = turbine_file_from(write_deck(tmp_path, pile="soil"))
    for key in ("modal_mass", "speed", "gravity"):
        for line in re.findall(rf"^{key} = .*$", text, flags=re.MULTILINE):
            assert re.search(r"# .*\w+\.(dat|fst):\d+", line), line
    assert re.search(r"damping_ratio = .*tower\.dat: TwrSSDmp.*0\.2 % air \(assumed\)", text)
    assert re.search(r"frequency = .*Hz if the tower bent as a beam of its sections", text)
    assert 'site = "offshore"' in text
    assert "[[sensor]] # downwind: YawBrTAgxp, ed.dat: OutList" in text


def test_sensors_are_those_that_the_model_names(tmp_path: Path):
    nacelle = {"ed.dat": ('"YawBrTAgxp, YawBrTAgyp"', '"NcIMUTAgys"')}
    found = ws.turbine_from(write_deck(tmp_path, changes=nacelle)).sensors
    assert [s.channel for s in found] == ["nacelle_x_acceleration", "tower_z_acceleration"]
    assert found[0].gain == pytest.approx(1.0 + 1.8 * 0.027, abs=0.01)
    assert found[1].gain == 1.0
    rotor = ws.turbine_from(tmp_path / "main.fst", "rotor").sensors
    assert [s.channel for s in rotor[1:]] == [f"blade_{b}_tip_lag_acceleration" for b in (1, 2, 3)]


def test_a_model_takes_the_place_of_a_turbine_file(tmp_path: Path):
    path = write_deck(tmp_path / "with space")
    assert ws.load_turbine(path).values == ws.turbine_from(str(path)).values
    record = ws.simulate(path, duration=120.0, rate=10.0, seed=1)
    assert ws.inspect(record, path).turbine is not None


def test_other_files_and_kinds_are_refused(tmp_path: Path):
    with pytest.raises(ws.ConfigurationError, match=r"expected a file that ends in \.fst or \.htc or .*\.csv"):
        ws.turbine_from(tmp_path / "model.prj")
    with pytest.raises(ws.ConfigurationError, match="kind: expected tower or rotor, got 'barge'"):
        ws.turbine_from(write_deck(tmp_path), "barge")
    with pytest.raises(ws.ConfigurationError, match=r"a \.toml file or of a model \(\.fst, \.htc, .*\.csv\)"):
        ws.load_turbine("model.prj")
    with pytest.raises(ws.ConfigurationError, match=r"no model: .*, such as .*\.fst$"):
        ws.turbine_from(tmp_path)


def test_the_command_writes_a_file_that_loads(run: Callable[..., Ended], tmp_path: Path):
    path, target = write_deck(tmp_path), tmp_path / "my.toml"
    assert str(target) in "".join(run("turbine", path, "--output", target).out.split())
    assert ws.load_turbine(target).values == ws.turbine_from(path).values
    assert run("turbine", path).out == target.read_text(encoding="utf-8")
    assert run("turbine", path, "--output", target).code == 2
    assert run("turbine", path, "--output", target, "--overwrite", "--kind", "rotor").code == 0
    before = (tmp_path / "blade.dat").read_bytes()
    refused = run("turbine", path, "--output", tmp_path / "blade.dat", "--overwrite")
    assert refused.code == 2
    assert "is to be read" in "".join(refused.err)
    assert (tmp_path / "blade.dat").read_bytes() == before


def test_a_faulty_deck_is_one_line_and_code_2(run: Callable[..., Ended], tmp_path: Path):
    path = write_deck(tmp_path, changes={"tower.dat": ("0.4 2500", "0.9 2500")})
    target = tmp_path / "my.toml"
    for command in (["turbine", path, "--output", target], ["simulate", "--turbine", path]):
        ended = run(*command)
        assert ended.code == 2
        assert len(ended.err) == 1
        assert "tower.dat:19: HtFract: expected ascending stations" in ended.err[0]
    assert not target.exists()
