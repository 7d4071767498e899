"""Results that were kept say what ran, where and of which commit, and the site shows them all."""

import importlib.util
from pathlib import Path

import pytest
from validation.record import RESULTS, main

FACTS = ["command", "commit", "date", "machine", "Python", "processor time"]


@pytest.mark.parametrize("file", sorted(RESULTS.glob("*.txt")), ids=lambda file: file.stem)
def test_a_kept_result_says_where_it_comes_from(file: Path):
    head, output = file.read_text(encoding="utf-8").split("\n\n", 1)
    assert [line.split(": ", 1)[0] for line in head.splitlines()] == FACTS
    assert head.startswith(f"command: python -m validation.{file.stem}")
    assert output.strip()


def test_the_page_shows_every_kept_result(tmp_path: Path):
    spec = importlib.util.spec_from_file_location("measured", RESULTS.parents[1] / "docs" / "measured.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (tmp_path / "spring.txt").write_text("command: python -m validation.spring\ncommit: abc\n\n f [Hz]\n\n 1.5\n")
    (tmp_path / "older.md").write_text("## Older\n")
    module.write_measured(tmp_path, tmp_path / "reference" / "page.md")
    text = (tmp_path / "reference" / "page.md").read_text(encoding="utf-8")
    assert "`python -m validation.spring`" in text
    assert "- commit: abc\n" in text
    assert "```text\n f [Hz]\n\n 1.5\n```" in text
    assert text.endswith("## Older\n")


@pytest.mark.parametrize("words", [[], ["no_such_module"], ["hammond", "--runs", "3"]])
def test_what_cannot_be_run_is_refused_in_one_line(words: list[str], capsys: pytest.CaptureFixture[str]):
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.err.startswith("validation.record: expected ")
    assert said.err.count("\n") == 1
