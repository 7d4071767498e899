"""Axes that are tilted, and sensors that do not yaw with the nacelle."""

import math

import numpy as np
import pytest

import windsysid as ws
from windsysid.inspection import Fault
from windsysid.signals import with_nacelle_axes

TIME = np.arange(0.0, 120.0, 0.05)
MOTION = 0.1 * np.sin(2.0 * np.pi * 0.3 * TIME) * (1.0 + 0.3 * np.sin(0.1 * TIME))


def openfast(yaw: float, source: str = "OpenFAST") -> ws.Record:
    """Fore-aft motion of a nacelle that is yawed by some degrees counter-clockwise, as OpenFAST writes it."""
    turn = math.radians(yaw)
    noise = 1e-3 * np.random.default_rng(0).normal(size=(2, TIME.size))
    values = MOTION * np.array([[math.sin(turn)], [math.cos(turn)]]) + noise
    columns = [*values, np.full(TIME.size, -turn)]
    names = ("tower_x_acceleration", "tower_z_acceleration", "nacelle_yaw")
    units = ("m/s^2", "m/s^2", "rad")
    return ws.Record(TIME, np.column_stack(columns), names, units, name="run", attributes={"source": source})


def faults(record: ws.Record, kind: str) -> list[Fault]:
    return [one for one in ws.inspect(record).findings if one.kind == kind]


@pytest.mark.parametrize(
    ("yaw", "severity"),
    [(0.0, None), (5.0, None), (30.0, "note"), (60.0, "warning"), (-90.0, "warning"), (180.0, None)],
)
def test_axes_below_a_yawed_nacelle_are_said(yaw: float, severity: str | None):
    found = faults(openfast(yaw), "yawed axes")
    assert [one.severity for one in found] == ([severity] if severity else [])
    if severity == "warning":
        assert "x is fore-aft and z is side-side" in found[0].text
    assert not faults(openfast(yaw, "a logger"), "yawed axes")


@pytest.mark.parametrize("yaw", [30.0, 90.0, -60.0])
def test_axes_of_openfast_are_turned_into_those_of_the_nacelle(yaw: float):
    """Below the yaw bearing, x of OpenFAST points downwind at yaw 0: the bearing of its first axis is π."""
    record = openfast(yaw)
    turned = with_nacelle_axes(record, "tower_z_acceleration", "tower_x_acceleration", bearing=math.pi, point="nacelle")
    np.testing.assert_allclose(turned["nacelle_z_acceleration"], MOTION, atol=0.01)
    np.testing.assert_allclose(turned["nacelle_x_acceleration"], 0.0, atol=0.01)


def test_the_tilt_of_a_nacelle_is_read_from_gravity():
    tilt = math.radians(5.0)
    columns = [MOTION + 9.80665 * math.sin(tilt), 0.1 * MOTION + 9.80665 * math.cos(tilt), MOTION + 0.01]
    names = ("nacelle_z_acceleration", "nacelle_y_acceleration", "nacelle_x_acceleration")
    record = ws.Record(TIME, np.column_stack(columns), names, ("m/s^2",) * 3, name="run")
    (found,) = faults(record, "tilt")
    assert found.channel == "nacelle_z_acceleration"
    assert found.severity == "note"
    assert "gravity at a tilt of 5°, with nacelle_y_acceleration" in found.text
    assert [one.channel for one in faults(record, "gravity")] == ["nacelle_y_acceleration"]


def test_an_offset_without_an_upright_axis_is_no_tilt():
    record = ws.Record(TIME, MOTION[:, None] + 0.8, ("tower_x_acceleration",), ("m/s^2",), name="run")
    assert not faults(record, "tilt")
