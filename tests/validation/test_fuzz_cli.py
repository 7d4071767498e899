"""The command line ends every input in a right answer or one clear line (`python -m validation.fuzz_cli`: more)."""

import os

import pytest
from validation.fuzz_cli import Input, Outcome, judge, run_inputs

pytestmark = pytest.mark.usefixtures("without_effects")


@pytest.mark.parametrize("count", [8, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.skipif(not hasattr(os, "fork"), reason="inputs run in forks of this process")
def test_inputs_end_in_a_right_answer_or_in_one_line(count: int):
    """The kinds that compile no new kernels."""
    table, violations = run_inputs(count, 2, None, kinds=("mapping", "record", "hostile", "values", "same"))
    assert violations == []
    assert sum(counts["exit 0"] for counts in table.values()) >= count // 50
    assert sum(counts["exit 2"] for counts in table.values()) >= min(6, count // 4)


@pytest.mark.parametrize(
    ("ended", "complaint"),
    [
        (Outcome(2, "", "windsysid: r.csv: no such file; check the name\n"), ""),
        (Outcome(2, "", "Usage: windsysid identify\nError: no such option\n"), ""),
        (Outcome(None, "", ""), "takes too long"),
        (Outcome(1, "", "Traceback (most recent call last):\nKeyError: 'x'\n"), "traceback: KeyError: 'x'"),
        (Outcome(0, "", "x.py:3: RuntimeWarning: divide by zero\n"), "a Python warning"),
        (Outcome(2, "", "windsysid: one\nwindsysid: two\n"), "2 lines"),
        (Outcome(2, "", "windsysid: \x1b[31mred\n"), "control characters"),
        (Outcome(139, "", ""), "exit code 139"),
    ],
)
def test_the_judge_knows_a_violation(tmp_path, ended, complaint):
    found = judge(Input("x", ["inspect", "r.csv"]), ended, tmp_path, {})
    assert complaint in found if complaint else found == ""


def test_the_judge_sees_lost_files_and_what_is_left_behind(tmp_path):
    given, refusal = Input("x", ["inspect", "r.csv"], {"r.csv": b"1"}), Outcome(2, "", "windsysid: no\n")
    assert judge(given, refusal, tmp_path, {}) == "lost or changed r.csv"
    (tmp_path / "r.csv").write_bytes(b"1")
    assert judge(given, refusal, tmp_path, {}) == ""
    (tmp_path / ".half").write_bytes(b"1")
    assert judge(given, refusal, tmp_path, {}) == "leaves .half behind"
