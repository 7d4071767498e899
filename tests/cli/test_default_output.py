"""Commands without --output: where results go, that nothing is overwritten, and that interrupted work goes on."""

import json
from pathlib import Path

import pytest

import windsysid as ws
from tests.conftest import Ended
from tests.turbine.models.test_drawing import DRAWING
from windsysid.cli.common import name_of, numbered, results_of
from windsysid.cli.fleet import _archive_of
from windsysid.cli.identify import _checkpoint, _default_output
from windsysid.fleet.archive import add_rows, has_records_of, place_of
from windsysid.output.folders import claim, is_free


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("records") / "year1.csv"
    ws.write_record(ws.simulate("tower", duration=200.0, rate=5.0, seed=1), path)
    return path


def shown(path: str) -> str:
    return f"results: {Path('results') / path / 'report.html'}"


@pytest.mark.usefixtures("without_pages", "by_spectra")
def test_results_are_named_after_the_input(run, record: Path):
    ended = run("identify", record, "--turbine", "tower")
    assert (ended.code, ended.err) == (0, [])
    assert shown("year1") in ended.out
    before = Path("results/year1/summary.json").read_bytes()
    assert shown("year1-2") in run("identify", record, "--turbine", "tower").out
    assert Path("results/year1/summary.json").read_bytes() == before
    for words, place in (
        (("oma", record), "year1-oma"),
        (("inspect", record), "year1-inspect"),
        (("compare", "results/year1", "results/year1-2"), "year1-2-compare"),
        (("damping", "results/year1"), "year1-damping"),
        (("modes", "results/year1"), "year1-modes"),
        (("modes", "--turbine", "tower"), "tower-modes"),
        (("report", "results/year1"), "year1-report"),
    ):
        ended = run(*words)
        assert (ended.code, ended.err) == (0, []), words
        assert shown(place) in ended.out
    ended = run("compare", "results/year1", "results/year1-2", "results/year1-2")
    assert shown("year1-2-compare-2") in ended.out
    assert shown("year1-2-compare-3") in ended.out


def test_a_summary_for_a_program_is_saved_only_where_asked(run):
    assert run("modes", "--turbine", "tower", "--json").code == 0
    assert not Path("results").exists()


def test_a_simulated_record_gets_the_next_free_name(run):
    for name in ("tower.csv", "tower-2.csv"):
        ended = run("simulate", "--turbine", "tower", "--duration", 5)
        assert f"record: {Path('results') / name}" in ended.out


@pytest.mark.parametrize("command", ["plan", "modes", "turbines"])
def test_a_turbine_without_its_option_is_refused_in_one_line(run, command: str):
    ended = run(command, "tower")
    assert (ended.code, ended.out) == (2, "")
    assert ended.err == [f"windsysid: {command}: a turbine is named by --turbine: windsysid {command} --turbine tower"]


def test_modes_take_a_result_or_a_turbine(run):
    for words in ((), ("here", "--turbine", "tower")):
        ended: Ended = run("modes", *words)
        assert ended.code == 2
        assert "expected a folder that identify wrote, .lin files, or --turbine; one of these" in ended.err[0]


def test_a_folder_is_free_until_it_holds_a_result_or_somebody_writes_there(tmp_path: Path):
    folder = tmp_path / "out"
    assert is_free(folder)
    with claim(folder) as write:
        assert not is_free(folder)
        write({"summary.json": b"{}"})
    assert not is_free(folder)
    (tmp_path / "dead" / ".windsysid").mkdir(parents=True)
    (tmp_path / "dead" / ".windsysid" / "lock").touch()
    assert is_free(tmp_path / "dead")
    (tmp_path / "file").touch()
    assert not is_free(tmp_path / "file")


def test_an_interrupted_identification_in_pieces_goes_on_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    first, second, third = (path for path, _ in zip(numbered("x"), range(3), strict=False))
    first.mkdir(parents=True)
    (first / "summary.json").touch()
    assert _default_output(Path("x.csv"), overwrite=False, resumes=True) == second
    _checkpoint(second).touch()
    assert _default_output(Path("x.csv"), overwrite=False, resumes=True) == second
    assert _default_output(Path("x.csv"), overwrite=False, resumes=False) == third


def test_batch_adds_to_the_archive_of_the_same_folder_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for home in ("a", "b"):
        (tmp_path / home / "data").mkdir(parents=True)
    archive, other = Path("results/data-batch"), Path("results/data-batch-2")
    assert _archive_of(["a/data"]) == archive
    row = {"source": str((tmp_path / "a/data/r.csv").resolve()), "start": None}
    add_rows(place_of(archive, "tower", "undated-00"), [row])
    assert has_records_of(archive, "a/data")
    assert _archive_of(["a/data"]) == _archive_of(["a/data/*.csv"]) == _archive_of(["a/data/r.csv"]) == archive
    assert _archive_of(["b/data"]) == other
    assert _archive_of(["s3://bucket/data"]) == other


def test_a_name_has_no_folder_and_no_ending(tmp_path: Path):
    (tmp_path / "2025.07").mkdir()
    assert name_of(tmp_path / "2025.07") == "2025.07"
    assert name_of("data/r.csv", "oma") == "r-oma"


