"""Mean squares of ranges of frequency, and energies of the two halves of a record, compared range by range."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import combine_pvalues, gamma

from windsysid.spectral.rotor.check import RangePower, misshapen, parts_of, unexplained, unsteady


def part(low: float, energy: float, channel: str = "tower_x_acceleration") -> RangePower:
    """A range of 0.1 Hz in which many independent entries were read."""
    return RangePower(channel, low, low + 0.1, 1.0, 0.1, energy, 200.0)


def test_a_range_that_one_half_lacks_is_not_compared():
    both = unsteady([part(0.3, 1.0), part(0.5, 8.0), part(0.6, 1.0)], [part(0.3, 1.0), part(0.6, 9.0)])
    assert len(both) == 1
    assert both[0].code == "nonstationary"
    assert both[0].data == {"channel": "tower_x_acceleration", "ratio": 9.0, "low": 0.6, "high": 0.6 + 0.1}
    assert unsteady([part(0.3, 1.0)], [part(0.2, 9.0), part(0.3, 1.1)]) == []


def test_ranges_of_different_channels_are_never_compared():
    assert unsteady([part(0.3, 1.0), part(0.3, 9.0, "tower_z_acceleration")], [part(0.3, 1.0)]) == []


def test_halves_without_a_common_range_are_reported():
    for first, second in (([part(0.3, 1.0)], [part(0.5, 1.0)]), ([], [part(0.5, 1.0)]), ([], [])):
        (found,) = unsteady(first, second)
        assert found.code == "stationarity_untestable"


def test_halves_whose_harmonics_lie_elsewhere_are_compared_where_both_have_bins():
    rng, frequency = np.random.default_rng(4), np.linspace(0.2, 0.8, 600)
    ranges = [(0.2, 0.4), (0.4, 0.6), (0.6, 0.800001)]

    def half(level: float, left_out: tuple[float, float]) -> list[RangePower]:
        power = level * rng.exponential(size=frequency.size)
        power[(frequency > left_out[0]) & (frequency < left_out[1])] = np.nan
        return parts_of(power, np.ones(frequency.size), frequency, "tower_x_acceleration", ranges, 1.0, 4.0)

    first, second = half(1.0, (0.39, 0.61)), half(1.0, (0.59, 0.81))
    assert len(first) == len(second) == 2
    assert unsteady(first, second) == []
    assert unsteady(first, half(10.0, (0.59, 0.81)))[0].code == "nonstationary"


@pytest.mark.parametrize("factor", [2.5, 0.4])
def test_a_factor_below_three_is_stationary(factor: float):
    assert unsteady([part(0.3, 1.0)], [part(0.3, factor)]) == []


def test_a_resonance_at_another_place_is_found_in_narrow_parts_of_a_band():
    """A band around 1.11 Hz whose mode is at 1.04 Hz."""
    frequency = np.linspace(1.0, 1.22, 112, endpoint=False)
    measured = np.repeat([0.85, 3.06, 0.9, 0.26, 0.2, 0.65, 0.66, 1.47], 14)
    ranges = list(pairwise(np.linspace(1.0, 1.22, 9)))
    found = unexplained(parts_of(measured, np.ones(112), frequency, "collective", ranges, 1.15, 4.0))
    assert {round(one.data["low"], 3): one.data["ratio"] for one in found} == pytest.approx({1.028: 3.06})


def test_mean_squares_beyond_chance_are_those_of_chi_square():
    """8 entries: a mean square of 3 has a probability of 2e-5, and one of 4 of 3e-8."""
    parts = [RangePower("a", 1.0, 2.0, mean, 8**-0.5, mean, 8.0) for mean in (3.0, 4.0)]
    assert [gamma.sf(8.0 * p.mean, 8.0) < 3.4e-6 for p in parts] == [bool(unexplained([p])) for p in parts]


def test_parts_of_a_row_are_combined_by_fishers_method():
    """Against SciPy: the same chances combined, over one row and over ten."""
    rows = [[RangePower("a", 1.0, 2.0, mean, 8**-0.5, mean, 8.0) for mean in (0.5, 2.2, 0.4, 1.9)]]
    chances = [2.0 * min(gamma.sf(8.0 * p.mean, 8.0), gamma.cdf(8.0 * p.mean, 8.0)) for p in rows[0]]
    together = combine_pvalues(chances, method="fisher").pvalue
    assert len(misshapen(rows, 1.01 * together)) == 1
    assert misshapen(rows, 0.99 * together) == []
    assert misshapen(rows * 10, 9.9 * together) == []
