"""How a streaming record is cut into blocks and transformed."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming.run import StreamingJob
from windsysid.identification.streaming.spectra import BlockLayout, SpectraAccumulator
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.spectral.transforms.lifted import Lifted
from windsysid.spectral.transforms.rotating_frame import TurnedBlock
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

AZIMUTH = np.asarray(2.0 * np.pi * 0.5 * np.arange(1000) / 10.0, dtype=np.float64)
READINGS = np.random.default_rng(1).normal(size=(1000, 2))


def accumulator(record: Record, turbine: Turbine) -> SpectraAccumulator:
    job = StreamingJob(turbine, turbine.sensors, Prior(), None, "spectral", None, "auto", None, None, False, {})
    return SpectraAccumulator(record, job)


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return load_turbine("tower").exact()


@pytest.fixture(scope="module")
def record(tower: Turbine) -> Record:
    return simulate_record(tower, duration=300.0, rate=5.0, seed=5)


def test_blocks_are_of_equal_time_or_of_equal_turns():
    still = BlockLayout(10.0, 300, 0, 0, None, 0)
    turning = still._replace(turns=20, harmonics=1)  # 40 s
    assert [b.stop - b.start for b in still.cut(AZIMUTH)[0]] == [300, 300, 300]
    assert [b.stop - b.start for b in turning.cut(AZIMUTH)[0]] == [401, 401]
    assert isinstance(turning.transform(READINGS, AZIMUTH), Lifted)
    assert still.kind is Lifted


def test_a_rotor_in_bands_is_transformed_in_its_frame_up_to_the_last_bin():
    layout = BlockLayout(10.0, 300, 0, 0, np.array([True, False]), 40)
    block = layout.transform(READINGS, AZIMUTH)
    assert isinstance(block, TurnedBlock)
    assert block.data.shape == (3, 41, 2)
    assert layout.kind is TurnedBlock


def test_samples_after_the_last_block_join_the_next_segment_but_not_across_a_gap(tower: Turbine, record: Record):
    first, second = record.section(0.0, 99.9), record.section(100.0, 250.0)
    taken = accumulator(first, tower)
    taken.take(first)
    assert taken.sums is not None
    assert taken.last is not None
    assert taken.sums.sizes == (1,)
    rest = taken.last.samples  # the overlap of the next block
    assert rest == round(0.05 * first.samples)
    taken.take(second)
    assert taken.sums.sizes == (2,)
    assert taken.last.samples == rest + second.samples - round(0.95 * first.samples)
    apart = accumulator(first, tower)
    apart.take(first)
    apart.take(record.section(110.0, 200.0))  # too short for a block of its own
    assert apart.sums is not None
    assert apart.sums.sizes == (1,)


def test_what_was_stored_is_restored_and_goes_on_the_same(tower: Turbine, record: Record):
    parts = [record.section(0.0, 99.9), record.section(100.0, 199.9), record.section(200.0, 299.9)]
    straight, stopped, resumed = (accumulator(parts[0], tower) for _ in range(3))
    for part in parts:
        straight.take(part)
    for part in parts[:2]:
        stopped.take(part)
        resumed.replay(part)
    resumed.restore(*stopped.stored())
    resumed.take(parts[2])
    assert resumed.sums is not None
    assert straight.sums is not None
    np.testing.assert_array_equal(resumed.sums.power, straight.sums.power)
    assert (resumed.taken, resumed.notes, resumed.speeds) == (straight.taken, straight.notes, straight.speeds)


def test_segments_of_another_rate_are_refused(tower: Turbine, record: Record):
    taken = accumulator(record, tower)
    with pytest.raises(RecordError, match=r"expected pieces of 5 Hz, got one of 2\.5 Hz"):
        taken.take(Record(record.time[::2], record.values[::2], record.channels, record.units))
