"""Trends as Legendre polynomials."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.fits import CHANNELS, TOWER
from windsysid.identification.effects.trend import MAX_POLYNOMIAL_ORDER, Trend
from windsysid.identification.model.regressor import Legendre, Term

TIME = np.linspace(20.0, 80.0, 2001)


def candidates(sensors: Any) -> Any:
    at: Any = SimpleNamespace(time=TIME, problem=SimpleNamespace(sensors=sensors))
    return Trend().candidates(at)


def test_each_channel_has_the_polynomials_over_the_record_but_the_constant():
    for row, (one, channel) in enumerate(zip(candidates(TOWER.sensors), CHANNELS, strict=True)):
        assert (one.code, one.channel) == ("trend", channel)
        assert {column.row for column in one.columns} == {row}
        waves = np.array([column.wave(TIME) for column in one.columns])
        x = np.linspace(-1.0, 1.0, len(TIME))
        np.testing.assert_allclose(
            waves, np.polynomial.legendre.legvander(x, MAX_POLYNOMIAL_ORDER)[:, 1:].T, atol=1e-12
        )


def test_a_sensor_with_a_random_walk_has_none():
    drifting = TOWER.sensors[0].model_copy(update={"drift": 0.1})
    assert [one.channel for one in candidates((drifting, TOWER.sensors[1]))] == [CHANNELS[1]]


def test_its_size_is_its_root_mean_square():
    terms = [Term("x", "m/s^2", Legendre(k, TIME[0], TIME[-1]), size, 0.1) for k, size in ((1, 0.3), (2, -0.2))]
    trend = sum(one.size * one.wave(TIME) for one in terms)
    assert Trend().describe(terms)["size"] == pytest.approx(np.sqrt(np.mean(np.square(trend))), rel=1e-3)
