"""Spectra of records in pieces: sums over blocks say what the whole says."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.findings import codes, only, reasons
from tests.identification.fits import identify_without_effects as identify
from tests.identification.fits import std_of_model
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.record import simulate_record
from windsysid.spectral.transforms.block_sums import BlockSums, factored
from windsysid.spectral.transforms.lifted import lift
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

LENGTH = 300.0
"""Of a piece of the tower's record [s]."""


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return load_turbine("tower").exact()  # bands of masses and gains do not shrink with more pieces


@pytest.fixture(scope="module")
def whole(tower: Turbine) -> Record:
    return simulate_record(tower, duration=1500.0, rate=5.0, seed=5)


@pytest.fixture(scope="module")
def straight(tower: Turbine, whole: Record) -> Identification:
    return identify_pieces(pieces(whole), tower, formulation="spectral")


def pieces(record: Record, seconds: float = LENGTH) -> list[Record]:
    n = round(seconds * record.rate)
    firsts = range(0, record.samples - 1, n)
    return [replace(record, time=record.time[i : i + n], values=record.values[i : i + n]) for i in firsts]


def apart(one: Identification, other: Identification) -> np.ndarray:
    """Differences of the estimates in standard deviations of the other."""
    return np.array([(a.estimate - b.estimate) / b.std for a, b in zip(one.estimates, other.estimates, strict=True)])


def test_one_piece_says_what_the_record_says(tower: Turbine, whole: Record) -> None:
    part = pieces(whole, 750.0)[0]  # long enough for independent bins, as those of several pieces are
    assert np.abs(apart(identify_pieces([part], tower, formulation="spectral"),
                        identify(part, tower, formulation="spectral"))).max() < 1e-3  # fmt: skip


@pytest.mark.slow
def test_one_piece_of_a_rotor_says_what_the_record_says(verne555: Turbine) -> None:
    record = simulate_record(verne555, duration=40.0, rate=50.0, seed=2)
    found = identify_pieces([record], verne555, formulation="spectral", loads="broadband")
    expected = identify(record, verne555, formulation="spectral", loads="broadband")
    assert np.abs(apart(found, expected)).max() < 0.02
    assert "one_block" in codes(reasons(found))


def test_pieces_and_the_whole_agree(tower: Turbine, whole: Record, straight: Identification) -> None:
    """The taper takes 6 % of the whole's ends and hardly any of the blocks': by chance that is √0.06 of a standard
    deviation."""
    found, expected = straight, identify(whole, tower, formulation="spectral")
    assert np.sqrt(np.mean(apart(found, expected) ** 2)) < 0.5
    ratio = [std_of_model(found, e.name) / std_of_model(expected, e.name) for e in found.estimates]
    assert ratio == pytest.approx(np.ones(len(ratio)), abs=0.15)
    blocks = only(found.findings, "blocks").data
    assert (blocks["blocks"], blocks["duration"]) == (5, pytest.approx(300.0, rel=1e-3))
    assert found.samples == whole.samples


def test_records_of_one_machine_add(tower: Turbine, whole: Record) -> None:
    """Two records a day apart, of which each has what is left at its end cut off."""
    parts = pieces(whole)
    day = replace(parts[1], time=parts[1].time + 86400.0)
    one = identify_pieces(parts[:1], tower, formulation="spectral")
    both = identify_pieces([parts[0], day], tower, formulation="spectral")
    assert only(both.findings, "blocks").data["blocks"] == 2
    side = [r.estimates[0] for r in (one, both)]
    assert side[1].std == pytest.approx(side[0].std / np.sqrt(2.0), rel=0.15)


def test_what_is_forgotten_counts_no_more(tower: Turbine, whole: Record, straight: Identification) -> None:
    parts = pieces(whole)
    late = identify_pieces(parts, tower, formulation="spectral", memory=50.0)
    last = identify_pieces(parts[-1:], tower, formulation="spectral")
    assert late.estimates[0].std == pytest.approx(last.estimates[0].std, rel=0.25)
    assert late.estimates[0].std > 1.5 * straight.estimates[0].std
    assert 0.0 < only(late.findings, "blocks").data["weight"] < 5.0


def _read(record: Record, turbine: Turbine) -> np.ndarray:
    """Which channels are accelerometers."""
    return np.isin(record.channels, [sensor.channel for sensor in turbine.sensors])


def _stopping(of: Sequence[Record], after: int) -> Iterator[Record]:
    yield from of[:after]
    raise KeyboardInterrupt


def test_an_interrupted_run_ends_where_an_uninterrupted_one_ends(
    tower: Turbine, whole: Record, straight: Identification, tmp_path: Path
) -> None:
    checkpoint = tmp_path / "state.npz"
    with pytest.raises(KeyboardInterrupt):
        identify_pieces(_stopping(pieces(whole), 3), tower, formulation="spectral", checkpoint=checkpoint)
    assert checkpoint.exists()
    resumed = identify_pieces(pieces(whole), tower, formulation="spectral", checkpoint=checkpoint)
    assert not checkpoint.exists()
    assert np.array_equal(resumed.cov, straight.cov)
    assert [e.estimate for e in resumed.estimates] == [e.estimate for e in straight.estimates]
    assert resumed.findings == straight.findings


def test_another_call_does_not_take_the_state_up(tower: Turbine, whole: Record, tmp_path: Path) -> None:
    checkpoint = tmp_path / "state.npz"
    with pytest.raises(KeyboardInterrupt):
        identify_pieces(_stopping(pieces(whole), 2), tower, formulation="spectral", checkpoint=checkpoint)
    with pytest.raises(ConfigurationError, match="another call"):
        identify_pieces(pieces(whole), tower, formulation="spectral", checkpoint=checkpoint, memory=100.0)
    changed = replace(whole, values=np.where(_read(whole, tower), 1.1, 1.0) * whole.values)
    changed = replace(whole, values=np.where((whole.time > 250.0)[:, None], changed.values, whole.values))
    with pytest.raises(ConfigurationError, match="record"):
        identify_pieces(pieces(changed), tower, formulation="spectral", checkpoint=checkpoint)


