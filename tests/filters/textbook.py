"""An independent Kalman filter and smoother for the chain of masses, in plain NumPy from the chain's springs.

The transition is written out as a matrix polynomial; filter and smoother are the textbook's formulas; and `dense`
treats a whole record as one Gaussian vector, without any recursion.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg

from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov

LOADS = (GaussMarkov("load_3", 2.0, 1.5), GaussMarkov("load_1", 5.0, 0.5))  # not in the model's order, one load known
STEPS = (0.02, 0.005, 0.033)


def composed() -> StateSpace:
    """The chain with two random loads, one known load and a bias, sampled at three different intervals."""
    rng = np.random.default_rng(31)
    root = 0.1 * rng.standard_normal((6, 6))
    return compose(
        chain(),
        intervals=STEPS,
        values=CHAIN_VALUES,
        loads=LOADS,
        sensors=chain_sensors(bias=0.3),
        mean=0.1 * rng.standard_normal(6),
        cov=root @ root.T + 1e-3 * np.eye(6),
    )


@dataclass(frozen=True)
class Textbook:
    """z₁ = F z₀ + B₀ w₀ + B₁ w₁ + noise of covariance Q, y = H z + D w + noise of covariance R."""

    F: np.ndarray
    B0: np.ndarray
    B1: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    D: np.ndarray
    R: np.ndarray


@lru_cache(maxsize=len(STEPS))
def textbook(h: float) -> Textbook:
    """All matrices for a step of h seconds."""
    m, k, c = (np.array([CHAIN_VALUES[f"{n}_{i}"] for i in (1, 2, 3)]) for n in "mkc")

    def assemble(s: np.ndarray) -> np.ndarray:
        return np.array([[s[0] + s[1], -s[1], 0.0], [-s[1], s[1] + s[2], -s[2]], [0.0, -s[2], s[2]]])

    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-assemble(k) / m[:, None], -assemble(c) / m[:, None]]])
    G = np.vstack([np.zeros((3, 3)), np.diag(1.0 / m)])
    # RK4 of a linear system with a linear load is the Taylor polynomial of order 4 of the system [x, w, dw/dt]
    augmented = np.zeros((12, 12))
    augmented[:6, :6], augmented[:6, 6:9], augmented[6:9, 9:] = A, G, np.eye(3)
    power, taylor = np.eye(12), np.eye(12)
    for order in (1, 2, 3, 4):
        power = power @ augmented * h / order
        taylor = taylor + power
    Ad, per_load, per_slope = taylor[:6, :6], taylor[:6, 6:9], taylor[:6, 9:]
    B1 = per_slope / h
    B0 = per_load - B1
    # loads as states, in the order of LOADS: forces on masses 3 and 1
    select = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    decay = np.array([np.exp(-h / 1.5), np.exp(-h / 0.5)])
    variance = np.array([2.0**2, 5.0**2]) * (1.0 - decay**2)
    F = scipy.linalg.block_diag(Ad, np.diag(decay), np.eye(1))
    F[:6, 6:8] = B0 @ select + B1 @ select @ np.diag(decay)
    gain = np.vstack([B1 @ select, np.eye(2), np.zeros((1, 2))])
    feed = np.array([[1.0 / m[0], 0.0, 0.0], [0.0, 0.0, 1.0 / m[2]], [0.0, 0.0, 0.0]])
    H = np.zeros((3, 9))
    H[0, :6], H[1, :6], H[2, 1] = A[3], A[5], 1.0
    H[:, 6:8] = feed @ select
    H[1, 8] = 1.0
    below = np.zeros((3, 3))
    return Textbook(
        F,
        np.vstack([B0, below]),
        np.vstack([B1, below]),
        gain @ np.diag(variance) @ gain.T,
        H,
        feed,
        np.diag([0.05, 0.08, 0.002]) ** 2,
    )


def simulated(model: StateSpace, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (known loads and interval) and readings drawn from the model itself; some readings missing."""
    rng = np.random.default_rng(seed)
    known = np.cumsum(rng.standard_normal((samples, 3)), axis=0)
    which = rng.integers(len(STEPS), size=samples)
    state = rng.multivariate_normal(model.mean, model.cov)
    readings = np.empty((samples, 3))
    for k in range(samples):
        t = textbook(STEPS[which[k]])
        if k:
            noise = rng.multivariate_normal(np.zeros(9), t.Q, method="svd")
            state = t.F @ state + t.B0 @ known[k - 1] + t.B1 @ known[k] + noise
        readings[k] = t.H @ state + t.D @ known[k] + rng.multivariate_normal(np.zeros(3), t.R)
    readings[rng.random(readings.shape) < 0.1] = np.nan
    readings[samples // 2] = np.nan
    return np.column_stack([known, which]), readings


@dataclass(frozen=True)
class Filtered:
    """What the textbook's filter knows after a sample, and that sample's prediction and innovation with covariances."""

    mean: np.ndarray
    cov: np.ndarray
    predicted: np.ndarray
    predicted_cov: np.ndarray
    F: np.ndarray
    innovation: np.ndarray
    S: np.ndarray
    log_likelihood: float


def kalman(model: StateSpace, inputs: np.ndarray, readings: np.ndarray) -> list[Filtered]:
    """The Kalman filter, a sample's readings taken in together."""
    mean, cov = model.mean, model.cov
    samples = []
    for k, reading in enumerate(readings):
        t = textbook(STEPS[int(inputs[k, 3])])
        if k:
            mean = t.F @ mean + t.B0 @ inputs[k - 1, :3] + t.B1 @ inputs[k, :3]
            cov = t.F @ cov @ t.F.T + t.Q
        predicted, predicted_cov = mean, cov
        seen = ~np.isnan(reading)
        H, R = t.H[seen], t.R[np.ix_(seen, seen)]
        innovation = reading[seen] - H @ mean - t.D[seen] @ inputs[k, :3]
        S = H @ cov @ H.T + R
        log_likelihood = -0.5 * (
            innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(S)[1] + seen.sum() * np.log(2 * np.pi)
        )
        gain = np.linalg.solve(S, H @ cov).T
        mean, cov = mean + gain @ innovation, cov - gain @ S @ gain.T
        samples.append(Filtered(mean, cov, predicted, predicted_cov, t.F, innovation, S, log_likelihood))
    return samples


def rauch_tung_striebel(samples: list[Filtered]) -> tuple[np.ndarray, np.ndarray]:
    """The smoother's means (T, n) and covariances (T, n, n)."""
    mean, cov = samples[-1].mean, samples[-1].cov
    means, covs = [mean], [cov]
    for now, then in zip(samples[-2::-1], samples[:0:-1], strict=True):
        gain = np.linalg.solve(then.predicted_cov, then.F @ now.cov).T
        mean = now.mean + gain @ (mean - then.predicted)
        cov = now.cov + gain @ (cov - then.predicted_cov) @ gain.T
        means.append(mean)
        covs.append(cov)
    return np.array(means[::-1]), np.array(covs[::-1])


def dense(model: StateSpace, inputs: np.ndarray, samples: int) -> tuple[np.ndarray, ...]:
    """All states (T n) and readings (T m) as one Gaussian vector: means, cov of states, H of all, cov of readings."""
    books = [textbook(STEPS[int(which)]) for which in inputs[:samples, 3]]
    n = len(model.mean)
    mean, cov = np.zeros((samples, n)), np.zeros((samples, n, samples, n))
    mean[0], cov[0, :, 0] = model.mean, model.cov
    for k in range(1, samples):
        t = books[k]
        mean[k] = t.F @ mean[k - 1] + t.B0 @ inputs[k - 1, :3] + t.B1 @ inputs[k, :3]
        for j in range(k):
            cov[k, :, j] = t.F @ cov[k - 1, :, j]
            cov[j, :, k] = cov[k, :, j].T
        cov[k, :, k] = t.F @ cov[k - 1, :, k - 1] @ t.F.T + t.Q
    whole = cov.reshape(samples * n, samples * n)
    H = scipy.linalg.block_diag(*(t.H for t in books))
    known = np.concatenate([t.D @ inputs[k, :3] for k, t in enumerate(books)])
    return mean.ravel(), whole, H, H @ mean.ravel() + known, H @ whole @ H.T + np.kron(np.eye(samples), books[0].R)
