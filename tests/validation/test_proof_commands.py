"""Commands that README and docs cite as proof: their options are known, and a short form of each of them runs."""

import argparse
import ast
import importlib
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from windsysid.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if page.parent.name not in ("reference", "gallery")),
]
DATA = ROOT.parent / "shared" / "data"
PEERS = ROOT / ".venv-peers" / "bin" / "python"

COMMAND = re.compile(r"python3? (?:-m )?((?:validation|benchmarks)[./][\w./]+)([^`\n#(]*)")
MAKE = re.compile(r"`make ([a-z-]+)|^make ([a-z-]+)(?: [A-Z]+=\S+)?\s+# ", re.MULTILINE)


class Cited(NamedTuple):
    """A command of a page: the program as `python -m` takes it, or its file, and its arguments as they are written."""

    program: str
    arguments: str
    page: str


def program_of(name: str) -> str:
    """A program's one name: a module of validation, or a file of benchmarks."""
    if name.startswith("benchmarks."):
        return name.replace(".", "/") + ".py"
    return name.removesuffix(".py").replace("/", ".") if name.startswith("validation") else name


def cited() -> list[Cited]:
    """All commands of all pages, and of the results that were kept."""
    found = []
    for page in (*PAGES, *sorted((ROOT / "validation" / "results").glob("*.txt"))):
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for name, arguments in COMMAND.findall(text):
            found.append(Cited(program_of(name.rstrip(".")), arguments.strip(), page.relative_to(ROOT).as_posix()))
    return list(dict.fromkeys(found))


CITED = cited()


def runnable() -> set[str]:
    """All programs of validation and benchmarks, cited or not."""
    sources = [*(ROOT / "validation").glob("*.py"), *(ROOT / "validation" / "adversary").glob("cal*.py")]
    sources += [path for path in (ROOT / "benchmarks").glob("*.py") if path.name not in ("bench.py", "sheets.py")]
    return {
        program_of(path.relative_to(ROOT).as_posix())
        for path in sources
        if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
    }


PROGRAMS = sorted({one.program for one in CITED} | runnable())

QUICK: dict[str, str] = {
    "validation.auto": '--only spectral --runs 1 --kinds "tower, random loads, 120 s"',
    "validation.damping": "--stop {tmp}/stop.nc",
    "validation.formats": "--files 1 --only CSV",
    "validation.frames": "--storeys 2 --runs 1 --seconds 60",
    "validation.kills": "--runs 1",
    "validation.mutation": "--sample 0",
}
"""Short forms that take some seconds, run by `make test`: program and arguments."""

