"""Dry friction and play make damping and stiffness go with amplitude, and loads push in two directions at once."""

from dataclasses import replace

import numpy as np
import pytest

from windsysid.checks.nonlinearity import doubt_bending
from windsysid.filters import EKF
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.identification.verdict.smoothed_loads import _score, judge_smoothed_loads
from windsysid.records.record import Record
from windsysid.results.smoothed_loads import SmoothedLoads, doubt_correlated
from windsysid.turbine.file import load_turbine

RATE, SUBSTEPS, SECONDS, RECORDS = 10.0, 5, 400.0, 4
TOWER = load_turbine("tower")


def vibration(friction: float, play: float, shared: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity and acceleration (T, 2, R) of a tower top along and across the rotor's axis, R records;
    its spring has play [m], friction [N] acts beside, and loads are correlated."""
    rng = np.random.default_rng(31)
    v = TOWER.values
    m, k, c = (np.array([[v[f"{what}_{f}"]] for f in ("side_side", "fore_aft")]) for what in ("mass", "k", "c"))
    step, count = 1.0 / (RATE * SUBSTEPS), round(SECONDS * RATE)
    stay = np.exp(-step)
    rms = np.array([[2e4], [8e4]])
    q, r, w = np.zeros((2, RECORDS)), np.zeros((2, RECORDS)), rms * rng.standard_normal((2, RECORDS))
    out = np.empty((3, count, 2, RECORDS))
    lead = round(50.0 * RATE)
    mixed = np.linalg.cholesky([[1.0, shared], [shared, 1.0]])
    for n in range(-lead, count):
        for part, kick in enumerate(rng.standard_normal((SUBSTEPS, 2, RECORDS))):
            a = (w - k * (q - np.clip(q, -play, play)) - c * r - friction * np.tanh(r / 1e-3)) / m
            if part == 0 and n >= 0:
                out[:, n] = q, r, a
            r = r + step * a
            q = q + step * r
            w = stay * w + np.sqrt(1.0 - stay**2) * rms * (mixed @ kick)
    return out[0], out[1], out[2]


def judged(friction: float = 0.0, play: float = 0.0, shared: float = 0.0) -> list[SmoothedLoads]:
    """Of each record, with the coefficients of this amplitude."""
    q, r, a = vibration(friction, play, shared)
    sensors = tuple(sensor.model_copy(update={"feels_gravity": False}) for sensor in TOWER.sensors)
    loads = TOWER.loads[:2]
    noise = 0.005 * np.random.default_rng(5).standard_normal(a.shape)
    found = []
    for i in range(RECORDS):
        values = dict(TOWER.values)
        for j, name in enumerate(("side_side", "fore_aft")):
            values[f"k_{name}"] *= 1.0 - np.mean(q[:, j, i] * np.clip(q[:, j, i], -play, play)) / np.mean(
                q[:, j, i] ** 2
            )
            values[f"c_{name}"] += friction * np.mean(np.abs(r[:, j, i])) / np.mean(r[:, j, i] ** 2)
        record = Record(
            time=np.arange(len(a)) / RATE, values=a[:, :, i] + noise[:, :, i],
            channels=tuple(sensor.channel for sensor in sensors), units=("m/s^2", "m/s^2"), name="tower",
        )  # fmt: skip
        problem = pose(record, replace(TOWER, loads=loads, sensors=sensors), sensors, Prior())
        theta = [p.coordinate(values[p.name]) if p.name in values else 0.0 for p in problem.parameters]
        model = problem.build(np.concatenate([theta, np.zeros(len(problem.statistics))]))
        info = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)[1]
        freedoms = problem.turbine.model.freedoms
        one = judge_smoothed_loads(model, problem.inputs, problem.readings, info, freedoms=freedoms)
        assert one is not None
        found.append(one)
    return found


def test_series_that_swell_together_do_not_go_together():
    """Of 200 pairs one in 370 is beyond 3 σ by chance; with the deviation of steady series 10 were."""
    rng = np.random.default_rng(70)
    swell = np.where(np.arange(3000) // 150 % 4, 0.5, 1.8)[:, None]
    e, d = swell * rng.standard_normal((3000, 200)), swell * rng.standard_normal((3000, 200))
    assert np.sum(np.abs(_score(e, d)) > 3.0) <= 4
    assert np.all(_score(e, d + 0.3 * e) > 4.0)


def test_straight_springs_and_dampers_and_loads_that_are_independent_are_not_doubted():
    assert not [one for one in judged() if doubt_bending(one.bending) or doubt_correlated(one.correlated)]


@pytest.mark.parametrize(
    ("fault", "law"),
    [
        ({"friction": 2e3}, "damping"),
        ({"play": 0.003}, "stiffness"),
        pytest.param({"play": 0.02}, "stiffness", marks=pytest.mark.slow),
    ],
)
def test_friction_and_play_are_found_and_named(fault: dict[str, float], law: str):
    found = [one.bending for one in judged(**fault)]
    assert all(one.sigmas > one.bound and one.law == law for one in found), found
    (reason,) = doubt_bending(found[0])
    assert (reason.code, reason.data["law"]) == ("amplitude_dependence", law)


@pytest.mark.parametrize("shared", [0.3, pytest.param(-0.7, marks=pytest.mark.slow)])
def test_loads_that_go_together_are_found(shared: float):
    found = [one.correlated for one in judged(shared=shared)]
    assert all(one is not None and one.sigmas * np.sign(shared) > one.bound for one in found), found
    (reason,) = doubt_correlated(found[0])
    assert (reason.code, reason.data["loads"]) == ("correlated_loads", ["load_side_side", "load_fore_aft"])
