"""The state of a tower in a record: which damping prior it gets, and what that is worth."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from windsysid.cli import app
from windsysid.errors import ConfigurationError
from windsysid.identification.condition.operating_state import in_state
from windsysid.identification.identify import identify
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine, packaged_file, write_turbine
from windsysid.turbine.turbine import Turbine

TOWER = load_turbine("tower")
PARKED = TOWER.in_state("parked")


def damped(tower: Turbine, ratio: float) -> Turbine:
    """The tower with this damping ratio in both directions."""
    critical = {name: tower.critical_damping(name) for name in tower.model.coordinates}
    return tower.with_values({f"c_{name}": ratio * c for name, c in critical.items()})


def standing(**channels: float) -> Record:
    """Two minutes of nothing but these channels, constant: speeds in rad/s, angles in rad."""
    time = np.arange(1200) / 10.0
    units = tuple("rad/s" if name.endswith("speed") else "rad" for name in channels)
    return Record(time, np.outer(np.ones_like(time), list(channels.values())), tuple(channels), units)


@pytest.mark.slow
def test_parked_towers_with_the_packaged_file_are_usable_and_their_intervals_hold():
    held = []
    for ratio, seed in product((0.004, 0.01), range(900, 902)):
        truth = damped(PARKED, ratio)
        found = identify(simulate_record(truth, duration=600.0, rate=4.0, seed=seed), "tower", formulation="spectral")
        assert found.summary()["state"] == "parked"
        assert {e.grade for e in found.estimates} <= {"A", "B"}
        held += [e.low < truth.values[e.name] < e.high for e in found.estimates]
    assert sum(held) >= 14  # 2 of 16 or fewer outside, with a probability of 96 % if ±2σ were exact


def test_an_operating_tower_is_identified_as_it_was():
    record = simulate_record(TOWER, duration=600.0, rate=10.0, seed=3)
    found, given = (identify(record, TOWER, formulation="spectral", state=state) for state in ("auto", "operating"))
    assert [e.estimate for e in found.estimates] == [e.estimate for e in given.estimates]
    assert {e.name: e.prior for e in found.estimates} == TOWER.coefficients
    assert found.summary()["state"] == "operating"


@pytest.mark.parametrize(
    ("channels", "state", "why"),
    [
        ({"rotor_speed": TOWER.rotor_speed}, "operating", "speed"),
        ({"rotor_speed": 0.5 * TOWER.rotor_speed}, "operating", "speed"),
        ({"rotor_speed": 0.0}, "parked", "speed"),
        ({"rotor_speed": 0.08 * TOWER.rotor_speed}, "parked", "speed"),
        ({"rotor_azimuth": 1.0}, "parked", "speed"),
        ({"rotor_speed": TOWER.rotor_speed, "blade_1_pitch": 0.4}, "operating", "speed"),
        ({"rotor_speed": 0.5 * TOWER.rotor_speed, "blade_1_pitch": 1.5}, "parked", "pitch"),
        ({"blade_1_pitch": 1.5}, "parked", "pitch"),
        ({"blade_1_pitch": 86.0}, "operating", "unknown"),  # degrees marked as rad
        ({"nacelle_yaw": 0.0}, "operating", "unknown"),
    ],
)
def test_rotor_speed_and_pitch_decide(channels: dict[str, float], state: str, why: str):
    turbine, (note,) = in_state(TOWER, standing(**channels), "auto")
    assert (note.data["state"], note.data["why"]) == (state, why)
    assert turbine.values["c_fore_aft"] == (PARKED if state == "parked" else TOWER).values["c_fore_aft"]
    assert str(note).startswith(f"the turbine is {state} (")


def test_a_start_is_not_parked():
    record = standing(rotor_speed=0.0)
    rising = record.with_channels({"rotor_speed": (np.linspace(0.0, TOWER.rotor_speed, record.samples), "rad/s")})
    assert in_state(TOWER, rising, "auto")[0] is TOWER


def test_a_parked_tower_has_no_blade_passing_and_keeps_its_structure():
    assert PARKED.rotor_speed == 0.0
    assert not any(load.harmonic for load in PARKED.loads)
    changed = {name for name, value in TOWER.values.items() if PARKED.values[name] != value}
    assert changed == {"c_side_side", "c_fore_aft"}


def test_a_file_without_states_is_as_before_and_says_what_it_lacks():
    rotor = load_turbine("verne555")
    assert in_state(rotor, standing(rotor_speed=0.0), "auto") == (rotor, ())
    with pytest.raises(ConfigurationError, match="has no state 'parked': expected operating; a tower file has it"):
        identify(standing(rotor_speed=0.0), rotor, state="parked")
    with pytest.raises(ConfigurationError, match="turbine 'tower' has no state 'idle': expected operating, parked"):
        identify(standing(rotor_speed=0.0), TOWER, state="idle")


def test_states_are_written_and_read(tmp_path: Path):
    write_turbine(TOWER, tmp_path / "tower.toml")
    again = load_turbine(tmp_path / "tower.toml")
    assert again.states["parked"].values == pytest.approx(TOWER.states["parked"].values)
    assert again.states["parked"].damping_spread == 0.8


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('side_side_damping_ratio = "1 %"', 'side_side_damping_ratio = "0 %"', "expected a size other than 0 %"),
        ('side_side_damping_ratio = "1 %"', 'side_side_damping_ratio = "1"', "side_side_damping_ratio"),
        ("prior_damping = 0.8", "prior_damping = -1", "expected a relative standard deviation"),
        ("prior_damping = 0.8", "", "prior_damping"),
        ("[states.parked]", "[states.idling]", "states.idling"),
    ],
)
def test_wrong_states_are_one_clear_line(tmp_path: Path, old: str, new: str, message: str):
    text = packaged_file("tower")
    assert old in text
    (tmp_path / "wrong.toml").write_text(text.replace(old, new))
    with pytest.raises(ConfigurationError, match=message) as error:
        load_turbine(tmp_path / "wrong.toml")
    assert "\n" not in str(error.value)


def test_a_record_in_pieces_takes_its_state_from_the_first():
    record = simulate_record(damped(PARKED, 0.01), duration=600.0, rate=10.0, seed=5)
    found = identify_pieces([record.section(0.0, 299.95), record.section(299.95, 600.0)], TOWER, formulation="spectral")
    assert found.summary()["state"] == "parked"
    assert found["c_fore_aft"].prior == PARKED.values["c_fore_aft"]


@pytest.mark.slow
def test_a_plan_takes_a_state(tmp_path: Path):
    planned = ["plan", "--turbine", "tower", "--duration", "60 min", "--rate", "5", "--json"]
    shown = [CliRunner().invoke(app, [*planned, *more]) for more in ([], ["--state", "parked"])]
    assert [one.exit_code for one in shown] == [0, 0]
    assert shown[0].stdout != shown[1].stdout
