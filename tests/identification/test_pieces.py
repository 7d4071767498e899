"""A record in pieces: the same answer as on line at once, in bounded memory, interrupted or not."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.findings import notes, only
from tests.identification.fits import identify_without_effects as identify
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.estimate.outlier import find_spikes
from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


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


@pytest.fixture(scope="module")
def straight(verne555: Turbine, whole: Record) -> Identification:
    """Of three pieces, without an interruption."""
    return identify_pieces(pieces(whole, 8.0), verne555)


def test_pieces_give_the_answer_of_the_whole(
    verne555: Turbine, whole: Record, straight: Identification, tmp_path: Path
):
    # The model is posed on the first 80 periods, whose loudest second sets the initial state's prior: hence not bit for
    # bit.
    one, found = identify(whole, verne555), straight
    assert found.samples == whole.samples
    assert found.section == pytest.approx((0.0, 23.98))
    for e in found.estimates:
        assert abs(e.estimate - one[e.name].estimate) < 0.02 * e.std, e.name
        assert e.std == pytest.approx(one[e.name].std, rel=0.02)
    assert np.all(np.diff(found.time) > 0.0)
    assert notes(found)[-1] == Finding("pieces", "note", {"kept": None})
    assert found.log_likelihood == pytest.approx(one.log_likelihood, abs=1.0)
    assert found.diagnosis.whiteness is not None
    assert one.diagnosis.whiteness is not None
    assert found.diagnosis.whiteness.used == one.diagnosis.whiteness.used
    assert found.loads is not None
    assert found.loads.mean.shape == (whole.samples, 5)
    found.save(tmp_path)


def test_an_interrupted_run_goes_on_where_it_stopped(
    verne555: Turbine, whole: Record, straight: Identification, tmp_path: Path
):
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
    assert not checkpoint.exists()
    np.testing.assert_array_equal(resumed.mean, straight.mean)
    np.testing.assert_array_equal(resumed.cov, straight.cov)
    np.testing.assert_array_equal(resumed.time, straight.time)


@pytest.fixture(scope="module")
def stopped(verne555: Turbine, whole: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a run left that was interrupted after two pieces."""
    checkpoint = tmp_path_factory.mktemp("stopped") / "checkpoint.npz"
    with pytest.raises(KeyboardInterrupt):
        identify_pieces(_stopping(pieces(whole, 8.0), 2), verne555, checkpoint=checkpoint)
    return checkpoint


def _changed(record: Record, sample: int) -> Record:
    values = record.values.copy()
    values[sample, record.channels.index("tower_x_acceleration")] += 1e-9
    return replace(record, values=values)


Call = Callable[[Record, Turbine, Path], Identification]


@pytest.mark.parametrize(
    ("call", "differs"),
    [
        (lambda r, t, c: identify_pieces(pieces(_changed(r, 3), 8.0), t, checkpoint=c), "record"),
        (lambda r, t, c: identify_pieces(pieces(_changed(r, 790), 8.0), t, checkpoint=c), "record"),
        (lambda r, t, c: identify_pieces(pieces(r.section(0.0, 12.0), 8.0), t, checkpoint=c), "record"),
        (lambda r, t, c: identify_pieces(pieces(r.section(0.0, 8.0), 8.0), t, checkpoint=c), "record"),
        (lambda r, t, c: identify_pieces(pieces(r, 8.0), t, checkpoint=c, prior=Prior(1.1, 1.1)), "prior"),
        (lambda r, t, c: identify_pieces(pieces(r, 8.0), t, checkpoint=c, parameters=["k_x"]), "parameters"),
        (lambda r, t, c: identify_pieces(pieces(r, 8.0), t, checkpoint=c, sensors=t.sensors[:-1]), "sensors"),
        (lambda r, t, c: identify_pieces(pieces(r, 8.0), t, checkpoint=c, options={"mapping": {"a": 1}}), "mapping"),
        (lambda r, t, c: identify_pieces(pieces(r, 8.0), t.with_values({"k_y": 9000.0}), checkpoint=c), "turbine"),
    ],
)  # fmt: skip
def test_a_checkpoint_is_not_taken_up_by_another_call(
    verne555: Turbine, whole: Record, stopped: Path, tmp_path: Path, call: Call, differs: str
):
    checkpoint = tmp_path / "checkpoint.npz"
    checkpoint.write_bytes(stopped.read_bytes())
    with pytest.raises(ConfigurationError, match=rf"another call, which differs in {differs}: .* delete") as caught:
        call(whole, verne555, checkpoint)
    assert "\n" not in str(caught.value)
    assert checkpoint.read_bytes() == stopped.read_bytes()


