"""Public functions name an argument of a wrong type; other errors stay as they are."""

import inspect
import pickle
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest

import windsysid as ws
from windsysid._lazy import misfit

WRONG: tuple[Any, ...] = (3, None, "no such thing", [])


def functions() -> Iterator[tuple[str, Any]]:
    for space in (ws, ws.filters, ws.models, ws.results, ws.signals):
        for name in space.__all__:
            if isinstance(getattr(space, name), FunctionType):
                yield f"{space.__name__}.{name}", getattr(space, name)


def test_an_argument_of_a_wrong_type_is_a_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Some ended in "'int' object has no attribute 'kind'"."""
    monkeypatch.chdir(tmp_path)
    for name, function in functions():
        needed = [one for one in inspect.signature(function).parameters.values() if one.default is one.empty]
        for wrong in WRONG if needed else ():
            by_name = {one.name: wrong for one in needed if one.kind is one.KEYWORD_ONLY}
            told = ""
            try:
                function(*[wrong for one in needed if one.kind is not one.KEYWORD_ONLY], **by_name)
            except (ws.WindsysidError, TypeError, ValueError) as error:
                told = str(error)
            assert "attribute" not in told, name
            assert "not iterable" not in told, name


def test_the_message_names_the_argument_what_it_is_and_what_it_was():
    with pytest.raises(TypeError, match=r"^monitor: blocks: expected RecordBlocks, got int 3$"):
        ws.monitor(3)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^write_turbine: turbine: expected Turbine, got str 'tower'$"):
        ws.write_turbine("tower", "tower.toml")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^plan: parameters: expected Sequence\[str\] \| None, got str 'k_x'$"):
        ws.plan("tower", parameters="k_x")
    with pytest.raises(TypeError, match=r"^read_blocks: folders: expected Sequence\[str \| Path\], got None$"):
        ws.read_blocks(None)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^band_pass: values: expected array_like, got str 'a'$"):
        ws.signals.band_pass("a", 10.0, (1.0, 2.0))


def test_errors_of_right_arguments_stay():
    with pytest.raises(ws.RecordError, match="no such file"):
        ws.read_record("nowhere.csv")
    with pytest.raises(TypeError, match=r"^read_record: missing a required argument: 'path'; its arguments are path, "):
        ws.read_record()  # type: ignore[call-arg]
    assert misfit(ws.signals.band_pass, (np.zeros(9), 10, [1.0, 2.0]), {}) == (
        "band: expected tuple[float, float], got list [1.0, 2.0]"
    )
    assert misfit(ws.identify, ("a.csv", "tower"), {"section": (0.0, 1.0), "rate": None}) is None
    assert misfit(ws.compare, ("a", Path("b")), {}) is None
    short = misfit(ws.identify, ("a.csv", "tower"), {"section": (10.0,)})
    assert short == "section: expected tuple[float, float] | None, got tuple (10.0,)"
    pair = misfit(ws.oma, ("a.csv",), {"limits": (0.5, "x")})
    assert pair == "limits: expected tuple[float, float] | None, got tuple (0.5, 'x')"
    assert misfit(ws.oma, ("a.csv",), {"bands": [(1, 2.0)], "limits": (0.5, 2)}) is None
    assert misfit(ws.read_linearisation, ([Path("a"), "b"],), {}) is None


def test_public_functions_can_be_pickled():
    for function in (ws.oma, ws.signals.resample, ws.results.load_posterior):
        assert pickle.loads(pickle.dumps(function)) is function


def test_a_linearisation_that_is_not_there_is_refused_as_a_record_is():
    with pytest.raises(
        ws.ConfigurationError,
        match=r"^nowhere\.1\.lin: no such file, expected a \.lin file of OpenFAST; check the name and the folder$",
    ):
        ws.read_linearisation("nowhere.1.lin")


def test_an_argument_that_a_function_does_not_have_is_told_under_its_public_name():
    """It was told of `analyse_vibration()`."""
    with pytest.raises(
        TypeError, match=r"oma: got an unexpected keyword argument 'chanels'; its arguments are record,"
    ):
        ws.oma("record.csv", chanels=3)  # type: ignore[call-arg]
