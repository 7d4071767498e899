import numpy as np
import pytest

from windsysid.spectral.modal_bands.model import Modes, advance, scores, spectrum, with_real_elements
from windsysid.spectral.transforms.dft import Band, band_data, taper_factor, transform, window_weights


def some_modes(rng, m=3, r=2, *, drift=False, mix=False):
    shape = rng.normal(size=(m, r)) + 1j * rng.normal(size=(m, r))
    load = np.eye(r, dtype=complex)
    if r > 1:
        load[1, 0] = 0.3 - 0.2j
    rest = np.linalg.cholesky(np.eye(m) + 0.3 * np.ones((m, m))).astype(complex)
    modes = Modes(np.array([0.97, 1.04])[:r], np.array([0.02, 0.01])[:r], 0.05 * shape, load, 0.4, rest, -0.7)
    if drift:
        modes = modes._replace(drift=0.1 * (rng.normal(size=(m, r)) + 1j * rng.normal(size=(m, r))))
    if mix:
        mixing = np.tril(rng.normal(size=(2, m, m)) + 1j * rng.normal(size=(2, m, m)), -1)
        mixing[0] += np.diag(np.append(0.0, rng.normal(size=m - 1)))
        modes = modes._replace(mix=mixing)
    return with_real_elements(modes)


def some_band(rng, m=3, samples=2000, rate=10.0):
    bins = np.arange(170, 240)
    values = rng.normal(size=(len(bins), m)) + 1j * rng.normal(size=(len(bins), m))
    return band_data(values, bins, samples, rate)


@pytest.mark.parametrize("mix", [False, True])
@pytest.mark.parametrize("drift", [False, True])
@pytest.mark.parametrize("r", [1, 2])
def test_gradient_and_information_are_those_of_differences_of_the_plain_formula(r, drift, mix):
    rng = np.random.default_rng(1)
    modes, band = some_modes(rng, r=r, drift=drift, mix=mix), some_band(rng)

    def cost(step):
        s = spectrum(advance(modes, step), band)
        return float(
            band.counts @ (np.linalg.slogdet(s)[1] + np.einsum("kij,kji->k", np.linalg.inv(s), band.power).real)
        )

    found = scores(modes, band)
    assert found.cost == pytest.approx(cost(np.zeros(modes.size)), rel=1e-10)
    steps = 1e-6 * np.eye(modes.size)
    gradient = [(cost(step) - cost(-step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-5, atol=1e-4)
    slopes = [(spectrum(advance(modes, step), band) - spectrum(advance(modes, -step), band)) / 2e-6 for step in steps]
    white = [np.linalg.inv(spectrum(modes, band)) @ slope for slope in slopes]
    fisher = [[np.einsum("k,kij,kji->", band.counts, a, b).real for a in white] for b in white]
    size = np.sqrt(np.diagonal(fisher))
    np.testing.assert_allclose(found.fisher / np.outer(size, size), fisher / np.outer(size, size), atol=1e-6)


def test_a_step_backward_undoes_a_step():
    rng = np.random.default_rng(2)
    modes = some_modes(rng)
    step = np.zeros(modes.size)
    step[: modes.size - 10] = 1e-3 * rng.normal(size=modes.size - 10)
    there = advance(advance(modes, step), -step)
    np.testing.assert_allclose(there.shape, modes.shape, atol=1e-12)
    np.testing.assert_allclose(there.rest, modes.rest, atol=1e-9)


def test_the_window_turns_a_lorentzian_into_its_expected_periodogram():
    # Against the definition: E|Y|² = Σ_τ R(τ) g(τ) e^{-iωτ} with the covariance R of a damped cosine and g the taper's
    # correlation with itself.
    samples, rate, f, z = 1500, 5.0, 0.7, 0.005
    w = 2.0 * np.pi * f
    lag = np.arange(-samples + 1, samples) / rate
    covariance = np.exp(-z * w * np.abs(lag)) * np.cos(w * lag)
    from scipy.signal.windows import tukey

    h = tukey(samples, 0.1)
    own = np.correlate(h, h, "full") / np.sum(h**2)
    bins = np.arange(195, 226)
    wave = np.exp(-2j * np.pi * np.outer(bins * rate / samples, lag))
    expected = 2.0 / rate * (wave @ (covariance * own)).real
    fine, first, weights = window_weights(samples, rate, bins)
    a = z * w
    exact = 2.0 * (a / (a**2 + (2 * np.pi * fine - w) ** 2) + a / (a**2 + (2 * np.pi * fine + w) ** 2))
    seen = np.sum(weights * exact[first[:, None] + np.arange(weights.shape[1])], axis=1)
    np.testing.assert_allclose(seen, expected, rtol=0.02)
    plain = np.interp(bins * rate / samples, fine, exact)
    assert np.max(np.abs(plain / expected - 1.0)) > 0.15, "without the window the peak is far off"


def test_transforms_of_white_noise_have_its_one_sided_density():
    rng = np.random.default_rng(3)
    y = rng.normal(size=(20_000, 1))
    _, found = transform(y, 10.0)
    assert np.mean(np.abs(found[10:-10]) ** 2) == pytest.approx(0.2, rel=0.03)
    assert taper_factor(20_000) == pytest.approx(1.055, abs=0.002)


def test_pooled_bins_keep_the_likelihood_of_a_flat_spectrum():
    rng = np.random.default_rng(4)
    values = rng.normal(size=(900, 2)) + 1j * rng.normal(size=(900, 2))
    band: Band = band_data(values, np.arange(1000, 1900), 10_000, 10.0)
    assert band.window.shape[1] == 1
    assert band.counts.sum() == 900
    np.testing.assert_allclose(np.einsum("k,kij->ij", band.counts, band.power), values.T @ values.conj(), atol=1e-9)
