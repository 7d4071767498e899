"""The taper's window on a finer grid, and the spectra of a tower."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from windsysid.identification.model.prior import Prior
from windsysid.mechanics.compile import compile_model
from windsysid.simulation.record import simulate_record
from windsysid.spectral.rotor import harmonic_transfer
from windsysid.spectral.rotor import model as module
from windsysid.spectral.rotor.build import pose_lifted
from windsysid.spectral.rotor.model import GRID_FACTOR, LiftedModel, finer_bins, taper_weights
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.spectral.transforms.dft import taper
from windsysid.turbine.file import load_turbine


def test_the_window_of_the_taper_adds_up_to_one_about_its_bin():
    bins = np.array([40, 41, 50])
    fine, weights = finer_bins(40, 50), taper_weights(400, bins) ** 2
    assert weights.shape == (len(fine), 3)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    np.testing.assert_allclose(fine @ weights, bins)
    assert np.diff(fine) == pytest.approx(1.0 / GRID_FACTOR)


@pytest.mark.parametrize("damping", [0.002, 0.006])
def test_bins_that_a_narrow_resonance_makes_alike_have_the_covariance_of_the_transform(damping: float):
    """A process with the autocovariance e^{−a|τ| + iωτ}, by the sum over all pairs of samples; a mode at 0.165 Hz."""
    T, bins, middle = 270, np.arange(35, 56), 44.6
    h, t, a = taper(T), np.arange(T), 2.0 * np.pi * 0.165 * damping
    apart = np.subtract.outer(t, t)
    process = np.exp(-a * np.abs(apart) + 2j * np.pi * middle / T * apart)
    F = h * np.exp(-2j * np.pi * np.outer(bins, t) / T)
    expected = F @ process @ F.conj().T / (h @ h)
    fine, weights = finer_bins(35, 55, 8), taper_weights(T, bins, 8)
    S = 2.0 * a / (a**2 + np.square(2.0 * np.pi * (fine - middle) / T))
    found = weights.T @ (S[:, None] * weights)
    np.testing.assert_allclose(found, expected, atol=0.06 * np.abs(expected).max())


def test_bins_far_from_a_resonance_say_as_much_together_as_alone(posed: Posed):
    assert posed.model.joint is not None
    model = posed.model._replace(joint=None)
    damped = posed.start + np.array([0.0, 30.0, 0.0, 30.0, *np.zeros(len(posed.start) - 4)]) * model.prior[1]
    together, alone = (np.diag(one.likelihood(damped).information)[4:8] for one in (posed.model, model))
    np.testing.assert_allclose(together, alone, rtol=0.15)


@pytest.mark.parametrize("border", [26, 27, 28, 29])
def test_a_resonance_at_the_border_of_two_groups_counts_once(
    posed: Posed, border: int, monkeypatch: pytest.MonkeyPatch
):
    """Groups that were independent counted one random amplitude twice: damping seemed 24 % better known."""
    whole = posed.model.likelihood(posed.start).information
    assert abs(posed.model.base[border] - 0.3163) < 3.0 / 300.0
    monkeypatch.setattr(module, "MAX_JOINT_BINS", border)
    found = posed.model.likelihood(posed.start).information
    np.testing.assert_allclose(np.diag(found)[:4], np.diag(whole)[:4], rtol=0.02)


def test_channels_that_nothing_links_say_as_much_apart_as_together(posed: Posed, monkeypatch: pytest.MonkeyPatch):
    apart = posed.model.likelihood(posed.start)
    monkeypatch.setattr(module, "_linked", lambda pairs: [np.arange(len(pairs))])
    together = posed.model.likelihood(posed.start)
    assert apart.value == pytest.approx(together.value)
    np.testing.assert_allclose(apart.gradient, together.gradient, atol=1e-6 * np.abs(together.gradient).max())
    np.testing.assert_allclose(apart.information, together.information, atol=1e-6 * together.information.max())


@pytest.mark.parametrize("most", [2, 7, 69, 100])
def test_groups_have_every_bin_once(posed: Posed, most: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "MAX_JOINT_BINS", most)
    joint = posed.model.joint
    assert joint is not None
    groups = [
        (first, given, C.shape[1])
        for first, given, C in joint.covariances(np.ones((1, len(posed.model.place.base), 1, 1)))
    ]
    assert [bin_ for first, given, size in groups for bin_ in range(first + given, first + size)] == list(
        range(joint.bins)
    )
    assert max(size for *_, size in groups) <= most


def test_a_smoothed_spectrum_is_the_sum_over_the_window(posed: Posed):
    model = posed.model
    assert model.window is not None
    smooth, fine = (one.spectrum(posed.start, slopes=True) for one in (model, model._replace(window=None)))
    window = model.window.toarray()
    np.testing.assert_allclose(smooth.spectrum, np.einsum("fb,fij->bij", window, fine.spectrum), rtol=1e-9)
    expected = np.einsum("fb,nfij->nbij", window, fine.slopes, optimize=True)
    np.testing.assert_allclose(smooth.slopes, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_matrices_that_are_affine_are_computed_once(posed: Posed, monkeypatch: pytest.MonkeyPatch):
    """At coefficients far from the priors' centres, as by differences there."""
    at = posed.start + 0.7 * posed.model.prior[1] * np.cos(np.arange(len(posed.start)))
    harmonic_transfer.affine_matrices.cache_clear()
    calls = Mock(side_effect=harmonic_transfer.matrix_harmonics)
    monkeypatch.setattr(harmonic_transfer, "matrix_harmonics", calls)
    found = [posed.model.matrices(at * share, slopes=True) for share in (0.5, 1.0)][1]
    assert calls.call_count == 1
    monkeypatch.setattr(LiftedModel, "_affine", lambda self: None)
    by_differences = posed.model.matrices(at, slopes=True)
    for ours, theirs in zip(found, by_differences, strict=True):
        for X, Y in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(X, Y, rtol=1e-7, atol=1e-11 * np.abs(Y).max())
            np.testing.assert_array_equal(X == 0.0, Y == 0.0)


def test_a_parked_rotor_of_many_bins_has_no_joint_covariance():
    """An evaluation took 1.4 s in place of 0.03 s, and `identify` minutes for a record of two minutes."""
    parked = replace(load_turbine("nrel5mw_full").exact(), rotor_speed=0.0)
    record = simulate_record(parked, duration=120.0, rate=20.0, seed=5)
    parameters = Prior().parameters(parked, list(parked.coefficients), linear=False)
    readings = np.column_stack([record[s.channel] for s in parked.sensors])
    compiled, inputs = compile_model(parked.model, parked.sensors), np.zeros((record.samples, 5))
    question = RotorQuestion(
        parked, parked.sensors, readings, record.rate, inputs, compiled, parameters, parked.loads
    )  # fmt: skip
    model = pose_lifted(question, "broadband").model
    assert model.joint is None
    assert model.window is not None


def test_a_likelihood_of_every_other_bin_counts_as_much_as_all(posed: Posed):
    model, at = posed.model, posed.start
    whole, half = (model.likelihood(at, every).information for every in (1, 2))
    np.testing.assert_allclose(np.diag(half), np.diag(whole), rtol=0.5)


def test_noise_and_loads_without_a_gap_are_as_alike_as_the_taper_makes_them(posed: Posed):
    model = posed.model
    S = model.spectrum(posed.start).spectrum
    assert model.likeness(S) >= model.overlap
    shared, count = model.shared_by_neighbours(S)
    assert count > 0
    assert shared < 0.5
