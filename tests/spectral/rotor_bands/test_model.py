"""Several bands as one function: unknowns that all share come first."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from windsysid.loads.statistics import Statistic
from windsysid.spectral.rotor.likelihood import Likelihood
from windsysid.spectral.rotor_bands.model import BandModel, RotorBand
from windsysid.statespace.unknowns import Unknowns


def band(name: str, given: float, count: int = 1) -> Any:
    statistics = tuple(Statistic(f"{name}_{i}", "N", given) for i in range(count))
    size = 2 + count
    model = SimpleNamespace(
        unknowns=Unknowns(("k", "c"), (), tuple(s.name for s in statistics)), statistics=statistics,
        prior=(np.arange(size, dtype=float), np.full(size, 0.5)),
        matrices=lambda unknowns, slopes: None,
        likelihood=lambda u, every, matrices: Likelihood(float(u @ u), 2.0 * u, 2.0 * np.eye(size)),
    )  # fmt: skip
    return RotorBand(model, None, ())  # type: ignore[arg-type]


def test_each_band_has_the_shared_unknowns_and_its_own():
    model = BandModel((band("a", 1.0), band("b", 2.0, 2)))
    np.testing.assert_array_equal(model.places()[0], [0, 1, 2])
    np.testing.assert_array_equal(model.places()[1], [0, 1, 3, 4])
    np.testing.assert_array_equal(model.prior[0], [0.0, 1.0, 2.0, 2.0, 3.0])


def test_likelihoods_of_bands_add():
    model, u = BandModel((band("a", 1.0), band("b", 2.0))), np.array([1.0, 2.0, 3.0, 4.0])
    value, gradient, information = model.likelihood(u)
    assert value == (1 + 4 + 9) + (1 + 4 + 16)
    np.testing.assert_array_equal(gradient, [4.0, 8.0, 6.0, 8.0])
    np.testing.assert_array_equal(information, np.diag([4.0, 4.0, 2.0, 2.0]))


def test_scores_of_bands_are_those_of_their_parts():
    def scored(name: str, base: list[float]) -> Any:
        one = band(name, 1.0)
        one.model.base = np.array(base)
        one.model.scores = lambda u: (np.outer([1.0, 2.0], u), np.array([np.eye(3), 2.0 * np.eye(3)]))
        return one

    model, u = BandModel((scored("a", [0.1, 0.2]), scored("b", [1.0, 1.2]))), np.array([1.0, 2.0, 3.0, 4.0])
    places, gradients, information = model.scores(u)
    np.testing.assert_array_equal(places, [0.1, 0.2, 1.0, 1.2])
    np.testing.assert_array_equal(gradients[[1, 3]], [[2.0, 4.0, 6.0, 0.0], [2.0, 4.0, 0.0, 8.0]])
    np.testing.assert_array_equal(information[3], np.diag([2.0, 2.0, 0.0, 2.0]))


def test_levels_that_two_models_have_stay_what_they_are():
    before, after = BandModel((band("a", 1.0),)), BandModel((band("a", 4.0), band("b", 2.0)))
    found = after.start_from(np.array([0.1, 0.2, np.log(8.0)]), before)
    np.testing.assert_allclose(found, [0.1, 0.2, np.log(2.0), 0.0])  # 8 of the first is twice what the second gives
