"""A run that stops, is written to a file and goes on from it ends, bit for bit, where it would have ended."""

from pathlib import Path

import numpy as np
import pytest

from tests.filters.test_protocol import MODELS, assert_same, chain_with, every_filter, every_model, record
from windsysid.errors import ConfigurationError, OutputError
from windsysid.filters import EKF, Filter, Info, load_belief, save_belief


@every_filter
@every_model
def test_a_run_from_a_checkpoint_is_the_uninterrupted_run(filter_: Filter, name: str, tmp_path: Path):
    model = MODELS[name]()
    inputs, readings = record(model)
    whole, info = filter_.run(model, filter_.init(model), inputs, readings)
    belief, first = filter_.run(model, filter_.init(model), inputs[:23], readings[:23])
    save_belief(tmp_path / "state.npz", model, belief)
    restored = load_belief(tmp_path / "state.npz", MODELS[name]())
    assert_same(restored, belief)
    belief, second = filter_.run(model, restored, inputs[23:], readings[23:])
    assert_same(belief, whole)
    assert_same(Info(*(np.concatenate(parts) for parts in zip(first, second, strict=True))), info)


def test_a_checkpoint_takes_the_place_of_the_last_one_and_leaves_nothing_beside_it(tmp_path: Path):
    model = chain_with()
    belief = EKF.init(model)
    save_belief(tmp_path / "state", model, belief)  # the name is kept as it is given
    with pytest.raises(OutputError, match="is already there"):
        save_belief(tmp_path / "state", model, belief._replace(samples=7))
    assert load_belief(tmp_path / "state", model).samples == 0
    save_belief(str(tmp_path / "state"), model, belief._replace(samples=7), overwrite=True)
    assert load_belief(tmp_path / "state", model).samples == 7
    assert [path.name for path in tmp_path.iterdir()] == ["state"]


def test_a_truncated_checkpoint_is_refused_wherever_it_ends(tmp_path: Path):
    model = chain_with()
    whole, cut = tmp_path / "whole.npz", tmp_path / "cut.npz"
    save_belief(whole, model, EKF.init(model))
    content = whole.read_bytes()
    for length in range(0, len(content) - 1, 37):
        cut.write_bytes(content[:length])
        with pytest.raises(
            ConfigurationError, match=r"cut\.npz: expected a file written by save_belief, got one that is damaged"
        ):
            load_belief(cut, model)


def test_a_damaged_checkpoint_is_refused_or_harmless(tmp_path: Path):
    model = chain_with()
    belief = EKF.init(model)
    path = tmp_path / "state.npz"
    save_belief(path, model, belief)
    content = bytearray(path.read_bytes())
    refused = 0
    for place in range(0, len(content), 23):
        damaged = content.copy()
        damaged[place] ^= 0xFF
        path.write_bytes(bytes(damaged))
        try:
            assert_same(load_belief(path, model), belief)  # a date or a flag that nobody reads
        except ConfigurationError:
            refused += 1
    assert refused > 0.7 * len(content) / 23


def test_files_that_are_no_checkpoints_are_refused(tmp_path: Path):
    model = chain_with()
    text, array, archive = tmp_path / "a.txt", tmp_path / "b.npy", tmp_path / "c.npz"
    text.write_text("time [s],tower_x_acceleration\n0,1\n")
    np.save(array, np.zeros(3))
    np.savez(archive, mean=np.zeros(6))
    for path in (text, array, archive, tmp_path):
        with pytest.raises(ConfigurationError, match="expected a file written by save_belief"):
            load_belief(path, model)
    with pytest.raises(ConfigurationError, match="no such file"):
        load_belief(tmp_path / "none.npz", model)


def test_a_checkpoint_of_another_model_is_refused(tmp_path: Path):
    with_loads, without = MODELS["chain_with_loads"](), chain_with()
    save_belief(tmp_path / "state.npz", with_loads, EKF.init(with_loads))
    with pytest.raises(
        ConfigurationError, match=r"belongs to another model: expected the states q_1, .* got .* load_3"
    ):
        load_belief(tmp_path / "state.npz", without)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path):
    model = chain_with()
    (tmp_path / "file").write_text("precious")
    with pytest.raises(OutputError, match=r"cannot be written: .*file is a file; choose a folder"):
        save_belief(tmp_path / "file" / "state.npz", model, EKF.init(model))
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="is a folder, expected the name of a file"):
        save_belief(tmp_path / "folder", model, EKF.init(model), overwrite=True)
    save_belief(tmp_path / "new" / "state.npz", model, EKF.init(model))
    assert load_belief(tmp_path / "new" / "state.npz", model).samples == 0
