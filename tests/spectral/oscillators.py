"""Modes under white loads, sampled exactly: an independent model for the tests of operational modal analysis."""

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter


def modal_responses(frequencies, dampings, rate, samples, rng, loads=None):
    """Displacements and velocities (T, r) of q̈ + 2ζω q̇ + ω² q = w under white loads w, or those of a mixing matrix
    (r, s), through the exact transition and noise covariance."""
    r = len(frequencies)
    mixing = np.eye(r) if loads is None else np.asarray(loads)
    state = np.zeros((2 * r, 2 * r))
    input_ = np.zeros((2 * r, mixing.shape[1]))
    for j, (f, z) in enumerate(zip(frequencies, dampings, strict=True)):
        w = 2.0 * np.pi * f
        state[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] = [[0.0, 1.0], [-w * w, -2.0 * z * w]]
        input_[2 * j + 1] = mixing[j]
    n = 2 * r
    block = np.block([[-state, input_ @ input_.T], [np.zeros((n, n)), state.T]]) / rate
    both = expm(block)
    step = both[n:, n:].T
    noise = step @ both[:n, n:]
    values, vectors = np.linalg.eig(step)
    lead = int(
        min(20.0 / (2.0 * np.pi * min(f * z for f, z in zip(frequencies, dampings, strict=True))) * rate, 200_000)
    )
    root = np.linalg.cholesky(0.5 * (noise + noise.T) + 1e-14 * np.trace(noise) * np.eye(n))
    shocks = rng.normal(size=(samples + lead, n)) @ root.T
    turned = shocks @ np.linalg.inv(vectors).T
    modal = np.column_stack([lfilter([1.0], [1.0, -v], turned[:, i]) for i, v in enumerate(values)])
    x = (modal @ vectors.T).real[lead:]
    return x[:, 0::2], x[:, 1::2]
