"""A prior that is wider than the file's, as a rival explanation, against integrals."""

import numpy as np
import pytest
from scipy.stats import norm

from tests.findings import reasons
from windsysid.checks.estimates import WIDENING_FACTOR, rival_priors
from windsysid.checks.limits import PRIOR_ODDS_OF_MISFIT
from windsysid.checks.widening import mixture_factor
from windsysid.identification.identify import identify
from windsysid.results.finding import Finding
from windsysid.simulation.record import simulate_record
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine

C = Parameter("c_x", 2.0, 0.5, False, 1.0, "damping")
K = Parameter("k_x", 1.0, 0.3, kind="stiffness")


def posterior(data: float, std: float) -> tuple[np.ndarray, np.ndarray]:
    """Of `C` from data with a standard deviation; `K`, of which 0.6 of C's error is a part, is well known."""
    mean, spread = C.prior
    variance = 1.0 / (spread**-2 + std**-2)
    cov = np.array([[variance, 0.6 * np.sqrt(variance) * 0.01], [0.0, 1e-4]])
    return np.array([variance * (mean / spread**2 + data / std**2), 0.0]), cov + np.triu(cov, 1).T


@pytest.mark.parametrize(("data", "std"), [(2.0, 5.0), (4.5, 0.9), (4.0, 0.4)])
def test_a_wider_prior_is_a_rival_by_its_evidence(data: float, std: float):
    theta, cov = posterior(data, std)
    (found,) = (one for one in rival_priors((C, K), theta, cov) if one.quantities == ("c_x",))
    x = np.linspace(-60.0, 60.0, 400_001)
    mean, spread = C.prior
    likelihood = norm.pdf(x, data, std)
    narrow, wide = (likelihood * norm.pdf(x, mean, factor * spread) for factor in (1.0, WIDENING_FACTOR))
    odds = PRIOR_ODDS_OF_MISFIT * wide.sum() / narrow.sum()
    assert found.data["chance"] == pytest.approx(odds / (1.0 + odds), rel=1e-6)
    middle = float(x @ wide / wide.sum())
    assert found.data["shifts"]["c_x"] == pytest.approx(middle - theta[0], abs=1e-6)
    assert found.data["shifts"]["k_x"] == pytest.approx(0.6 * 0.01 * (middle - theta[0]) / np.sqrt(cov[0, 0]), abs=1e-6)
    std_wide = np.sqrt(np.square(x - middle) @ wide / wide.sum())
    assert found.data["widths"]["c_x"] == pytest.approx(std_wide / np.sqrt(cov[0, 0]), rel=1e-6)
    part = tuple(found.data[what]["c_x"] for what in ("shifts", "widths"))
    assert mixture_factor([(part[0] / np.sqrt(cov[0, 0]), part[1], found.data["chance"])]) > 1.1


@pytest.mark.parametrize(("data", "std"), [(2.0, 0.5), (2.5, 0.3), (2.6, 0.05)])
def test_a_prior_that_data_outweigh_and_confirm_is_no_rival(data: float, std: float):
    assert rival_priors((C, K), *posterior(data, std)) == []


def of_prior(found: list[Finding], name: str) -> list[Finding]:
    return [one for one in found if one.code == "prior_decides" and one.quantities == (name,)]


def test_what_is_mostly_the_prior_has_grade_b():
    """Damping of nine seconds had grade A, with the prior's interval and no word about it next to the grade."""
    turbine = load_turbine("verne555")
    record = simulate_record(turbine, duration=9.0, rate=50.0, seed=31)
    found = identify(record, turbine, formulation="joint", loads="broadband")
    weak = [one for one in found.estimates if one.informed_by_data < 0.05]
    assert weak
    for one in weak:
        assert one.grade in "BC"
        assert of_prior([*found.findings], one.name)
    for one in found.estimates:
        assert one.informed_by_data < 0.95 or not of_prior([*found.findings], one.name)
    assert "prior_decides" not in {one.code for one in reasons(found)}
