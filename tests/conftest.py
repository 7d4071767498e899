"""What several test modules share. Generated models go to the user's own cache, so that a second run is fast."""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

import windsysid.loads.family  # noqa: F401 (registers windsysid's own, before a test forgets what came in it)
from tests.accessible import problems
from windsysid import cli
from windsysid.identification import identify as front_door
from windsysid.identification import pipeline
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.mechanics.model import MODELS
from windsysid.mechanics.sensors import SENSORS
from windsysid.output.progress import Progress, unheard
from windsysid.records.formats.access.probing import ProcessGuard
from windsysid.records.record import Record
from windsysid.reports import html
from windsysid.results.finding import Finding
from windsysid.results.identification import Identification
from windsysid.results.provenance import record_hash
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

ProcessGuard.on = True
"""Damaged HDF5 files of the tests are those of fixed seeds; `tests/records/formats/test_probing.py` looks first."""


def pytest_collection() -> None:
    """Collect no garbage while tests are imported, of which hardly anything is garbage."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave what was imported out of garbage collection, which went through it again and again, and collect seldom."""
    gc.freeze()
    gc.set_threshold(50_000)
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def every_finding_has_a_sentence() -> Iterator[None]:
    """Make the sentence of each finding as it comes into being, so that no test passes one that lacks data."""
    made = Finding.__post_init__

    def read(finding: Finding) -> None:
        made(finding)
        assert "{" not in str(finding)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Finding, "__post_init__", read)
        yield


@pytest.fixture(scope="session", autouse=True)
def every_page_can_be_read() -> Iterator[None]:
    """Check each page as it is made, so that no test makes one that keyboards and screen readers cannot read."""
    made = html.template

    @wraps(made)
    def checked(name: str) -> Any:
        template = made(name)

        def render(**values: Any) -> str:
            page = template.render(**values)
            lacks = problems(page) if name == "report" else []
            assert not lacks, "\n".join(lacks[:20])
            return page

        return SimpleNamespace(render=render)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(html, "template", checked)
        yield


@pytest.fixture(scope="session")
def verne555() -> Turbine:
    """The scale model with masses and sensors known exactly: bounds, and other ways to the same numbers, know no
    tolerances."""
    return load_turbine("verne555").exact()


@contextmanager
def effects_untested() -> Iterator[None]:
    """Identify without tests for effects, which take more than half of the time of filters."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "_test", lambda job, fit, *_: (fit, None))
        yield


@pytest.fixture(scope="module")
def without_effects() -> Iterator[None]:
    """Leave effects untested in a module that asks nothing of them."""
    with effects_untested():
        yield


_IDENTIFIED: list[tuple[Any, Identification]] = []
"""Records and options that were identified in this process, and the results."""

_identify = front_door.identify


def identify_once(record: Record, turbine: Any, *, progress: Progress = unheard, **options: Any) -> Identification:
    """Identify what was not identified in this process before, for tests of what is around it."""
    given = (record_hash(record), record.name, record.start, repr(record.attributes), turbine, options)
    for known, result in _IDENTIFIED:
        if known == given:
            return result
    _IDENTIFIED.append((given, _identify(record, turbine, progress=progress, **options)))
    return _IDENTIFIED[-1][1]


@contextmanager
def registers_as_before() -> Iterator[None]:
    """Forget afterwards what is registered inside: models, load hypotheses, sensors, and examples that did it."""
    registers: tuple[dict[str, Any], ...] = (MODELS, HYPOTHESES, SENSORS)
    known = [dict(register) for register in registers]
    try:
        yield
    finally:
        for register, before in zip(registers, known, strict=True):
            register.clear()
            register.update(before)
        for name in [name for name in sys.modules if name.split(".")[0] == "examples"]:
            del sys.modules[name]


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: list[str]
    """Lines on standard error, but for the news that something is compiled for the first time."""


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Ended]:
    """Run the command line in this process and an empty folder, as the console script would."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["windsysid", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        lines = [line for line in err.splitlines() if not line.startswith("windsysid: first run")]
        return Ended(int(ended.value.code or 0), out, lines)

    return run
