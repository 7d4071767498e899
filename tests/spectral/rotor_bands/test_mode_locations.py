"""Where modes are read."""

import numpy as np
import pytest

from windsysid.spectral.rotor_bands.mode_locations import _base, _curves, _doubts, _Group, _stands
from windsysid.statespace.parameter import Parameter

GROUP = _Group((Parameter("k_x", 100.0, 0.2),), ("tower side-side",))


def test_whirls_are_read_one_turn_from_where_they_stand():
    assert _base("lag backward", 0.8, 0.2) == pytest.approx(1.0)
    assert _base("lag forward", 1.2, 0.2) == pytest.approx(1.0)
    assert _base("tower fore-aft", 0.3, 0.2) == 0.3


def test_the_roll_is_no_mode_to_read():
    assert _stands("tower fore-aft")
    assert not _stands("tower roll")
    assert not _stands("lag collective")


def test_a_curve_is_the_models_frequency_over_the_factor():
    scales = np.linspace(-0.4, 0.4, 9)
    curves = _curves(lambda v: {"tower side-side": 0.3 * np.sqrt(v["k_x"] / 100.0)}, {"k_x": 100.0}, GROUP, scales, 0.2)
    np.testing.assert_allclose(curves["tower side-side"], np.log(0.3) + 0.5 * scales)


def test_a_faint_peak_and_a_rival_are_said():
    found = {"tower side-side": 0.31}
    assert [one.code for one in _doubts(GROUP, found, 1.0, [])] == ["faint_peak"]
    assert [one.code for one in _doubts(GROUP, found, 50.0, [0.35])] == ["ambiguous_peak"]
    assert _doubts(GROUP, found, 50.0, []) == []
