"""Decision limits of an identification against the chance that their docstrings state."""

import ast
import math
from pathlib import Path

import pytest
from scipy.stats import f, norm, rayleigh
from validation.structure import KINDS, SETTINGS, limits_of

import windsysid.identification
from windsysid.checks.limits import CONFLICT_SIGMAS, MAX_DISAGREEMENT_SIGMAS, OUTLIER_SIGMAS, STRONG_LOG_ODDS
from windsysid.identification import limits
from windsysid.identification.effects.sinusoid import MAX_HARMONIC

ROOM = Path(windsysid.identification.__file__).parent
SINE = f(2, 12)
"""Thomson's F of seven tapers under chance."""


@pytest.mark.parametrize(
    ("chance", "one_in"),
    [
        (2.0 * norm.sf(OUTLIER_SIGMAS), 2e6),
        (2.0 * norm.sf(MAX_DISAGREEMENT_SIGMAS), 370),
        (rayleigh.sf(CONFLICT_SIGMAS), 3000),
        (SINE.sf(limits.MIN_SINUSOID_F), 6600),
        (2 * MAX_HARMONIC * SINE.sf(limits.MIN_HARMONIC_F), 100),
        (math.exp(-STRONG_LOG_ODDS), 20),
    ],
)
def test_chance_exceeds_a_limit_as_rarely_as_it_states(chance: float, one_in: float):
    assert 1.0 / chance == pytest.approx(one_in, rel=0.15)


def test_decisions_have_their_limits_in_one_module_and_settings_stand_beside_their_code():
    for path in ROOM.rglob("*.py"):
        kinds = KINDS if path == ROOM / "limits.py" else SETTINGS
        for name, kind in limits_of(ast.parse(path.read_text(encoding="utf-8"))):
            assert kind in kinds, f"{path}: {name}"
