"""Motions that go together: an image has one line in its product with the mode, two random motions have none."""

import numpy as np

from windsysid.spectral.modal_bands.images import _go_together, _Motion, _phase_is_bound, with_bound_motions

from ..oma.modes import mode


def motion(transform: np.ndarray, freedom: float) -> _Motion:
    return _Motion(transform, 0.0, 1.0, float(np.sum(np.abs(transform) ** 2)), freedom)


def test_an_image_goes_with_its_mode_and_another_mode_does_not():
    rng = np.random.default_rng(3)
    one, other = rng.normal(size=(2, 64)) + 1j * rng.normal(size=(2, 64))
    assert _go_together(motion(one, 40.0), motion(0.1 * one, 40.0))
    assert _go_together(motion(one, 40.0), motion(0.1 * one[::-1].conj(), 40.0))
    assert not _go_together(motion(one, 40.0), motion(other, 40.0))


def test_narrow_motions_of_a_few_values_do_not_go_together_by_chance():
    rng, shape = np.random.default_rng(7), 1.0 / (1.0 + np.linspace(-20.0, 20.0, 64) ** 2)
    for _ in range(200):
        pair = np.sqrt(shape) * (rng.normal(size=(2, 64)) + 1j * rng.normal(size=(2, 64)))
        power = np.abs(pair) ** 2
        few = power.sum(axis=1) ** 2 / np.sum(power**2, axis=1)
        assert not _go_together(motion(pair[0], few[0]), motion(pair[1], few[1]))


def motions(*, bound: bool, power: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Transforms of a narrow random line at 0.6 Hz, and of one at 1.2 Hz with twice its phase or one of its own."""
    rng, samples, rate = np.random.default_rng(4), 6000, 10.0
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    near = np.exp(-0.5 * ((frequency - 0.6) / 0.006) ** 2)
    first = np.fft.irfft(near * (rng.normal(size=(2, len(near))).T @ [1.0, 1.0j]), samples)
    turning = np.fft.ifft(np.concatenate([2.0 * np.fft.rfft(first), np.zeros(samples - len(near))]))
    turning /= np.abs(turning).std()
    amplitude = np.interp(np.arange(samples), np.arange(0, samples, 200), rng.uniform(0.5, 1.5, samples // 200))
    second = (amplitude * (turning / np.abs(turning)) ** 2).real
    if not bound:
        far = np.exp(-0.5 * ((frequency - 1.2) / 0.012) ** 2)
        second = np.fft.irfft(far * (rng.normal(size=(2, len(far))).T @ [1.0, 1.0j]), samples)
        second = second / second.std()
    whole = turning.real + np.sqrt(power) * second + 0.01 * rng.normal(size=samples)
    return frequency, np.fft.rfft(whole)[:, None]


def bound_of(frequency: np.ndarray, values: np.ndarray) -> list[bool]:
    lines = [mode(0.6, 0.008, (1.0,)), mode(0.9, 0.008, (1.0,)), mode(1.2, 0.008, (1.0,))]
    return [one.doubted_for("load") for one in with_bound_motions(lines, frequency, values)]


def test_lines_with_bound_phases_are_harmonics_of_a_machine():
    """A 3P line of a rotor whose speed and load vary was a mode of grade A, as its envelope varies like a mode's."""
    assert bound_of(*motions(bound=True)) == [True, False, True]
    assert bound_of(*motions(bound=False)) == [False, False, False]


def test_a_phase_that_is_bound_in_part_only_is_significant_at_one_in_a_thousand():
    """Björkö's 1P and 2P over 250 s: a squared coherence of 0.36 by 19 independent values, 4 in 10 000 by chance."""
    rng = np.random.default_rng(8)
    time = np.zeros(64, dtype=complex)
    time[:32] = rng.normal(size=32) + 1j * rng.normal(size=32)
    other = np.zeros(64, dtype=complex)
    double = np.abs(time) * (time / np.maximum(np.abs(time), 1e-300)) ** 2
    other[:32] = double[:32] + 1.2 * (rng.normal(size=32) + 1j * rng.normal(size=32))
    one, two = (_Motion(np.fft.fft(x), 1.0, 1.0 + 63 / 64, 1.0, 19.0) for x in (time, other))
    two = two._replace(first=2.0, last=2.0 + 63 / 64)
    assert _phase_is_bound(one, two, 2, 1 / 64)
    assert not _phase_is_bound(one, two._replace(transform=two.transform[::-1]), 2, 1 / 64)


def test_a_faint_harmonic_leaves_its_mode():
    assert bound_of(*motions(bound=True, power=0.002)) == [False, False, True]
