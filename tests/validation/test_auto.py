"""What the table of formulations says."""

import numpy as np
from validation.auto import KINDS, Told, row


def test_a_row_counts_all_records_and_the_errors_of_those_that_gave_a_result():
    told = [
        Told("spectral", trusted=True, off=np.array([0.5, -2.5]), seconds=1.0),
        Told("joint", trusted=False, off=np.array([3.0, 0.0]), seconds=2.0),
        Told("refused", trusted=False, off=np.empty(0), seconds=0.1),
    ]
    assert row(told) == "joint 1, refused 1, spectral 1 | 1 of 3 | 50.0 % | 50.0 % | 2.5 | 1.97 | 1.0 s"
    assert row(told[2:]) == "refused 1 | 0 of 1 |  |  |  |  | 0.1 s"


def test_records_whose_second_half_is_louder_are_so():
    record = KINDS["tower, second half three times as loud, 600 s"][2](1)
    half = record.samples // 2
    z = record["tower_x_acceleration"]
    assert 2.0 < z[half:].std() / z[:half].std() < 4.5
    assert np.ptp(record["rotor_speed"]) == 0.0