SHORT: dict[str, tuple[str, ...]] = {
    "validation.install_size": ("",),
    "benchmarks/agreement.py": ("--samples 20",),
    "benchmarks/before.py": ("{root} --runs 1",),
    "benchmarks/compiling.py": ("--short",),
    "benchmarks/filters.py": ("",),
    "benchmarks/growth.py": ("--short",),
    "benchmarks/live_store.py": ("--blocks 100",),
    "benchmarks/peers.py": ("--short",),
    "benchmarks/processes.py": ("--short",),
    "benchmarks/roofline.py": ("--short",),
    "benchmarks/scaling.py": ("--short",),
    "benchmarks/smc.py": ("--runs 1",),
    "benchmarks/spectral_cost.py": ("--short",),
    "benchmarks/speed.py": ("",),
    "benchmarks/subspace.py": ("--openfast {data}/openfast --output {tmp} --lengths 270 --rotor",),
    "validation.adversary": ("--only reference --runs 1 --loads broadband --folder {tmp}",),
    "validation.adversary.calibrate": ("--runs 1",),
    "validation.benchmarks": ("--ground {data}/elcentro/elcentro_NS.dat --runs 1",),
    "validation.bjorko": ("--data {data}/bjorko/pull_release_10Hz.csv",),
    "validation.calibration": ("--scenario free-decay --runs 1",),
    "validation.comparison": ("--pairs 1 --cache {tmp}",),
    "validation.damping": ("--runs 1",),
    "validation.decays": ("--runs 1",),
    "validation.effects": ("--first 1 --runs 1 --machines tower --only bias --sizes 0.4",),
    "validation.endurance": ("--hours 0.02",),
    "validation.matching": ("--machines 20 --records 1",),
    "validation.field": ("--openfast {data}/openfast --output {tmp} --without-rotor --seeds 1",),
    "validation.window_pairs": ("--openfast {data}/openfast --records c2 --seconds 180 --output {tmp}",),
    "validation.wave_response": ("--openfast {data}/openfast",),
    "validation.windows": ("--openfast {data}/openfast --records c2 --seconds 180",),
    "validation.field_spectral": ("--simulated --rpm 12.1 --loads random --runs 1",),
    "validation.fleet": ("--healthy 1",),
    "validation.fleet_work": ("--reading", "--kills 1", "--speed 4", "--cost 1"),
    "validation.fuzz_cli": ("--inputs 3 --keep {tmp}",),
    "validation.hammond": ("",),
    "validation.integration": ("{tmp}",),
    "validation.live_api": ("--cases 1",),
    "validation.live_broker": ("--turbines 1 --seconds 5",),
    "validation.live_demo": ("--until page --limit 120",),
    "validation.live_engine": ("--turbines 1 --hours 0.2 --workers 1", "--coverage 1 --windows 2 --workers 1"),
    "validation.live_hostile": ("--messages 200",),
    "validation.live_kills": ("--runs 1 --seconds 60",),
    "validation.live_watch": ("--only bands --trials 1", "--only causes --trials 1"),
    "validation.mismatch": ("--runs 1 --models broadband",),
    "validation.oma": ("--runs 1 --frames 0",),
    "validation.particles": ("--runs 1 --seeds 1",),
    "validation.pieces": ("--only -",),
    "validation.robustness": ("--runs 1 --only clean",),
    "validation.side_by_side": ("--other {root} --only spectral --kinds random --folder {tmp}",),
    "validation.spectral": ("--runs 1 --loads random",),
    "validation.tolerances": ('--runs 1 --jobs 1 --only "as the"',),
    "validation.towers": ("--runs 1 --only healthy",),
    "validation.wind_study": ("--output {tmp}",),
    "validation.years": ("--years 1",),
}
"""Short forms that take longer, run by `make test-all`."""

NOT_RUN = {
    "validation.measured": "downloads measured records from a package index",
    "validation.record": "writes a kept result; tests/validation/test_record.py runs it",
    "validation.richer": "identifies a rotor many times from records that are no part of this repository;"
    " tests/validation/test_richer.py runs its parts",
    "validation.structure": "tests/validation/test_structure.py measures this checkout, and runs it on a small one",
    "validation.wheel": "makes environments from a package index",
}
"""Programs without a short form, and why."""

OF_PEERS = ("benchmarks/agreement.py", "benchmarks/peers.py", "benchmarks/smc.py", "benchmarks/subspace.py")
"""Programs that run in the environment of `benchmarks/peers.txt`."""


def words_of(arguments: str) -> list[str]:
    """Arguments as words; what stands for more of the same is left out."""
    return shlex.split(re.sub(r"--[\w-]+ …", "", arguments).replace("…", ""))


class _Built(Exception):  # noqa: N818 (no error)
    """A program has built its parser."""


def parser_of(program: str, monkeypatch: pytest.MonkeyPatch) -> argparse.ArgumentParser | None:
    """The parser that a module of validation builds before it does anything; None of one that takes no options."""
    built: list[argparse.ArgumentParser] = []

    def stop(parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        built.append(parser)
        raise _Built

    if "parse_args" not in (source_of(program)).read_text(encoding="utf-8"):
        return None
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    with pytest.raises(_Built):
        importlib.import_module(entry_of(program)).main()
    monkeypatch.undo()
    return built[0]


def entry_of(program: str) -> str:
    """The module whose `main` a program runs."""
    return "validation.adversary.campaign" if program == "validation.adversary" else program


def source_of(program: str) -> Path:
    """The file of a program's options."""
    return ROOT / program if program.endswith(".py") else ROOT / (entry_of(program).replace(".", "/") + ".py")


def options_in(source: Path) -> set[str]:
    """Options that a source adds to a parser, read without running it."""
    calls = (node for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))
    added = (call.args for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "add_argument")
    return {str(word.value) for words in added for word in words if isinstance(word, ast.Constant)}


