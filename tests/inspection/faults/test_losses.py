import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

import windsysid as ws
from windsysid.inspection.faults import losses
from windsysid.inspection.faults.losses import lost_rows

RATE = 50.0
NAMES = ("acceleration_1", "acceleration_2", "acceleration_3")


def frame(seed, samples=30_000, rate=RATE):
    """Accelerations of three modes under white loads, with 2 % of noise."""
    rng = np.random.default_rng(seed)
    q = np.empty((samples, 3))
    for j, f in enumerate((1.0, 2.8, 4.05)):
        w = 2.0 * np.pi * f / rate
        a = [1.0, -2.0 * np.exp(-0.01 * w) * np.cos(w), np.exp(-0.02 * w)]
        q[:, j] = lfilter([1.0, -2.0, 1.0], a, rng.normal(size=samples))
    y = q @ np.array([[0.33, -0.74, -0.59], [0.59, -0.33, 0.74], [0.74, 0.59, -0.33]]).T
    return y + 0.02 * y.std() * rng.normal(size=y.shape)


def record_of(values, rate=RATE):
    names = NAMES[: values.shape[1]]
    return ws.Record(np.arange(len(values)) / rate, values, names, ("m/s^2",) * len(names), name="made up")


def without_every(values, n):
    """The rows that remain when every n-th is lost."""
    return np.delete(values, np.s_[n - 1 :: n], axis=0)


@pytest.mark.parametrize("n", [8, 10, 20])
@pytest.mark.parametrize("channels", [1, 3])
def test_rows_lost_at_a_regular_distance_are_found_though_times_are_even(n, channels):
    found = lost_rows(record_of(without_every(frame(n), n)[:, :channels]), NAMES[:channels])
    assert [finding.kind for finding in found] == ["lost rows"]
    assert f"one row was lost after every {n - 1}," in found[0].text
    assert f"{100 / (n - 1):.2g} % too high" in found[0].text


def test_neither_oma_nor_identify_trusts_a_record_with_lost_rows():
    record = record_of(without_every(frame(1), 10))
    found = ws.oma(record)
    assert not any(mode.trusted for mode in found.modes)
    assert any("one row was lost after every 9" in doubt for doubt in found.doubts)
    assert any(finding.kind == "lost rows" for finding in ws.inspect(record).findings)


@pytest.mark.parametrize("seed", range(20))
def test_no_rows_are_said_to_be_lost_of_a_healthy_record(seed):
    rng = np.random.default_rng(100 + seed)
    y = frame(seed)
    kinds = {
        0: y,
        1: y * np.exp(np.sin(np.arange(len(y)) / 2000.0))[:, None],  # fades and swells
        2: y + y.std() * (rng.random(y.shape) < 0.002) * rng.normal(size=y.shape) * 20.0,  # blows
        3: y + y.std() * np.sin(2.0 * np.pi * 2.5 * np.arange(len(y)) / RATE)[:, None],  # 2 f is a tenth of the rate
        4: y + 3.0 * y.std() * np.exp(-(np.arange(len(y)) % 50) / 3.0)[:, None],  # a blow at every 50th row
    }
    assert lost_rows(record_of(kinds[seed % len(kinds)]), NAMES) == []


def test_readings_that_were_filled_in_are_not_lost_rows():
    y, t = frame(7)[::5], np.arange(30_000) / 5.0
    slow = np.arange(len(y))
    for filled in (CubicSpline(slow, y)(t), np.column_stack([np.interp(t, slow, column) for column in y.T])):
        assert lost_rows(record_of(filled), NAMES) == []


@pytest.mark.parametrize("rows", [997, 5_000, 60_011])
def test_sums_by_remainder_are_those_of_each_period_alone(rows: int):
    terms = np.random.default_rng(rows).normal(size=(rows, 3))
    found = losses._by_remainder(terms)
    assert sorted(found) == list(range(losses.MIN_PERIOD_ROWS, min(losses.MAX_PERIOD_ROWS, rows // 50) + 1))
    for period, sums in found.items():
        whole = rows // (2 * period) * 2 * period
        np.testing.assert_allclose(sums, terms[:whole].reshape(-1, period, 3).sum(axis=0), atol=1e-9)
