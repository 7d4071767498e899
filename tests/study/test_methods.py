"""The methods side by side: one record of the reference scenario."""

import numpy as np
import pytest

from windsysid.study.methods import Method, gather, method_table, run_methods
from windsysid.turbine.file import load_turbine


@pytest.fixture(scope="module")
def methods() -> dict[str, Method]:
    return {f"{m.name}, {m.told}": m for m in run_methods(load_turbine("verne555"), seed=0)}


def test_withheld_loads_ruin_the_balance_and_wrong_statistics_the_joint_filter(methods):
    by = {name: (m.rms_error("k_"), m.rms_error("c_"), m.covered) for name, m in methods.items()}
    told = "motion of every degree of freedom"
    balance, withheld = by[f"force balance, EKF, arm A, {told}, loads"], by[f"force balance, EKF, arm B, {told}"]
    assert balance[1] < 0.03 < 0.5 < withheld[1]
    mode = by["joint, posterior mode, nothing"]
    wrong = by["joint, extended Kalman filter, the same, loads 3 × too loud"]
    assert mode[0] < 0.03 < wrong[0]
    assert mode[2] >= 0.8


def test_runs_are_gathered_by_method(methods):
    runs = list(methods.values())
    both = gather(runs + [run._replace(error=-run.error, seconds=3.0 * run.seconds) for run in runs])
    assert [m.name for m in both] == [m.name for m in runs]
    assert both[0].error.shape == (2, 10)
    assert both[0].rms_error("k_") == pytest.approx(runs[0].rms_error("k_"))
    assert both[0].summary()["seconds"] == pytest.approx(2.0 * float(np.median(runs[0].seconds)))
    table = method_table(both)
    assert len(table.rows) == len(runs)
    assert "2 records, 10 coefficients" in table.caption
