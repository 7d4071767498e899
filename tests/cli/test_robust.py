"""Whatever a user types or a terminal cannot show: one line, no traceback, nothing cut off."""

import io
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from windsysid import cli
from windsysid.output.console import plain, render
from windsysid.output.table import Table
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

VERNE555 = Path(cli.__file__).parents[1] / "turbine" / "packaged" / "verne555.toml"


@pytest.fixture
def refusal(run):
    """The one line in which the command line refuses, with exit code 2."""

    def refusal(*arguments: object) -> str:
        ended = run(*arguments)
        assert (ended.code, ended.out, len(ended.err)) == (2, "", 1), ended.err
        line: str = ended.err[0]
        return line

    return refusal


# what a terminal can show


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "utf-8"])
def test_output_comes_out_in_every_encoding(monkeypatch: pytest.MonkeyPatch, encoding: str):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding=encoding))
    monkeypatch.setattr(sys, "argv", ["windsysid", "turbines"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    text = written.getvalue().decode(encoding)
    assert "verne555" in text
    assert "?" not in text


def test_signs_are_spelt_so_that_they_can_be_read():
    assert plain("±2σ, Ω ≤ 3, é, 5 °, −1 … 2, m/s²") == "+/-2sigma, Omega <= 3, e, 5 deg, -1 ... 2, m/s^2"
    assert plain("±2σ", "cp1252") == "±2sigma"
    assert plain("┏━│┃ ζ ⇒") == "+-|| zeta ?"


class Terminal(io.StringIO):
    """A terminal of some encoding."""

    def __init__(self, encoding: str = "utf-8") -> None:
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._encoding

    def isatty(self) -> bool:
        return True


def identified_table():
    title = "a turbine, [/x]: " + "a caption that says more than fits, " * 4
    headings = ("coefficient", "estimate", "95 % interval", "unit", "from data", "reference", "difference")
    cells = ("1.2345e+06", "1.2345e+06 … 1.3456e+06", "N·m·s/rad", "99.9 %", "1.2345e+06", "+12.34 %")
    names = ("k_x", "c_beta_3", "a_very_long_name_of_a_coefficient_[/x]")
    return Table(headings, [(name, *cells) for name in names], title)


@pytest.mark.parametrize("columns", [60, 80, 120])
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "ascii"])
def test_a_table_fits_the_terminal_and_nothing_is_cut_off(monkeypatch: pytest.MonkeyPatch, columns: int, encoding: str):
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr(sys, "stdout", Terminal(encoding))
    sentence = (
        "Every mode is damped from 6.96 to 90.5 rpm: the least by 0.53 %, and so on and on for many words more than"
        " fit."
    )
    text = render(identified_table(), sentence)
    assert max(map(len, text.splitlines())) <= columns
    assert "".join(text.split()).count("99.9%") == 3
    text.encode(encoding)


