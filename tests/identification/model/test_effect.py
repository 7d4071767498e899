"""What an effect does that overrides nothing, and how a job includes effects."""

import numpy as np

from tests.identification.fits import TOWER, fitted, job_of, noise, record_of
from windsysid.identification.model.effect import Detection, Effect

RECORD = record_of(noise())


class Offset:
    """An effect as it is included: half a metre per second squared in every reading."""

    code = "offset"

    def correct(self, record, turbine, sensors, *, filtered):
        moved = {one.channel: (record[one.channel] - 0.5, "m/s^2") for one in sensors}
        return record.with_channels(moved), tuple(sensors)

    def notes(self, outcome, *, filtered):
        return ()


def test_an_effect_that_tests_nothing_leaves_the_fit_as_it_is():
    job, fit, effect = job_of(RECORD), fitted(RECORD), Effect()
    assert effect.find(job) is None
    found = effect.detect(job, fit)
    assert found == Detection(fit, inclusion=None, log10_odds=0.0, start=None)
    assert effect.confirm(job, found, fit) is fit


def test_an_included_effect_corrects_what_is_read_and_never_the_record():
    job = job_of(RECORD).including(Offset())
    read = job.condition().record
    for sensor in TOWER.sensors:
        np.testing.assert_allclose(RECORD[sensor.channel] - read[sensor.channel], 0.5)
    assert job.record is RECORD
    assert job.including(Offset()).effects[0] is not job.effects[0]
    assert len(job.including(Offset()).effects) == 1
