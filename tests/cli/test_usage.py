"""A command that is typed wrong is refused in one line: what, expected, got, what to do."""

import re
from collections.abc import Callable

import pytest
import typer

from tests.conftest import Ended
from windsysid.cli import app
from windsysid.cli.common import COMMANDS

TURBINES = "hammond, nrel5mw, nrel5mw_full, tower, verne555"


@pytest.mark.parametrize(
    ("typed", "line"),
    [
        ("identify a.csv", rf"identify: --turbine is missing: expected {TURBINES}, a TOML file .* Type: windsysid "
         r"identify RECORD --turbine NAME$"),
        ("identify a.csv --turbine", rf"identify: --turbine: expected {TURBINES}, a TOML file"),
        ("identify", "identify: RECORD is missing: expected CSV, .* Type: windsysid identify RECORD --turbine NAME"),
        ("compare a", "compare: AFTER is missing: expected one or more folders of later records. Type: windsysid"),
        ("publish a --turbine b", "publish: --broker is missing: expected mqtt://"),
        ("identify a.csv --turbin b", "identify: no option --turbin: did you mean --turbine[?] windsysid identify --h"),
        ("study --verbose", "study: no option --verbose: windsysid study --help lists all options"),
        ("identify a --turbine b --formulation c",
         "--formulation: expected one of joint, spectral, force-balance, auto, got 'c'"),
        ("identify a --turbine b --section 1 c", r"--section: expected two numbers \(START END\), got '1 c'"),
        ("identify a --turbine b --section 1", r"--section: expected two numbers \(START END\); see windsysid ident"),
        ("identify a --turbine b --overwrite=3", "--overwrite: expected no value"),
        ("identify a b --turbine c", "too many arguments: 'b'; a name with spaces needs quotes"),
        ("plan --turbine tower --rate fast", "plan: --rate: expected a number, got 'fast'; see windsysid plan --help"),
        ("plan --turbine tower --seed -1", "plan: --seed: expected a whole number of at least 0, got '-1'"),
        ("live --port 70000", "live: --port: expected a whole number from 0 to 65535, got '70000'"),
        ("idntify a.csv", "no command 'idntify': did you mean identify[?]"),
        ("nothing", "no command 'nothing': windsysid --help lists all commands"),
        ("--turbine tower identify", "no option --turbine before a command: options follow it"),
    ],
)  # fmt: skip
def test_a_command_that_is_typed_wrong_is_refused_in_one_line(run: Callable[..., Ended], typed: str, line: str):
    ended = run(*typed.split())
    assert (ended.code, ended.out, len(ended.err)) == (2, "", 1)
    assert re.search(f"^windsysid: {line}" if line.startswith("no ") else line, ended.err[0]), ended.err[0]


def test_a_file_without_a_command_is_refused_with_the_command_to_begin_with(run: Callable[..., Ended], tmp_path):
    (tmp_path / "a.csv").write_text("")
    assert "expected one before the file: windsysid start a.csv" in run("a.csv").err[0]


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_of_every_command_without_its_value_is_refused_in_one_line(
    run: Callable[..., Ended], name: str, step: int
):
    for param in typer.main.get_command(app).commands[name].params[::-step]:  # type: ignore[attr-defined]
        if param.param_type_name == "option" and not param.is_flag:
            option = max(param.opts, key=len)
            ended = run(name, option)
            assert (ended.code, len(ended.err)) == (2, 1), ended
            assert option in ended.err[0], ended.err