def test_text_in_a_pipe_is_the_same_whatever_the_terminal(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    sentence = "word " * 60
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    assert render(sentence) == sentence.rstrip()


# what users type


@pytest.mark.parametrize("options", [("--duration", "1e12"), ("--duration", "1e8", "--rate", "1e4")])
def test_a_simulation_larger_than_the_memory_is_refused(refusal, tmp_path: Path, options: tuple[str, ...]):
    line = refusal("simulate", "--turbine", "verne555", "--output", tmp_path / "x.csv", *options)
    assert "GB of memory, and this machine has" in line


def test_brackets_in_names_are_no_markup(refusal, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    for arguments in (
        ("identify", "[/x].csv", "--turbine", "verne555", "--output", tmp_path / "o"),
        ("inspect", "[/x].csv"),
        ("modes", "[/x]"),
        ("simulate", "--turbine", "verne555", "--duration", "5", "--output", tmp_path / "[/x].md"),
    ):
        assert "[/x]" in refusal(*arguments)
    for usage in (("[/x]",), ("study", "--seed", "[/x]"), ("identify", "--[/x]")):
        monkeypatch.setattr(sys, "argv", ["windsysid", *usage])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 2


@pytest.mark.parametrize(
    ("stiffness", "complaint"),
    [("1e14 N/m", "makes x vibrate at"), ("0 N/m", "expected a positive k_x, got 0"),
    ("1e-5 N/m", "one period of the turbine's slowest"),
    ("1e40 N/m", "support.k_x: expected a size of 1e-06 … 1e+15 N/m"),
    ("1e-300 N/m", "support.k_x: expected a size of 1e-06 … 1e+15 N/m")],
)  # fmt: skip
def test_a_stiffness_that_cannot_be_is_refused(refusal, tmp_path: Path, stiffness: str, complaint: str):
    from windsysid.records.formats import write_record

    write_record(simulate_record(load_turbine("verne555"), duration=5.0, rate=100.0), tmp_path / "record.csv")
    text = VERNE555.read_text(encoding="utf-8")
    assert 'k_x = "1800 N/m"' in text
    (tmp_path / "t.toml").write_text(text.replace('k_x = "1800 N/m"', f'k_x = "{stiffness}"'), encoding="utf-8")
    common = ("--turbine", tmp_path / "t.toml", "--output", tmp_path / "o")
    assert complaint in refusal("identify", tmp_path / "record.csv", *common)


def test_values_that_nothing_measures_are_refused(refusal, tmp_path: Path):
    rows = "".join(f"{k / 100},{'-' if k % 2 else ''}1e308\n" for k in range(100))
    (tmp_path / "record.csv").write_text(f"time [s],tower_x_acceleration [m/s^2]\n{rows}")
    assert "reaches 1e+308: expected less than 1e+100" in refusal("inspect", tmp_path / "record.csv")


def test_a_name_that_is_too_long_is_refused(refusal, tmp_path: Path):
    long = tmp_path / ("a" * 300)
    for arguments in (
        ("plan", "--turbine", "verne555", "--output", long),
        ("inspect", f"{long}.csv"),
        ("modes", "--turbine", f"{long}.toml"),
        ("simulate", "--turbine", "verne555", "--duration", "5", "--output", f"{long}.csv"),
    ):
        assert re.search("File name too long|no such file", refusal(*arguments))


def test_tables_nested_deeper_than_python_follows_are_refused(refusal, tmp_path: Path):
    deep = tmp_path / "deep.toml"
    deep.write_text("a = " + "[" * 5000 + "]" * 5000)
    (tmp_path / "record.csv").write_text("time [s],a [m]\n0,1\n1,2\n")
    assert "nested too deeply" in refusal("modes", "--turbine", deep)
    assert "nested too deeply" in refusal("plan", "--turbine", "verne555", "--sensors", deep)
    assert "nested too deeply" in refusal("inspect", tmp_path / "record.csv", "--mapping", deep)


def test_control_characters_of_a_name_do_not_reach_the_terminal(refusal):
    assert "?[31mred" in refusal("inspect", "\x1b[31mred.csv")


def test_control_characters_of_a_channel_are_not_printed():
    from windsysid.output.console import render

    assert render("channel \x1b[31mred", "a\nb") == "channel ?[31mred\na\nb"


# how a run ends

HEARD = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""A program that a shell starts in the background ignores interrupts, and so do the programs that it starts."""


def test_a_reader_who_has_seen_enough_ends_it_quietly():
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        ended = subprocess.run(
            [sys.executable, "-m", "windsysid", "turbines"], stdout=closed, stderr=subprocess.PIPE, check=False
        )
    assert (ended.returncode, ended.stderr) == (1, b"")


@pytest.mark.parametrize("after", [0.02, 0.2])
def test_an_interrupt_while_modules_are_loaded_ends_it_quietly(tmp_path: Path, after: float):
    code = (
        f"{HEARD}"
        "from windsysid.__main__ import main\n"
        "import os, signal, sys, threading\n"
        f"path = {str(tmp_path / 'x.csv')!r}\n"
        "sys.argv = ['windsysid', 'simulate', '--turbine', 'verne555', '--duration', '5000', '--output', path]\n"
        f"threading.Timer({after}, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "main()"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert ended.returncode in (130, -signal.SIGINT), ended.stderr.decode()
    assert b"Traceback" not in ended.stderr


def test_an_interrupt_inside_a_destructor_ends_it_too():
    code = (
        f"{HEARD}"
        "import windsysid.cli, os, signal, time\n"
        "class Dropping:\n"
        "    def __del__(self):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "        time.sleep(0.2)\n"
        "def run():\n"
        "    Dropping()\n"
        "    time.sleep(30.0)\n"
        "windsysid.cli.main = run\n"
        "from windsysid.__main__ import main\n"
        "main()"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False, timeout=25)
    assert ended.returncode == 130
    assert ended.stderr == b""


@pytest.mark.parametrize("columns", [60, 80])
def test_no_number_is_broken_over_two_lines(monkeypatch: pytest.MonkeyPatch, columns: int):
    monkeypatch.setenv("COLUMNS", str(columns))
    row = ("noise_of_the_accelerometer_on_the_tower", "1.78083e+06", "-1.90012e-03", "1.7497e+06 … 1.8124e+06")
    text = render(Table(("name", "before", "after", "±2σ band"), [row]))
    assert all(len(line) <= columns for line in text.splitlines())
    for number in ("1.78083e+06", "-1.90012e-03", "1.7497e+06 …", "1.8124e+06"):
        assert number in text


def test_tables_have_one_style_and_an_empty_line_between_them(monkeypatch: pytest.MonkeyPatch):
    narrow = Table(("name", "value"), [("a", "1.0"), ("大", "22.0")], "narrow")
    wide = Table(("name", *(f"value of {i}" for i in range(9))), [("a", *(["1.23456789e+10"] * 9))])
    for columns in ("80", "200"):
        monkeypatch.setenv("COLUMNS", columns)
        text = render(narrow, narrow, wide, "end")
        assert not set("┏┃│┡") & set(text)
        assert text.startswith("narrow\nname  value\n───────────\na       1.0\n大     22.0\n\nnarrow\n")
        assert text.endswith("\nend")
    assert text.count("\n\n") == 2


@pytest.mark.parametrize("name", ["nic\udce9$a$.csv", "a\n[red]b\x1b[31m.csv", "<b>x.csv"])
def test_any_name_of_a_file_is_shown_and_saved(run, tmp_path: Path, name: str):
    path = tmp_path / name
    try:
        path.write_text("time [s],tower_x_acceleration [m/s^2]\n" + "".join(f"{k / 10},{k % 7}\n" for k in range(300)))
    except OSError:
        pytest.skip("this file system has other names")
    ended = run("inspect", path, "--output", tmp_path / "out\udce9\n")
    assert ended.code == 0, ended.err
    assert all(line.isprintable() for line in ended.out.split("\n"))
    page = (tmp_path / "out\udce9\n" / "report.html").read_text(encoding="utf-8")
    assert "<b>x.csv" not in page
    ended = run("oma", tmp_path / f"gone{name}", "--output", tmp_path / "modes")
    assert ended.code == 2
    assert len(ended.err) == 1
    assert ended.err[0].isprintable()


def test_a_page_holds_any_text():
    from windsysid.reports.html import Section, report_page

    assert b"\\udce9" in report_page("nic\udce9", "", [Section("title", ["text"])])
