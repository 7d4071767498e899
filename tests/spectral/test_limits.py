"""Limits of spectra and of their modes."""

import ast
from pathlib import Path
from types import ModuleType

import pytest
from validation.structure import KINDS, limits_of

from windsysid.spectral.lti import limits as of_lti
from windsysid.spectral.modal_bands import limits as of_modal_bands
from windsysid.spectral.oma import limits as of_oma
from windsysid.spectral.rotor import limits as of_rotor
from windsysid.spectral.rotor_bands import limits as of_rotor_bands
from windsysid.spectral.transforms import limits as of_transforms

ROOMS = of_lti, of_modal_bands, of_oma, of_rotor, of_rotor_bands, of_transforms


@pytest.mark.parametrize("limits", ROOMS, ids=lambda limits: limits.__package__)
def test_every_limit_states_its_kind(limits: ModuleType):
    path = Path(str(limits.__file__))
    found = dict(limits_of(ast.parse(path.read_text(encoding="utf-8"))))
    assert set(found) == {name for name in vars(limits) if name.isupper() and name != "FIRST_BIN"}
    assert {name for name, kind in found.items() if not kind} == set()


def test_constants_of_spectra_outside_limits_decide_nothing():
    for path in Path(str(of_lti.__file__)).parents[1].rglob("*.py"):
        if path.name != "limits.py":
            found = dict(limits_of(ast.parse(path.read_text(encoding="utf-8"))))
            assert {name for name, kind in found.items() if kind in ("", *KINDS)} == set(), path.name
