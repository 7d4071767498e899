"""The profile of the posterior, against an optimiser that we did not write."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.identification.test_planning import one_mode
from windsysid.errors import ConfigurationError
from windsysid.filters import EKF
from windsysid.identification.estimate.profile import Profile, profile_likelihood
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record

PRIOR = Prior(1.2, 1.2, spread=1.0)


@pytest.fixture(scope="module")
def record() -> Record:
    return simulate_record(one_mode(), duration=12.0, rate=50.0, seed=3)


@pytest.fixture(scope="module")
def profile(record) -> Profile:
    return profile_likelihood(record, one_mode(), "c_x", prior=PRIOR)


def best_by_scipy(record: Record, value: float) -> float:
    """The greatest log posterior with c_x held at `value`: Nelder–Mead over everything else."""
    turbine = one_mode()
    problem = pose(record, turbine, turbine.sensors, PRIOR)
    mean, cov = problem.prior
    held = value / problem.parameters[1].scale

    def height(others: np.ndarray) -> float:
        unknowns = np.insert(others, 1, held)
        model = problem.build(unknowns)
        _, info = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)
        off = unknowns - mean
        return -float(info.log_likelihood.sum() - 0.5 * np.sum(off**2 / np.diag(cov)))

    start = np.array([np.log(1.0 / 1.2), 0.0, 0.0, 0.0])
    found = minimize(height, start, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-4, "maxiter": 2000})
    return -float(found.fun)


def test_the_profile_is_the_maximum_that_scipy_finds(record, profile):
    top = best_by_scipy(record, profile.estimate)
    for value, expected in zip(profile.values[::2], profile.log_posterior[::2], strict=True):
        assert best_by_scipy(record, value) - top == pytest.approx(expected, abs=0.02)


def test_the_posterior_has_dropped_by_two_at_the_ends_of_the_band(record, profile):
    top = best_by_scipy(record, profile.estimate)
    for end in (profile.low, profile.high):
        assert best_by_scipy(record, end) - top == pytest.approx(-2.0, abs=0.05)


def test_a_short_record_gives_a_band_that_is_not_symmetric_and_near_the_gaussian_one(profile):
    assert profile.low < profile.estimate < profile.high
    assert (profile.low, profile.high) != pytest.approx(profile.gaussian, rel=1e-3)
    width = profile.gaussian[1] - profile.gaussian[0]
    assert (profile.low, profile.high) == pytest.approx(profile.gaussian, abs=0.15 * width)


def test_what_only_the_prior_knows_has_the_priors_band():
    # A mass beside stiffness, damper and load that are all unknown: the data see their proportion, the prior of 30 %
    # the rest.
    light = one_mode()
    light = light.with_values({f"blade_mass_{i}": 1e-9 for i in (1, 2, 3)} | {"hub_mass_x": light.inertia("x")})
    record = simulate_record(light, duration=40.0, rate=50.0, seed=3)
    found = profile_likelihood(record, light, "hub_mass_x", parameters=["k_x", "c_x", "hub_mass_x"])
    # k and m both have a prior σ of 0.3 and are tied together: σ = 0.3/√2, and a little less with those of damper and
    # load.
    assert np.log(found.high / found.low) == pytest.approx(4.0 * 0.3 / np.sqrt(2.0), rel=0.15)


def test_a_profile_is_drawn_and_put_in_words(profile):
    assert str(profile).startswith("c_x: ")
    assert "(profile)" in str(profile)
    assert "N·s/m" in str(profile)
    (axes,) = profile.plot().axes
    assert axes.get_xlabel().endswith("[N·s/m]")


def test_what_is_not_identified_has_no_profile(record):
    with pytest.raises(
        ConfigurationError, match="profile of 'k_y': expected one of the identified parameters k_x, c_x"
    ):
        profile_likelihood(record, one_mode(), "k_y")
