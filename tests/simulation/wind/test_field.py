"""Turbulence on the turning rotor: Kaimal's spectrum, the IEC's coherence, what a turning point sees."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import csd, welch

from windsysid.errors import ConfigurationError
from windsysid.simulation.wind import (
    WindConditions,
    coherence,
    extreme_direction_change,
    iec_turbulence_intensity,
    kaimal_spectrum,
    rotating_turbulence,
    rotor_wind,
)
from windsysid.simulation.wind.field import tower_shadow

RATE, SAMPLES, ONCE = 20.0, 60_000, 1.16
WIND = WindConditions(speed=5.56, hub_height=6.0, turbulence_intensity=0.2, shear_exponent=0.0)


@pytest.fixture(scope="module")
def standing():
    """Six 'blades' that stand still, at 0.6 m and 2 m, for 3000 s: twelve fixed points."""
    return rotating_turbulence(WIND, np.full(SAMPLES, 0.3), (0.6, 2.0), blades=6, rate=RATE, seed=1)


@pytest.fixture(scope="module")
def turning():
    psi = 2.0 * np.pi * ONCE * np.arange(2 * SAMPLES) / RATE
    return rotating_turbulence(WIND, psi, (2.0,), rate=RATE, seed=2)


def test_the_spectrum_at_fixed_points_is_kaimals(standing):
    f, spectra = welch(standing.blades.reshape(SAMPLES, -1).T, RATE, nperseg=2048)
    ratio = spectra.mean(axis=0) / kaimal_spectrum(f, WIND)
    # 57 pieces at half overlap are worth 38; a band of n lines of one point has the std 1/√(38 n): 2.4 % for the 46
    # lines of the first, where the twelve points are nearly one, 0.2 to 0.5 % for the others, where they are many.
    # Three to four of them.
    for low, high, bound in ((0.05, 0.5, 0.10), (0.5, 2.0, 0.03), (2.0, 5.0, 0.02), (5.0, 9.9, 0.02)):
        assert abs(ratio[(f >= low) & (f < high)].mean() - 1.0) < bound, (low, high)


def test_kaimals_spectrum_integrates_to_the_variance_and_has_its_closed_form():
    f = np.concatenate([[0.0], np.geomspace(1e-5, 1e5, 20_001)])
    assert np.trapezoid(kaimal_spectrum(f, WIND), f) == pytest.approx(WIND.std**2, rel=1e-3)
    tall = WindConditions(speed=12.0, hub_height=90.0, turbulence_intensity=0.1)
    assert tall.length_scale == pytest.approx(340.2)
    assert kaimal_spectrum(0.1, tall) == pytest.approx(4 * 1.44 * 28.35 / (1 + 6 * 2.835) ** (5 / 3))


def test_coherence_has_the_iecs_closed_form():
    tall = WindConditions(speed=12.0, hub_height=90.0)
    assert coherence(0.0, 30.0, tall) == pytest.approx(np.exp(-12.0 * 0.12 * 30.0 / 340.2))
    assert coherence(0.3, 30.0, tall) == pytest.approx(np.exp(-12.0 * np.hypot(0.3 * 30.0 / 12.0, 0.12 * 30.0 / 340.2)))
    assert coherence(0.3, 0.0, tall) == 1.0


def test_the_variance_is_the_intensitys(standing):
    # In the mean of 3000 s; what lies above 10 Hz (2 %) and below 1/3000 s is not there. σ of the record's variance: 3
    # %.
    captured = 1.0 - (1.0 + 6.0 * RATE / 2.0 * WIND.length_scale / WIND.speed) ** (-2.0 / 3.0)
    assert 0.97 < captured < 0.99
    for values in (standing.hub, standing.blades):
        assert values.var(axis=0).mean() / WIND.std**2 == pytest.approx(captured, rel=0.09)


@pytest.mark.parametrize(
    ("first", "second"), [((0, 0), (1, 0)), ((0, 1), (1, 1)), ((0, 1), (3, 1)), ((0, 0), (0, 1)), ((2, 0), (5, 1))]
)
def test_the_coherence_of_points_of_the_rotor_is_the_iecs(standing, first, second):
    positions = [(0.6, 2.0)[ring] * np.exp(1j * blade * np.pi / 3.0) for blade, ring in (first, second)]
    _compare_coherence(standing.blades[:, *first], standing.blades[:, *second], abs(positions[0] - positions[1]))


def test_the_hub_is_a_point_of_the_same_field(standing):
    _compare_coherence(standing.hub, standing.blades[:, 4, 1], 2.0)


def _compare_coherence(a: np.ndarray, b: np.ndarray, separation: float) -> None:
    f, cross = csd(a, b, RATE, nperseg=512)
    measured = cross.real / np.sqrt(welch(a, RATE, nperseg=512)[1] * welch(b, RATE, nperseg=512)[1])
    # 234 pieces at half overlap (two thirds of them independent), averaged over bands: std of a coherence γ is (1 −
    # γ²)/√(2 · 150 n).
    for low, high in ((0.1, 0.25), (0.25, 0.6), (0.6, 1.5), (1.5, 4.0)):
        band = (f >= low) & (f < high)
        target = coherence(f[band], separation, WIND).mean()
        assert measured[band].mean() == pytest.approx(target, abs=0.06), (separation, low, high)


def test_a_turning_point_sees_the_spectrum_of_theory(turning):
    """Against the transform of the exact autocovariance ∫ S γ(2 r |sin Ωτ/2|) cos 2πfτ df, an independent route."""
    pieces = 2048
    lags = np.arange(pieces) / RATE
    f = np.geomspace(1e-4, RATE / 2.0, 3000)
    weights = np.gradient(f) * kaimal_spectrum(f, WIND)
    chord = 4.0 * np.abs(np.sin(np.pi * ONCE * lags))
    covariance = np.array(
        [np.sum(weights * coherence(f, c, WIND) * np.cos(2 * np.pi * f * t)) for c, t in zip(chord, lags, strict=True)]
    )
    # Welch's expectation: the covariance times the window's own correlation.
    window = np.hanning(pieces + 1)[:-1]
    taper = np.correlate(window, window, "full")[pieces - 1 :] / np.sum(window**2)
    tapered = covariance * taper
    expected = 2.0 / RATE * (2.0 * np.fft.rfft(tapered).real - tapered[0])
    frequency, spectra = welch(turning.blades[:, :, 0].T, RATE, nperseg=pieces, detrend=False)
    measured = spectra.mean(axis=0)
    for multiple in (1, 2, 3, 4, 5, 6):
        peak = np.abs(frequency - multiple * ONCE) < 0.15
        assert measured[peak].sum() / expected[peak].sum() == pytest.approx(1.0, abs=0.06), f"{multiple}P"
    between = np.abs(frequency / ONCE - 1.5) < 0.2
    assert measured[between].sum() / expected[between].sum() == pytest.approx(1.0, abs=0.06)


def test_turning_moves_variance_to_multiples_of_the_rotor_frequency(turning):
    f, blade = welch(turning.blades[:, 0, 0], RATE, nperseg=2048)
    peak, slow = np.abs(f - ONCE) < 0.1, (f > 0.2) & (f < 0.6)
    assert blade[peak].mean() > 5.0 * kaimal_spectrum(ONCE, WIND)
    assert blade[slow].mean() < 0.7 * kaimal_spectrum(f[slow], WIND).mean()


def test_the_same_seed_gives_the_same_wind_and_another_seed_another():
    psi = np.linspace(0.0, 40.0, 500)
    first, again, other = (rotor_wind(WIND, psi, (1.0, 2.0), rate=50.0, seed=seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.blades, again.blades)
    np.testing.assert_array_equal(first.hub, again.hub)
    assert abs(np.corrcoef(first.hub, other.hub)[0, 1]) < 0.999
    assert not np.array_equal(first.blades, other.blades)


def test_a_record_does_not_end_where_it_began():
    # The transform's own period is longer: over 200 seeds, first and last sample of 120 s are as good as independent.
    ends = np.array(
        [
            rotating_turbulence(WIND, np.zeros(600), (1.0,), rate=5.0, seed=s, harmonics=1).hub[[0, -1]]
            for s in range(200)
        ]
    )
    assert abs(np.corrcoef(ends.T)[0, 1]) < 0.25  # 3.5/√200


def test_mean_shear_follows_the_power_law():
    steady = replace(WIND, turbulence_intensity=0.0, shear_exponent=0.2)
    psi = np.array([np.pi / 2.0, 0.0, -np.pi / 2.0])
    wind = rotor_wind(steady, psi, (2.0,), blades=1, rate=10.0)
    np.testing.assert_allclose(wind.blades[:, 0, 0] / 5.56, [(8.0 / 6.0) ** 0.2, 1.0, (4.0 / 6.0) ** 0.2])
    np.testing.assert_array_equal(wind.hub, 5.56)


def test_the_tower_shadows_a_blade_that_points_down_and_no_other():
    shadowed = replace(WIND, turbulence_intensity=0.0, tower_radius=0.06, tower_distance=0.4)
    psi = np.linspace(-np.pi, np.pi, 3601)
    wind = rotor_wind(shadowed, psi, (1.5,), blades=3, rate=100.0).blades[:, :, 0] / 5.56
    for blade in range(3):
        theta = np.mod(psi + 2.0 * np.pi * blade / 3.0 + np.pi, 2.0 * np.pi) - np.pi
        deepest = theta[np.argmin(wind[:, blade])]
        assert np.rad2deg(deepest) == pytest.approx(-90.0, abs=0.11)
        assert wind[:, blade].min() == pytest.approx(1.0 - (0.06 / 0.4) ** 2, rel=1e-6)
        np.testing.assert_array_equal(wind[theta > 0.01, blade], 1.0)
    # Potential flow: where the blade is as far beside the tower as the rotor is upwind of it, nothing; further out a
    # little faster.
    assert tower_shadow(shadowed, -np.arccos(0.4 / 1.5), 1.5) == pytest.approx(1.0, abs=1e-12)
    assert tower_shadow(shadowed, -0.5, 1.5) > 1.0


def test_the_iecs_numbers():
    assert iec_turbulence_intensity(15.0, "A") == pytest.approx(0.16 * (0.75 * 15.0 + 5.6) / 15.0)
    assert np.rad2deg(extreme_direction_change(WIND, 5.4)) == pytest.approx(
        np.rad2deg(4.0 * np.arctan(0.2 / (1.0 + 0.54 / 4.2)))
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turbulence_intensity": -0.1}, "turbulence intensity: expected"),
        ({"turbulence_intensity": float("nan")}, "turbulence intensity: expected"),
        ({"hub_height": 0.0}, "hub height: expected"),
        ({"speed": -1.0}, "wind speed: expected"),
        ({"speed": float("inf")}, "wind speed: expected"),
        ({"shear_exponent": 3.0}, "shear exponent: expected"),
        ({"tower_radius": 0.5, "tower_distance": 0.3}, "tower distance: expected"),
    ],
)
def test_impossible_wind_is_refused_by_name(change, message):
    with pytest.raises(ConfigurationError, match=message):
        replace(WIND, **change)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"radii": ()}, "at least one radius"),
        ({"radii": (7.0,)}, "0 to the hub height"),
        ({"rate": 0.0}, "sampling rate"),
        ({"blades": 0}, "number of blades"),
        ({"harmonics": 0}, "harmonics"),
        ({"azimuth": np.array([0.0, np.nan])}, "azimuth"),
    ],
)
def test_impossible_sampling_is_refused_by_name(options, message):
    options = {"azimuth": np.zeros(10), "radii": (1.0,), "rate": 10.0} | options
    with pytest.raises(ConfigurationError, match=message):
        rotor_wind(WIND, options.pop("azimuth"), options.pop("radii"), **options)


def test_an_unknown_category_is_refused():
    with pytest.raises(ConfigurationError, match="category: expected one of A"):
        iec_turbulence_intensity(10.0, "D")
