"""Modes at the border of a band, steady envelopes, and other explanations of a band."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from windsysid.spectral.modal_bands import check
from windsysid.spectral.modal_bands.check import ENVELOPES, explanations, is_spurious, variation
from windsysid.spectral.modal_bands.limits import MAX_STEADINESS
from windsysid.spectral.modal_bands.model import Modes
from windsysid.spectral.modal_bands.model_order import BandFit, fit_band
from windsysid.spectral.modal_bands.scoring import score
from windsysid.spectral.transforms.dft import Band, transform

from .drawn import BINS, RATE, SAMPLES, vibration

LENGTH = 400.0


@pytest.fixture(scope="module")
def found(one_mode: Modes, exact_band: Band, transforms: tuple[np.ndarray, np.ndarray]) -> BandFit:
    bins, values = transforms
    return BandFit(score(one_mode, exact_band), exact_band, values, bins, np.eye(2, dtype=complex), 0.0)


def test_a_clear_mode_inside_is_real_and_one_outside_is_spurious(found: BandFit):
    assert not is_spurious(found, 0, LENGTH)
    outside = found.fit._replace(modes=found.fit.modes._replace(frequency=np.array([1.3])))
    assert is_spurious(found._replace(fit=outside), 0, LENGTH)


def test_a_mode_at_the_edge_of_its_range_is_doubted(found: BandFit, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(check, "fit_doubts", lambda *_: [])
    shapes, readings = SimpleNamespace(std=np.zeros((2, 1))), SimpleNamespace(samples=LENGTH * RATE, rate=RATE)
    edge = found.fit._replace(modes=found.fit.modes._replace(frequency=found.bins[-1:] / LENGTH))
    said = [
        {doubt.kind for doubt in check.mode_doubts(one, 0, shapes, readings)}  # type: ignore[arg-type]
        for one in (found, found._replace(fit=edge))
    ]
    assert ["border" in kinds for kinds in said] == [False, True]


def test_an_envelope_is_steady_under_a_load_of_constant_amplitude_only():
    """A machine whose speed varies by 1 % has the spectrum of a mode, and a constant envelope."""
    rng = np.random.default_rng(3)
    slow = lfilter([1.0], [1.0, -np.exp(-1.0 / (20.0 * RATE))], rng.normal(size=SAMPLES))
    machine = np.sin(2.0 * np.pi * np.cumsum(1.0 + 0.01 * slow / slow.std()) / RATE)
    steady = []
    for values in (vibration(4), np.outer(machine, [1.0, 0.5]) + 0.01 * rng.normal(size=(SAMPLES, 2))):
        found = fit_band(transform(values, RATE)[1][BINS], BINS, SAMPLES, RATE, 1, 1)
        steady.append(variation(found, 0)[0])
    assert steady[0] < 0.5
    assert steady[1] == pytest.approx(MAX_STEADINESS)


def test_motions_of_a_long_record_are_drawn_one_after_the_other():
    """All at once a day of four channels needed 4 GB."""
    found = fit_band(transform(vibration(4), RATE)[1][BINS], BINS, SAMPLES, RATE, 1, 1)
    variation(found, 0)
    tracemalloc.start()
    try:
        variation(found, 0)
        assert tracemalloc.get_traced_memory()[1] < ENVELOPES * len(found.values) * np.complex128().nbytes
    finally:
        tracemalloc.stop()


def test_gusts_are_no_steady_amplitude():
    """The level of the load on a mode varies by half: every such mode was called a load of steady amplitude."""
    slow = lfilter([0.0577], [1.0, -np.exp(-1.0 / (60.0 * RATE))], np.random.default_rng(3).normal(size=SAMPLES))
    load = np.random.default_rng(4).normal(size=SAMPLES) * np.exp(0.5 * slow)
    size, angle = np.exp(-0.01 * 2.0 * np.pi / RATE), 2.0 * np.pi / RATE
    motion = lfilter([1.0], [1.0, -2.0 * size * np.cos(angle), size**2], load)
    values = np.outer(motion / motion.std(), [1.0, 0.5])
    values += 0.02 * np.random.default_rng(5).normal(size=(SAMPLES, 2))
    found = fit_band(transform(values, RATE)[1][BINS], BINS, SAMPLES, RATE, 1, 1)
    assert variation(found, 0)[0] < 1.0


def test_a_machine_whose_speed_and_amplitude_vary_differs_from_a_mode_in_its_phase():
    """Its amplitude varies by 40 %, nearly as much as that of random response, and its phase varies more."""
    rng, found = np.random.default_rng(7), []
    for _ in range(6):
        fast, slow = rng.normal(size=(2, SAMPLES))
        fast, slow = (lfilter([1.0], [1.0, -np.exp(-1.0 / (t * RATE))], x) for t, x in ((20.0, slow), (8.0, fast)))
        machine = (1.0 + 0.4 * fast / fast.std()) * np.sin(
            2.0 * np.pi * np.cumsum(1.0 + 0.01 * slow / slow.std()) / RATE
        )
        values = np.outer(machine, [1.0, 0.5]) + 0.02 * rng.normal(size=(SAMPLES, 2))
        found.append(variation(fit_band(transform(values, RATE)[1][BINS], BINS, SAMPLES, RATE, 1, 1), 0)[0])
    assert np.median(found) > 2.0


def test_a_load_of_its_own_is_another_explanation(found: BandFit):
    """Shifts are those of the logarithms of frequency and damping ratio."""
    modes = found.fit.modes
    plain = found.fit._replace(modes=modes._replace(frequency=1.01 * modes.frequency, damping=2.0 * modes.damping))
    (_, alone), *rest = explanations(found._replace(plain=plain), 0)
    np.testing.assert_allclose(alone, np.log([1.01, 2.0]))
    assert len(rest) == 1
    assert np.all(np.abs(rest[0][1]) < 0.01)
