"""Information of a simulated record about relative values of all unknowns."""

import numpy as np

from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.identification.planning.information import BLOCK_COUNT, planned_information
from windsysid.output.progress import unheard
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine


def test_information_is_the_same_however_the_record_is_parted():
    tower = load_turbine("tower").exact()
    record = simulate_record(tower, duration=60.0, rate=5.0, seed=1)
    problem = pose(record, tower, tower.sensors, Prior(), ["k_fore_aft", "c_fore_aft"])
    totals = []
    for finding in (10.0, 30.0):
        start, growths = planned_information(problem, 5.0, finding, unheard)
        ends = np.linspace(round(finding * 5.0), len(problem.readings), BLOCK_COUNT + 1).astype(int)
        totals.append(start + np.tensordot(np.diff(ends) / 5.0, growths, axes=1))
        assert len(growths) == BLOCK_COUNT
    np.testing.assert_allclose(totals[0], totals[1], rtol=1e-6, atol=1e-6 * np.abs(totals[0]).max())
    assert np.linalg.eigvalsh(totals[0]).min() > 0.0
