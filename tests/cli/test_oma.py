import json

import numpy as np
import pytest

import windsysid as ws
from tests.spectral.test_oma import RATE, record_of, two_modes


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    file = tmp_path_factory.mktemp("records") / "record.nc"
    ws.write_record(record_of(two_modes(0), RATE), file)
    return file


def test_bands_are_given_as_two_numbers_any_number_of_times(run, path, tmp_path):
    done = run(
        "oma", "--band", 0.9, 1.3, path, "--band", 2.4, 3.0, "--output", tmp_path / "out", "--json", "--no-report"
    )
    assert done.code == 0, done.err
    summary = json.loads(done.out)
    assert np.round([mode["frequency"]["estimate"] for mode in summary["modes"]], 1).tolist() == [1.1, 2.7]
    assert sorted(file.name for file in (tmp_path / "out").iterdir() if not file.name.startswith(".")) == [
        "answer.json",
        "summary.json",
    ]


def test_a_sensor_list_places_the_shapes(run, path, tmp_path):
    tables = [
        f'[[sensor]]\nchannel = "floor_{i}_displacement"\nposition = [0, 0, {3 * i}]\ndirection = [1, 0, 0]\n'
        for i in (1, 2, 3)
    ]
    (tmp_path / "sensors.toml").write_text("\n".join(tables))
    done = run("oma", path, "--sensors", tmp_path / "sensors.toml", "--output", tmp_path / "out", "--section", 0, 400)
    assert done.code == 0, done.err
    assert "mode 2" in done.out
    assert not list((tmp_path / "out").glob("*.png"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--band", "one", "two"), "--band: expected two frequencies in Hz, such as --band 0.9 1.1, got 'one two'"),
        (("--section", "0", "5"), "samples are too few for modes"),
    ],
)
def test_bad_input_ends_in_one_line(run, path, tmp_path, options, message):
    done = run("oma", path, *options, "--output", tmp_path / "out")
    assert done.code == 2
    (line,) = done.err
    assert message in line


def test_a_sensor_list_with_a_channel_that_is_not_there_says_so(run, path, tmp_path):
    (tmp_path / "sensors.toml").write_text('[[sensor]]\nchannel = "roof"\n')
    done = run("oma", path, "--sensors", tmp_path / "sensors.toml", "--output", tmp_path / "out")
    assert done.code == 2
    (line,) = done.err
    assert "no channel 'roof'" in line


def test_modes_by_hand_and_decays_have_clear_errors(run, path, tmp_path):
    (tmp_path / "modes.toml").write_text("add = [[2, 1]]")
    for options, message in (
        (("--modes", tmp_path / "modes.toml"), "two rising frequencies"),
        (("--decay", "--band", 0.9, 1.3), "--band cannot be combined with --decay"),
        (("--decay", "--section", 0, 100), "expected a free decay, got none"),
    ):
        done = run("oma", path, *options, "--output", tmp_path / "out")
        assert done.code == 2
        (line,) = done.err
        assert message in line
