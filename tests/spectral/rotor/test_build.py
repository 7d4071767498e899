"""Which way a question goes."""

import pytest

from windsysid.errors import ConfigurationError
from windsysid.spectral.rotor.build import pose_lifted, turns_couple
from windsysid.spectral.rotor.problem import RotorQuestion


def test_the_matrices_of_a_tower_do_not_turn(question: RotorQuestion):
    assert not turns_couple(question)


def test_wind_on_a_rotor_needs_a_rotor(question: RotorQuestion):
    with pytest.raises(ConfigurationError, match="rotor-wind"):
        pose_lifted(question, "rotor-wind")


def test_a_narrow_band_load_has_statistics_of_its_own(question: RotorQuestion):
    broad, narrow = (pose_lifted(question, name).model.statistics for name in ("broadband", "narrow-band"))
    assert {s.name for s in broad} < {s.name for s in narrow}
