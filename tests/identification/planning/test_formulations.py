"""How a planned record is simulated."""

import pytest

from windsysid.identification.planning.formulations import MAX_SIMULATED_SAMPLES, Planned
from windsysid.output.progress import unheard
from windsysid.turbine.file import load_turbine

PLANNED = Planned(load_turbine("tower"), ("k_fore_aft",), 100.0, 600.0, 0.01, 15.0, 4, 0, unheard)


def test_samples_that_are_left_out_leave_the_density_of_the_noise():
    assert PLANNED.simulated_rate == 25.0
    for thin, given in zip(PLANNED.thinned.sensors, PLANNED.turbine.sensors, strict=True):
        assert thin.noise**2 / PLANNED.simulated_rate == pytest.approx(given.noise**2 / PLANNED.rate)


def test_a_record_is_as_long_as_its_samples_allow_and_settles_within_three_decays():
    assert PLANNED.most == MAX_SIMULATED_SAMPLES / 25.0
    assert PLANNED.settling == 300.0
    assert PLANNED._replace(damping=1e-6).settling == PLANNED.most
    assert not PLANNED.turns  # a tower has no blades that wind drives
