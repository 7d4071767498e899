"""The first state's prior: as uncertain as the record is loud, through what each sensor makes of the motion."""

import math
from dataclasses import replace

import numpy as np
import pytest

from windsysid.formulation import Prior
from windsysid.mechanics import RotorModel, Sensor
from windsysid.record import Record
from windsysid.stateonly import pose
from windsysid.turbine import Turbine


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration", "moment"])
def test_the_first_state_is_as_uncertain_as_the_loudest_second_asks_for(verne555: Turbine, quantity: str):
    # One mass on a spring and a damper, vibrating at its natural frequency: three times its rms, by hand.
    rigid = verne555.with_model(RotorModel(3, y="locked", lag="locked"))
    critical = 2.0 * rigid.inertia("x") * rigid.natural_frequency("x")
    rigid = rigid.with_values({"c_x": 0.5 * critical})  # well damped, so that stiffness and inertia are told apart
    stiffness, damping, w = rigid.values["k_x"], rigid.values["c_x"], rigid.natural_frequency("x")
    gains = {"displacement": 1.0, "velocity": w, "acceleration": w**2, "moment": abs(stiffness + 1j * w * damping)}
    sensor = Sensor(channel="read", quantity=quantity, point="tower", axis="x", noise=1e-3)  # type: ignore[arg-type]
    turbine = replace(rigid, sensors=(sensor,), loads=tuple(load for load in rigid.loads if load.load == "load_x"))
    time = np.arange(2000) / 100.0
    amplitude = 0.004
    read = amplitude * gains[quantity] * np.sin(w * time)
    azimuth = np.mod(rigid.rotor_speed * time, 2.0 * np.pi)
    record = Record(time, np.column_stack([azimuth, read]), ("rotor_azimuth", "read"), ("rad", sensor.unit))
    std = np.sqrt(np.diag(pose(record, turbine, (sensor,), Prior()).model.cov))
    expected = 3.0 * amplitude * math.sqrt(0.5 * (1.0 + abs(math.sin(w)) / w))  # the loudest of all seconds
    assert std[0] == pytest.approx(expected, rel=0.005)
    assert std[1] == pytest.approx(expected * w, rel=0.005)
