"""One's own equations from spectra: working point, frequency range, and sums of segments."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.identification.test_own_equations import NOISE, PARAMETERS, RATE, SPRING, sensors, shaken
from windsysid import ConfigurationError, Record
from windsysid.errors import RecordError
from windsysid.identification.condition.segments import SegmentReader
from windsysid.identification.estimate.spectral.equations_spectra import _pose, _take
from windsysid.identification.model.equations_problem import EquationsJob
from windsysid.models import GaussMarkov
from windsysid.spectral.transforms.cross_spectra import transform_block

JOB = EquationsJob(
    SPRING, PARAMETERS, sensors(), None, None, {"m": 2.0}, (GaussMarkov("force", 3.0, 0.5),), {}, True
)  # fmt: skip


@pytest.fixture(scope="module")
def record() -> Record:
    return shaken(6000, 5).select(list(NOISE))


def reader(of: object) -> SegmentReader:
    return SegmentReader(of, JOB.readings, continuous=False)  # type: ignore[arg-type]


def test_segments_add_up_to_the_blocks_that_they_are(record: Record):
    parts = [replace(record, time=record.time[a:b], values=record.values[a:b]) for a, b in ((0, 2000), (2000, 4500))]
    taken = _take(JOB, reader(parts))
    ranges = taken.sums.last.ranges
    limits = ranges[0][0], ranges[-1][1] / 1.001
    blocks = [transform_block(record.values[a : a + 2000], RATE, limits, ranges) for a in (0, 2000)]
    expected = sum(block.data[:, :, None] * block.data[:, None, :].conj() for block in blocks)
    np.testing.assert_allclose(taken.sums.power, expected, rtol=1e-9)
    assert taken.sums.sizes == (2,)
    np.testing.assert_allclose(taken.energies, [block.energies for block in blocks])
    assert taken.model.blur == RATE / 2000


def test_a_whole_record_is_one_block_that_is_compared_with_itself(record: Record):
    taken = _take(JOB, reader(record))
    assert taken.sums.blocks == 1.0
    assert taken.sums.last.samples == 6000
    assert taken.energies.shape[0] == 2
    middle = np.sqrt(50.0 / 2.0) / (2.0 * np.pi)
    assert taken.sums.last.frequency[0] < middle < taken.sums.last.frequency[-1] < 0.4 * RATE


def test_the_model_has_the_working_point_and_the_densities_that_were_given(record: Record):
    model = _pose(JOB._replace(mean=[0.1, 0.0]), record)
    np.testing.assert_allclose(model.noise, 2.0 * np.square(list(NOISE.values())) / RATE)
    assert model.loads_at.tolist() == [0.0]
    assert model.start.tolist() == [0.1, 0.0]
    assert dict(zip(model.compiled.parameters, model.given, strict=True)) == pytest.approx(
        {"m": 2.0, "c": 0.4, "k": 20.0}
    )


@pytest.mark.parametrize(
    ("refused", "kind", "message"),
    [
        (lambda r: _pose(JOB._replace(values={}), r), ConfigurationError, "parameters without a value: .* for m"),
        (lambda r: _pose(JOB._replace(loads=(), values={"m": 2.0, "force": 0.0}), r), ConfigurationError, "got none"),
        (lambda r: _pose(JOB._replace(mean=[0.0]), r), ConfigurationError, r"mean: expected 2 states, got shape \(1,"),
        (lambda r: _pose(JOB, shaken(200)), ConfigurationError, "'force' varies: expected constant inputs"),
        (lambda r: _take(JOB, reader(r.section(0.0, 1.0))), RecordError, "s or more for spectra, got 1 s"),
    ],
)  # fmt: skip
def test_what_spectra_cannot_be_read_of_is_refused(
    record: Record, refused: Callable[[Record], object], kind: type[Exception], message: str
):
    with pytest.raises(kind, match=message):
        refused(record)
