"""A folder of results appears whole or not at all, and is never overwritten silently."""

from pathlib import Path

import pytest

from windsysid.errors import OutputError
from windsysid.output import check_output, new_folder


def results(folder: Path, text: str = "old") -> Path:
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text(text)
    (folder / "report.html").write_text(text)
    return folder


def test_a_folder_appears_with_everything_in_it(tmp_path: Path):
    target = tmp_path / "deep" / "down" / "results"
    with new_folder(target, overwrite=False) as folder:
        (folder / "summary.json").write_text("new")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["summary.json"]
    assert [path.name for path in target.parent.iterdir()] == ["results"]
    assert target.stat().st_mode & 0o777 == 0o755


def test_an_empty_folder_may_be_filled(tmp_path: Path):
    (tmp_path / "results").mkdir()
    with new_folder(tmp_path / "results", overwrite=False) as folder:
        (folder / "a").write_text("new")
    assert (tmp_path / "results" / "a").read_text() == "new"


def test_results_are_not_overwritten_without_being_told(tmp_path: Path):
    target = results(tmp_path / "results")
    with pytest.raises(OutputError, match="is already there: choose another folder, or add --overwrite"):
        check_output(target, overwrite=False)
    with pytest.raises(OutputError, match="already there"), new_folder(target, overwrite=False):
        pytest.fail("never entered")
    assert (target / "summary.json").read_text() == "old"


def test_overwriting_replaces_everything(tmp_path: Path):
    target = results(tmp_path / "results")
    with new_folder(target, overwrite=True) as folder:
        (folder / "summary.json").write_text("new")
    assert [path.name for path in target.iterdir()] == ["summary.json"]
    assert (target / "summary.json").read_text() == "new"


def test_a_folder_of_something_else_is_not_overwritten_even_then(tmp_path: Path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter1.tex").write_text("years of work")
    with pytest.raises(OutputError, match="holds files that are not results of windsysid"):
        check_output(tmp_path / "thesis", overwrite=True)
    assert (tmp_path / "thesis" / "chapter1.tex").read_text() == "years of work"


def test_work_that_fails_leaves_nothing_and_spoils_nothing(tmp_path: Path):
    target = results(tmp_path / "results")

    def work() -> None:
        with new_folder(target, overwrite=True) as folder:
            (folder / "summary.json").write_text("half")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        work()
    assert (target / "summary.json").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["results"]


def test_what_cannot_be_made_is_refused_before_any_work(tmp_path: Path):
    file = tmp_path / "file"
    file.write_text("a file")
    with pytest.raises(OutputError, match="expected a folder, got a file"):
        check_output(file, overwrite=True)
    with pytest.raises(OutputError, match=r"cannot be made: .* is not a folder that can be written to") as caught:
        check_output(file / "below", overwrite=False)
    assert "\n" not in str(caught.value)
    assert file.read_text() == "a file"


def test_a_disk_error_is_one_line(tmp_path: Path):
    with (
        pytest.raises(OutputError, match="cannot be written: No space left on device; choose another folder"),
        new_folder(tmp_path / "results", overwrite=False),
    ):
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())
