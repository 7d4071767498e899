"""`import windsysid` is light, and every public name leads somewhere that explains itself."""

import importlib
import inspect
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import windsysid
from windsysid.cli.common import COMMANDS, HYPOTHESES_HELP

HEAVY = ("numba", "sympy", "scipy", "pandas", "xarray", "matplotlib", "numpy", "pydantic", "typer", "rich")
MODULES = [
    "windsysid",
    *sorted(info.name for info in pkgutil.walk_packages(windsysid.__path__, "windsysid.")),
]


def in_a_new_process(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_help_of_a_command_loads_no_numerics():
    """Pydantic alone comes in with options; help is drawn without Rich. One process, in which modules add up, tells
    the first command that loads one."""
    code = (
        "import io, sys, contextlib\n"
        "from windsysid.cli import main\n"
        f"for command in {['', *COMMANDS]!r}:\n"
        "    sys.argv, said = ['windsysid', *command.split(), '--help'], io.StringIO()\n"
        "    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):\n"
        "        main()\n"
        "    assert f'windsysid {command}'.strip() in said.getvalue(), command\n"
        f"    loaded = sorted((set({HEAVY!r}) - {{'pydantic', 'typer'}}) & set(sys.modules))\n"
        "    if loaded:\n"
        "        sys.exit(print(command, loaded))\n"
    )
    assert in_a_new_process(code) == ""


@pytest.mark.parametrize(
    "namespace", [windsysid, windsysid.results, windsysid.models], ids=lambda space: space.__name__
)
def test_every_public_name_resolves_and_a_prompt_completes_it(namespace: ModuleType):
    assert all(getattr(namespace, name) is not None for name in namespace.__all__)
    assert len(set(namespace.__all__)) == len(namespace.__all__)
    assert set(namespace.__all__) <= set(dir(namespace))


HEAVY_FOR_AN_ANSWER = {
    "matplotlib", "pandas", "xarray", "sympy", "PIL", "scipy.signal", "scipy.stats", "scipy.optimize",
    "scipy.interpolate",
}  # fmt: skip
PAGE_OF_TOWER = (
    "{'report.html': importlib.import_module('windsysid.reports.identification')"
    ".identification_report(ws.identify(record, 'tower'), record)}"
)


def test_the_package_turbines_and_answers_load_nothing_that_they_do_not_need(tmp_path: Path):
    """One process, in which modules add up: import, list of turbines, answers; then names are what they say."""
    path = tmp_path / "record.csv"
    windsysid.write_record(windsysid.simulate("tower", duration=300.0, rate=4.0), path)
    code = (
        "import sys, windsysid as ws\n"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)))\n"
        "for name in ws.packaged_turbines():\n"
        "    ws.load_turbine(name)\n"
        f"print(sorted((set({HEAVY!r}) - {{'pydantic'}}) & set(sys.modules)))\n"
        f"record = ws.read_record({str(path)!r})\n"
        "for found in (ws.inspect(record), ws.oma(record)):\n"
        "    assert len(found.files()['report.html']) > 10_000\n"
        f"    print(sorted({HEAVY_FOR_AN_ANSWER!r} & set(sys.modules)))\n"
        "print([name for name in ws.__all__ if type(getattr(ws, name)).__name__ == 'module'])"
    )
    assert in_a_new_process(code).splitlines() == ["[]"] * 4 + ["['filters', 'models', 'results', 'signals']"]


@pytest.mark.slow
def test_an_identification_and_its_page_load_nothing_heavy(tmp_path: Path):
    path = tmp_path / "record.csv"
    windsysid.write_record(windsysid.simulate("tower", duration=300.0, rate=4.0), path)
    code = (
        "import importlib, sys, windsysid as ws\n"
        f"record = ws.read_record({str(path)!r})\n"
        f"found = {PAGE_OF_TOWER}\n"
        "assert len(found['report.html']) > 10_000\n"
        f"print(sorted({HEAVY_FOR_AN_ANSWER!r} & set(sys.modules)))"
    )
    assert any(in_a_new_process(code) == "[]" for _ in range(2))  # the first may have to compile equations


def test_help_names_the_hypotheses_as_they_describe_themselves():
    code = "import windsysid.loads.family; from windsysid.loads.hypothesis import HYPOTHESES as all; "
    said = in_a_new_process(f"{code} print('; '.join(f'{{one.name}}: {{one.text}}' for one in all.values()))")
    assert said == HYPOTHESES_HELP


@pytest.mark.parametrize("namespace", [windsysid, windsysid.results], ids=lambda space: space.__name__)
def test_a_prompt_completes_nothing_else(namespace: ModuleType):
    assert sorted(namespace.__all__) == sorted({*namespace._PUBLIC} | ({"__version__"} & {*vars(namespace)}))
    assert dir(namespace) == sorted(namespace.__all__)


def test_the_root_is_short():
    assert len(windsysid.__all__) <= 40


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'windsysid' has no attribute 'identfy'"):
        _ = windsysid.identfy


@pytest.mark.slow
@pytest.mark.parametrize(
    "first", ["ws.identify", "__import__('windsysid.study')", "ws.models.Prior", "ws.results.Mode"]
)
def test_public_names_are_what_they_say_whatever_was_imported_first(first: str):
    # A submodule of the same name must not take a function's place.
    code = (
        f"import windsysid as ws; {first}; "
        "print([name for name in ws.__all__ if type(getattr(ws, name)).__name__ == 'module'])"
    )
    assert in_a_new_process(code) == "['filters', 'models', 'results', 'signals']"


def undocumented(module: str) -> Iterator[str]:
    """Names of a module, of what it exports and of its classes' methods that have no docstring."""
    loaded = importlib.import_module(module)
    if not loaded.__doc__:
        yield module
    for name in getattr(loaded, "__all__", ()):
        value = getattr(loaded, name, None)
        if value is None or ((inspect.isfunction(value) or inspect.isclass(value)) and not inspect.getdoc(value)):
            yield f"{module}.{name}"
        elif inspect.isclass(value) and value.__module__.startswith("windsysid"):
            for method, member in vars(value).items():
                described = inspect.isfunction(member) or isinstance(member, property | classmethod)
                if described and not method.startswith("_") and not inspect.getdoc(getattr(value, method)):
                    yield f"{module}.{name}.{method}"


def test_every_exported_function_and_class_is_there_and_explains_itself():
    lacking = [name for module in MODULES for name in undocumented(module)]
    assert not lacking, "\n".join(lacking)


def test_modules_with_public_names_say_which():
    """But for modules of limits, whose names all are."""
    for module in [name for name in MODULES if not name.endswith(".limits")]:
        loaded = importlib.import_module(module)
        room = hasattr(loaded, "__path__") and not [
            name for name in vars(loaded) if inspect.isfunction(vars(loaded)[name])
        ]
        assert room or hasattr(loaded, "__all__"), module
