"""The posterior on line: equal to the posterior of the whole record, however the record comes."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.errors import ConfigurationError
from windsysid.identification.estimate.online import History, Online, advance, begin, finish, restored, stored
from windsysid.identification.estimate.scoring import posterior_mode
from windsysid.identification.streaming.checkpoint import Checkpoint
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov

Array = np.ndarray
FIRST = 200
PRIOR = np.array([0.2, -0.2, 1.0]), np.diag([0.3, 0.3, 1.5]) ** 2
"""ln of k_1, of the load's rms and of the noise, relative to the truth."""


MODEL, SENSORS = chain(), chain_sensors()


def build(theta: Array) -> StateSpace:
    return compose(
        MODEL,
        rate=50.0,
        values=CHAIN_VALUES | {"k_1": CHAIN_VALUES["k_1"] * np.exp(theta[0])},
        loads=[GaussMarkov("load_1", 5.0 * np.exp(theta[1]), 0.5), GaussMarkov("load_3", 5.0 * np.exp(theta[1]), 0.5)],
        sensors=[s if i == 2 else type(s)(s.channel, s.expression, s.noise * np.exp(theta[2])) for i,
        s in enumerate(SENSORS)],
        cov=0.01 * np.eye(6),
    )  # fmt: skip


@pytest.fixture(scope="module")
def record() -> tuple[Array, Array]:
    truth = build(np.zeros(3))
    rng = np.random.default_rng(6)
    loads = [GaussMarkov("load_1", 5.0, 0.5), GaussMarkov("load_3", 5.0, 0.5)]
    drawn = draw_loads(loads, truth.compiled.loads, 2100, 50.0, rng)
    clean = integrate(truth.compiled, truth.blocks.p, drawn, rate=50.0, start=np.zeros(6), substeps=4).readings
    readings = clean + np.sqrt(truth.blocks.noise) * rng.standard_normal(clean.shape)
    readings[rng.random(readings.shape) < 0.05] = np.nan
    return np.zeros((2100, 3)), readings


@pytest.fixture(scope="module")
def whole(record: tuple[Array, Array]) -> tuple[Online, History]:
    return advance(build, begin(*PRIOR, FIRST, (3, 3)), *record)


def test_on_line_is_as_good_as_the_whole_record_at_once(record: tuple[Array, Array], whole: tuple[Online, History]):
    online, history = whole
    online, last = finish(build, online)
    assert online.samples == 2100
    assert last.samples.tolist() == [2100]
    mode = posterior_mode(build, *record, prior=PRIOR, start=PRIOR)
    std = np.sqrt(np.diag(mode.cov))
    assert np.all(np.abs(online.theta - mode.mean) < 0.1 * std)
    np.testing.assert_allclose(np.sqrt(np.diag(online.cov)), std, rtol=0.15)
    assert np.all(np.abs(online.theta) < 3.5 * std)
    assert history.samples[0] == FIRST
    assert {200, 400, 800, 1600} <= set(history.samples.tolist())
    assert np.all(np.diff(history.samples) > 0)


def test_pieces_of_any_length_give_the_same_bit_for_bit(record: tuple[Array, Array], whole: tuple[Online, History]):
    online, history = whole
    pieces, rows = begin(*PRIOR, FIRST, (3, 3)), []
    cuts = [0, 1, 37, 199, 200, 504, 1599, 1603, 2099, 2100]
    for first, last in pairwise(cuts):
        pieces, part = advance(build, pieces, record[0][first:last], record[1][first:last])
        rows.append(part)
    for field in ("theta", "precision", "inputs", "readings", "samples"):
        np.testing.assert_array_equal(getattr(pieces, field), getattr(online, field))
    for field, expected in zip(History._fields, history, strict=True):
        np.testing.assert_array_equal(np.concatenate([getattr(part, field) for part in rows]), expected)


@pytest.mark.parametrize("cut", [100, 300, 1800])
def test_a_run_that_was_interrupted_goes_on_bit_for_bit(
    record: tuple[Array, Array], whole: tuple[Online, History], tmp_path: Path, cut: int
):
    online, history = whole
    stopped, before = advance(build, begin(*PRIOR, FIRST, (3, 3)), record[0][:cut], record[1][:cut])
    checkpoint = Checkpoint(tmp_path / "checkpoint.npz", {})
    checkpoint.write(stored(stopped, before), {})
    with checkpoint.opened() as arrays:
        again, kept = restored(build, arrays)
    assert again.reached == cut
    resumed, after = advance(build, again, record[0][cut:], record[1][cut:])
    np.testing.assert_array_equal(resumed.theta, online.theta)
    np.testing.assert_array_equal(resumed.precision, online.precision)
    np.testing.assert_array_equal(np.concatenate([kept.mean, after.mean]), history.mean)


def test_filters_that_lost_their_way_are_found_anew_while_all_samples_are_held(record: tuple[Array, Array]):
    inputs, readings = record
    early = advance(build, begin(*PRIOR, FIRST, (3, 3)), inputs[:250], readings[:250])[0]
    assert early.bank is not None
    lost = early._replace(bank=early.bank._replace(mean=np.full_like(early.bank.mean, np.nan)))
    sound, mended = (advance(build, begun, inputs[250:320], readings[250:320])[0] for begun in (early, lost))
    assert sound.samples == mended.samples > early.samples
    assert np.all(np.abs(mended.theta - sound.theta) < 0.2 * np.sqrt(np.diag(sound.cov)))


def test_memory_does_not_grow_with_the_record(whole: tuple[Online, History]):
    online, _ = whole
    assert online.samples >= 8 * FIRST
    assert len(online.readings) < online.samples // 20 + FIRST


def test_a_file_that_is_no_checkpoint_is_refused(whole: tuple[Online, History], tmp_path: Path):
    path = tmp_path / "checkpoint.npz"
    checkpoint = Checkpoint(path, {})
    checkpoint.write(stored(*whole), {})
    whole_file = path.read_bytes()
    for content in (b"", b"not a checkpoint", whole_file[:300], whole_file[: len(whole_file) // 2]):
        path.write_bytes(content)
        with (
            pytest.raises(ConfigurationError, match=r"expected a checkpoint of this version, got something else"),
            checkpoint.opened() as arrays,
        ):
            restored(build, arrays)
