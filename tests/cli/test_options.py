"""What commands make of their options before they begin."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from windsysid.cli import fleet, identify, oma, publish
from windsysid.errors import ConfigurationError


def test_pieces_go_with_joint_or_spectral_and_without_added_noise():
    assert identify._length("10 min", "joint", 0.0) == 600.0
    for formulation, noise in (("force-balance", 0.0), ("joint", 1.0)):
        with pytest.raises(ConfigurationError, match="--in-pieces goes with"):
            identify._length("10 min", formulation, noise)


def test_a_band_is_two_frequencies():
    assert oma._band("0.9 1.1") == (0.9, 1.1)
    with pytest.raises(ConfigurationError, match="expected two frequencies"):
        oma._band("0.9")


def test_no_list_of_sensors_is_none():
    assert oma._sensor_lists([], 2) is None


def test_an_interrupted_publisher_says_where_blocks_wait():
    publisher: Any = SimpleNamespace(ring=[1, 2])
    assert publish._interrupted(publisher, 5, None) == (
        "interrupted: 5 blocks sent, 2 not committed: send the records again"
    )
    assert publish._interrupted(publisher, 5, Path("b")).endswith("they are kept in b")


def test_an_archive_without_a_turbine_that_can_be_watched_is_refused(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="no turbine can be watched; T01"):
        fleet._watch_each(tmp_path, ["T01"], 0.1)


def test_a_percentage_is_reported_as_it_was_given(run):
    ended = run("plan", "--turbine", "tower", "--within", "-4")
    assert ended.code == 2
    assert "--within: expected a percentage above 0 and up to 1000, got -4" in "".join(ended.err)
