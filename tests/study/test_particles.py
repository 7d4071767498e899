"""The particle filter of the published comparison."""

import numpy as np

from windsysid.identification.estimate.force_balance import Balance
from windsysid.study.arms import START
from windsysid.study.particles import SIR, force_balance_case
from windsysid.study.published import PUBLISHED
from windsysid.study.scenario import RATE
from windsysid.turbine.file import load_turbine


def test_a_section_of_the_balance_is_a_model_with_its_readings_and_the_published_coefficients():
    turbine = load_turbine("verne555").exact()
    n, samples = len(turbine.model.coordinates), round(3.0 * RATE)
    force = np.arange(float(samples * n)).reshape(samples, n)
    balance = Balance(force, np.ones((samples, n, 2 * n)))
    case = force_balance_case(turbine, balance, (1.0, 2.0))
    np.testing.assert_array_equal(case.readings, force[round(RATE) : 2 * round(RATE)])
    assert {q.name for q in case.model.parameters} >= set(PUBLISHED)
    assert all(q.logarithmic is False for q in case.model.parameters)


def test_the_filter_has_as_many_particles_as_the_papers():
    assert SIR.particles == 2000
    assert (START.stiffness, START.damping) == (1.3, 0.7)
