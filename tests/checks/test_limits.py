"""Limits of checks and of inspection: each names its kind, and each is used."""

import ast
import re
from pathlib import Path

import pytest
from validation.structure import KINDS, SETTINGS, limits_of

import windsysid
from windsysid.checks import limits as checks
from windsysid.inspection import limits as inspection

PACKAGE = Path(windsysid.__file__).parent


@pytest.mark.parametrize("room", ["checks", "inspection", "results"])
def test_decision_limits_are_in_limits_and_all_constants_name_their_kind(room: str):
    for path in (PACKAGE / room).rglob("*.py"):
        kinds = KINDS if path.name == "limits.py" else SETTINGS
        for name, kind in limits_of(ast.parse(path.read_text(encoding="utf-8"))):
            assert kind in kinds, f"{path.name}: {name}"


@pytest.mark.parametrize("limits", [checks, inspection])
def test_every_limit_is_used(limits):
    used: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        if path.name != "limits.py":
            used.update(re.findall(r"\b[A-Z][A-Z0-9_]+\b", path.read_text(encoding="utf-8")))
    assert [name for name in vars(limits) if name.isupper() and name not in used] == []
