import numpy as np

from windsysid.study.calibration import calibrate


def test_a_calibration_run_repeats_and_its_result_is_nearer_than_its_prior():
    first, again = (calibrate(2, duration=20.0) for _ in range(2))
    assert first.result.shape == first.online_error.shape == (2, len(first.names)) == (2, 10)
    np.testing.assert_array_equal(first.result, again.result)
    stiffness = [i for i, name in enumerate(first.names) if name.startswith("k_")]
    assert np.sqrt(np.mean(first.result_error[:, stiffness] ** 2)) < 0.1  # priors are 30 % off
    assert np.all(np.abs(first.result) < 5.0)
