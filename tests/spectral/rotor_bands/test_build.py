"""Which modes of the support share a band."""

from windsysid.spectral.rotor_bands.build import SUPPORT_HALF_WIDTH, _near_each_other
from windsysid.spectral.rotor_bands.mode_locations import ModeLocation


def place(name: str, frequency: float, shape: int | None = None) -> ModeLocation:
    return ModeLocation(name, shape, frequency, 0.01)


def test_modes_whose_bands_would_overlap_are_together_and_blades_are_left_out():
    places = [place("b", 0.31), place("a", 0.3), place("c", 0.31 * (1.01 + SUPPORT_HALF_WIDTH)), place("lag", 0.3, 1)]
    assert [[p.name for p in group] for group in _near_each_other(places)] == [["a", "b"], ["c"]]
