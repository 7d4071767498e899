"""Modes of results as they are compared: what a record itself says, without the prior that all records share."""

import json
import math
from pathlib import Path

import pytest

from windsysid.spectral.modal_bands.scoring import DAMPING_PRIOR
from windsysid.spectral.oma.known_modes import KnownMode, as_modes, without_damping_prior
from windsysid.spectral.oma.result import ANALYSIS


def mode(ln_damping: float, std: float) -> KnownMode:
    return KnownMode("mode 1", 0.0, 0.001, ln_damping, std, {"a": 1.0 + 0.0j}, True)


@pytest.mark.parametrize(("own", "own_std"), [(math.log(0.005), 0.3), (math.log(0.06), 1.0)])
def test_the_prior_of_damping_is_taken_out_again(own: float, own_std: float):
    centre, spread = DAMPING_PRIOR
    information = own_std**-2.0 + spread**-2.0
    mean = (own * own_std**-2.0 + centre * spread**-2.0) / information
    assert without_damping_prior(mode(mean, information**-0.5)) == pytest.approx((own, own_std))


def test_a_damping_that_is_the_priors_says_nothing():
    assert without_damping_prior(mode(DAMPING_PRIOR[0], DAMPING_PRIOR[1]))[1] == math.inf


def test_the_summary_of_version_0_2_is_read(tmp_path: Path):
    """It had the key ``frequency_hz``."""
    values = {"estimate": 1.0, "low": 0.98, "high": 1.02}
    shape = {"sensors": ["a"], "real": [1.0], "imaginary": [0.0], "std": [0.01]}
    mode = {"name": "mode 1", "frequency_hz": values, "damping_ratio": values, "shape": shape, "trusted": True}
    summary = {
        "analysis": ANALYSIS, "record": "a", "start": None, "section": [0.0, 60.0], "record_hash": None,
        "rotor_speed_rad_s": 0.0, "doubts": [], "modes": [mode],
    }  # fmt: skip
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    (found,) = as_modes(tmp_path).modes
    assert (found.ln_frequency, found.ln_frequency_std) == pytest.approx((0.0, 0.01))
