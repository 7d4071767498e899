"""Channels that operational modal analysis takes where none are listed: those of the structure."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.spectral.oma.sensors import choose_sensors

from .oscillators import modal_responses
from .test_oma import RATE, turning, two_modes


def tower_and_blade(seed, once=0.45):
    """Two tower channels, and a blade's own: its mode, and the tower's at f ± 1P."""
    rng = np.random.default_rng(seed)
    q, _ = modal_responses([1.1, 1.3, 3.3], [0.012, 0.015, 0.01], RATE, 6000, rng)
    q = q / q.std(axis=0) + 0.02 * rng.normal(size=q.shape)
    psi = 2.0 * np.pi * once * np.arange(len(q)) / RATE
    return q[:, 0], q[:, 1], 0.5 * q[:, 2] + q[:, 0] * np.cos(psi) + q[:, 1], np.mod(psi, 2.0 * np.pi)


TOWER = ("tower_x_acceleration", "tower_z_acceleration")


@pytest.mark.parametrize(("name", "with_azimuth"), [("Spn3ALxb1", False), ("Spn3ALxb1", True), ("blade_1_acc", True)])
def test_a_blades_own_channel_beside_the_towers_is_left_out_with_a_note(name, with_azimuth):
    x, z, blade, psi = tower_and_blade(1)
    columns = {name: blade, **dict(zip(TOWER, (x, z), strict=True))}
    found = ws.oma(turning({**columns, **({"rotor_azimuth": psi} if with_azimuth else {})}))
    assert found.channels == TOWER
    assert any(note.startswith(f"left out: {name}") for note in found.notes)
    assert {round(mode.frequency.estimate, 1) for mode in found.modes} == {1.1, 1.3}


@pytest.mark.parametrize("name", ["B1N003_TAxl", "Blade 1 x-acceleration", "Mbdy:blade1 acc", "blade_1_acc"])
def test_a_blades_own_channel_has_many_names(name):
    x, z, blade, _ = tower_and_blade(1)
    chosen, notes = choose_sensors(turning({name: blade, **dict(zip(TOWER, (x, z), strict=True))}), None)
    assert tuple(sensor.channel for sensor in chosen) == TOWER
    assert any(note.startswith(f"left out: {name}") for note in notes)


def beside_water(name):
    """A tower's accelerations, and another one of a wave."""
    y = two_modes(2)
    wave = modal_responses([0.35], [0.08], RATE, 6000, np.random.default_rng(3))[0][:, 0]
    return {**dict(zip(TOWER, y.T, strict=False)), name: wave / wave.std()}


@pytest.mark.slow
def test_the_waters_own_acceleration_is_left_out_with_a_note():
    columns = beside_water("wave_acceleration")
    found = ws.oma(turning(columns))
    assert found.channels == TOWER
    assert any(note.startswith("left out: wave_acceleration: water") for note in found.notes)
    listed = ws.oma(turning(columns), sensors=list(columns))
    assert listed.channels == tuple(columns)  # what is listed is taken


@pytest.mark.parametrize("name", ["FAcc1xi", "M1N1FAxi", "Wave1Axi", "L1N4Ax"])
def test_the_waters_own_acceleration_has_many_names(name):
    columns = beside_water(name)
    chosen, notes = choose_sensors(turning(columns), None)
    assert tuple(sensor.channel for sensor in chosen) == TOWER
    assert any(note.startswith(f"left out: {name}: water") for note in notes)
    listed, _ = choose_sensors(turning(columns), list(columns))
    assert tuple(sensor.channel for sensor in listed) == tuple(columns)


def test_blades_alone_are_taken_unless_the_rotor_turns():
    x, z, _, psi = tower_and_blade(4)
    columns = {"Spn1ALxb1": x, "Spn2ALxb1": z}
    bands = [(0.9, 1.5)]
    assert ws.oma(turning(columns), bands=bands).channels == ("Spn1ALxb1", "Spn2ALxb1")
    parked = {**columns, "tower_x_acceleration": x + z, "rotor_speed": np.zeros(len(x))}
    assert len(ws.oma(turning(parked), bands=bands).channels) == 3
    with pytest.raises(ws.ConfigurationError, match="got only Spn1ALxb1, Spn2ALxb1 of blades"):
        ws.oma(turning({**columns, "rotor_azimuth": psi}))
