import numpy as np
import pytest
from validation.calibration import binomial_interval, bound, calibrate, scenarios


def test_the_interval_is_that_of_the_binomial_distribution():
    low, high = binomial_interval(500)
    assert (low, high) == pytest.approx((0.922, 0.982), abs=0.002)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reference", "free-decay"])
def test_bands_are_true_and_errors_at_the_bound(name: str):
    assert name in scenarios()
    runs = list(calibrate(name, 40))
    deviation = np.array([run.deviation for run in runs])
    assert [run.seed for run in runs] == list(range(40))
    for i in range(3):  # the whole record, and on line; 400 bands each
        assert 0.92 < np.mean(np.abs(deviation[:, i]) < 2.0) < 0.985
    error = np.sqrt(np.mean(np.array([run.error[0] for run in runs]) ** 2, axis=0))
    assert np.sqrt(np.mean((error / bound(name, 100.0, runs=4)) ** 2)) < 1.2
