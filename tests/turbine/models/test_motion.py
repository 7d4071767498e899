"""Modes of machines: closed forms, and the program that their decks were written for."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.turbine.models.decks import write_deck
from windsysid.turbine.models.machine import Machine, Support, Top
from windsysid.turbine.models.motion import machine_modes, tower_modes
from windsysid.turbine.models.openfast import read_openfast

DECKS = Path(__file__).parents[4] / "shared" / "data" / "decks"
SHARED = next(
    (p / "shared" / "data" / "decks" for p in Path(__file__).parents if (p / "shared" / "data").is_dir()), DECKS
)

needs_decks = pytest.mark.skipif(not SHARED.is_dir(), reason="the decks are not part of this repository")


def uniform(top_mass: float, gravity: float = 0.0, base: np.ndarray | None = None) -> Machine:
    z = np.array([0.0, 80.0])
    support = Support(
        z, np.full(2, 4000.0), np.zeros(2), np.full((2, 2), 4e11), np.full(2, np.inf), (), base, 0.0,
        np.full((2, 2), 0.01), None,
    )  # fmt: skip
    top = Top(((top_mass, np.zeros(3)),), np.zeros((2, 2)), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    return Machine("made up", "a test", support, top, None, 3, 1.0, gravity, False, (), {"tower": "t"})


def test_the_ratio_of_a_tower_alone_is_smaller_with_its_top_mass():
    """ζ √(m/(m + M)) at the same shape: 1 % is 0.33 % for a mass of twice the tower's; modal mass of the tower 0.24."""
    machine = uniform(2.0 * 320e3)
    found = tower_modes(machine, 0)[0]
    m = found.mass - 2.0 * 320e3
    assert m == pytest.approx(0.236 * 320e3, rel=0.01)
    assert found.damping == pytest.approx(0.01 * math.sqrt(m / found.mass), rel=1e-6)


def test_the_two_directions_of_a_symmetric_machine_are_equal():
    found = machine_modes(uniform(3e5, 9.81), 1.0)
    assert found.side_side.frequency == pytest.approx(found.fore_aft.frequency, rel=1e-9)
    assert found.collective is None


def test_a_soft_foundation_lowers_the_frequency_as_springs_in_series():
    """Rocking k of a stiff tower with a heavy top: 1/k_total = h²/k + h³/3EI."""
    heavy, height, rocking = 1e8, 80.0, 1e10
    base = np.array([np.diag([1e15, rocking])] * 2)
    omega = 2.0 * math.pi * tower_modes(uniform(heavy, base=base), 1)[0].frequency
    stiffness = 1.0 / (height**2 / rocking + height**3 / (3.0 * 4e11))
    assert omega == pytest.approx(math.sqrt(stiffness / heavy), rel=1e-3)


def test_a_pile_without_flexibility_leaves_the_tower_as_it_is(tmp_path: Path):
    land = machine_modes(read_openfast(write_deck(tmp_path / "land")), 1.6)
    stiff = {"sd.dat": ("2.1e11 8.08e10 7850", "2.1e15 8.08e14 7850")}
    clamped = machine_modes(read_openfast(write_deck(tmp_path / "sea", pile="clamped", changes=stiff)), 1.6)
    soft = machine_modes(read_openfast(write_deck(tmp_path / "soft", pile="soil")), 1.6)
    assert clamped.side_side.frequency == pytest.approx(land.side_side.frequency, rel=1e-3)
    assert soft.side_side.frequency < 0.97 * land.side_side.frequency
    assert soft.side_side.damping < land.side_side.damping


@needs_decks
def test_nrel_5_mw_has_the_modes_of_its_linearisation():
    machine = read_openfast(SHARED / "nrel5mw_land" / "NREL-5MW.fst")
    found = machine_modes(machine, machine.rotor_speed)
    expected = {
        "side_side": (0.3153, 0.00349), "fore_aft": (0.3235, 0.00354), "backward": (0.8908, 0.00575),
        "collective": (1.0402, 0.00434), "forward": (1.2990, 0.00399),
    }  # fmt: skip
    for name, (frequency, damping) in expected.items():
        mode = getattr(found, name)
        assert mode.frequency == pytest.approx(frequency, rel=0.0025), name
        assert mode.damping == pytest.approx(damping, rel=0.01), name
    assert tower_modes(machine, 0)[0].mass == pytest.approx(449214.6, rel=1e-3)
    assert 3.0 * machine.blade.mass.sum() == pytest.approx(109389.84 - 56780.0, rel=1e-6)  # type: ignore[union-attr]


@needs_decks
@pytest.mark.parametrize(
    ("soil", "frequencies", "ratios"),
    [("", (0.16428, 0.16495), (0.00112, 0.00114)), ("soil70", (0.16116, 0.16180), (0.00106, 0.00107))],
)
def test_iea_15_mw_on_its_pile_has_the_modes_of_its_linearisation(
    tmp_path: Path, soil: str, frequencies: tuple[float, float], ratios: tuple[float, float]
):
    folder = tmp_path / "deck"
    shutil.copytree(SHARED / "iea15_monopile", folder, ignore=shutil.ignore_patterns("*.lin", "soil70", "four_digits"))
    if soil:
        shutil.copy(SHARED / "iea15_monopile" / soil / "ssi.dat", folder)
    machine = read_openfast(folder / "ls_mono.fst")
    found = machine_modes(machine, machine.rotor_speed)
    for mode, frequency, ratio in zip((found.side_side, found.fore_aft), frequencies, ratios, strict=True):
        assert mode.frequency == pytest.approx(frequency, rel=0.002)
        assert mode.damping == pytest.approx(ratio, rel=0.02)
