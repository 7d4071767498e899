"""Limits of operational modal analysis."""

import ast
from pathlib import Path

from validation.structure import limits_of

from windsysid.spectral.oma import limits


def test_every_limit_says_of_which_kind_it_is():
    path = Path(str(limits.__file__))
    found = dict(limits_of(ast.parse(path.read_text(encoding="utf-8"))))
    assert set(found) == set(limits.__all__)
    assert {name for name, kind in found.items() if not kind} == set()
