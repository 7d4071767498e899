"""The command line: what it does, and how it refuses. Bad input ends in one line on standard error and exit code 2."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import windsysid
from tests.conftest import Ended
from windsysid import cli
from windsysid.cli.common import register_commands
from windsysid.cli.program import _name_options
from windsysid.errors import RecordError
from windsysid.records.formats import read_record, write_record
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

OUTB = Path(__file__).parents[3] / "shared" / "data" / "openfast" / "a2_rot12_decay_min.outb"


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good record: 20 s of verne555."""
    path = tmp_path_factory.mktemp("records") / "good.csv"
    write_record(simulate_record(load_turbine("verne555"), duration=20.0, rate=100.0, seed=1), path)
    return path


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return tmp_path / "results"


def refused(ended: Ended, complaint: str) -> None:
    """One line that says what was wrong, exit code 2, nothing else."""
    assert ended.code == 2, ended
    assert len(ended.err) == 1, ended.err
    assert ended.err[0].startswith("windsysid: ")
    assert re.search(complaint, ended.err[0]), ended.err[0]
    assert "Traceback" not in ended.err[0]
    assert ended.out == ""


# bad records


def edited(record: Path, folder: Path, edit) -> Path:
    """A copy of the good record whose lines went through `edit`."""
    lines = record.read_text().splitlines()
    path = folder / "bad.csv"
    path.write_text("\n".join(edit(lines)) + "\n")
    return path


def cell(lines: list[str], row: int, column: int, text: str) -> list[str]:
    cells = lines[row].split(",")
    cells[column] = text
    return [*lines[:row], ",".join(cells), *lines[row + 1 :]]


def column(lines: list[str], number: int, text: str) -> list[str]:
    for row in range(1, len(lines)):
        lines = cell(lines, row, number, text)
    return lines


def without(lines: list[str], number: int) -> list[str]:
    return [",".join(c for i, c in enumerate(line.split(",")) if i != number) for line in lines]


@pytest.mark.parametrize(
    ("edit", "complaint"),
    [
        (lambda lines: lines[:1], r"(0|no) rows? under the header"),
        (lambda lines: lines[:2], "expected at least 2"),
        (lambda lines: cell(lines, 7, 3, "much"), r"column 'tower_x_acceleration .*line 8: 'much' is not a number"),
        (lambda lines: cell(lines, 7, 3, "inf"), "'tower_x_acceleration' is infinite at line 8"),
        (lambda lines: [*lines[:5], lines[6], lines[5], *lines[7:]], "the time runs backwards at line 7"),
        (lambda lines: [*lines[:6], lines[5], *lines[6:]], "the time is repeated at line 7"),
        (lambda lines: cell(lines, 9, 0, ""), "the time at line 10 is nan"),
        (lambda lines: column(lines, 3, ""), "channel 'tower_x_acceleration' holds no numbers"),
        (lambda lines: column(lines, 1, "nan"), "channel 'rotor_azimuth': expected angles, got no numbers"),
        (lambda lines: without(lines, 1), "no channel 'rotor_azimuth'"),
        pytest.param(
            lambda lines: without(without(lines[:], 3), 2)[:40], "expected at least one revolution",
            marks=pytest.mark.slow,
        ),
        (lambda lines: cell(lines, 0, 3, "tower_x_acceleration [m/s]"), r"expected a unit of acceleration .*got m/s;"),
        (lambda lines: cell(lines, 0, 3, "tower_x_acceleration [furlong]"), "unknown unit 'furlong'"),
        (lambda lines: cell(lines, 0, 1, "rotor_azimuth [N]"), "'rotor_azimuth': expected rad, got N"),
        (lambda lines: cell(lines, 0, 2, "rotor_speed [rpm]"),
        "rotor_azimuth turns at 7.288 rad/s but rotor_speed says"),
        (lambda lines: [lines[0], *lines[1::10]], "expected at least 10.1 samples per second"),
        (lambda lines: [*lines[:500], lines[500][:30]], "cells, expected 8 as in the header; the file may be cut off"),
    ],
)  # fmt: skip
def test_a_bad_record_is_refused_in_one_line(run, record, tmp_path, results, edit, complaint):
    bad = edited(record, tmp_path, edit)
    refused(run("identify", bad, "--turbine", "verne555", "--output", results, "--no-report"), complaint)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.csv"]


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("empty.csv", b"", "the file is empty"),
        ("rubbish.csv", bytes(range(256)) * 9, "binary"),
        ("rubbish.nc", bytes(range(256)) * 9, "is not netCDF-4"),
        ("rubbish.out", bytes(range(256)) * 9, "is binary, not text"),
        ("rubbish.outb", bytes(range(255, -1, -1)) * 9, "is not OpenFAST binary output"),
        ("cut.nc", b"\x89HDF\r\n\x1a\n" + bytes(200), "damaged or cut off"),
        ("sheet.xlsx", b"PK\x03\x04", "unknown ending '.xlsx'"),
    ],
)
def test_a_file_that_is_no_record_is_refused_in_one_line(run, tmp_path, results, name, content, complaint):
    (tmp_path / name).write_bytes(content)
    refused(run("identify", tmp_path / name, "--turbine", "verne555", "--output", results), complaint)
    assert not results.exists()


