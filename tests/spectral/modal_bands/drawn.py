"""Vibration of one mode, drawn by its spectrum."""

import numpy as np

RATE, SAMPLES = 10.0, 12_000
BINS = np.arange(960, 1440)


def vibration(seed: int, f: float = 1.0, zeta: float = 0.01) -> np.ndarray:
    """Two channels of one mode under a white load, with white noise (T, 2): a part of four times its length, drawn by
    its spectrum."""
    rng, frequency = np.random.default_rng(seed), np.fft.rfftfreq(4 * SAMPLES, 1.0 / RATE)
    r = frequency / f
    white = np.fft.rfft(rng.normal(size=4 * SAMPLES))
    q = np.fft.irfft(-(r**2) / (1.0 - r**2 + 2j * zeta * r) * white)[:SAMPLES]
    return np.asarray(np.outer(q, [1.0, 0.5]) + 0.02 * q.std() * rng.normal(size=(SAMPLES, 2)))
