"""Modes of a fit against the closed forms of oscillators."""

import math

import numpy as np
import pytest

from tests.identification.fits import TOWER, noise, outcome_of, record_of
from windsysid.identification.estimate.fitted.modes import modes_of

RECORD = record_of(noise())


def test_modes_are_those_of_oscillators_with_the_estimates():
    outcome = outcome_of(RECORD)
    theta = outcome.theta.copy()
    i = [q.name for q in outcome.model.parameters].index("k_fore_aft")
    theta[i] = outcome.model.parameters[i].coordinate(1.21 * TOWER.values["k_fore_aft"])
    found = modes_of(outcome._replace(theta=theta))
    v = TOWER.values
    for mode, name, k in zip(sorted(found.modes, key=lambda one: one.frequency.estimate), ("side_side", "fore_aft"),
                             (v["k_side_side"], 1.21 * v["k_fore_aft"]), strict=True):  # fmt: skip
        omega = math.sqrt(k / v[f"mass_{name}"])
        damping = v[f"c_{name}"] / (2.0 * v[f"mass_{name}"] * omega)
        assert mode.frequency.estimate == pytest.approx(omega / (2.0 * math.pi), rel=1e-6)
        assert mode.damping_ratio.estimate == pytest.approx(damping, rel=1e-6)
    assert found.speed == pytest.approx(TOWER.rotor_speed)
    assert found.turbine.values["k_fore_aft"] == pytest.approx(1.21 * v["k_fore_aft"])


def test_slopes_are_those_of_the_square_root_of_stiffness():
    """f ∝ √k: one per cent more stiffness is half a per cent more frequency."""
    outcome = outcome_of(RECORD)
    found = modes_of(outcome)
    i = [q.name for q in outcome.model.parameters].index("k_side_side")
    k = int(np.argmin([mode.frequency.estimate for mode in found.modes]))
    q = outcome.model.parameters[i]
    assert q.logarithmic
    assert found.slopes[0][k][i] == pytest.approx(0.5 * found.modes[k].frequency.estimate, rel=1e-3)
    np.testing.assert_array_equal(found.given_masses, outcome.cov)
