"""Docstrings of everything in the public namespaces: parameters and attributes are named, arrays with their shape
and quantities with their unit; errors and what comes back are told."""

import ast
import dataclasses
import doctest
import importlib
import inspect
import re
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import windsysid
from tests.conftest import registers_as_before

NAMESPACES = (windsysid, windsysid.results, windsysid.models, windsysid.filters, windsysid.signals)
PUBLIC = {name: getattr(space, name) for space in NAMESPACES for name in space.__all__ if not name.startswith("__")}
FUNCTIONS = {name: thing for name, thing in PUBLIC.items() if inspect.isfunction(thing)}
CLASSES = {name: thing for name, thing in PUBLIC.items() if inspect.isclass(thing) and not issubclass(thing, Exception)}


SHAPE = r"\([^()\s][^()]*,[^()]*\)"
"""``(T, m)``, ``(n,)``."""

UNIT = r"\[.+?\]|\bunits?\b|\bSI\b|\b[Rr]elative|\b[Ss]hare\b|\b[Ff]actors?\b|\bfilter coordinates\b|\b[Ll]og "
"""``[Hz]``, in the unit of something else that is named; or in words that leave no unit over."""

WITHOUT_EXAMPLE = {
    *windsysid.results.__all__, "Aligned", "Belief", "CausalIntegrator", "CausalState", "ClockOffset", "Cloud",
    "Coefficient", "CompiledModel", "Coordinate", "Despiked", "Fit", "Info", "LevelledPair", "LoadHypothesis",
    "MechanicalModel", "Mixture", "MixtureInfo", "Motion", "ParticleInfo", "PlacedSensor", "RotorLayout", "RotorMotion",
    "Sensor", "Smoothed", "StateSpace", "SupposedLoads", "Unbiased",
} - {"ModeMarks"}  # fmt: skip
"""Classes of what functions return, and those to derive from: the examples of functions and decorators show them."""

RAISE_NOTHING = {"degeneracy", "packaged_turbines", "register_loads", "register_model", "register_sensor"}
"""Functions that raise nothing, and call nothing that does: of every other a user must know the errors."""


def names(text: str, word: str) -> bool:
    """Whether a docstring names a parameter."""
    return re.search(rf"\b{re.escape(word)}\b", text) is not None


def entries(text: str) -> Iterator[tuple[str, str]]:
    """Name and text of each parameter or attribute that a docstring lists; those that share a text share it here."""
    section = r"^(?:Parameters|Attributes)\n-+\n(.*?)(?=^\w+\n-+$|\Z)"
    for listed in re.findall(section, text, flags=re.DOTALL | re.MULTILINE):
        for head, told in re.findall(r"^(\S.*)\n((?:[ ]+.*\n?|\n)*)", listed, flags=re.MULTILINE):
            for name in head.partition(" : ")[0].split(", "):
                yield name, f"{head} {told}"


def without_shape_or_unit(text: str, annotations: dict[str, Any]) -> list[str]:
    """What is listed without shape though it is an array, or without unit though it is a number."""
    lacking = []
    for name, told in entries(text):
        kind = str(annotations.get(name, ""))
        if "Callable" in kind or re.search(r"\bAs (?:those )?(?:of|for|in) `", told):  # says it there
            continue
        if "ndarray" in kind or kind == "Array":
            lacking += [f"{name}: shape"] * (re.search(SHAPE, told) is None)
        elif re.search(r"\bfloat\b", kind):
            lacking += [f"{name}: unit"] * (re.search(UNIT, told) is None)
    return lacking


def raises(function: Any) -> bool:
    """Whether a function itself raises, and not only what it calls."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    return any(isinstance(node, ast.Raise) and node.exc is not None for node in ast.walk(tree))


def methods() -> Iterator[tuple[str, Any]]:
    """Names and public methods that stand in a public class itself."""
    for name, found in CLASSES.items():
        for attribute, thing in vars(found).items():
            if isinstance(thing, classmethod | staticmethod):
                thing = thing.__func__
            if inspect.isfunction(thing) and not attribute.startswith("_"):
                yield f"{name}.{attribute}", thing


def lacks_of_a_function(function: Any) -> list[str]:
    """Parameters, units, results and errors that a function's docstring does not name."""
    text, given = inspect.getdoc(function) or "", inspect.get_annotations(function)
    lacking = [name for name in inspect.signature(function).parameters if not names(text, name)]
    lacking += without_shape_or_unit(text, given)
    returns = given["return"] is None or "Returns\n-------" in text or "Yields\n------" in text
    lacking += ["Returns"] * (not returns)
    return lacking + ["Raises"] * ("Raises\n------" not in text and function.__name__ not in RAISE_NOTHING)


