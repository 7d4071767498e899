"""Decision limits of an identification against the chance that their docstrings state."""

import ast
import math
from pathlib import Path

import pytest
from scipy.stats import norm, rayleigh
from validation.structure import KINDS, SETTINGS, limits_of

import windsysid.identification
from windsysid.checks.limits import CONFLICT_SIGMAS, MAX_DISAGREEMENT_SIGMAS, OUTLIER_SIGMAS, STRONG_LOG_ODDS

ROOM = Path(windsysid.identification.__file__).parent


@pytest.mark.parametrize(
    ("chance", "one_in"),
    [
        (2.0 * norm.sf(OUTLIER_SIGMAS), 2e6),
        (2.0 * norm.sf(MAX_DISAGREEMENT_SIGMAS), 370),
        (rayleigh.sf(CONFLICT_SIGMAS), 3000),
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
