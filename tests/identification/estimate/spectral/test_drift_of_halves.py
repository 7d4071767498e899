"""Clock drifts from halves whose likelihood is a parabola."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from windsysid.identification.estimate.spectral.drift_of_halves import drift_of_halves
from windsysid.statespace.unknowns import Unknowns

UNKNOWNS = Unknowns(parameters=("k",), clocks=("clock of a", "clock of b"))
SPREAD = np.array([1e-3, 2e-3])


def half(delays: list[float], information: list[float]) -> Any:
    """A half with the clocks late by these delays [s]; −log likelihood ½ Σ I (τ − τ₀)² in units of the tolerances."""
    at, known = np.array(delays) / SPREAD, np.array(information)

    def likelihood(u: np.ndarray) -> Any:
        return SimpleNamespace(gradient=np.r_[0.0, known * (u[1:] - at)], information=np.diag(np.r_[1.0, known]))

    late = np.zeros((3, 2))
    late[1:] = -np.diag(SPREAD)
    return SimpleNamespace(unknowns=UNKNOWNS, likelihood=likelihood, inexact=SimpleNamespace(late=late))


def test_a_rate_is_the_difference_of_the_delays_over_the_time_between():
    unknowns = np.array([0.3, 0.5, -0.5])
    early, late = half([1e-3, 0.0], [100.0, 25.0]), half([4e-3, 0.0], [400.0, 25.0])
    first, second = drift_of_halves([early, late], unknowns, ["a", "b"], apart=300.0)
    assert (first.logger, second.logger) == ("a", "b")
    assert first.rate == pytest.approx(3e-3 / 300.0)
    assert first.std == pytest.approx(1e-3 * math.hypot(0.1, 0.05) / 300.0)
    assert second.rate == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_array_equal(unknowns, [0.3, 0.5, -0.5])


def test_a_clock_that_nothing_shows_has_no_band_and_no_logger_has_no_drift():
    halves = [half([0.0, 0.0], [100.0, 0.0])] * 2
    assert drift_of_halves(halves, np.zeros(3), ["a", "b"], 300.0)[1].std == math.inf
    assert drift_of_halves(halves, np.zeros(3), [], 300.0) == []