def test_functions_say_what_they_take_give_and_refuse():
    assert {name: lacks for name in FUNCTIONS if (lacks := lacks_of_a_function(FUNCTIONS[name]))} == {}


def test_functions_and_classes_that_users_call_have_an_example():
    called = FUNCTIONS | {name: CLASSES[name] for name in CLASSES.keys() - WITHOUT_EXAMPLE}
    examples = {
        name: (inspect.getdoc(thing) or "").partition("Examples\n--------\n")[2] for name, thing in called.items()
    }
    assert [name for name, example in examples.items() if ">>> import windsysid as ws\n" not in example] == []


def lacks_of_a_class(found: Any) -> list[str]:
    """Fields that the docstrings of a class and its bases do not name, or without shape or unit."""
    text = "\n".join(inspect.getdoc(base) or "" for base in found.__mro__)
    fields = [field.name for field in dataclasses.fields(found)] if dataclasses.is_dataclass(found) else []
    fields += [*getattr(found, "_fields", ()), *getattr(found, "model_fields", ())]
    lacking = [name for name in fields if not name.startswith("_") and not names(text, name)]
    annotations: dict[str, Any] = {}
    for base in reversed(found.__mro__):
        annotations |= inspect.get_annotations(base)
    return lacking + without_shape_or_unit(text, annotations)


def test_classes_say_what_they_hold():
    assert {name: lacks for name in CLASSES if (lacks := lacks_of_a_class(CLASSES[name]))} == {}


def lacks_of_a_method(method: Any) -> list[str]:
    """Parameters, shapes, units and errors that a method's docstring does not name."""
    text, given = inspect.getdoc(method) or "", inspect.get_annotations(method)
    taken = [name for name in inspect.signature(method).parameters if name not in ("self", "cls")]
    lacking = ["docstring"] * (not text) + [name for name in taken if not names(text, name)]
    lacking += without_shape_or_unit(text, given)
    arrays = [name for name, kind in given.items() if "ndarray" in str(kind) and name != "return"]
    lacking += ["shape"] * (bool(arrays) and re.search(SHAPE, text) is None)
    return lacking + ["Raises"] * ("Raises\n------" not in text and "Error" not in text and raises(method))


def test_methods_say_what_they_take_and_refuse():
    assert {name: lacks for name, method in methods() if (lacks := lacks_of_a_method(method))} == {}


def examples_of(module: ModuleType) -> list[doctest.DocTest]:
    """Examples of a module's docstrings; one that imports windsysid runs as a user types it, without what its module
    imports."""
    found = doctest.DocTestFinder(exclude_empty=True).find(module)
    for test in found:
        if any("import windsysid as ws" in example.source for example in test.examples):
            test.globs = {}
    return found


SLOW_EXAMPLES = {
    "windsysid.filters.particles.raoblackwell.RaoBlackwellised", "windsysid.fleet.batch.batch",
    "windsysid.identification.estimate.profile.profile_likelihood", "windsysid.identification.model.prior.Prior",
    "windsysid.identification.streaming.identify_pieces.identify_pieces",
    "windsysid.mechanics.sensors.Accelerometer", "windsysid.modal.marks.ModeMarks",
    "windsysid.monitoring.comparison.compare", "windsysid.monitoring.damping.separate_damping",
    "windsysid.monitoring.series.read_blocks", "windsysid.reports.loading.load_result",
    "windsysid.results.posterior.load_posterior", "windsysid.spectral.oma.analyse.analyse_vibration",
}  # fmt: skip
"""Examples of a third of a second or more, most of which identify records."""


@pytest.mark.parametrize("slow", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_examples_in_docstrings_print_what_they_say(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, slow: bool):
    """Two examples had numbers that no command had printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    package = Path(windsysid.__file__).parent
    failed, ran = [], set[str]()
    for path in sorted(package.rglob("*.py")):
        written = path.read_text(encoding="utf-8").count(">>> ")
        if written:
            name = ".".join(path.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")
            tests = examples_of(importlib.import_module(name))
            assert sum(len(test.examples) for test in tests) == written, f"{name}: examples that are not run"
            with registers_as_before():
                runner = doctest.DocTestRunner(verbose=False)
                chosen = [test for test in tests if (test.name in SLOW_EXAMPLES) == slow]
                failed += [test.name for test in chosen if runner.run(test).failed]
                ran |= {test.name for test in chosen}
    assert not failed
    assert not slow or ran == SLOW_EXAMPLES