def test_halves_that_differ_are_not_trusted(tower: Turbine, whole: Record) -> None:
    louder = np.where(whole.time > 750.0, 5.0, 1.0)[:, None]
    values = np.where(_read(whole, tower), louder, 1.0) * whole.values
    found = identify_pieces(pieces(replace(whole, values=values)), tower, formulation="spectral")
    assert "nonstationary" in codes(reasons(found))


@pytest.fixture(scope="module")
def machine() -> Turbine:
    return load_turbine("nrel5mw").exact()


@pytest.fixture(scope="module")
def turning(machine: Turbine) -> Record:
    """A real machine's rotor in wind, which is read in bands."""
    return simulate_record(machine, duration=360.0, rate=12.5, seed=31, loads="wind")


@pytest.fixture(scope="module")
def expected(machine: Turbine, turning: Record) -> Identification:
    return identify(turning, machine, formulation="spectral")


@pytest.mark.slow
def test_one_piece_in_bands_says_what_the_record_says(
    machine: Turbine, turning: Record, expected: Identification
) -> None:
    found = identify_pieces([turning], machine, formulation="spectral")
    assert np.abs(apart(found, expected)).max() < 1e-3
    assert "one_block" in codes(reasons(found))


@pytest.mark.slow
def test_pieces_in_bands_agree_with_the_whole(machine: Turbine, turning: Record, expected: Identification) -> None:
    found = identify_pieces(pieces(turning, 120.0), machine, formulation="spectral")
    blocks = only(found.findings, "blocks").data
    assert (blocks["blocks"], blocks["duration"]) == (3, pytest.approx(120.0, rel=1e-3))
    assert np.sqrt(np.mean(apart(found, expected) ** 2)) < 0.5
    of_blades = [e.std / expected[e.name].std for e in found.estimates if "beta" in e.name]
    assert of_blades == pytest.approx(np.ones(len(of_blades)), abs=0.3)


@pytest.mark.slow
def test_a_rotor_whose_modes_are_many_turns_up_comes_in_pieces() -> None:
    """It is read in bands whatever its damping."""
    slow = replace(load_turbine("nrel5mw_full").exact(), rotor_speed=0.9)
    record = simulate_record(slow, duration=240.0, rate=12.5, seed=4, loads="wind")
    assert identify_pieces(pieces(record, 120.0), slow, formulation="spectral").samples == record.samples


def test_halves_in_bands_that_differ_are_not_trusted(machine: Turbine, turning: Record) -> None:
    louder = np.where(turning.time > 180.0, 5.0, 1.0)[:, None]
    values = np.where(_read(turning, machine), louder, 1.0) * turning.values
    found = identify_pieces(pieces(replace(turning, values=values), 90.0), machine, formulation="spectral")
    assert "nonstationary" in codes(reasons(found))
    assert "narrow_resonance_in_bands_of_pieces" in codes(reasons(found))


def test_pieces_of_few_turns_are_refused(verne555: Turbine) -> None:
    record = simulate_record(verne555, duration=10.0, rate=50.0, seed=2)
    for seconds in (0.5, 1.0, 3.0):
        with pytest.raises(RecordError, match=r"make them longer|at least one revolution"):
            identify_pieces(pieces(record, seconds), verne555, formulation="spectral")


def test_a_speed_that_varies_within_pieces_is_seen(verne555: Turbine) -> None:
    record = simulate_record(verne555, duration=80.0, rate=50.0, seed=2)
    speed = record["rotor_speed"] * (1.0 + 0.1 * np.sin(2.0 * np.pi * 0.25 * record.time))
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / record.rate])
    varying = record.with_channels({"rotor_speed": (speed, "rad/s"), "rotor_azimuth": (psi % (2.0 * np.pi), "rad")})
    with pytest.raises(RecordError, match="speed varies by ±7"):
        identify_pieces(pieces(varying, 20.0), verne555, formulation="spectral")


def test_options_of_the_other_formulation_are_refused(tower: Turbine, whole: Record) -> None:
    with pytest.raises(ConfigurationError, match="rate"):
        identify_pieces([whole], tower, formulation="spectral", rate=2.0)
    with pytest.raises(ConfigurationError, match="memory"):
        identify_pieces([whole], tower, memory=10.0)
    with pytest.raises(RecordError, match="no pieces"):
        identify_pieces([], tower, formulation="spectral")


def test_sums_hold_the_products_of_all_blocks() -> None:
    rng = np.random.default_rng(1)
    psi = np.asarray(2.0 * np.pi * 0.2 * np.arange(1000) / 10.0, dtype=np.float64)
    blocks = [lift(rng.normal(size=(1000, 2)), psi, 10.0, 1) for _ in range(3)]
    sums = BlockSums.of(blocks[0]).plus(blocks[1]).plus(blocks[2], memory=0.5)
    flat = [block.data.reshape(len(block.data), -1) for block in blocks]
    expected = sum(w * y[:, :, None] * y[:, None, :].conj() for w, y in zip((0.5, 0.5, 1.0), flat, strict=True))
    assert sums.blocks == 2.0
    assert sums.power == pytest.approx(expected, abs=1e-12)
    root = factored(sums.power)
    assert root @ np.conj(np.swapaxes(root, 1, 2)) == pytest.approx(sums.power, abs=1e-12)
    assert sums.gusts < 1.1
