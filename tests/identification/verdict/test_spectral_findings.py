"""What speaks against spectra: blades that pass, blocks of other energy, halves."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.fits import TOWER
from windsysid.identification.limits import MIN_RESONANCE_DOF
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.identification.verdict.spectral_findings import (
    _unsteady_blocks,
    drifts_of,
    halves_of,
    passed_by,
)

PARAMETERS = Prior().parameters(TOWER, identifiable(TOWER), linear=False)
QUESTION: Any = SimpleNamespace(parameters=PARAMETERS, turbine=TOWER, sensors=TOWER.sensors, sums=object())
AT_FILE = np.array([q.coordinate(TOWER.values[q.name]) for q in PARAMETERS])
POSED: Any = SimpleNamespace(resonance=1000.0, smoothed=None, bands=[(0.1, 0.4), (0.5, 1.0)])


def sums(*energies: float) -> Any:
    return SimpleNamespace(energies=np.repeat(np.array(energies)[:, None], 2, axis=1), blocks=float(len(energies)))


def test_blades_that_pass_at_a_mode_are_a_reason_and_others_are_none():
    own = TOWER.natural_frequency("fore_aft") / (2.0 * math.pi)
    (found,) = passed_by(QUESTION, AT_FILE, own / TOWER.model.blades)
    assert found.severity == "reason"
    assert passed_by(QUESTION, AT_FILE, 3.0 * own / TOWER.model.blades) == []
    assert passed_by(QUESTION, AT_FILE, 0.0) == []


def test_the_coefficients_that_were_found_say_where_the_modes_are():
    stiffer = AT_FILE.copy()
    for i, q in enumerate(PARAMETERS):
        if q.kind == "stiffness":
            stiffer[i] = q.coordinate(9.0 * TOWER.values[q.name])
    own = TOWER.natural_frequency("fore_aft") / (2.0 * math.pi)
    assert passed_by(QUESTION, stiffer, own / TOWER.model.blades) == []
    assert passed_by(QUESTION, stiffer, 3.0 * own / TOWER.model.blades)


def test_blocks_of_other_energy_are_not_stationary():
    assert _unsteady_blocks(QUESTION, sums(1.0, 1.1, 1.0, 0.9), POSED) == []
    found = _unsteady_blocks(QUESTION, sums(1.0, 1.0, 9.0, 9.0), POSED)
    assert {one.code for one in found} == {"nonstationary"}
    assert found[0].data["ratio"] == pytest.approx(9.0)
    assert [one.code for one in _unsteady_blocks(QUESTION, sums(1.0), POSED)] == ["one_block"]


def test_a_block_that_is_too_short_for_its_resonance_is_a_reason():
    short: Any = SimpleNamespace(**(vars(POSED) | {"resonance": 1.6 * MIN_RESONANCE_DOF, "smoothed": object()}))
    (found,) = _unsteady_blocks(QUESTION, sums(1.0, 1.0), short)
    assert (found.code, found.data["count"]) == ("narrow_resonance_in_pieces", pytest.approx(0.8 * MIN_RESONANCE_DOF))


def test_blocks_have_no_halves_and_no_halves_no_drifts():
    nothing: Any = None
    assert halves_of(QUESTION, nothing, nothing, "broadband") == []
    assert drifts_of(QUESTION, [], AT_FILE, ()) == ()
