"""The site: every public name and every command is in the reference, pages lead to pages that are there, and what they
tell to type works."""

import importlib.util
import inspect
import re
import runpy
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest
import typer

import windsysid
from tests.conftest import Ended, registers_as_before
from windsysid.cli import app

ROOT = Path(__file__).parents[1]
SITE = sorted(page for page in (ROOT / "docs").rglob("*.md") if page.parent.name not in ("reference", "_build"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *SITE]


def named(page: Path) -> str:
    """A page's name in the site."""
    return page.relative_to(ROOT).as_posix()


def is_tutorial(page: Path) -> bool:
    """Whether its commands are run, too."""
    return page.parent.name == "tutorials"


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    folder = tmp_path_factory.mktemp("reference")
    module.write_reference(folder)
    return folder


def test_every_public_name_is_in_the_reference_with_a_docstring(reference: Path):
    for namespace in (windsysid, windsysid.results, windsysid.models, windsysid.filters, windsysid.signals):
        text = (reference / f"{namespace.__name__}.md").read_text(encoding="utf-8")
        for name in namespace.__all__:
            thing = getattr(namespace, name)
            if not name.startswith("__") and not inspect.ismodule(thing):
                assert f":: {namespace.__name__}.{name}\n" in text
                assert thing.__doc__


def test_every_command_is_in_the_reference(reference: Path):
    text = (reference / "commands.md").read_text(encoding="utf-8")
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        assert f"## windsysid {name}\n" in text
        assert f"Usage: windsysid {name} " in text


def test_links_lead_somewhere():
    dead = []
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
            if not target.startswith(("http://", "https://", "reference/", "gallery/")):
                dead += [f"{named(page)}: {target}"] * (not (page.parent / target).exists())
    assert not dead, "\n".join(dead)


def test_every_page_is_on_the_site():
    listed = set()
    for page in SITE:
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL):
            lines = [line for line in tree.split() if not line.startswith(":")]
            listed |= {found.resolve() for line in lines for found in page.parent.glob(f"{line}.md")}
    assert set(SITE) - {ROOT / "docs" / "index.md"} <= listed


FENCED = re.compile(
    r"(?:<!--\s*not run:(?P<why>.*?)-->\s*)?^```(?P<kind>python|sh)\n(?P<code>.*?)^```$", re.DOTALL | re.MULTILINE
)
"""A block of code, and above it the reason why it is not run, where there is one."""

SPRING = """
import numpy as np, sympy as sp, windsysid as ws
x, v, ground, force, k, c_x, m = sp.symbols("x v ground load_x k c_x m", real=True)
"""

MODEL = (
    SPRING
    + """
system = ws.models.Equations("page_spring", (x, v), (), (m, c_x, k), (force,), (v, (force - c_x * v - k * x) / m))
model = ws.models.compose(
    system, rate=50.0, values={"m": 1.0}, gate=6.0, loads=[ws.models.GaussMarkov("load_x", 1.0, 0.3)],
    parameters=[ws.models.Parameter("c_x", 0.4, 0.2, False, 10.0), ws.models.Parameter("k", 40.0, 0.3)],
    sensors=[ws.models.Reading("tower_x_acceleration", (force - c_x * v - k * x) / m, 0.1)],
)
readings = np.random.default_rng(0).standard_normal((200, 1))
inputs = np.zeros((200, len(ws.filters.UKF.init(model).inputs)))
next_inputs, next_readings = inputs[0], readings[0]
"""
)

TOWER = """
import windsysid as ws
turbine = ws.load_turbine("tower")
record = ws.simulate(turbine, duration=400.0, rate=10.0, seed=1)
"""

