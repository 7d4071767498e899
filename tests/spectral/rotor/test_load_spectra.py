"""Spectra of loads: first-order loads, and the coherence of turbulence along a blade."""

import numpy as np
import pytest

from windsysid.loads.statistics import values_of
from windsysid.spectral.rotor.load_spectra import BroadbandLoads, coherence_table, slopes_by_differences
from windsysid.spectral.rotor.problem import RotorQuestion


@pytest.fixture(scope="module")
def loads(question: RotorQuestion) -> BroadbandLoads:
    return BroadbandLoads(question.loads, question.turbine.model, np.array([[0.1], [0.4]]))


def test_a_broadband_load_has_the_spectrum_of_a_first_order_process(loads: BroadbandLoads, question: RotorQuestion):
    values = values_of(loads.statistics, np.zeros(len(loads.statistics)))
    f = np.array([0.1, 0.4])
    found = loads.spectra(values).own
    expected = np.column_stack(
        [
            2.0 * q.rms**2 * q.time_constant / (1.0 + (2.0 * np.pi * f * q.time_constant) ** 2)
            for q in question.loads
            if not q.harmonic
        ]
    )
    np.testing.assert_allclose(np.sort(found, axis=1), np.sort(expected, axis=1), rtol=1e-9)


def test_slopes_are_those_of_differences(loads: BroadbandLoads):
    values = values_of(loads.statistics, np.full(len(loads.statistics), 0.1))
    np.testing.assert_allclose(loads.slopes(values).own, slopes_by_differences(loads, values, 1).own, rtol=1e-5)


def test_slow_turbulence_is_the_same_all_over_the_rotor_and_fast_is_not():
    grid, table = coherence_table((1.0, 2.0))
    assert np.all(np.diff(grid) > 0.0)
    np.testing.assert_allclose(table[0, :, :, 0], 1.0, atol=0.05)
    assert np.abs(table[0, :, :, 1:]).max() < 0.05
    assert table[-1, 0, 1, 0] < 0.05
