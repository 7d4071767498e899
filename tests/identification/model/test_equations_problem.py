"""What is asked of equations of one's own, and the columns that a record gives them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp

from windsysid import ConfigurationError, Record, RecordError
from windsysid.identification.model.equations_problem import (
    EquationsJob,
    constant_loads,
    known_columns,
    loads_behind_low_pass,
    read_columns,
)
from windsysid.models import Equations, GaussMarkov, Parameter, Reading

q, v, force = sp.symbols("q v force", real=True)
c, k = sp.symbols("c k", positive=True)
SPRING = Equations("spring", (q, v), (), (c, k), (force,), (v, force - c * v - k * q))
JOB = EquationsJob(
    SPRING, (Parameter("k", 20.0, 1.5),), (Reading("a", q, 0.1), Reading("b", v, 0.1)), None, None, {"c": 2.0},
    (GaussMarkov("force", 1.0, 0.5),), {}, True,
)  # fmt: skip
RECORD = Record(np.arange(50) / 10.0, np.arange(100.0).reshape(50, 2), ("a", "b"), ("m", "m/s"), name="short")
COMPILED: Any = SimpleNamespace(inputs=("wind",), loads=("force", "thrust"))


def test_levels_are_those_of_the_noise_and_of_the_loads_or_none():
    assert JOB.levels.tolist() == [1.5] * 3
    assert JOB._replace(learn_levels=False).levels.size == 0
    assert JOB.centres == {"c": 2.0, "k": pytest.approx(20.0)}
    assert JOB.readings == ("a", "b")


def test_a_load_is_a_channel_or_a_model_or_a_constant():
    job = JOB._replace(values={"thrust": 3.0}, channels={"other": "a"})
    assert constant_loads(("force", "thrust", "other", "b"), RECORD, job) == {"force": 0.0, "thrust": 3.0}
    with pytest.raises(ConfigurationError, match="load 'drag' is not defined"):
        constant_loads(("drag",), RECORD, JOB)


def test_columns_are_channels_by_name_or_where_they_are_said_to_be():
    job = JOB._replace(channels={"wind": "b"})
    columns = known_columns(COMPILED, RECORD, job, {"force": 0.0, "thrust": 3.0})
    np.testing.assert_array_equal(columns, np.column_stack([RECORD["b"], np.zeros(50), np.full(50, 3.0)]))
    with pytest.raises(ConfigurationError, match="channels: 'sun' is no input or load"):
        known_columns(COMPILED, RECORD, JOB._replace(channels={"sun": "b"}), {})
    gap = RECORD.with_channels({"b": (np.where(RECORD.time < 1.0, np.nan, 0.0), "m/s")})
    with pytest.raises(RecordError, match="channel 'b' is an input of the model and lacks 10 of 50 samples"):
        known_columns(COMPILED, gap, job, {"force": 0.0, "thrust": 3.0})


def test_readings_are_columns_and_the_first_must_hold_numbers():
    np.testing.assert_array_equal(read_columns(RECORD, JOB.sensors), RECORD.values)
    empty = RECORD.with_channels({"a": (np.full(50, np.nan), "m")})
    with pytest.raises(RecordError, match="channel 'a' holds no numbers"):
        read_columns(empty, JOB.sensors)
    assert np.isnan(read_columns(empty, JOB.sensors, first=False)[:, 0]).all()


def test_first_order_loads_go_through_the_low_pass_of_the_record():
    assert loads_behind_low_pass(JOB.loads, RECORD) == (JOB.loads, ())
    passed, notes = loads_behind_low_pass(JOB.loads, Record(
        RECORD.time, RECORD.values, RECORD.channels, RECORD.units, attributes={"low_pass_hz": "4.0"}
    ))  # fmt: skip
    assert notes == ()
    assert passed == (GaussMarkov("force", 1.0, 0.5, low_pass=4.0),)