@pytest.mark.skipif(not OUTB.is_file(), reason="the OpenFAST records are not beside this checkout")
@pytest.mark.parametrize("kept", [0.6, 0.001])
def test_a_cut_off_outb_is_refused_in_one_line(run, tmp_path, results, kept):
    content = OUTB.read_bytes()
    (tmp_path / "cut.outb").write_bytes(content[: int(kept * len(content))])
    refused(
        run("identify", tmp_path / "cut.outb", "--turbine", "nrel5mw", "--output", results),
        "is cut off|is not OpenFAST",
    )


def test_what_is_no_result_is_refused_with_what_to_do(run, record):
    made = "give the folder of a result; windsysid identify RECORD makes one$"
    refused(run("compare", record, record), f"expected a result of windsysid identify or oma, got a file: {made}")
    refused(run("modes", record), f"a result of windsysid identify, got a file: {made}")


def test_what_is_not_there_or_a_folder_is_refused(run, record, tmp_path, results):
    common = ("--turbine", "verne555", "--output", results)
    refused(run("identify", tmp_path, *common), "is a folder, expected a record")
    refused(run("identify", tmp_path / "nowhere.csv", *common), "no such file")
    refused(run("identify", record, "--turbine", "nordex", "--output", results), "no turbine 'nordex'")


# bad options


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--section", "10", "30"), "the section 10 to 30 s reaches outside the record"),
        (("--section", "10", "5"), "expected start before end"),
        (("--section", "nan", "5"), "expected start before end"),
        (("--section", "1", "1.5"), "expected at least one revolution"),
        (("--prior-scale", "0"), "prior scale of stiffness: expected a factor between 0.05 and 20, got 0"),
        (("--prior-scale", "-1"), "prior scale of stiffness: expected a factor"),
        (("--prior-scale", "nan"), "prior scale of stiffness: expected a factor"),
        (("--prior-scale", "1e6"), "prior scale of stiffness: expected a factor"),
        (("--add-noise", "-1"), "added noise: expected a percentage between 0 and 1000, got -1"),
        (("--add-noise", "nan"), "added noise: expected a percentage"),
        (
            ("--turbine", "nordex"),
            "no turbine 'nordex': expected one of hammond, nrel5mw, nrel5mw_full, tower, verne555",
        ),
        (("--turbine", "nowhere.toml"), r"nowhere\.toml: no such file, expected a turbine file"),
        (("--sensors", "nowhere.toml"), r"nowhere\.toml: no such file, expected a TOML file"),
    ],
)
def test_a_bad_option_is_refused_in_one_line(run, record, results, options, complaint):
    base = ("identify", record, "--turbine", "verne555", "--output", results, "--no-report")
    refused(run(*base, *options), complaint)
    assert not results.exists()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("no TOML at all", r"sensors\.toml: is not a TOML file"),
        ("", "expected .*sensor.* tables and nothing else, got an empty file"),
        ("sensor = []", "the sensor list is empty"),
        ('[[sensor]]\nchannel = "a"\n', "sensor 1: 'quantity' is missing"),
        (
            '[[sensor]]\nchannel="nacelle"\nquantity="acceleration"\npoint="tower"\naxis="x"\nnoise=0.1\n',
            "has no channel 'nacelle'",
        ),
        (
            '[[sensor]]\nchannel="tower_x_acceleration"\nquantity="acceleration"\npoint="tower"\naxis="x"\nnoise=0\n',
            "noise: .* greater than 0, got 0",
        ),
    ],
)
def test_a_bad_sensor_list_is_refused_in_one_line(run, record, tmp_path, results, text, complaint):
    (tmp_path / "sensors.toml").write_text(text)
    common = ("--turbine", "verne555", "--output", results, "--sensors", tmp_path / "sensors.toml")
    refused(run("identify", record, *common), complaint)


