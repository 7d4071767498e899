"""Series of the watch in words."""

import pytest

from windsysid.live.watch.series_words import said_with_name, series_title


def test_titles():
    assert series_title("k_side_side") == "stiffness, side-side"
    assert series_title("c_beta_1") == "damping, beta 1"
    assert series_title("noise_tower_acceleration") == "noise, tower acceleration"
    assert series_title("blade_2_lag_acceleration") == "blade 2 lag acceleration"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("k_fore_aft", "stiffness of the tower, fore-aft"), ("c_x", "damping of the tower, x"),
        ("k_beta_2", "stiffness of blade 2"), ("noise_tower_acceleration", "noise of the tower acceleration"),
        ("k_lean", "stiffness of lean"), ("f_first mode", "frequency of first mode"),
    ],
)  # fmt: skip
def test_a_sentence_has_the_words_and_the_name(name: str, said: str):
    assert said_with_name(name) == f"{said} ({name})"


def test_a_name_of_no_known_kind_stays():
    assert said_with_name("tilt") == "tilt"
