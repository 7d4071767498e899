"""An estimate in physical units, and as plain values."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from tests.identification.fits import TOWER, noise, outcome_of, record_of
from windsysid.identification.model.fit import Outcome
from windsysid.identification.verdict.conclude import _estimates
from windsysid.results.estimate import Estimate, IntervalEstimate
from windsysid.results.mode import Mode
from windsysid.results.serialization import as_plain, from_plain


def estimates(outcome: Outcome) -> tuple[Estimate, ...]:
    """Estimates of grade A."""
    return _estimates(outcome, "AAAA", np.ones(4))


def test_a_band_is_two_standard_deviations_of_the_filter_coordinate():
    std = 0.02
    outcome = outcome_of(record_of(noise()), std=std)
    found = {one.name: one for one in estimates(outcome)}
    k = found["k_side_side"]
    assert isinstance(k, Estimate)
    assert (k.kind, k.tip) == ("stiffness", None)
    assert k.estimate == pytest.approx(TOWER.values["k_side_side"])
    assert (k.low, k.high) == pytest.approx((k.estimate * math.exp(-2.0 * std), k.estimate * math.exp(2.0 * std)))
    assert k.std == pytest.approx(std * k.estimate)
    q = next(q for q in outcome.model.parameters if q.name == k.name)
    assert k.informed_by_data == pytest.approx(1.0 - (std / q.prior[1]) ** 2)
    assert k.reference == TOWER.values["k_side_side"]
    assert k.average_error_percent == pytest.approx(0.0, abs=1e-9)


def test_the_error_of_the_history_is_relative_to_the_file():
    outcome = outcome_of(record_of(noise()))
    q = outcome.model.parameters[0]
    history = np.tile(outcome.theta, (3, 1))
    history[:, 0] = [q.coordinate(factor * TOWER.values[q.name]) for factor in (0.9, 1.0, 1.2)]
    assert estimates(outcome._replace(history_mean=history))[0].average_error_percent == pytest.approx(10.0)


def test_an_estimate_comes_back_from_plain_values_and_is_not_changed():
    one = Estimate("c_x", "N·s/m", "damping", 2.0, 1.0, 3.0, 0.5, 0.9, 2.5, None, None, {"estimate": 1.0})
    assert from_plain(Estimate, as_plain(one)) == one
    name = "estimate"
    with pytest.raises(FrozenInstanceError):
        setattr(one, name, 3.0)


def test_a_mode_prints_its_values_with_grades():
    f = IntervalEstimate(0.3153, 0.3139, 0.3167, 0.0007, "Hz", "A")
    z = IntervalEstimate(0.00437, 0.00116, 0.00758, 0.0016, "1", "B")
    expected = "tower side-side: 0.3153 ± 0.0014 Hz (grade A), damping ratio 0.437 ± 0.321 % (grade B)"
    assert str(Mode("tower side-side", f, z)) == expected