def test_messages_name_arguments_in_python_and_options_in_the_command(run, record, tmp_path, results):
    wide = read_record(record)
    other = tmp_path / "other.csv"
    pd.DataFrame({"time [s]": wide.time, "nacelle [m/s^2]": wide["tower_x_acceleration"]}).to_csv(other, index=False)
    advice = "rename them with {}.*, or list your own with {}"
    with pytest.raises(RecordError, match=advice.format("mapping=", "sensors=")):
        windsysid.identify(read_record(other), "verne555", progress=lambda *_: None)
    ended = run("identify", other, "--turbine", "verne555", "--output", results)
    refused(ended, advice.format("--mapping", "--sensors"))


@pytest.mark.parametrize(
    ("command", "message", "shown"),
    [
        ("identify", "use formulation='joint', or rate=", "use --formulation joint, or --rate"),
        ("identify", "overwrite it (overwrite=True)", "overwrite it (--overwrite)"),
        ("turbine", "expected kind='tower'", "expected --kind tower"),
        ("inspect", "use formulation='joint'", "use formulation='joint'"),
        ("identify", "a/rate=.csv: no such file; rate=3", "a/rate=.csv: no such file; rate=3"),
        ("no-command", "use rate=", "use rate="),
    ],
)
def test_only_options_of_the_command_are_named(monkeypatch, command, message, shown):
    monkeypatch.setattr(sys, "argv", ["windsysid", command])
    register_commands()
    assert _name_options(message) == shown


def test_the_force_balance_takes_no_sensor_list(run, record, tmp_path, results):
    (tmp_path / "sensors.toml").write_text(
        '[[sensor]]\nchannel="tower_x_acceleration"\nquantity="acceleration"\npoint="tower"\naxis="x"\nnoise=0.1\n'
    )
    common = ("--turbine", "verne555", "--output", results, "--formulation", "force-balance")
    refused(run("identify", record, *common, "--sensors", tmp_path / "sensors.toml"), "takes no sensor list")


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("k_y =", "k_z =", "unknown key 'support.k_z'"),
        ('k_y = "1650 N/m"', 'k_y = "1650 kg"', "support.k_y: expected a unit of the same quantity as N/m"),
        ('mass = "2.5 kg"', 'mass = "-2.5 kg"', "blade.1.mass: .* greater than 0"),
        ('k_y = "1650 N/m"', "", "'support.k_y' is missing"),
    ],
)
def test_a_bad_turbine_file_is_refused_in_one_line(run, record, tmp_path, results, old, new, complaint):
    text = (Path(cli.__file__).parents[1] / "turbine" / "packaged" / "verne555.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "mine.toml").write_text(text.replace(old, new), encoding="utf-8")
    refused(run("identify", record, "--turbine", tmp_path / "mine.toml", "--output", results), complaint)
    refused(run("simulate", "--turbine", tmp_path / "mine.toml", "--output", tmp_path / "x.csv"), complaint)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--rate", "1"), "rate: expected"),
        (("--rate", "nan"), "rate: expected"),
        (("--duration", "0"), "duration: expected"),
        (("--duration", "-5"), "duration: expected"),
        (("--duration", "inf"), "duration: expected"),
        (("--turbine", "nordex"), "no turbine 'nordex'"),
        (("--output", "x.xlsx"), "cannot write files ending in '.xlsx'"),
    ],
)
def test_a_simulation_that_cannot_be_is_refused_in_one_line(run, tmp_path, monkeypatch, options, complaint):
    monkeypatch.chdir(tmp_path)
    base = ("simulate", "--turbine", "verne555", "--duration", "5", "--output", "x.csv")
    refused(run(*base, *options), complaint)
    assert not list(tmp_path.iterdir())


