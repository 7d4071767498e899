"""Modes of many records, followed by frequency and shape; modes of two, compared."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.monitoring.modal_comparison import compare_modes
from windsysid.monitoring.modal_tracks import modal_tracks, tracks_of
from windsysid.spectral.oma.known_modes import KnownMode, KnownModes

SHAPES = {"bending": {"a": 1.0 + 0j, "b": 0.5 + 0j}, "torsion": {"a": 1.0 + 0j, "b": -0.9 + 0j}}


def mode(name: str, frequency: float, *, trusted: bool = True, std: float = 1e-3) -> KnownMode:
    return KnownMode(name, math.log(frequency), std, math.log(0.01), 0.05, dict(SHAPES[name]), trusted)


def record(name: str, modes: Sequence[KnownMode]) -> KnownModes:
    return KnownModes(name, None, None, None, tuple(modes), True)


def test_modes_of_one_frequency_are_told_apart_by_their_shapes():
    records = [record("r0", [mode("bending", 1.00), mode("torsion", 1.02)]),
               record("r1", [mode("torsion", 1.01), mode("bending", 1.03)])]  # fmt: skip
    channels, tracks = tracks_of(records)
    assert channels == ["a", "b"]
    named = [[records[t].modes[j].name for t, j in track.items()] for track in tracks]
    assert sorted(named) == [["bending", "bending"], ["torsion", "torsion"]]


def test_a_mode_that_few_records_trust_is_not_followed():
    records = [record(f"r{i}", [mode("bending", 1.0), mode("torsion", 3.0, trusted=i == 0)]) for i in range(4)]
    (track,), notes = modal_tracks(records)
    assert track.name == "bending"
    np.testing.assert_allclose(track.values[:, 0], 0.0, atol=1e-12)
    assert "3 Hz (1 of 4)" in notes[0]
    with pytest.raises(ConfigurationError, match="got none"):
        modal_tracks([record("r0", [mode("bending", 1.0, trusted=False)])])


def test_a_step_of_a_frequency_has_its_size_and_the_band_of_both():
    found = compare_modes(record("r0", [mode("bending", 1.0)]), record("r1", [mode("bending", 1.05)]))
    change = found.coefficients[0]
    assert change.percent == pytest.approx(5.0)
    assert change.high == pytest.approx(100.0 * math.expm1(math.log(1.05) + 2.0 * math.sqrt(2.0) * 1e-3), rel=1e-3)
    assert change.moved


def test_what_is_not_compared_is_named():
    before = record("r0", [mode("bending", 1.0), mode("torsion", 2.0)])
    after = record("r1", [mode("bending", 1.0), mode("torsion", 2.0, trusted=False), mode("torsion", 9.0)])
    notes = compare_modes(before, after).notes
    assert notes[0].startswith("not trusted in both, and not compared: torsion")
    assert notes[1] == "only r1 has torsion, 9 Hz"
