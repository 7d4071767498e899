"""Names and skirts of modes."""

import pytest

from windsysid.spectral.oma.describe import named, without_skirts
from windsysid.spectral.oma.mode import Doubt

from .modes import mode

BLADES = ("tower_x_acceleration", "blades_root_lag collective", "blades_root_lag forward", "blades_root_lag backward")


def test_modes_without_a_rotor_have_numbers():
    assert [one.name for one in named([mode(1.0), mode(2.0)], ("a", "b"))] == ["mode 1", "mode 2"]


@pytest.mark.parametrize(
    ("shape", "name"),
    [
        ((1.0, 0.1, 0.1, 0.1), "tower x"),
        ((0.4, 0.1, 1.0, 0.1), "tower x"),
        ((0.2, 0.1, 1.0, 0.1), "lag forward"),
        ((0.0, 1.0, 0.1, 0.1), "lag collective"),
    ],
)
def test_a_mode_has_the_name_of_the_part_that_moves_most(shape: tuple[complex, ...], name: str):
    assert [one.name for one in named([mode(shape=shape), mode(shape=shape)], BLADES)] == [name, f"{name} 2"]


@pytest.mark.parametrize(("frequency", "kept"), [(1.05, 1), (1.07, 2)])
def test_a_mode_at_the_border_near_a_mode_of_the_next_band_is_its_skirt(frequency: float, kept: int):
    """Half-widths of 0.01 Hz reach three of them, from both sides: 0.06 Hz."""
    border = mode(frequency, 0.01 / frequency, doubts=(Doubt("border", "it is at the edge of its frequency range"),))
    assert sum(map(len, without_skirts([[mode(1.0, 0.01)], [border]]))) == kept
