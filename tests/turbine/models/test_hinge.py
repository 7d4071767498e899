"""The equivalent rotor of hinged blades, as compiled and analysed by the rest of the package."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.turbine.models.decks import write_deck
from tests.turbine.models.test_motion import SHARED, needs_decks
from windsysid.modal.sweep import find_modes
from windsysid.turbine.models.hinge import equivalent_hinge
from windsysid.turbine.models.machine import Blade, Top
from windsysid.turbine.models.motion import TowerMode, machine_modes
from windsysid.turbine.models.openfast import read_openfast
from windsysid.turbine.models.read import turbine_from


def test_a_blade_that_is_hinged_is_its_own_equivalent():
    """A rigid blade of three point masses on a hinge at 3 m: radius, moments and spring come back."""
    arms, mass = np.array([5.0, 15.0, 25.0]), np.array([300.0, 200.0, 100.0])
    lever = 30.0
    moves = np.stack([0.0 * arms, arms / lever], axis=-1)[:, None, :]
    blade = Blade(
        3.0 + arms, mass, moves, (arms / lever**2)[:, None, None], np.array([[5e4]]), np.array([[60.0]]), 0, 0.05
    )
    top = Top((), np.zeros((2, 2)), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    found = equivalent_hinge(blade, top, TowerMode(0.3, 1e5, 0.02, 0.003, 0.003))
    assert found.offset == pytest.approx(3.0)
    assert found.lever == pytest.approx(lever)
    assert found.first_moment == pytest.approx(np.sum(mass * arms))
    assert found.inertia == pytest.approx(np.sum(mass * arms**2))
    assert (found.stiffness, found.damping) == pytest.approx((5e4 * lever**2, 60.0 * lever**2))


def modes_of(path: Path) -> dict[str, tuple[float, float]]:
    """Frequency [Hz] and damping ratio of the modes of the rotor file of a deck, in the fixed frame."""
    turbine = turbine_from(path, "rotor")
    found = find_modes(turbine, speeds=(0.9 * turbine.rotor_speed, 1.1 * turbine.rotor_speed))
    at = found.usual
    return {curve.name: (float(curve.frequency[at]), float(curve.damping[at])) for curve in found.curves}


@pytest.mark.slow
def test_the_rotor_file_has_the_modes_of_its_deck(tmp_path: Path):
    path = write_deck(tmp_path)
    machine = read_openfast(path)
    expected = machine_modes(machine, machine.rotor_speed)
    turbine = turbine_from(path, "rotor")
    assert turbine.rotor_speed == pytest.approx(machine.rotor_speed)
    assert turbine.values["gravity"] == pytest.approx(9.80665 * math.cos(math.radians(5.0)), rel=1e-6)
    found = sorted(modes_of(path).values())
    named = [expected.side_side, expected.backward, expected.collective, expected.forward, expected.second]
    targets = sorted((mode.frequency, mode.damping) for mode in named if mode is not None)
    for (frequency, damping), (target, ratio) in zip(found, targets, strict=True):
        assert frequency == pytest.approx(target, rel=0.01)
        assert damping == pytest.approx(ratio, rel=0.1)


@needs_decks
@pytest.mark.slow
def test_the_rotor_file_of_nrel_5_mw_has_the_modes_of_its_linearisation():
    found = sorted(modes_of(SHARED / "nrel5mw_land" / "NREL-5MW.fst").values())
    expected = [(0.3153, 0.00349), (0.8908, 0.00575), (1.0402, 0.00434), (1.2990, 0.00399)]
    for (frequency, damping), (target, ratio) in zip(found, expected, strict=False):
        assert frequency == pytest.approx(target, rel=0.0025)
        assert damping == pytest.approx(ratio, rel=0.03)
