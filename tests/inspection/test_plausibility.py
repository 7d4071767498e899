"""Units that values contradict."""

import numpy as np
import pytest

import windsysid as ws


def shaken(unit_of_g: float, axes: tuple[float, ...] = (0.5, 0.6, 0.62), amplitude: float = 0.01) -> ws.Record:
    """Accelerometers along three axes, in any unit of which gravity has `unit_of_g`, declared as m/s²."""
    t = np.arange(0.0, 120.0, 0.05)
    rng = np.random.default_rng(0)
    swing = amplitude * (np.sin(2.0 * np.pi * 0.3 * t) + 0.1 * rng.normal(size=(3, len(t))))
    tilted = np.array(axes) / np.linalg.norm(axes)
    names = ("tower_x_acceleration", "tower_y_acceleration", "tower_z_acceleration")
    return ws.Record(t, unit_of_g * (swing.T + tilted), names, ("m/s^2",) * 3)


def units_said(record: ws.Record) -> list[str]:
    return [str(one.text) for one in ws.inspect(record).findings if one.kind == "unit"]


@pytest.mark.parametrize(("size", "unit"), [(1.0, "g marked as m/s²"), (1000.0, "mg marked as m/s²")])
def test_a_tilted_logger_shows_its_unit_by_gravity_on_three_axes(size: float, unit: str):
    """Only an upright accelerometer showed it."""
    said = units_said(shaken(size))
    assert len(said) == 1
    assert unit in said[0]
    assert units_said(shaken(9.81)) == []


def test_an_acceleration_that_would_move_a_tower_by_metres_is_in_another_unit():
    t = np.arange(0.0, 120.0, 0.05)
    values = 20.0 * np.sin(2.0 * np.pi * 0.3 * t) + np.random.default_rng(0).normal(size=len(t))

    def said(scale: float) -> list[str]:
        return units_said(ws.Record(t, scale * values[:, None], ("tower_x_acceleration",), ("m/s^2",)))

    assert said(1.0) == []
    assert "means a motion of 1" in said(3.0)[0]