@pytest.mark.parametrize(
    "command",
    [
        ("inspect", "{}", "--write-mapping", "{}"),
        ("turbine", "{}", "--output", "{}"),
        ("simulate", "--turbine", "{}", "--output", "{}", "--duration", "60"),
    ],
)
def test_a_command_never_overwrites_the_file_that_it_reads(run, record: Path, tmp_path: Path, command: tuple[str, ...]):
    """A measured record, named as the mapping to write by mistake, was replaced by it."""
    path = tmp_path / "read.csv"
    content = record.read_bytes() if command[0] == "inspect" else DRAWING.encode()
    path.write_bytes(content)
    ended = run(*(word.format(path) for word in command), "--overwrite")
    assert path.read_bytes() == content
    assert ended.code == 2
    assert "is to be read: choose another name" in ended.err[0]


FILES = {
    "identify": ("identification.nc", ""),
    "inspect": ("inspection.json", "{}"),
    "oma": ("answer.json", '{"answer": "OperationalModes"'),
    "compare": ("answer.json", '{"answer": "Comparison"'),
    "study": ("summary.json", '{"published_seconds": 1.0}'),
    "report": ("summary.json", '{"archive": "a"}'),
}


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, Path]:
    """A folder of each command's result, as a pattern finds them."""
    for command, (name, text) in FILES.items():
        (tmp_path / command).mkdir()
        (tmp_path / command / name).write_text(text, encoding="utf-8")
    (tmp_path / "study" / "identification.nc").touch()
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").touch()
    return {path.name: path for path in tmp_path.iterdir()}


def test_results_of_other_commands_are_left_out_of_many_and_named(folders: dict[str, Path], capsys):
    given = [*folders.values(), folders["identify"]]
    assert results_of(given, "identify") == [folders["identify"]]
    line = capsys.readouterr().err
    assert line.startswith("left out of the results of identify: ")
    assert line.count("\n") == 1
    for name, path in folders.items():
        assert (f"{path} ({name if name in FILES else 'no result'})" in line) == (name != "identify")


def test_a_result_of_another_command_alone_and_a_missing_folder_remain(folders: dict[str, Path], capsys):
    for alone in ([folders["oma"]], [folders["oma"], folders["compare"]]):
        assert results_of(alone, "identify") == alone
    pair = [folders["identify"], folders["compare"]]
    assert results_of(pair, "identify", "oma", least=2) == pair
    missing = [folders["identify"], folders["identify"] / "missing"]
    assert results_of(missing, "identify", "oma") == missing
    assert capsys.readouterr().err == ""


def test_results_of_identify_and_oma_alike_remain_and_of_more_of_one_command_these(folders: dict[str, Path]):
    both = [folders["identify"], folders["oma"]]
    assert results_of(both, "identify", "oma") == both
    assert results_of([*both, folders["study"]], "identify", "oma") == both
    (folders["empty"] / "identification.nc").touch()
    assert results_of([*both, folders["empty"]], "identify", "oma") == [folders["identify"], folders["empty"]]


def test_a_record_that_was_identified_twice_counts_once(folders: dict[str, Path], capsys):
    for name, section in (("identify", [0, 600]), ("empty", [0, 600]), ("oma", [600, 1200])):
        (folders[name] / "identification.nc").touch()
        (folders[name] / "answer.json").unlink(missing_ok=True)
        summary = {"record_hash": "sha256:1", "section": section}
        (folders[name] / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    given = [folders["identify"], folders["empty"], folders["oma"]]
    assert results_of(given, "identify") == [folders["identify"], folders["oma"]]
    assert f"{folders['empty']} (same record as identify)" in capsys.readouterr().err
    assert results_of(given[:2], "identify", least=2) == given[:2]
    for folder in given[:2]:
        (folder / "summary.json").write_text('{"record_hash": null, "section": [0, 600]}', encoding="utf-8")
    assert results_of(given[:2], "identify") == given[:2]


def test_compare_never_takes_a_later_record_for_the_one_to_compare_with(run, folders: dict[str, Path]):
    """The first folder was left out where it was of oma and the others of identify, and the second took its place."""
    (folders["empty"] / "identification.nc").touch()
    for first in ("oma", "inspect"):
        ended = run("compare", folders[first], folders["identify"], folders["empty"])
        assert (ended.code, len(ended.err)) == (2, 1), ended
        assert str(folders[first]) in ended.err[0]


@pytest.mark.parametrize("command", ["monitor", "damping", "compare"])
def test_a_folder_that_was_left_out_is_not_overwritten(run, folders: dict[str, Path], command: str):
    for name in ("identify", "empty"):
        (folders[name] / "identification.nc").touch()
        (folders[name] / "summary.json").write_text('{"record_hash": "1", "section": [0, 1]}', encoding="utf-8")
    (folders["notes.txt"]).unlink()
    folders["notes.txt"].mkdir()
    (folders["notes.txt"] / "identification.nc").touch()
    given = folders["identify"], folders["notes.txt"], folders["empty"]
    ended = run(command, *given, "--output", folders["empty"], "--overwrite")
    assert ended.code == 2
    assert "is the result that is to be read" in ended.err[-1]