@pytest.mark.slow
def test_a_record_that_has_grown_since_is_the_same_record(
    verne555: Turbine, whole: Record, stopped: Path, tmp_path: Path
):
    checkpoint = tmp_path / "checkpoint.npz"
    with pytest.raises(KeyboardInterrupt):  # the record ended at 16 s when the run was interrupted
        identify_pieces(_stopping([*pieces(whole.section(0.0, 16.0), 8.0)] * 2, 2), verne555, checkpoint=checkpoint)
    grown = identify_pieces(pieces(whole, 8.0), verne555, checkpoint=checkpoint)
    assert grown.samples == whole.samples
    assert grown.provenance is not None
    assert grown.provenance.record_hash == record_hash(whole)


def test_other_pieces_than_those_of_the_interrupted_run_are_refused(
    verne555: Turbine, whole: Record, stopped: Path, tmp_path: Path
):
    checkpoint = tmp_path / "checkpoint.npz"
    checkpoint.write_bytes(stopped.read_bytes())
    with pytest.raises(ConfigurationError, match=r"another call, which differs in length of pieces\b"):
        identify_pieces(pieces(whole, 6.0), verne555, checkpoint=checkpoint)


def _stopping(records: Iterable[Record], after: int) -> Iterator[Record]:
    for count, record in enumerate(records):
        if count == after:
            raise KeyboardInterrupt
        yield record


@pytest.mark.slow
def test_what_is_missing_between_pieces_is_missing_readings(verne555: Turbine, whole: Record):
    parts = list(pieces(whole, 8.0))
    gap = Record(parts[1].time[100:], parts[1].values[100:], whole.channels, whole.units, name="late")
    found = identify_pieces([parts[0], gap, parts[2]], verne555)
    found.plot()
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


@pytest.mark.slow
def test_spikes_are_left_out_of_pieces_as_of_the_whole():
    tower = load_turbine("tower")
    whole = simulate_record(tower, duration=200.0, rate=4.0, seed=4)
    values = whole.values.copy()
    values[[130, 300, 477, 700], whole.channels.index("tower_x_acceleration")] += 30.0
    spiky = replace(whole, values=values)
    found = identify_pieces(pieces(spiky, 60.0), tower, loads="broadband", rate=4.0)
    outliers = only(found.findings, "outliers")
    assert outliers.channels == ("tower_x_acceleration",)
    assert (outliers.data["count"], outliers.data["read"]) == (4, 800)
    clean = identify(whole, tower, loads="broadband", rate=4.0)
    for e in found.estimates:
        assert abs(e.estimate - clean[e.name].estimate) < 0.05 * e.std, e.name


def test_spikes_stand_alone_and_a_release_does_not(verne555: Turbine, whole: Record):
    values = np.full((2 * whole.samples - 1, len(whole.channels)), np.nan)
    values[::2] = whole.values
    column = whole.channels.index("tower_x_acceleration")
    assert not find_spikes([(values, values)]).places
    values[[260, 1000], column] += 30.0
    values[300:310, column] = np.nan
    (places,) = find_spikes([(values, values)]).places
    assert places.tolist() == [260 * values.shape[1] + column, 1000 * values.shape[1] + column]
    time = np.arange(0.0, 60.0, 0.02)
    decay = np.exp(-0.2 * time) * np.cos(12.0 * time) + 1e-4 * np.random.default_rng(1).standard_normal(len(time))
    assert not find_spikes([(decay, decay[:, None])]).places


@pytest.mark.slow
def test_the_diagnosis_judges_all_pieces(verne555: Turbine, whole: Record):
    values = whole.values.copy()
    tone = np.sin(2.0 * np.pi * 4.0 * whole.time[:400])  # in the first piece alone, where something answers
    column = whole.channels.index("tower_x_acceleration")
    values[:400, column] += 5.0 * np.nanstd(values[:, column]) * tone
    found = identify_pieces(pieces(replace(whole, values=values), 8.0), verne555, loads="broadband")
    assert not found.diagnosis.trusted


@pytest.mark.slow
def test_a_tower_is_resampled_and_chooses_its_loads_in_pieces_as_in_one():
    tower = load_turbine("tower")
    record = simulate_record(tower, duration=240.0, rate=6.0, seed=2)
    one = identify(record, tower)
    found = identify_pieces(pieces(record, 60.0), tower)
    assert found.rate == pytest.approx(one.rate)
    assert found.samples == one.samples
    assert notes(found)[0] == notes(one)[0]
    assert (notes(found)[0].code, notes(found)[0].data["recorded"]) == ("resampled", pytest.approx(6.0))
    chosen = [only(result.findings, "load_model_chosen").data for result in (found, one)]
    assert chosen[0]["model"] == chosen[1]["model"]
    for e in found.estimates:
        assert abs(e.estimate - one[e.name].estimate) < 0.02 * e.std, e.name
    assert found.modes[0].frequency.estimate == pytest.approx(one.modes[0].frequency.estimate, rel=1e-4)
