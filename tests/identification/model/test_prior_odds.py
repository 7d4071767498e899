"""Prior odds: what a site and a turbine file change, and by how much a bound moves."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from windsysid.checks.limits import LOG_EVIDENCE_STD
from windsysid.errors import ConfigurationError
from windsysid.identification.effects import EFFECTS
from windsysid.identification.formulations import estimate
from windsysid.identification.identify import identify
from windsysid.identification.job import Job
from windsysid.identification.model.prior_odds import (
    WAVE_FREQUENCIES_HZ,
    chances_of_rivals,
    f_bound,
    log_bound,
    odds_of,
    odds_table,
    sigma_bound,
)
from windsysid.identification.pipeline import run
from windsysid.simulation.record import simulate_record
from windsysid.spectral.transforms.harmonics import TAPER_COUNT
from windsysid.turbine.file import load_turbine

TOWER = load_turbine("tower")


def test_waves_are_likely_offshore_and_at_frequencies_of_waves():
    sea, odds = TOWER.at("offshore"), odds_table()["waves"]
    alone = odds_of("narrow_band_load", sea, 1.1 * WAVE_FREQUENCIES_HZ[1])
    assert odds_of("narrow_band_load", sea, 0.3) == alone + odds["offshore"]
    assert odds_of("narrow_band_load", TOWER, 0.3) == alone + odds["onshore"]
    assert odds["offshore"] > 10.0 > 0.1 > odds["onshore"]


def test_a_turbine_file_replaces_odds():
    assert odds_of("step", replace(TOWER, odds={"step": 3.0})) == 3.0
    assert odds_of("step", replace(TOWER, odds={"trend": 3.0})) == odds_of("step", TOWER)


def test_bounds_are_as_given_onshore_and_move_with_the_odds():
    rare = replace(TOWER, odds={"sinusoid": 0.01 * odds_of("sinusoid", TOWER)})
    for bound in (log_bound, sigma_bound):
        assert bound(4.0, "sinusoid", TOWER) == pytest.approx(4.0)
    assert log_bound(4.0, "sinusoid", rare) == pytest.approx(4.0 + math.log(100.0))
    assert sigma_bound(4.0, "sinusoid", rare) ** 2 == pytest.approx(16.0 + 2.0 * math.log(100.0))
    chance = [stats.f.sf(f_bound(1e-4, "sinusoid", at), 2, 2 * TAPER_COUNT - 2) for at in (TOWER, rare)]
    assert chance == pytest.approx([1e-4, 1e-6])


def test_evidence_that_may_be_wrong_makes_rivals_less_certain():
    """Independently: the mean over normal errors of the log odds, by draws."""
    errors = LOG_EVIDENCE_STD * np.random.default_rng(1).standard_normal(400_000)
    for log_odds in (-4.0, 0.0, 3.0):
        mean = float(np.mean(1.0 / (1.0 + np.exp(-(log_odds + errors)))))
        assert chances_of_rivals([log_odds]) == pytest.approx([mean], abs=0.01)
    assert chances_of_rivals([]) == []
    assert sum(chances_of_rivals([9e3, 9e3, -9e3])) == pytest.approx(1.0)


def test_a_waveform_that_a_turbine_file_calls_unlikely_needs_more_evidence():
    """Of usual odds, the step of this record is included: see
    `test_score_test.test_the_automatic_choice_says_what_filters_found`."""
    made, channel = simulate_record(TOWER, duration=300.0, rate=4.0, seed=5), "tower_z_acceleration"
    steps = 0.03 * (made.time > 165.0)
    made = made.with_channels({channel: (made[channel] + steps, made.unit(channel))})

    job = Job(made, made, TOWER, None, None, None, None, "broadband")
    rare = replace(job, turbine=replace(TOWER, odds={"step": 1e-40}))
    answered, _ = run(rare, estimate(job), effects=((EFFECTS[-1],),))
    assert "step" not in [one.code for one in answered.effects]


@pytest.mark.parametrize(
    ("options", "odds", "complaint"),
    [
        ({"site": "lake"}, {}, "site: expected onshore or offshore; got 'lake'"),
        ({}, {"waves": 0.0}, "odds: expected finite numbers greater than 0, got 0.0 for waves"),
        ({}, {"wave": 2.0}, r"odds: expected effects \(sensor_bias, .*\); got 'wave'"),
    ],
)
def test_a_wrong_site_or_effect_is_refused_in_one_line(options: Any, odds: Any, complaint: str):
    made = simulate_record(TOWER, duration=60.0, rate=4.0, seed=2)
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        identify(made, replace(TOWER, odds=odds), **options)
    assert len(str(caught.value).splitlines()) == 1
    assert np.isfinite(made.values).all()
