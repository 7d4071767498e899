"""What equations of one's own need before their spectra are read."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.test_own_equations import PARAMETERS, RATE, SPRING, TRUTH, sensors
from tests.spectral.test_linear import LOAD, driven
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.estimate.equations_spectra import EquationsQuestion, _linear_model, fit_by_spectra
from windsysid.records.record import Record

QUESTION = EquationsQuestion(SPRING, PARAMETERS, sensors(), None, {"m": TRUTH["m"]}, [LOAD], {}, np.full(3, 1.5))


@pytest.fixture(scope="module")
def record() -> Record:
    return driven(1, 6000)


def test_noise_is_a_one_sided_density(record: Record):
    model = _linear_model(QUESTION, record)
    np.testing.assert_allclose(model.noise, [2.0 * sensor.noise**2 / RATE for sensor in QUESTION.sensors])
    assert len(model.prior[0]) == len(PARAMETERS) + 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"known": {}}, "without a value"),
        ({"parameters": (*PARAMETERS, replace(PARAMETERS[0], name="other"))}, "got other"),
        ({"loads": []}, "load 'force': nothing says"),
        ({"mean": [0.0]}, "expected 2 states"),
    ],
)
def test_a_question_that_lacks_something_is_refused(record: Record, change: dict[str, object], message: str):
    with pytest.raises(ConfigurationError, match=message):
        _linear_model(QUESTION._replace(**change), record)  # type: ignore[arg-type]


def test_no_pieces_are_refused():
    with pytest.raises(RecordError, match="no pieces"):
        fit_by_spectra(QUESTION, [])


def test_pieces_are_blocks_as_long_as_the_first(record: Record):
    found = fit_by_spectra(QUESTION, [record.section(0.0, 0.45 * record.duration), record])
    assert any("read in 3 blocks" in note for note in found.notes)
    assert found.samples > record.samples
