"""Shapes of linearised modes at sensors."""

import math

import numpy as np
import pytest

from windsysid.modal.linearisation.eigenmodes import LinearisedMode
from windsysid.modal.matching.sensor_shapes import linearised_shape
from windsysid.results.estimate import IntervalEstimate

CHANNELS = (
    "tower_x_acceleration", "tower_z_acceleration", "blades_tip_lag_acceleration collective",
    "blades_tip_lag_acceleration forward", "blades_tip_lag_acceleration backward",
)  # fmt: skip


def shape_of(**kinds: complex) -> dict[str, complex]:
    named = {name.replace("__", "-").replace("_", " "): value for name, value in kinds.items()}
    f, z = IntervalEstimate.normal(0.3, 0.0, "Hz"), IntervalEstimate.normal(0.0, 0.0, "1")
    return linearised_shape(LinearisedMode("m", f, z, {}, named), 1.2, CHANNELS)


def test_a_moving_tower_top_moves_blades_forward_and_backward_alike():
    found = shape_of(tower_side__side=1.0)
    square = (2.0 * math.pi * 0.3) ** 2
    assert found["tower_x_acceleration"] == pytest.approx(square)
    assert found["tower_z_acceleration"] == 0.0
    assert abs(found["blades_tip_lag_acceleration forward"]) == pytest.approx(square)
    assert abs(found["blades_tip_lag_acceleration backward"]) == pytest.approx(square)
    assert "blades_tip_lag_acceleration collective" not in found


def test_sway_and_side_side_have_opposite_signs_in_files():
    assert shape_of(tower_side__side=-1.0, platform_sway=0.2)["tower_x_acceleration"].real == pytest.approx(
        -1.2 * (2.0 * math.pi * 0.3) ** 2
    )


def test_a_whirl_is_seen_at_its_frequency_in_the_rotating_frame():
    found = shape_of(edge_forward=1.0)
    assert abs(found["blades_tip_lag_acceleration forward"]) == pytest.approx((2.0 * math.pi * 0.3 - 1.2) ** 2)
    assert found["blades_tip_lag_acceleration backward"] == 0.0
    np.testing.assert_allclose(abs(shape_of(edge_collective=1.0)[CHANNELS[2]]), (2.0 * math.pi * 0.3) ** 2)
