"""Checkpoints: written whole, read by the call that wrote them, refused in one line else."""

from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.identification.streaming.checkpoint import Checkpoint

CALL = {"rate": 5.0, "sensors": [{"channel": "a"}], "memory": None}


@pytest.fixture
def written(tmp_path: Path) -> Checkpoint:
    checkpoint = Checkpoint(tmp_path / "state.npz", CALL)
    checkpoint.write({"values": np.arange(3.0)}, {"samples": 7, "notes": ["one"]})
    return checkpoint


def test_the_same_call_reads_what_was_written(written: Checkpoint):
    assert written.progress() == {"samples": 7, "notes": ["one"]}
    with written.opened() as arrays:
        np.testing.assert_array_equal(arrays["values"], np.arange(3.0))
    assert Checkpoint(written.path.with_name("none.npz"), CALL).progress() is None


def test_another_call_is_refused_with_what_differs(written: Checkpoint):
    other = written._replace(call={**CALL, "rate": 6.0, "memory": 1.0})
    with pytest.raises(ConfigurationError, match=r"another call, which differs in rate, memory: .* delete") as caught:
        other.progress()
    assert "\n" not in str(caught.value)


def test_a_checkpoint_of_an_earlier_version_is_refused_in_one_line(tmp_path: Path):
    path = tmp_path / "old.npz"
    np.savez(path, call=np.asarray("{}"), progress=np.asarray("{}"), power=np.zeros(3))
    with pytest.raises(ConfigurationError, match="one of an earlier version: delete it to begin anew") as caught:
        Checkpoint(path, CALL).progress()
    assert len(str(caught.value)) < 160 + len(str(path))


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04"])
def test_a_file_that_is_no_checkpoint_is_refused_and_left_alone(tmp_path: Path, content: bytes):
    path = tmp_path / "state.npz"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match="expected a checkpoint of this version, got something else"):
        Checkpoint(path, CALL).progress()
    assert path.read_bytes() == content


def test_arrays_of_another_problem_are_refused(written: Checkpoint):
    with pytest.raises(ConfigurationError, match="got something else"), written.opened() as arrays:
        arrays["power"]
