"""A spring under a first-order load, and cross-spectra that are exactly its own."""

import numpy as np
import pytest

from tests.identification.test_own_equations import NOISE, PARAMETERS, RATE, SPRING, sensors
from tests.spectral.test_linear import LOAD
from windsysid.mechanics.compile import compile_model
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.rotor.load_filters import load_shapes
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.cross_spectra import CrossSpectra, transform_block

AT = np.array([0.05, 0.02, 0.1, -0.1, 0.1])


@pytest.fixture(scope="package")
def model() -> LinearModel:
    compiled = compile_model(SPRING, sensors())
    given = np.array([{"m": 2.0, "c": 0.4, "k": 20.0}[name] for name in compiled.parameters])
    noise, shapes = 2.0 * np.array(list(NOISE.values())) ** 2 / RATE, load_shapes([LOAD], ("force",))
    return LinearModel(
        compiled, given, np.zeros(0), np.zeros(1), np.zeros(2), PARAMETERS, noise, np.zeros(2), shapes, np.full(3, 1.5)
    )


@pytest.fixture(scope="package")
def exact(model: LinearModel) -> CrossSpectra:
    """Of 20 blocks of 6000 samples, as a finite record has them."""
    readings = np.random.default_rng(1).normal(size=(6000, 2))
    like = BlockSums.of(transform_block(readings, RATE, (0.1, 3.0), [(0.1, 3.0)]))
    rows = model.rows(like, AT)
    power = model._windowed(like.last, np.arange(len(like.power) + 1), AT)
    assert len(rows.frequency)
    return like._replace(powers=(20.0 * power,), counts=(20.0,))
