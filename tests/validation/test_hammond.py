"""Hammond's helicopter: ranges of instability to 0.1 rpm, from Coleman's quartic and from SciPy's integrator."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from validation.hammond import DAMPERS, HUBS, SPEEDS, examine, helicopter

from windsysid.mechanics import compile_model
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

FOUND = {
    ("all dampers", "table"): [],
    ("all dampers", "isotropic"): [],
    ("one lag damper out", "table"): [(210.4, 307.1)],
    ("one lag damper out", "isotropic"): [(156.9, 200.7)],
    ("no damping at all", "table"): [(134.9, 183.8), (200.6, 306.0)],
    ("no damping at all", "isotropic"): [(128.5, 197.2)],
}
"""Unstable ranges [rpm] that docs/modes.md prints."""


@pytest.mark.parametrize("hub", HUBS)
@pytest.mark.parametrize("dampers", DAMPERS)
@pytest.mark.slow
def test_unstable_ranges_are_those_in_the_documents_and_the_methods_agree(dampers: str, hub: str):
    method, unstable, difference = examine(helicopter(dampers, hub), SPEEDS[::5])
    assert [(round(u.low * RPM, 1), round(u.high * RPM, 1)) for u in unstable] == FOUND[dampers, hub]
    if dampers == "one lag damper out":
        assert (method, difference) == ("Floquet", None)
    else:
        assert method == "Coleman"
        assert difference is not None
        assert difference < 1e-6


def test_without_damping_the_isotropic_hub_is_unstable_where_colemans_quartic_has_no_four_real_frequencies():
    # With λ = iω the quartic of tests/test_modal.py becomes (k − M ω²)(K − I (ω − Ω)²) = (N/2) S² ω⁴, real; two roots
    # meet at the boundaries.
    v = helicopter("no damping at all", "isotropic").values
    M, k = v["hub_mass_x"] + 4 * v["blade_mass_1"], v["k_x"]
    S, inertia = v["blade_first_moment_1"], v["blade_inertia_1"]

    def discriminant(rpm: float) -> float:
        speed = rpm / RPM
        lag = np.poly1d([-inertia, 2 * inertia * speed, S * v["hinge_offset"] * speed**2 - inertia * speed**2])
        r = (np.poly1d([-M, 0, k]) * lag - np.poly1d([2 * S**2, 0, 0, 0, 0])).roots
        return float(np.prod([(r[i] - r[j]) ** 2 for i in range(4) for j in range(i)]).real / np.abs(r).max() ** 12)

    ends = [brentq(discriminant, *bracket, xtol=1e-3) for bracket in ((120.0, 135.0), (190.0, 205.0))]
    assert [round(end, 1) for end in ends] == list(FOUND["no damping at all", "isotropic"][0])


@pytest.mark.parametrize("hub", HUBS)
def test_with_one_damper_out_scipys_monodromy_matrix_changes_sides_at_the_ends(hub: str):
    helicopter_ = helicopter("one lag damper out", hub)
    ((low, high),) = FOUND["one lag damper out", hub]
    sides = [growth(helicopter_, rpm) > 0.0 for rpm in (low - 0.1, low + 0.1, high - 0.1, high + 0.1)]
    assert sides == [False, True, True, False]


def growth(turbine: Turbine, rpm: float) -> float:
    """Largest real part of the exponents [1/s], by SciPy."""
    model = compile_model(turbine.model)
    p = np.array([turbine.values[name] for name in model.parameters])
    n, speed = len(model.states), rpm / RPM

    def rates(time: float, X: np.ndarray) -> np.ndarray:
        A, B, G = np.zeros((n, n)), np.zeros((n, 0)), np.zeros((n, n // 2))
        model.rates_jacobian(
            np.zeros(n), np.array([speed * time, speed, 0.0]), p, np.zeros(n // 2), np.empty(n), A, B, G
        )
        return np.asarray((A @ X.reshape(n, n)).ravel())

    turn = 2 * math.pi / speed
    end = solve_ivp(rates, (0.0, turn), np.eye(n).ravel(), method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return float(np.log(np.abs(np.linalg.eigvals(end.reshape(n, n))).max()) / turn)