# output


def test_what_is_there_already_is_left_untouched(run, record, results, tmp_path):
    results.mkdir()
    (results / "summary.json").write_text("mine")
    common = ("--turbine", "verne555", "--output", results)
    ended = run("identify", record, *common)
    refused(ended, r"is already there: choose another folder, or overwrite it \(--overwrite\)")
    refused(run("study", "--output", results), "is already there")
    assert [(path.name, path.read_text()) for path in results.iterdir()] == [("summary.json", "mine")]

    (tmp_path / "mine.csv").write_text("mine")
    simulate = ("simulate", "--turbine", "verne555", "--duration", "5", "--output", tmp_path / "mine.csv")
    refused(run(*simulate), "is already there; .*--overwrite")
    assert (tmp_path / "mine.csv").read_text() == "mine"


def test_somebody_elses_folder_is_never_replaced(run, record, results):
    results.mkdir()
    (results / "thesis.tex").write_text("mine")
    command = ("identify", record, "--turbine", "verne555", "--output", results, "--overwrite")
    refused(run(*command), "holds files that are not noted as results of windsysid")
    assert (results / "thesis.tex").read_text() == "mine"


def test_output_that_cannot_be_written_is_refused_before_any_work(run, record, tmp_path):
    file = tmp_path / "file"
    file.write_text("mine")
    for command in (("identify", record, "--turbine", "verne555"), ("study",)):
        refused(run(*command, "--output", file / "below"), "cannot be made")
        refused(run(*command, "--output", file), "expected a folder, got a file")
    refused(
        run("simulate", "--turbine", "verne555", "--duration", "5", "--output", file / "x.csv"),
        "file is a file; choose a folder you may write to",
    )
    assert file.read_text() == "mine"


# usage errors are the command line's own


@pytest.mark.parametrize(
    "arguments",
    [
        ("identify",),
        ("identify", "x.csv", "--turbine", "verne555"),
        ("identify", "x.csv", "--output", "y"),
        ("identify", "x.csv", "--turbine", "verne555", "--output", "y", "--formulation", "both"),
        ("identify", "x.csv", "--turbine", "verne555", "--output", "y", "--site", "lake"),
        ("identify", "x.csv", "--turbine", "verne555", "--output", "y", "--prior-scale", "much"),
        ("identify", "x.csv", "--turbine", "verne555", "--output", "y", "--section", "1"),
        ("simulate", "--turbine", "verne555", "--output", "x.csv", "--seed", "-1"),
        ("study", "--seed", "one"),
        ("identfy",),
        ("study", "--colour"),
    ],
)
def test_usage_errors_end_with_code_2(run, arguments):
    ended = run(*arguments)
    assert ended.code == 2
    assert not any("Traceback" in line for line in ended.err)
    assert ended.err


# what it does


def test_turbines_are_listed_with_source_and_assumptions(run):
    ended = run("turbines")
    assert (ended.code, ended.err) == (0, [])
    for words in ("hammond", "nrel5mw", "verne555", "69.6 rpm", "10.4050/JAHS.19.14", "assumed: hub_mass_x"):
        assert words in ended.out


def test_the_file_of_a_packaged_turbine_begins_ones_own(run, tmp_path):
    own = tmp_path / "my_tower.toml"
    own.write_text(run("turbines", "--turbine", "tower").out.replace('"0.3163 Hz"', '"0.3 Hz"'), encoding="utf-8")
    assert "# Copy this file" in own.read_text(encoding="utf-8")
    assert load_turbine(own).values["k_side_side"] < load_turbine("tower").values["k_side_side"]
    ended = run("turbines", "--turbine", "towel")
    assert (ended.code, ended.out) == (2, "")
    assert "no packaged turbine 'towel': expected one of hammond" in " ".join(ended.err)


