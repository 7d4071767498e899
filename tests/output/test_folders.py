"""Nothing of the user's is lost, and a result is there whole: the old one or the new one."""

import contextlib
import errno
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.disks import files_of_at_most
from windsysid.errors import OutputError
from windsysid.output import folders as output
from windsysid.output.files import claim_file, replace_file
from windsysid.output.folders import Saveable, claim, result_file, without
from windsysid.reports.loading import KEPT

OLD = {"summary.json": b"old", "report.html": b"old, and longer", "changes.png": b"old"}
NEW = {"summary.json": b"new", "report.html": b"new report", "plan.png": b"new"}

posix = pytest.mark.skipif(sys.platform == "win32", reason="forks")


@pytest.fixture(autouse=True)
def flushed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is flushed to the disk and renamed, in order; flushing itself takes too long for so many tests."""
    done: list[str] = []
    replace = os.replace

    def renamed(source: Path, target: Path) -> None:
        done.append(f"rename {Path(target).name}")
        replace(source, target)

    def flush(handle: int) -> None:
        path = Path(f"/proc/self/fd/{handle}")
        done.append(f"flush {path.readlink().name if path.exists() else handle}")

    monkeypatch.setattr(os, "fsync", flush)
    monkeypatch.setattr(os, "replace", renamed)
    return done


class Answer(Saveable):
    """Something to save."""

    def __init__(self, **files: bytes):
        self.content = files

    def files(self) -> dict[str, bytes]:
        return {name.replace("_", "."): content for name, content in self.content.items()}


def save(folder: Path, files: dict[str, bytes]) -> None:
    with claim(folder, overwrite=True) as write:
        write(files)


def content(folder: Path) -> dict[str, bytes]:
    """What a user sees: every file that is not hidden."""
    return {path.name: path.read_bytes() for path in folder.glob("[!.]*") if path.is_file()}


def hidden(folder: Path) -> list[str]:
    """What is left beside what a user sees, but for the note."""
    return [str(path.relative_to(folder)) for path in folder.rglob("*") if ".windsysid" in str(path) and path.is_file()]


NOTE = [".windsysid/manifest.json"]


# whole or not at all


def test_a_folder_appears_with_everything_in_it(tmp_path: Path):
    target = tmp_path / "deep" / "down" / "results"
    with claim(target) as write:
        assert content(target) == {}
        write(NEW)
    assert content(target) == NEW
    assert [path.name for path in target.parent.iterdir()] == ["results"]
    assert hidden(target) == NOTE


def test_nothing_written_leaves_nothing(tmp_path: Path):
    with pytest.raises(RuntimeError, match="half way"), claim(tmp_path / "deep" / "results"):
        raise RuntimeError("half way")
    assert not list(tmp_path.iterdir())


def test_an_empty_folder_may_be_filled(tmp_path: Path):
    (tmp_path / "results").mkdir()
    with claim(tmp_path / "results") as write:
        write(NEW)
    assert content(tmp_path / "results") == NEW


def test_every_result_is_saved_into_a_new_folder_given_as_text_and_never_silently_again(tmp_path: Path):
    Answer(summary_json=b"1").save(str(tmp_path / "new" / "folder"))
    with pytest.raises(OutputError, match="is already there"):
        Answer(summary_json=b"2").save(tmp_path / "new" / "folder")
    assert content(tmp_path / "new" / "folder") == {"summary.json": b"1"}
    Answer(summary_json=b"2").save(str(tmp_path / "new" / "folder"), overwrite=True)
    assert content(tmp_path / "new" / "folder") == {"summary.json": b"2"}


def test_every_result_type_is_saved_by_the_one_way():
    from windsysid.identification.planning.plan import Plan
    from windsysid.inspection import Inspection
    from windsysid.modal.campbell import Campbell
    from windsysid.monitoring.change import Comparison
    from windsysid.monitoring.changes import Watch
    from windsysid.monitoring.separation import Separation
    from windsysid.results.identification import Identification

    for kind in (Campbell, Comparison, Identification, Inspection, Plan, Separation, Watch):
        assert kind.save is Saveable.save, kind


# what is overwritten, and what is not


def test_results_are_not_overwritten_without_being_told(tmp_path: Path):
    save(tmp_path, OLD)
    with (
        pytest.raises(OutputError, match=r"is already there: choose another folder, or overwrite it"),
        claim(tmp_path),
    ):
        pytest.fail("never entered")
    assert content(tmp_path) == OLD


def test_overwriting_replaces_what_is_ours_and_keeps_what_is_the_users(tmp_path: Path):
    save(tmp_path, OLD)
    mine = {"record.csv": "years", "notes/today.md": "of work", ".hidden": "too", "figures/report.html": "mine"}
    for name, text in mine.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    save(tmp_path, NEW)
    assert {name: (tmp_path / name).read_text() for name in mine} == mine
    assert content(tmp_path) == NEW | {"record.csv": b"years"}  # changes.png, of the old result, is gone
    assert hidden(tmp_path) == NOTE


@pytest.mark.parametrize("name", ["summary.json", "changes.png"])
def test_a_file_of_ours_that_the_user_changed_is_kept(tmp_path: Path, name: str):
    save(tmp_path, OLD)
    (tmp_path / name).write_bytes(b"my")
    with pytest.raises(OutputError, match=f"{name} was changed, or is not windsysid's: move it away"):
        save(tmp_path, NEW)
    assert content(tmp_path) == OLD | {name: b"my"}


def test_a_file_that_the_user_changes_during_the_work_is_kept_too(tmp_path: Path):
    save(tmp_path, OLD)
    with claim(tmp_path, overwrite=True) as write:
        (tmp_path / "report.html").write_bytes(b"my")
        with pytest.raises(OutputError, match=r"report.html was changed"):
            write(NEW)
    assert content(tmp_path) == OLD | {"report.html": b"my"}
    assert hidden(tmp_path) == NOTE


def test_a_file_of_the_users_with_a_results_name_is_met_before_the_work(tmp_path: Path):
    save(tmp_path, {"summary.json": b"old"})
    (tmp_path / "report.html").write_bytes(b"my")
    with pytest.raises(OutputError, match=r"report.html was changed, or is not"), claim(tmp_path, overwrite=True):
        pytest.fail("never entered")
    assert (tmp_path / "report.html").read_bytes() == b"my"


def test_a_file_that_the_user_removed_is_written_again(tmp_path: Path):
    save(tmp_path, OLD)
    (tmp_path / "summary.json").unlink()
    save(tmp_path, NEW)
    assert content(tmp_path) == NEW


@pytest.mark.parametrize("name", ["chapter1.tex", "summary.json", "inspection.json"])
def test_a_folder_without_our_note_is_not_overwritten_even_then(tmp_path: Path, name: str):
    (tmp_path / name).write_text("years of work")
    with pytest.raises(OutputError, match="holds files that are not noted as results of windsysid"):
        save(tmp_path, NEW)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "years of work"


@pytest.mark.parametrize("name", ["../thesis.tex", "/thesis.tex", ".."])
def test_a_note_that_names_files_elsewhere_is_no_note(tmp_path: Path, name: str):
    save(tmp_path / "results", OLD)
    (tmp_path / "thesis.tex").write_bytes(b"old")
    note = tmp_path / "results" / ".windsysid" / "manifest.json"
    found = json.loads(note.read_text())
    found["files"][name] = found["files"]["summary.json"]
    note.write_text(json.dumps(found))
    with pytest.raises(OutputError, match="not noted as results"):
        save(tmp_path / "results", NEW)
    assert (tmp_path / "thesis.tex").read_bytes() == b"old"


def test_a_folder_that_holds_what_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    save(tmp_path / "result", OLD)
    record = tmp_path / "data" / "record.csv"
    record.parent.mkdir()
    record.write_text("years")
    monkeypatch.chdir(record.parent)
    for folder, read, complaint in (
        (tmp_path / "result", tmp_path / "result", "is the result that is to be read"),
        (tmp_path / "data" / ".." / "result", tmp_path / "result", "is the result that is to be read"),
        (Path(), record, r"output \. holds record.csv, which is to be read: choose a folder of its own"),
        (tmp_path / "data", Path("record.csv"), "holds record.csv"),
    ):
        with pytest.raises(OutputError, match=complaint), claim(folder, overwrite=True, inputs=[read]):
            pytest.fail("never entered")
    assert content(tmp_path / "result") == OLD
    with claim(record.parent / "result", inputs=[record]) as write:
        write(NEW)


def test_what_cannot_be_made_is_refused_before_any_work(tmp_path: Path):
    file = tmp_path / "file"
    file.write_text("a file")
    with pytest.raises(OutputError, match="expected a folder, got a file"), claim(file, overwrite=True):
        pytest.fail("never entered")
    with (
        pytest.raises(OutputError, match=r"cannot be made: .* is not a folder that can be written to") as caught,
        claim(file / "below"),
    ):
        pytest.fail("never entered")
    assert "\n" not in str(caught.value)
    assert file.read_text() == "a file"


# one writer at a time


def test_a_second_writer_is_refused_before_its_work(tmp_path: Path):
    def second(claimed: contextlib.AbstractContextManager[object], complaint: str) -> None:
        with pytest.raises(OutputError, match=complaint), claimed:
            pytest.fail("never entered")

    with claim(tmp_path / "out") as write:
        second(claim(tmp_path / "out"), "another windsysid is writing there")
        write(NEW)
    assert content(tmp_path / "out") == NEW
    with claim_file(tmp_path / "x.csv"):
        second(claim_file(tmp_path / "x.csv"), "another process is writing it")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


def in_a_child(work: Callable[[], object]) -> int:
    """How a process ended that did the work."""
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@posix
def test_a_lock_dies_with_its_process(tmp_path: Path):
    def die() -> None:
        with claim(tmp_path / "out"), claim_file(tmp_path / "x.csv"):
            os._exit(9)

    assert in_a_child(die) == 9
    assert hidden(tmp_path)
    save(tmp_path / "out", NEW)
    with claim_file(tmp_path / "x.csv") as write:
        write(lambda file: file.write(b"new"))
    assert content(tmp_path) == {"x.csv": b"new"}
    assert hidden(tmp_path) == ["out/.windsysid/manifest.json"]


# flushed, and killed at any step


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="asks Linux for the names of open files")
def test_everything_is_on_the_disk_before_it_is_the_result_and_before_the_old_one_goes(
    tmp_path: Path, flushed: list[str]
):
    save(tmp_path, OLD)
    flushed.clear()
    save(tmp_path, NEW)
    note, first = flushed.index("rename manifest.json"), flushed.index("rename summary.json")
    assert {f"flush {name}" for name in NEW} < set(flushed[:note])
    assert any(step.startswith("flush new-") for step in flushed[:note])  # the folder with the names
    assert any(step.startswith("flush .manifest.json.") for step in flushed[:note])
    assert "flush .windsysid" in flushed[note:first]
    assert flushed[-1] == f"flush {tmp_path.name}"


STEPS = ("os.replace", "os.link", "os.rename", "os.unlink", "os.rmdir", "os.mkdir", "os.fsync", "os.open", "os.close")


def dying(work: Callable[[], object], step: int) -> int:
    """Do the work in a process that ends, as by kill -9, before its n-th step on the file system; how it ended."""

    def child() -> None:
        left = step

        def dies_before(function: Callable[..., object]) -> Callable[..., object]:
            def call(*arguments: object, **options: object) -> object:
                nonlocal left
                left -= 1
                if left < 0:
                    os._exit(9)
                return function(*arguments, **options)

            return call

        for name in STEPS:
            setattr(os, name.removeprefix("os."), dies_before(getattr(os, name.removeprefix("os."))))
        work()

    return in_a_child(child)


@posix
def test_killed_at_any_step_the_old_result_or_the_new_one_is_there(tmp_path: Path):
    step, seen = 0, []
    while True:
        home = tmp_path / str(step)
        save(home, OLD)
        (home / "notes.txt").write_bytes(b"my")
        ended = dying(lambda: save(home, NEW), step)  # noqa: B023
        raw = content(home)
        read = {name: file.read_bytes() for name in {*OLD, *NEW} if (file := result_file(home, name)).exists()}
        assert read in (OLD, NEW), step
        assert content(home) in (OLD | {"notes.txt": b"my"}, NEW | {"notes.txt": b"my"}), step  # and to the eye, now
        seen.append((raw in (OLD | {"notes.txt": b"my"}, NEW | {"notes.txt": b"my"}), read == NEW))
        save(home, OLD)
        assert content(home) == OLD | {"notes.txt": b"my"}
        assert hidden(home) == NOTE
        if ended == 0:
            break
        assert ended == 9
        shutil.rmtree(home)
        step += 1
    assert step > 20
    assert (False, True) in seen  # some died between two renames
    assert [new for _, new in seen] == sorted(new for _, new in seen)  # one step makes the new result the result


@pytest.mark.slow
@posix
def test_killed_at_any_step_of_the_first_writing_there_is_nothing_or_all(tmp_path: Path):
    step = 0
    while True:
        home = tmp_path / str(step)
        ended = dying(lambda: save(home, NEW), step)  # noqa: B023
        read = {name: file.read_bytes() for name in NEW if (file := result_file(home, name)).exists()}
        assert read in ({}, NEW), step
        if read:
            with pytest.raises(OutputError, match="already there"), claim(home):
                pytest.fail("never entered")
        else:
            with claim(home) as write:
                write(NEW)
            assert content(home) == NEW
        if ended == 0:
            break
        step += 1


@posix
def test_killed_at_any_step_a_file_is_the_old_one_or_the_new_one(tmp_path: Path):
    def write() -> None:
        with claim_file(path, overwrite=True) as write:
            write(lambda file: file.write(b"new"))

    path, step = tmp_path / "x.csv", 0
    while True:
        path.write_bytes(b"old")
        ended = dying(write, step)
        assert path.read_bytes() in (b"old", b"new")
        if ended == 0:
            break
        step += 1
    assert [file.name for file in tmp_path.iterdir()] == ["x.csv"]  # the last run has swept up what the others left


def test_a_result_that_waits_is_read_where_nothing_may_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    save(tmp_path, OLD)
    with monkeypatch.context() as patch:
        patch.setattr(output, "_finish", lambda _: None)
        save(tmp_path, NEW)
        assert content(tmp_path) == OLD
        patch.setattr(output, "try_lock", lambda _: None)
        assert {name: result_file(tmp_path, name).read_bytes() for name in NEW} == NEW
        assert not result_file(tmp_path, "changes.png").exists()
    assert result_file(tmp_path, "plan.png").read_bytes() == b"new"
    assert content(tmp_path) == NEW


# disks that are full


def test_a_full_disk_is_one_line_and_the_old_result_stays(tmp_path: Path):
    save(tmp_path, OLD)
    with (
        files_of_at_most(2000),
        pytest.raises(OutputError, match="cannot be written: File too large; choose another folder") as caught,
    ):
        save(tmp_path, NEW | {"identification.nc": bytes(3000)})
    assert "\n" not in str(caught.value)
    assert content(tmp_path) == OLD
    assert hidden(tmp_path) == NOTE


def test_a_full_disk_leaves_the_old_file(tmp_path: Path):
    path = tmp_path / "x.csv"
    path.write_bytes(b"old")
    with (
        claim_file(path, overwrite=True) as write,
        files_of_at_most(2000),
        pytest.raises(OutputError, match="cannot be written: File too large"),
    ):
        write(lambda file: file.write(bytes(3000)))
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("x.csv", b"old")]


# single files


def test_a_files_folder_is_made_and_removed_again_where_nothing_comes(tmp_path: Path):
    with pytest.raises(RuntimeError), claim_file(tmp_path / "deep" / "down" / "x.csv"):
        raise RuntimeError
    assert not list(tmp_path.iterdir())
    with claim_file(str(tmp_path / "deep" / "x.csv")) as write:
        write(lambda file: file.write(b"new"))
    assert content(tmp_path / "deep") == {"x.csv": b"new"}


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_comes_to_be_there_during_the_work_is_kept(
    tmp_path: Path, links: bool, monkeypatch: pytest.MonkeyPatch
):
    def no_links(*_: object) -> None:
        raise OSError(errno.EPERM, "no hard links")

    if not links:
        monkeypatch.setattr(os, "link", no_links)
    path = tmp_path / "x.csv"
    with claim_file(path) as write:
        path.write_bytes(b"my")
        with pytest.raises(OutputError, match="is already there"):
            write(lambda file: file.write(b"new"))
    assert content(tmp_path) == {"x.csv": b"my"}
    with claim_file(tmp_path / "y.csv") as write:
        write(lambda file: file.write(b"new"))
    assert content(tmp_path) == {"x.csv": b"my", "y.csv": b"new"}


def test_what_living_processes_write_is_not_swept_up(tmp_path: Path):
    def slow(file) -> None:
        replace_file(tmp_path / "y.csv", lambda file: file.write(b"y"))
        file.write(b"x")

    replace_file(tmp_path / "x.csv", slow)
    assert content(tmp_path) == {"x.csv": b"x", "y.csv": b"y"}


# killed at random


@pytest.mark.slow
@posix
def test_nothing_is_lost_in_ten_random_kills(tmp_path: Path):
    from validation.kills import run

    tally = run(10, tmp_path, seed=1)
    assert tally.kills == 10
    assert tally.lost == ()


def test_a_folder_of_every_answer_names_the_command_that_wrote_it(tmp_path: Path):
    for name in KEPT:
        (tmp_path / "answer.json").write_text(f'{{"answer": "{name}", "fields": {{}}}}', encoding="utf-8")
        assert without("a result", tmp_path).endswith(": give another folder")


def test_advice_names_the_command_that_writes_what_was_expected(tmp_path: Path):
    """A folder that should have been an archive of batch was advised to be made by identify."""
    assert without("an archive of windsysid batch", tmp_path).endswith("check the name, or use windsysid batch first")
    assert without("a result of windsysid", tmp_path).endswith("check the name, or use windsysid identify first")
    (tmp_path / "a.csv").touch()
    assert without("a result of windsysid oma", tmp_path / "a.csv").endswith("; windsysid oma RECORD makes one")
