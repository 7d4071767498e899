"""TOML and JSON from outside end in values or in one ValueError, in time and memory that their length bounds."""

import os
import time

import pytest

from windsysid.configuration import MAX_TOML_CHARACTERS, parse_json, parse_toml
from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.fleet.members import read_fleet
from windsysid.live.configuration.settings import SettingsError, read_settings
from windsysid.mechanics.sensor_lists import read_sensors
from windsysid.monitoring.covariates import read_covariates
from windsysid.records.formats import load_mapping, read_record
from windsysid.turbine.file import load_turbine

N = 100_000


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * N) + " = 1",
        "[" + ".".join("a" * N) + "]",
        "[[" + " . ".join(["'a'"] * N) + "]]",
        "x = { " + ".".join(['"b"'] * N) + " = 1 }",
        "x = " + "[" * N,
        "x = " + "{ a = " * N,
        'x = "' + '\\"' * N,
        "-" * 10 * N,
        "x = " + "9" * N,
        "#" * (MAX_TOML_CHARACTERS + 1),
    ],
)
def test_toml_that_is_nested_without_end_is_refused_at_once(text):
    began = time.process_time()
    with pytest.raises(ValueError, match=r"\S"):
        parse_toml(text)
    assert time.process_time() - began < 5.0


def test_sound_toml_is_parsed_as_ever():
    text = 'a.b.c = 1\n[x."y.z".t]\nurl = "a.b.c.d.e.f.g.h"  # see 1. 2. 3. 4. 5. 6. 7. 8. 9. 10. 11.\nv = [1.5, 2.5]\n'
    found = parse_toml(text)
    assert found["a"]["b"]["c"] == 1
    assert found["x"]["y.z"]["t"]["v"] == [1.5, 2.5]


def test_json_that_is_nested_without_end_is_a_value_error():
    assert parse_json('{"a": [1]}') == {"a": [1]}
    with pytest.raises(ValueError, match="nested too deeply"):
        parse_json("[" * N)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize(
    ("read", "error"),
    [
        (load_turbine, ConfigurationError),
        (load_mapping, ConfigurationError),
        (read_sensors, ConfigurationError),
        (read_fleet, ConfigurationError),
        (read_settings, SettingsError),
        (lambda path: read_covariates(path, 3), ConfigurationError),
    ],
)
def test_a_pipe_or_a_device_is_no_file_of_settings(tmp_path, read, error):
    path = tmp_path / "x.toml"
    os.mkfifo(path)
    with pytest.raises(error, match="is a pipe"):
        read(path)
    path.unlink()
    path.symlink_to("/dev/zero")
    with pytest.raises(error, match="is a device"):
        read(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("name", ["x.csv", "x.h5", "x.mf4", "x.uff", "x.unknown"])
def test_a_pipe_or_a_device_is_no_record(tmp_path, name):
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(WindsysidError, match=f"{name}: is a pipe, expected a file"):
        read_record(path)
    path.unlink()
    path.symlink_to("/dev/zero")
    with pytest.raises(WindsysidError, match=f"{name}: is a device, expected a file"):
        read_record(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize(("given", "other"), [("x.sel", "x.dat"), ("x.$04", "x.%04")])
def test_a_pipe_is_no_second_file_of_a_record(tmp_path, given, other):
    (tmp_path / given).write_text("FILE\n")
    os.mkfifo(tmp_path / other)
    with pytest.raises(WindsysidError, match="has no"):
        read_record(tmp_path / given)
