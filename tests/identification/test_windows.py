"""Pieces give filters the samples that the whole record gives them, however they are cut."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import OutputError
from windsysid.identification.condition.blockwise import BlockwiseConditioner
from windsysid.identification.condition.readings import resample_for_model
from windsysid.identification.condition.samples import SamplesOnDisk, split_evenly
from windsysid.identification.model.fit import known_inputs, known_loads
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.signals import resample
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return load_turbine("tower")


def moving(turbine: Turbine, sensors: Sequence[Sensor], rate: float, duration: float) -> Record:
    """A rotor whose speed wanders, a nacelle that yaws, and sensors that read tones; angles are wrapped."""
    time = 3.7 + np.arange(round(duration * rate)) / rate
    speed = turbine.rotor_speed * (1.0 + 0.03 * np.sin(0.2 * time))
    azimuth = np.mod(np.concatenate([[1.0], 1.0 + np.cumsum(0.5 * (speed[1:] + speed[:-1])) / rate]), 2.0 * np.pi)
    yaw = np.mod(3.0 + 0.5 * np.sin(0.05 * time), 2.0 * np.pi)
    tones = [np.sin(2.0 * np.pi * (0.31 + 0.05 * i) * time + i) for i in range(len(sensors))]
    return Record(
        time, np.column_stack([azimuth, speed, yaw, *tones]),
        ("rotor_azimuth", "rotor_speed", "nacelle_yaw", *(s.channel for s in sensors)),
        ("rad", "rad/s", "rad", *(s.unit for s in sensors)), name="moving",
    )  # fmt: skip


def read_whole(record: Record, turbine: Turbine, sensors: Sequence[Sensor], rate: float | None) -> tuple[Rows, int]:
    part, steps, _ = resample_for_model(record, turbine, rate, sensors)
    seen = seen_by(turbine, sensors, [])
    inputs = np.hstack([known_inputs(part, seen, sensors), known_loads(part, seen)[0]])
    return (part.time, inputs, np.column_stack([part[s.channel] for s in sensors])), steps


def read_pieces(
    record: Record, cuts: Sequence[int], turbine: Turbine, sensors: Sequence[Sensor], rate: float | None
) -> Rows:
    edges = [0, *cuts, record.samples]
    parts = [replace(record, time=record.time[a:b], values=record.values[a:b]) for a, b in pairwise(edges)]
    windows = BlockwiseConditioner(parts[0], turbine, sensors, rate)
    found = [*map(windows.take, parts), windows.finish()]
    rows = [(p.record.time, p.inputs, p.readings) for p in found if p is not None]
    time, inputs, readings = (np.concatenate(columns) for columns in zip(*rows, strict=True))
    return time, inputs, readings


def agree(found: Rows, whole: Rows, within: float) -> None:
    np.testing.assert_allclose(found[0], whole[0], rtol=0.0, atol=1e-9)
    turns = np.round((found[1][:, 0] - whole[1][:, 0]) / (2.0 * np.pi))
    assert np.ptp(turns) == 0.0  # the azimuth goes on
    np.testing.assert_allclose(found[1][:, 1:], whole[1][:, 1:], rtol=0.0, atol=within)
    np.testing.assert_allclose(found[1][:, 0] - 2.0 * np.pi * turns, whole[1][:, 0], rtol=0.0, atol=within)
    np.testing.assert_array_equal(np.isnan(found[2]), np.isnan(whole[2]))
    np.testing.assert_allclose(found[2], whole[2], rtol=0.0, atol=within)


@pytest.mark.parametrize("cuts", [(700,), (333, 1111, 1122, 2500)])
def test_a_rotor_in_pieces_reads_as_the_whole(verne555: Turbine, cuts: Sequence[int]):
    record = moving(verne555, verne555.sensors, 50.0, 60.0).select(
        ["rotor_azimuth", *(s.channel for s in verne555.sensors)]  # the speed is the slope of the azimuth
    )
    whole, _ = read_whole(record, verne555, verne555.sensors, None)
    # a rate that rounding moves by 1e-12 may give the smooth slope two samples more
    agree(read_pieces(record, cuts, verne555, verne555.sensors, None), whole, 1e-4)


def test_a_rotor_without_sensors_on_its_blades_has_inputs_for_what_is_seen(verne555: Turbine):
    """Pieces had inputs of locked blades, too, and ended in an error."""
    tower = [one for one in verne555.sensors if one.channel.startswith("tower")]
    record = moving(verne555, tower, 50.0, 60.0).select(["rotor_azimuth", *(s.channel for s in tower)])
    whole, _ = read_whole(record, verne555, tower, None)
    agree(read_pieces(record, (700,), verne555, tower, None), whole, 1e-4)


@pytest.mark.parametrize("known", ["azimuth", "speed", "nothing"])
def test_a_tower_in_pieces_is_resampled_as_the_whole(tower: Turbine, known: str):
    dropped = {"azimuth": (), "speed": ("rotor_azimuth",), "nothing": ("rotor_azimuth", "rotor_speed")}[known]
    record = moving(tower, tower.sensors, 20.0, 600.0)
    record = record.select([name for name in record.channels if name not in dropped])
    whole, _ = read_whole(record, tower, tower.sensors, None)
    assert 3.5 < 0.5 / np.diff(whole[0]).mean() < 4.5  # two steps for each reading
    # splines remember a cut for a few samples: what is left is a millionth of the tones
    agree(read_pieces(record, (2000, 2050, 7000, 11980), tower, tower.sensors, None), whole, 1e-5)


def test_steps_between_readings_are_those_of_the_whole(verne555: Turbine):
    record = moving(verne555, verne555.sensors, 50.0, 60.0)
    whole, steps = read_whole(record, verne555, verne555.sensors, 12.0)
    assert steps > 1
    agree(read_pieces(record, (700, 1500, 1520), verne555, verne555.sensors, 12.0), whole, 1e-4)


def test_what_is_missing_between_pieces_is_missing(verne555: Turbine):
    record = moving(verne555, verne555.sensors, 50.0, 60.0)
    kept = np.r_[0:1000, 1400:3000]
    part = replace(record, time=record.time[kept], values=record.values[kept])
    whole, steps = read_whole(part.on_uniform_grid(), verne555, verne555.sensors, None)
    assert steps == 2
    found = read_pieces(part, (1000, 1700), verne555, verne555.sensors, None)
    assert np.isfinite(found[2][0:2000:2]).all()
    assert np.isnan(found[2][2000:2800]).all()
    agree(found, whole, 1e-4)


def test_samples_on_disk_come_back_in_even_blocks(tmp_path: Path):
    rng = np.random.default_rng(1)
    inputs, readings = rng.standard_normal((2500, 3)), rng.standard_normal((2500, 2))
    readings[5] = np.nan
    samples = SamplesOnDisk((3, 2), tmp_path)
    for cut in (slice(0, 7), slice(7, 2000), slice(2000, None)):
        samples.append(inputs[cut], readings[cut])
    assert samples.count == 2500
    for _ in range(2):
        blocks = list(samples)
        np.testing.assert_array_equal(np.concatenate([u for u, _ in blocks]), inputs)
        np.testing.assert_array_equal(np.concatenate([y for _, y in blocks]), readings)
    np.testing.assert_array_equal(samples.rows(1990, 2010)[1], readings[1990:2010])
    assert not list(tmp_path.iterdir())  # the file has no name
    samples.close()
    parts = split_evenly(250_001, every=4)
    assert [part.start % 4 for part in parts] == [0, 0, 0]
    assert [parts[0].start, parts[-1].stop] == [0, 250_001]
    assert max(part.stop - part.start for part in parts) - min(part.stop - part.start for part in parts) < 8


def test_a_disk_without_room_is_one_clear_line(tmp_path: Path):
    with pytest.raises(OutputError, match="cannot be written"):
        SamplesOnDisk((3, 2), tmp_path / "missing")
    samples = SamplesOnDisk((1, 1), tmp_path)

    class Full:
        def seek(self, *_: int) -> int:
            return 0

        def write(self, _: bytes) -> int:
            raise OSError(28, "No space left on device")

    samples._file = Full()  # type: ignore[assignment]
    with pytest.raises(OutputError, match=r"No space left on device; choose an output on a disk with more space"):
        samples.append(np.zeros((2, 1)), np.zeros((2, 1)))


def test_resampling_alone_is_what_the_pieces_do(tower: Turbine):
    # one channel against `resample` itself, far from the ends
    record = moving(tower, tower.sensors, 20.0, 600.0)
    time, _, readings = read_pieces(record, (3000, 6000, 9000), tower, tower.sensors, None)
    rate = 0.5 / np.diff(time).mean()  # two steps for each reading
    alone = resample(record, rate)[tower.sensors[0].channel]
    np.testing.assert_allclose(readings[::2, 0], alone[: len(readings[::2])], atol=1e-5)
