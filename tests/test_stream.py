"""A record in pieces: the same answer as on line at once, in bounded memory, interrupted or not."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification import identify
from windsysid.record import Record
from windsysid.simulate import simulate_record
from windsysid.stream import identify_pieces
from windsysid.turbine import Turbine


@pytest.fixture(scope="module")
def whole(verne555: Turbine) -> Record:
    return simulate_record(verne555, duration=24.0, rate=50.0, seed=4)


def pieces(record: Record, length: float) -> Iterator[Record]:
    edges = np.arange(0.0, record.duration + length, length)
    for start, end in pairwise(edges):
        inside = (record.time >= start - 1e-9) & (record.time < end - 1e-9)
        if inside.sum() > 1:
            yield Record(
                record.time[inside], record.values[inside], record.channels, record.units, name=f"from {start:g} s"
            )


def test_pieces_give_the_online_answer_of_the_whole(verne555: Turbine, whole: Record, tmp_path: Path):
    # The model is posed on the first piece, whose loudest second sets the initial state's prior: hence not bit for bit.
    one = identify(whole, verne555)
    found = identify_pieces(pieces(whole, 8.0), verne555)
    assert found.samples == whole.samples
    assert found.section == pytest.approx((0.0, 23.98))
    for i, e in enumerate(found.estimates):
        assert abs(e.estimate - one[e.name].estimate) < 0.25 * e.std, e.name
        assert found.std[-1, i] == pytest.approx(np.sqrt(found.cov[i, i]))
    assert np.all(np.diff(found.time) > 0.0)
    found.save(tmp_path)
    found.plot()


def test_an_interrupted_run_goes_on_where_it_stopped(verne555: Turbine, whole: Record, tmp_path: Path):
    checkpoint = tmp_path / "checkpoint.npz"

    def interrupted() -> Iterator[Record]:
        for count, piece in enumerate(pieces(whole, 8.0)):
            if count == 2:
                raise KeyboardInterrupt
            yield piece

    with pytest.raises(KeyboardInterrupt):
        identify_pieces(interrupted(), verne555, checkpoint=checkpoint)
    assert checkpoint.exists()
    resumed = identify_pieces(pieces(whole, 8.0), verne555, checkpoint=checkpoint)
    straight = identify_pieces(pieces(whole, 8.0), verne555)
    assert not checkpoint.exists()
    np.testing.assert_array_equal(resumed.mean, straight.mean)
    np.testing.assert_array_equal(resumed.cov, straight.cov)
    np.testing.assert_array_equal(resumed.time, straight.time)


def test_other_pieces_than_those_of_the_interrupted_run_are_refused(verne555: Turbine, whole: Record, tmp_path: Path):
    checkpoint = tmp_path / "checkpoint.npz"
    with pytest.raises(KeyboardInterrupt):
        identify_pieces(_stopping(pieces(whole, 8.0), 2), verne555, checkpoint=checkpoint)
    with pytest.raises(ConfigurationError, match="expected pieces as long as those of the run that was interrupted"):
        identify_pieces(pieces(whole, 6.0), verne555, checkpoint=checkpoint)


def _stopping(records: Iterator[Record], after: int) -> Iterator[Record]:
    for count, record in enumerate(records):
        if count == after:
            raise KeyboardInterrupt
        yield record


def test_what_is_missing_between_pieces_is_missing_readings(verne555: Turbine, whole: Record):
    parts = list(pieces(whole, 8.0))
    gap = Record(parts[1].time[100:], parts[1].values[100:], whole.channels, whole.units, name="late")
    found = identify_pieces([parts[0], gap, parts[2]], verne555)
    assert found.samples == whole.samples
    for e in found.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 4.0 * e.std


def test_pieces_that_do_not_go_on_are_refused(verne555: Turbine, whole: Record):
    parts = list(pieces(whole, 8.0))
    with pytest.raises(RecordError, match="begins after the one before"):
        identify_pieces([parts[0], parts[0]], verne555)
    with pytest.raises(RecordError, match="expected the channels of the first piece, got none of tower_x_acceleration"):
        identify_pieces(
            [parts[0], parts[1].select([c for c in whole.channels if c != "tower_x_acceleration"])], verne555
        )
    with pytest.raises(RecordError, match="no pieces"):
        identify_pieces([], verne555)
