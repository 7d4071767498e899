"""One order of the unknowns in every problem of one record."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.identification.condition.spectral_readings import SpectralSamples
from windsysid.identification.estimate.spectral.frequency_domain import ask, inexact_of, tolerances_in
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.problem import Problem
from windsysid.identification.model.turbine_problem import pose
from windsysid.loads.statistics import values_of
from windsysid.spectral.rotor.build import pose_lifted


@pytest.fixture(scope="module")
def tower() -> ws.Turbine:
    return ws.load_turbine("tower")


@pytest.fixture(scope="module")
def record(tower: ws.Turbine) -> ws.Record:
    return ws.simulate(tower, duration=150.0, rate=12.5, seed=1)


def test_filters_and_spectra_hold_the_same_blocks_in_the_same_order(tower: ws.Turbine, record: ws.Record):
    problem: Problem = pose(record, tower, tower.sensors, Prior())
    question = ask(SpectralSamples.of(record, tower, tower.sensors, []), tower, Prior(), None, "broadband")
    model = pose_lifted(question, "broadband").model
    model = model._replace(inexact=inexact_of(question, tolerances_in(question)))
    ours, theirs = problem.unknowns, model.unknowns
    assert (ours.parameters, ours.tolerances, ours.clocks) == (theirs.parameters, theirs.tolerances, theirs.clocks)
    assert ours.parameters
    assert ours.tolerances
    assert len(problem.prior[0]) == ours.of("parameters", "statistics").stop
    assert len(problem.wide_prior[0]) == len(ours.but("clocks"))
    assert len(model.prior[0]) == theirs.size


def test_a_model_has_the_statistics_and_the_parameters_of_its_blocks(tower: ws.Turbine, record: ws.Record):
    problem = pose(record, tower, tower.sensors, Prior())
    known = problem.unknowns
    at = known.vector(parameters=0.1, statistics=0.2, tolerances=0.0)
    built = problem.build(at)
    values = values_of(problem.statistics, at[known.of("statistics")])
    noise = np.sqrt(np.ravel(built.blocks.noise)[:1])
    assert values["noise_tower_acceleration"] / tower.sensors[0].noise == pytest.approx(np.exp(0.2))
    assert np.isfinite(noise).all()
    first = problem.parameters[0]
    p = built.blocks.p[built.compiled.parameters.index(first.name)]
    assert p == pytest.approx(float(first.physical(0.1)))
