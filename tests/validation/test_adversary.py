"""The simulator that shares no code with windsysid agrees with windsysid's own equations, and its loads are what they
are called."""

import numpy as np
import pytest
from validation.adversary.campaign import identify_one
from validation.adversary.loads import gauss_markov, narrow_band
from validation.adversary.machine import Machine, accelerations
from validation.adversary.scenarios import record, scenario

from tests.findings import reasons
from windsysid.identification import pipeline
from windsysid.identification.condition.readings import resample_for_model
from windsysid.identification.estimate.scoring import information
from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.loads.statistics import coordinates_of
from windsysid.mechanics.compile import compile_model
from windsysid.simulation.integrate import integrate
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine


@pytest.mark.parametrize("seed", [0, *(pytest.param(one, marks=pytest.mark.slow) for one in range(1, 5))])
def test_own_equations_agree_with_those_that_windsysid_derives(seed: int):
    rng = np.random.default_rng(seed)
    q, rates, loads = 0.1 * rng.standard_normal(5), rng.standard_normal(5), 100.0 * rng.standard_normal(5)
    psi = rng.uniform(0.0, 6.0)
    turbine = load_turbine("verne555")
    model = compile_model(turbine.model, turbine.sensors)
    inputs = np.concatenate([[psi, turbine.rotor_speed, 0.0], loads])[None, :]
    p = np.array([turbine.values[name] for name in model.parameters])
    theirs = integrate(model, p, inputs, rate=100.0, start=np.concatenate([q, rates])).rates[0, 5:]
    ours = accelerations(Machine(), psi, q, rates, loads)
    assert np.max(np.abs(ours - theirs)) < 1e-10 * np.max(np.abs(theirs))


def test_loads_have_the_level_and_the_memory_that_they_are_given():
    rng = np.random.default_rng(1)
    drawn = gauss_markov(rng, 400_000, 15.0, 1.0)  # 200 s, 100 times the memory
    assert np.std(drawn) == pytest.approx(15.0, rel=0.25)
    later = 1000  # half a second
    assert np.mean(drawn[later:] * drawn[:-later]) / np.var(drawn) == pytest.approx(np.exp(-0.5), abs=0.1)
    line = narrow_band(rng, 400_000, 2.0, 3.0, 0.01)
    power = np.abs(np.fft.rfft(line)) ** 2
    assert np.argmax(power) / 200.0 == pytest.approx(3.0, rel=0.05)
    assert np.std(line) == pytest.approx(2.0, rel=0.3)


@pytest.mark.slow  # tests/statespace/test_within_step.py has the mathematics
def test_statistics_of_loads_in_continuous_time_are_not_off():
    """Scores at the truth, ten minutes each: with loads along straight lines between samples the memory was off by 3.4
    and the blades' noise by 4.4 standard deviations of three records together."""
    turbine, off = load_turbine("verne555"), []
    for seed in range(300_000, 300_003):
        fine, _, _ = resample_for_model(record("600 s at 50 Hz", seed), turbine, None, turbine.sensors)
        problem = pose(fine, turbine, turbine.sensors, Prior())
        theta = [q.coordinate(turbine.values[q.name]) for q in problem.parameters]
        eta = coordinates_of(problem.statistics, {one.name: one.given for one in problem.statistics})
        truth = np.concatenate([theta, eta])
        gradient, fisher = information(
            problem.build, problem.inputs, problem.readings, truth, np.full(len(truth), 1e-4)
        )
        cov = np.linalg.inv(fisher)
        off.append((cov @ gradient / np.sqrt(np.diag(cov)))[len(theta) :])
    assert np.abs(np.sum(off, axis=0) / np.sqrt(len(off))).max() < 3.0


@pytest.mark.slow
def test_a_slow_rotor_without_wind_is_not_taken_for_one_in_wind():
    """Bands around the modes suppose wind: a peak of noise was the support's mode, 12.4 standard deviations off, and
    trusted."""
    found = identify_one("rotor at 18 rpm", 240_011)
    assert found["trusted"], found["findings"]
    assert max(map(abs, found["z"])) < 3.0
    assert "joint_as_loads_are_broad" in [one["code"] for one in found["findings"]]
    asked = identify(
        record("rotor at 18 rpm", 240_011), "verne555", prior=DrawnPrior(seed=240_011), formulation="spectral"
    )
    assert [one.code for one in reasons(asked)] == ["bands_suppose_wind"]


def test_what_is_drawn_is_the_same_for_a_seed_and_another_for_another():
    one, again, other = (scenario("all of it drawn", seed).machine for seed in (3, 3, 4))
    assert one == again != other


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["blades 2 ms late", "5 degrees off"])
def test_an_instrument_that_is_off_by_what_its_tolerance_explains_is_trusted(kind: str):
    """Filters and spectra are compared with instruments where they have found them: as their files say, both were wrong
    in ways of their own."""
    found = identify_one(kind, 84000)
    assert found["trusted"], found["findings"]
    assert max(map(abs, found["z"])) < 3.0


@pytest.mark.slow
def test_a_support_that_hardens_is_not_trusted():
    hard = identify_one("support hardens", 4001, "broadband")
    assert not hard["trusted"]
    assert "nonlinear_force" in [one["code"] for one in hard["findings"] if one["severity"] == "reason"]


@pytest.mark.slow
def test_a_support_that_loosens_midway_is_told_by_parts_of_the_record_that_contradict():
    found = identify_one("support 15 % softer from midway", 4002, "broadband")
    wide = next(one for one in found["findings"] if one["code"] == "wider_intervals")
    assert wide["data"]["over"] == "time"
    assert any(name.startswith("k_") for name in wide["data"]["names"])


@pytest.mark.slow
def test_a_line_is_seen_though_it_turns_the_modes_of_the_tower_into_others(monkeypatch: pytest.MonkeyPatch):
    """It brings the stiffnesses together, so that the tower whirls: the file has no modes of these names."""
    monkeypatch.setattr(pipeline, "MAX_EXTENSIONS", 0)
    found = identify(
        record("line 5 % from a mode", 7023), "verne555", prior=DrawnPrior(seed=7023), formulation="joint",
        loads="broadband",
    )  # fmt: skip
    assert {"tower backward", "tower forward"} <= {mode.name for mode in found.modes}
    assert not found.diagnosis.trusted
    assert any(one.data.get("frequency") == pytest.approx(1.64, abs=0.005) for one in reasons(found))