OPTIONS = {
    "study": ("--output", "--seed"),
    "simulate": (
        "--turbine", "--duration", "Length [s]", "--rate", "[Hz]", "--output", "--seed",
        "second-order: ", "rotor-wind: ", "wind-feedback: ",
    ),
    "identify": (
        "record", "--turbine", "--sensors", "--formulation", "joint", "force-balance", "--section", "START END",
        "to use [s]",
        "--prior-scale", "--add-noise", "PERCENT", "--seed", "--output", "--overwrite", "--no-report",
        "--loads", "broadband: ", "rotor-wind: ", "--in-pieces", "LENGTH", "--rate", "--mapping",
    ),
    "inspect": ("record", "--turbine", "--output", "--mapping", "--section-length", "[s]", "--overwrite"),
    "plan": (
        "turbine", "--sensors", "--duration", "--rate", "[Hz]", "--parameters", "NAME,NAME", "--within", "PERCENT",
        "--load-scale",
        "--rotor-speed", "--seed", "--output", "--json", "--overwrite",
    ),
    "modes": ("--speeds", "--operating", "--output", "--json", "--overwrite"),
    "monitor": ("results", "--covariates", "--alarms-per-year", "--output", "--json", "--overwrite"),
    "compare": ("before", "after", "--output", "--json", "--overwrite"),
    "turbines": ("NAME",),
}  # fmt: skip


@pytest.mark.parametrize("command", OPTIONS)
def test_help_shows_every_option(run, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "160")
    ended = run(command, "--help")
    assert ended.code == 0
    for option in OPTIONS[command]:
        assert "".join(option.split()) in "".join(ended.out.split()), option
    assert command in run("--help").out


