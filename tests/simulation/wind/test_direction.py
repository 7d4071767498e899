"""Wind direction: statistics of the mean-reverting part, changes where they are asked for."""

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.simulation.wind import Direction, DirectionChange, simulate_direction


def test_direction_reverts_to_its_mean_with_its_time_constant():
    delta = np.rad2deg(simulate_direction(Direction(10.0, 5.0, 4.0), 200_000, rate=10.0, seed=3))
    # 20 000 s of a process with τ = 4 s: 2 500 independent pieces, so 2 % on mean/σ and 1.4 % on σ, three times which
    # is allowed.
    assert delta.mean() == pytest.approx(10.0, abs=0.3)
    assert delta.std() == pytest.approx(5.0, rel=0.05)
    lagged = np.corrcoef(delta[:-40], delta[40:])[0, 1]
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.05)


def test_a_change_of_direction_is_where_it_was_asked_for():
    changes = (
        DirectionChange(at=20.0, by_deg=42.0, over=6.0),
        DirectionChange(at=34.0, by_deg=-42.0, over=6.0),
        DirectionChange(50.0, 10.0, 0.0),
    )
    delta = np.rad2deg(simulate_direction(Direction(changes=changes), 6000, rate=100.0))
    time = np.arange(6000) / 100.0
    assert np.all(delta[time <= 20.0] == 0.0)
    np.testing.assert_allclose(delta[(time >= 26.0) & (time <= 34.0)], 42.0)
    np.testing.assert_allclose(delta[2300], 21.0)
    np.testing.assert_allclose(delta[(time >= 40.0) & (time < 50.0)], 0.0, atol=1e-12)
    np.testing.assert_allclose(delta[time >= 50.0], 10.0)


def test_direction_is_reproducible_for_a_seed():
    direction = Direction(std_deg=5.0)
    first, again, other = (simulate_direction(direction, 100, rate=10.0, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"std_deg": -1.0}, "spread of direction"),
        ({"time_constant": 0.0}, "time constant"),
        ({"mean_deg": float("nan")}, "mean direction"),
    ],
)
def test_impossible_directions_are_refused_by_name(options, message):
    with pytest.raises(ConfigurationError, match=message):
        Direction(**options)


def test_an_impossible_change_is_refused():
    with pytest.raises(ConfigurationError, match="direction change"):
        DirectionChange(at=20.0, by_deg=40.0, over=-1.0)
    with pytest.raises(ConfigurationError, match="positive rate"):
        simulate_direction(Direction(), 10, rate=0.0)