GIVEN = {
    "benchmarks_structural": SPRING
    + """
w = sp.Symbol("w")
absolute = -(c_x * v + k * x)
spring = ws.models.Equations("page_shaken", (x, v, w), (ground,), (m, c_x, k), (), (v, absolute / m - ground, v - w))
time = np.arange(500) / 50.0
shaking = np.random.default_rng(0).standard_normal((500, 2))
record = ws.Record(time, shaking, ("ground", "acceleration"), ("m/s^2", "m/s^2"))
_models = ws.models
class ws:
    class models:
        Parameter, Reading = _models.Parameter, _models.Reading
        fit = staticmethod(lambda *a, values, **more: _models.fit(*a, values={**values, "c_x": 0.3}, **more))
""",
    "filters": MODEL,
    "particles": MODEL.replace("gate=6.0, ", ""),
    "inspect": TOWER + "folder = 'inspected'",
    "oma": TOWER + "ws.write_record(record, 'record.csv')",
    "records": TOWER
    + """
from pathlib import Path
from windsysid import iterate_record, read_record
ws.write_record(ws.simulate(turbine, duration=5000.0, rate=2.0, seed=1), "year.parquet")
ws.write_record(record, "year.csv")
ws.write_record(record, "mast.csv")
Path("mast.csv").rename("mast.dat")
Path("mast.toml").write_text('[channels.tower_x_acceleration]\\nunit = "m/s^2"\\n')
""",
    "results": TOWER + "ws.identify(record, turbine).save('results/verne555')",
    "README": """
import windsysid as ws
ws.write_record(ws.simulate("tower", duration=600.0, rate=10.0), "tower_year1.csv")
""",
}
"""What the code of a page takes for granted, by the page's name."""

LONG = {
    "README", "results", "benchmarks_structural", "filters", "findings", "grades", "particles", "planning", "wind",
}  # fmt: skip
"""Pages whose code takes a second or more: run by `make test-all`, as tutorials are."""


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Kind, code and reason not to run it of each block of a page."""
    found = FENCED.finditer(page.read_text(encoding="utf-8"))
    return [(block["kind"], block["code"], (block["why"] or "").strip()) for block in found]


def commands(code: str) -> list[list[str]]:
    """The windsysid commands of a block of shell, as words."""
    lines = code.replace("\\\n", " ").splitlines()
    words = [shlex.split(line, comments=True) for line in lines]
    return [line[1:] for line in words if line and line[0] == "windsysid"]


@pytest.mark.parametrize("page", [page for page in PAGES if "```sh" in page.read_text(encoding="utf-8")], ids=named)
def test_commands_and_their_options_exist(page: Path):
    program: Any = typer.main.get_command(app)
    for kind, code, _ in blocks(page):
        for name, *given in commands(code) if kind == "sh" else ():
            command = program.commands[name]
            with command.make_context(name, given):
                pass


QUICK = {"months_of_estimates"}
"""Examples that take some seconds; the others are run by `make test-all`, and all whenever the site is built. Notebooks
and tests of an own turbine's model run the code of two others."""


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(file, id=file.stem, marks=[] if file.stem in QUICK else [pytest.mark.slow])
        for file in sorted((ROOT / "examples").glob("*.py"))
    ],
)
def test_an_example_runs(example: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.path", [str(ROOT), *sys.path])
    monkeypatch.setattr("sys.argv", [str(example)])
    plt.switch_backend("agg")
    with registers_as_before():
        runpy.run_path(str(example), run_name="__main__")
    assert plt.get_fignums(), "expected a figure"
    plt.close("all")


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=named(page), marks=[pytest.mark.slow] * (page.stem in LONG or is_tutorial(page)))
        for page in PAGES
        if any(kind == "python" for kind, _, _ in blocks(page)) or is_tutorial(page)
    ],
)
def test_the_code_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[..., Ended]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [str(ROOT), *sys.path])
    (tmp_path / "results").mkdir()
    known: dict[str, object] = {"__name__": "page"}
    with registers_as_before():
        exec(GIVEN.get(page.stem, ""), known)
        for kind, code, why in blocks(page):
            if why:
                continue
            if kind == "python":
                exec(compile(code, str(page), "exec"), known)
            for words in commands(code) if kind == "sh" and is_tutorial(page) else ():
                ended = run(*words)
                assert ended.code == 0, (words, ended.err)
                assert words[0] != "identify" or "trust: yes" in ended.out, "a tutorial ends in an answer to trust"


def test_version_is_the_same_everywhere():
    """What a reader cites, and the newest heading of what changed."""
    assert f"\nversion: {windsysid.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert newest is not None
    assert newest[1] == windsysid.__version__