def test_help_lists_first_what_is_asked_of_one_record_and_asks_no_value_of_a_flag(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    commands = re.findall(r"^  (\w+) +\w", run("--help").out.partition("Commands")[2], flags=re.MULTILINE)
    assert commands[:4] == ["start", "inspect", "identify", "oma"]
    assert len(commands) == len(cli.app.registered_commands)
    assert re.search(r"--overwrite +Overwrite", run("identify", "--help").out)


def test_a_record_is_simulated_identified_and_replaced(run, tmp_path):
    results = tmp_path / "results"
    for name in ("record.csv", "record.nc"):
        simulate = (
            "simulate",
            "--turbine",
            "verne555",
            "--duration",
            "20",
            "--rate",
            "50",
            "--output",
            tmp_path / name,
            "--seed",
            "3",
        )
        ended = run(*simulate)
        assert (ended.code, ended.err) == (0, [])
        assert f"record: {tmp_path / name}" in ended.out
    text, binary = read_record(tmp_path / "record.csv"), read_record(tmp_path / "record.nc")
    np.testing.assert_array_equal(text.values, binary.values)
    assert text.samples == 1000
    assert text.start == binary.start == "2020-01-04T00:00:00Z"

    command = ("identify", tmp_path / "record.nc", "--turbine", "verne555", "--prior-scale", "1.3", "--output", results)
    ended = run(*command)
    assert (ended.code, ended.err) == (0, [])
    assert "k_beta_3" in ended.out
    assert f"results: {results / 'report.html'}" in ended.out
    assert sorted(path.name for path in results.glob("[!.]*")) == ["identification.nc", "report.html", "summary.json"]
    html = (results / "report.html").read_text(encoding="utf-8")
    assert '<svg class="drawn"' not in html
    assert "difference from the turbine file [%]" in html
    assert html.count('<figure class="plot">') > 4
    assert "trust: yes" in html
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", html)
    summary = json.loads((results / "summary.json").read_text())
    assert summary["parameters"]["k_x"]["prior"] == pytest.approx(1.3 * 1800.0)
    assert summary["formulation"] == "joint"

    refused(run(*command), "already there")
    ended = run(*command, "--overwrite", "--no-report", "--formulation", "force-balance", "--section", "5", "15")
    assert (ended.code, ended.err) == (0, [])
    assert sorted(path.name for path in results.glob("[!.]*")) == ["identification.nc", "summary.json"]
    summary = json.loads((results / "summary.json").read_text())
    assert (summary["formulation"], summary["samples"]) == ("force-balance", 500)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["record.csv", "record.nc", "results"]

    ended = run(*simulate, "--overwrite", "--rate", "25")
    assert ended.code == 0
    assert read_record(tmp_path / "record.nc").samples == 500


def test_a_seed_repeats_a_record(run, tmp_path):
    for name, seed in (("a.csv", 1), ("b.csv", 1), ("c.csv", 2)):
        run(
            "simulate",
            "--turbine",
            "tower",
            "--duration",
            "5",
            "--rate",
            "20",
            "--output",
            tmp_path / name,
            "--seed",
            seed,
        )
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes() != (tmp_path / "c.csv").read_bytes()


@pytest.mark.slow
def test_added_noise_is_told_to_the_filter_and_repeats(run, record, tmp_path):
    summaries = []
    for number, noise in enumerate([("--add-noise", "40", "--seed", "1")] * 2 + [()]):
        command = ("identify", record, "--turbine", "verne555", "--output", tmp_path / str(number), "--no-report")
        options = ("--formulation", "joint", "--loads", "broadband", "--section", "0", "5", *noise)
        assert run(*command, *options).code == 0
        summaries.append(json.loads((tmp_path / str(number) / "summary.json").read_text())["modes"])
    assert summaries[0] == summaries[1]
    collective = [next(mode["frequency"] for mode in modes if mode["name"] == "lag collective") for modes in summaries]
    widths = [frequency["high"] - frequency["low"] for frequency in collective]
    assert widths[0] > 1.1 * widths[2]


def test_a_sensor_list_of_ones_own_is_used(run, record, tmp_path):
    (tmp_path / "sensors.toml").write_text(
        "".join(
            f'[[sensor]]\nchannel="{name}"\nquantity="acceleration"\npoint="tower"\naxis="{axis}"\nnoise=0.05\n'
            for name, axis in (("nacelle_side", "x"), ("nacelle_up", "y"))
        )
    )
    data = read_record(record)
    names = {"tower_x_acceleration": "nacelle_side", "tower_y_acceleration": "nacelle_up"}
    channels = tuple(names.get(name, name) for name in data.channels)
    write_record(Record(data.time, data.values, channels, data.units).section(0.0, 10.0), tmp_path / "mine.csv")
    common = ("--turbine", "verne555", "--output", tmp_path / "out", "--no-report", "--loads", "broadband")
    sensors = ("--formulation", "joint", "--sensors", tmp_path / "sensors.toml")
    ended = run("identify", tmp_path / "mine.csv", *common, *sensors)
    assert ended.code == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["sensors"] == ["nacelle_side", "nacelle_up"]
    assert list(summary["parameters"]) == ["k_x", "c_x", "k_y", "c_y"]


# the program as it is installed


def program(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "windsysid", *arguments], capture_output=True, text=True, check=False)


def test_the_program_says_its_version():
    ended = program("--version")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert re.fullmatch(r"windsysid \d+\.\d+\.\d+\n", ended.stdout)


def test_the_program_refuses_in_one_line():
    ended = program("identify", "nowhere.csv", "--turbine", "verne555", "--output", "never")
    assert (ended.returncode, ended.stdout) == (2, "")
    lines = [line for line in ended.stderr.splitlines() if not line.startswith("windsysid: first run")]
    assert len(lines) == 1, ended.stderr
    assert lines[0].startswith("windsysid: nowhere.csv: no such file")


def test_the_console_script_is_installed():
    script = shutil.which("windsysid", path=str(Path(sys.executable).parent))
    assert script is not None
    ended = subprocess.run([script], capture_output=True, text=True, check=False)
    assert "Usage: windsysid" in ended.stdout
    assert "Traceback" not in ended.stderr