def test_commands_are_found_on_the_pages():
    assert len(PROGRAMS) > 40
    assert any(one.arguments.startswith("--runs 500") for one in CITED)


@pytest.mark.parametrize("program", PROGRAMS)
def test_cited_options_are_known_to_their_program(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    mine = [one for one in CITED if one.program == program]
    if program.startswith("benchmarks/"):
        known = options_in(ROOT / program)
        for one in mine:
            assert set(re.findall(r"--[\w-]+", one.arguments)) <= known, one
        return
    parser = parser_of(program, monkeypatch)
    for one in mine:
        if parser is None:
            assert not one.arguments.startswith("-"), one
        elif "[" in one.arguments:  # what may be given
            assert set(re.findall(r"--[\w-]+", one.arguments)) <= set(parser._option_string_actions), one
        elif one.arguments:  # a program that is only named may want more
            try:
                parser.parse_args(words_of(one.arguments))
            except SystemExit:
                pytest.fail(f"{one}: {capsys.readouterr().err}")


def test_cited_targets_of_make_exist():
    rules = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    asked = {page.name: {a or b for a, b in MAKE.findall(page.read_text(encoding="utf-8"))} for page in PAGES}
    assert {"study", "test", "bench"} <= asked["README.md"] | asked["performance.md"]
    assert {name: targets - rules for name, targets in asked.items() if targets - rules} == {}


def test_options_of_windsysid_within_sentences_exist():
    program = typer.main.get_command(app)
    assert isinstance(program, typer.core.TyperGroup)
    for page in PAGES:
        for text in re.findall(r"`windsysid ([a-z]+[^`\n]*)`", page.read_text(encoding="utf-8")):
            name, _, rest = text.partition(" ")
            assert name in program.commands, f"{page.name}: windsysid {text}"
            parameters = program.commands[name].params
            known = {option for one in parameters for option in (*one.opts, *one.secondary_opts)} | {"--help"}
            assert set(re.findall(r"(?<![\w-])--[\w-]+", rest)) <= known, f"{page.name}: windsysid {text}"


def test_every_program_has_a_short_form():
    """A program that is new or newly cited needs a line in one of the tables above."""
    assert set(PROGRAMS) == {*QUICK, *SHORT, *NOT_RUN}


def filled(arguments: str, folder: Path) -> list[str]:
    """Arguments with a folder, the checkout and the records beside it."""
    return shlex.split(arguments.format(tmp=folder, root=ROOT, data=DATA))


@pytest.mark.parametrize(
    "program",
    [pytest.param(one, marks=[pytest.mark.slow] * (one in ("validation.kills", "validation.frames"))) for one in QUICK],
)
def test_the_shortest_form_of_a_command_runs(
    program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(sys, "argv", [program, *filled(QUICK[program], tmp_path)])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "src"), str(ROOT)]))
    try:
        code = importlib.import_module(program).main()
    except SystemExit as ended:
        code = ended.code
    assert not code
    assert "--stop" in QUICK[program] or capfd.readouterr().out.strip()


SHORT_FORMS = [(program, arguments) for program, given in SHORT.items() for arguments in given]


@pytest.mark.slow
@pytest.mark.parametrize(("program", "arguments"), SHORT_FORMS, ids=lambda text: text)
def test_the_short_form_of_a_command_runs(program: str, arguments: str, tmp_path: Path):
    lacking = what_lacks(program, arguments)
    if lacking:
        pytest.skip(lacking)
    python = str(PEERS) if program in OF_PEERS else sys.executable
    start = [python, str(ROOT / program)] if program.endswith(".py") else [python, "-m", program]
    around = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    ended = subprocess.run(
        [*start, *filled(arguments, tmp_path)], cwd=tmp_path, env=around, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert ended.stdout.strip()


def what_lacks(program: str, arguments: str) -> str:
    """What this machine lacks to run a program, in words."""
    if "{data}" in arguments and not DATA.is_dir():
        return "measured and simulated records are not beside this checkout"
    if program in OF_PEERS and not PEERS.exists():
        return "no environment of benchmarks/peers.txt: make bench makes one"
    if program == "validation.live_broker" and shutil.which("mosquitto") is None:
        return "no mosquitto"
    if program == "validation.live_api" and importlib.util.find_spec("schemathesis") is None:
        return "no schemathesis"
    return ""
