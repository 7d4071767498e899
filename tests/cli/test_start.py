"""From a file to an answer: the walk, its questions, and the examples it is tried on."""

import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import windsysid as ws
from windsysid.cli import start
from windsysid.errors import OutputError
from windsysid.records.formats import load_mapping, read_record
from windsysid.simulation.examples import building, write_examples

pytestmark = pytest.mark.usefixtures("without_pages", "by_spectra")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("examples")
    write_examples(made)
    return made


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch):
    return lambda *lines: monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


@pytest.fixture
def names_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ask for names alone: no section is chosen, and nothing is identified."""
    monkeypatch.setattr(start, "_section", lambda *_: [])
    monkeypatch.setattr(start, "_run", lambda *_: Path("report.html"))


def bare(folder: Path) -> Path:
    """The logger's record without units in its headers."""
    head, *rows = (folder / "logger.csv").read_text(encoding="utf-8").splitlines()
    assert head.startswith("Time (s);")
    path = Path("bare.csv")
    rows = rows[: len(rows) // 3]
    path.write_text("\n".join(["time [s];first;acc ss;Rotor speed (rpm)", *rows]) + "\n", encoding="utf-8")
    return path


def test_yes_takes_every_default_and_prints_the_command_that_repeats_it(
    run, folder: Path, monkeypatch: pytest.MonkeyPatch
):
    record = folder / "logger.csv"
    ended = run("start", record, "--turbine", "tower", "--yes")
    assert (ended.code, ended.err) == (0, [])
    mapping = Path("logger-mapping.toml")
    again = f"windsysid identify {record} --turbine tower --mapping {mapping}"
    assert ended.out.splitlines()[-1] == f"again: {again}"
    assert "tower_x_acceleration" in read_record(record, mapping=mapping).channels
    assert Path("results/logger/report.html").exists()
    assert run(*again.split()[1:]).code == 0
    assert Path("results/logger-2/report.html").exists()
    monkeypatch.setattr(start, "_section", lambda *_: [])  # nothing is identified again
    run("start", record, "--turbine", "tower", "--yes")
    assert [path.name for path in Path().glob("*.toml")] == [mapping.name]


def test_the_readme_shows_what_is_printed(folder: Path, tmp_path: Path):
    """It showed the estimates of another formulation. Outside of this process `start` found no `identify`, since a
    command imports its own module only."""
    shutil.copy(folder / "logger.csv", tmp_path)
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    command, shown = readme.split("windsysid examples .\nwindsysid ")[1].split("\n```\n\n```text\n", 1)
    ended = subprocess.run(
        [sys.executable, "-m", "windsysid", *command.split()],
        cwd=tmp_path,
        env=os.environ | {"COLUMNS": "80", "PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    printed = ended.stdout.splitlines()
    assert printed[-1].startswith("again: windsysid identify")
    assert [line for line in shown.split("\n```")[0].splitlines() if line not in printed] == []


def test_an_acceleration_in_the_unit_of_a_force_is_asked_about(run, folder: Path, answers):
    """A mapping with that unit was written, and refused afterwards."""
    record = Path("kilonewtons.csv")
    record.write_text((folder / "logger.csv").read_text(encoding="utf-8").replace("FA (mg)", "FA (kN)"))
    ended = run("start", record, "--turbine", "tower", "--yes")
    assert ended.code == 2
    assert "no safe default: Unit of 'Acc tower top FA'" in ended.err[-1]
    assert not list(Path().glob("*.toml"))
    answers("", "kN", "mg")
    ended = run("start", record, "--turbine", "tower")
    assert (ended.code, ended.err) == (0, []), ended
    assert "expected a unit of acceleration" in ended.out
    assert "a quantity that is not measured in kN" in ended.out
    assert "kN" not in Path("kilonewtons-mapping.toml").read_text(encoding="utf-8").split("only_listed")[1]


def test_the_findings_of_the_inspection_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Only their number was printed."""
    path = tmp_path / "upright.csv"
    rows = [f"{0.05 * k:.2f},{9.81 + 0.01 * ((7 * k) % 13 - 6):.4f}" for k in range(4000)]
    path.write_text("\n".join(["time [s],tower_y_acceleration [m/s^2]", *rows]) + "\n", encoding="utf-8")
    start._section(path, None, start.NO_TURBINE, start._Guide(yes=True))
    assert "  note, tower_y_acceleration: contains gravity" in capsys.readouterr().out


def test_answers_are_read_from_standard_input_and_asked_again(run, folder: Path, answers):
    record = bare(folder)
    answers("towel", "tower", "tower_z_acceleration", "stone", "mg", "", "mg")
    ended = run("start", record)
    assert (ended.code, ended.err) == (0, []), ended
    assert "no turbine 'towel'" in ended.out
    assert "unknown unit 'stone'" in ended.out
    assert "Its values allow each" in ended.out  # before the question, which is hard to answer without
    assert "expected a unit" in ended.out
    rules = load_mapping("bare-mapping.toml").channels
    assert (rules["first"].name, rules["first"].unit) == ("tower_z_acceleration", "mg")
    assert (rules["acc ss"].name, rules["acc ss"].unit) == ("tower_x_acceleration", "mg")
    assert "k_side_side" in ended.out


def with_header(folder: Path, *names: str) -> Path:
    """The logger's record with other names."""
    _, *rows = (folder / "logger.csv").read_text(encoding="utf-8").splitlines()
    path = Path("renamed.csv")
    path.write_text("\n".join([";".join(names), *rows[:4000]]).replace(".", ",") + "\n", encoding="utf-8")
    return path


def test_a_logger_of_another_language_is_understood(run, folder: Path):
    """Names with ä, ó … were cut there, and `identify` refused the mapping that was written."""
    record = with_header(
        folder, "Zeit [s]", "Beschleunigung Gondel längs [mg]", "Querbeschleunigung [mg]", "Drehzahl [1/min]"
    )
    ended = run("start", record, "--turbine", "tower", "--yes")
    assert (ended.code, ended.err) == (0, []), ended
    rules = load_mapping("renamed-mapping.toml").channels
    assert [rule.name for rule in rules.values()] == ["tower_z_acceleration", "tower_x_acceleration", "rotor_speed"]


def test_channels_that_the_turbine_does_not_know_are_refused_before_a_mapping_is_written(run, folder: Path):
    """A mapping with `# ? name =` was written, and `identify` refused it."""
    record = with_header(folder, "time [s]", "a1 [mg]", "a2 [mg]", "n [rpm]")
    ended = run("start", record, "--turbine", "tower", "--yes")
    assert (ended.code, len(ended.err)) == (2, 1), ended
    assert "no channel has a name that tower knows" in ended.err[0]
    assert "leave --yes out to name them" in ended.err[0]
    assert not list(Path().glob("*.toml"))


@pytest.mark.usefixtures("names_only")
@pytest.mark.parametrize(
    "names",
    [("ax [mg]", "ay [mg]"), ("Acc Y [mg]", "Acc X [mg]"),
     *(pytest.param(one, marks=pytest.mark.slow) for one in (
         ("acc_x [mg]", "acc_y [mg]"), ("Beschleunigung X [mg]", "Beschleunigung Y [mg]"),
         ("Tower top X [mg]", "Tower top Y [mg]")))],
)  # fmt: skip
def test_two_horizontal_axes_are_a_guess_that_somebody_confirms(run, folder: Path, answers, names: tuple[str, str]):
    record = with_header(folder, "time [s]", *names, "n [rpm]")
    ended = run("start", record, "--turbine", "tower", "--yes")
    assert (ended.code, len(ended.err)) == (2, 1), ended
    assert "start --yes: no safe default: Name of" in ended.err[0]
    assert "a guess: X fore-aft and Y side-side" in ended.out
    assert not list(Path().glob("*.toml"))
    usual = {"X": "tower_z_acceleration", "Y": "tower_x_acceleration"}
    written = [name.split(" [")[0] for name in names]
    answers("", "", "")
    assert run("start", record, "--turbine", "tower").code == 0
    rules = load_mapping("renamed-mapping.toml").channels
    assert [rules[name].name for name in written] == [usual[name[-1].upper()] for name in written]
    answers(rules[written[1]].name, "", "")
    assert run("start", record, "--turbine", "tower").code == 0
    exchanged = load_mapping("renamed-mapping-2.toml").channels
    assert [exchanged[name].name for name in written] == [rules[name].name for name in reversed(written)]


@pytest.mark.usefixtures("names_only")
def test_the_mapping_says_nothing_of_a_guess_that_was_answered_otherwise(run, folder: Path, answers):
    """It said "X fore-aft and Y side-side" over names that had been exchanged."""
    record = with_header(folder, "time [s]", "acc_x [mg]", "acc_y [mg]", "n [rpm]")
    answers("tower_x_acceleration", "", "")
    assert run("start", record, "--turbine", "tower").code == 0
    assert "fore-aft" not in Path("renamed-mapping.toml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("names_only")
def test_an_axis_is_never_proposed_as_another_direction_or_as_a_blade(run, folder: Path, answers):
    """A turbine without fore-aft channel was offered X as side-side, and Y as a blade's tip."""
    record = with_header(folder, "time [s]", "acc_x [mg]", "acc_y [mg]", "n [rpm]")
    answers("", "", "")
    assert run("start", record, "--turbine", "nrel5mw").code == 0
    rules = load_mapping("renamed-mapping.toml").channels
    assert [rules[name].name for name in ("acc_x", "acc_y")] == ["acc_x", "tower_x_acceleration"]


@pytest.mark.usefixtures("names_only")
def test_a_second_x_keeps_its_own_name(run, folder: Path):
    record = with_header(folder, "time [s]", "acc_x_1 [mg]", "acc_x_2 [mg]", "n [rpm]")
    ended = run("start", record, "--turbine", "tower", "--yes")
    assert "no channel has a name that tower knows" in ended.err[0]


def test_a_missing_record_is_refused_before_a_question(run, answers):
    ended = run("start", "nowhere.csv")
    assert (ended.code, len(ended.err)) == (2, 1)
    assert "nowhere.csv: no such file" in ended.err[0]


def test_a_unit_is_never_guessed(run, folder: Path):
    ended = run("start", bare(folder), "--turbine", "tower", "--yes")
    assert ended.code == 2
    assert len(ended.err) == 1
    assert "no safe default: Unit of 'first'" in ended.err[0]
    assert not Path("bare-mapping.toml").exists()


def test_without_a_turbine_modes_are_found(run, folder: Path):
    record = Path("building.csv")
    record.write_text("\n".join((folder / record).read_text(encoding="utf-8").splitlines()[:4001]) + "\n")
    ended = run("start", record, "--yes")
    assert (ended.code, ended.err) == (0, [])
    assert ended.out.splitlines()[-1] == f"again: windsysid oma {record}"
    assert not list(Path().glob("*.toml"))


def test_answers_that_end_are_refused_in_one_line(run, folder: Path, answers):
    answers()
    ended = run("start", folder / "logger.csv")
    assert ended.code == 2
    assert ended.err == ["windsysid: start: the answers ended at: Turbine, a .toml file, or none for modes only"]


def test_numbers_are_checked():
    assert start._two_numbers("0 600.5") == ["0", "600.5"]
    assert start._two_numbers("all") == []
    assert start._positive("20") == 20.0
    for refuse in (lambda: start._two_numbers("6"), lambda: start._positive("-1"), lambda: start._unit("x", "")):
        with pytest.raises(ws.WindsysidError, match="expected"):
            refuse()


def test_a_page_is_opened_only_where_somebody_sees_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("DISPLAY", ":0")
    assert not start._has_display()


def test_examples_are_written_once_and_their_commands_are_commands(run, folder: Path):
    text = (folder / "README.md").read_text(encoding="utf-8")
    for path in folder.glob("*.csv"):
        assert f" {path.name}" in text
    assert sum(path.stat().st_size for path in folder.iterdir()) < 10e6
    with pytest.raises(OutputError, match="is already there"):
        write_examples(folder)


def test_a_building_has_the_modes_that_it_was_made_with():
    made = building(3, duration=300.0)
    found = ws.oma(made.record).modes
    for mode, (frequency, _) in zip(found, made.modes, strict=True):
        assert abs(mode.frequency.estimate - frequency) < 4.0 * mode.frequency.std


def test_names_are_asked_for_where_the_turbine_knows_none_of_them(run, folder: Path, answers):
    """Units in the headers and names of one's own: nothing was asked, and `identify` refused the record."""
    _, *rows = (folder / "logger.csv").read_text(encoding="utf-8").splitlines()
    rows = rows[: len(rows) // 3]
    Path("odd.csv").write_text("\n".join(["time [s];TT 1 [mg];TT 2 [mg];n [rpm]", *rows]) + "\n", encoding="utf-8")
    answers("tower_z_acceleration", "tower_z_acceleration", "tower_x_acceleration", "rotor_speed")
    ended = run("start", "odd.csv", "--turbine", "tower")
    assert (ended.code, ended.err) == (0, []), ended
    assert "another channel is called tower_z_acceleration already" in ended.out
    names = [rule.name for rule in load_mapping("odd-mapping.toml").channels.values()]
    assert names == ["tower_z_acceleration", "tower_x_acceleration", "rotor_speed"]


def test_a_name_that_the_file_gives_to_a_later_channel_is_refused(run, folder: Path, answers):
    """It was in the mapping twice, which was refused after all questions; the name of a channel left out is free."""
    _, *rows = (folder / "logger.csv").read_text(encoding="utf-8").splitlines()
    rows = rows[: len(rows) // 3]
    Path("odd.csv").write_text("\n".join(["time [s];TT 1;TT 2;Rotor speed (rpm)", *rows]) + "\n", encoding="utf-8")
    answers("rotor_speed", "tower_z_acceleration", "-", "tower_z_acceleration", "mg")
    ended = run("start", "odd.csv", "--turbine", "tower")
    assert (ended.code, ended.err) == (0, []), ended
    assert "another channel is called rotor_speed already" in ended.out
    assert "another channel is called tower_z_acceleration already" not in ended.out
    mapping = load_mapping("odd-mapping.toml")
    assert [rule.name for rule in mapping.channels.values()] == ["tower_z_acceleration", "rotor_speed"]


def test_a_file_that_is_not_there_is_refused_before_any_question(run):
    ended = run("start", "nothere.csv")
    assert ended.code == 2
    assert "nothere.csv: no such file" in "".join(ended.err)
    assert "Turbine" not in ended.out
