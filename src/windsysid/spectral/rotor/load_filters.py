"""Spectra of load models in continuous time.

A stationary linear block dz = F z dt + noise of covariance P is known by Φ = e^{Fh} and P. So F = ln Φ / h, the noise
has the intensity Q = −(F P + P Fᵀ), and what the block drives, H z, has the two-sided spectrum h hᴴ with
h = H (iω − F)⁻¹ Q^½.
"""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.statespace.load_model import LoadModel

__all__ = ["LoadShape", "load_shapes"]

MAX_STEP_SECONDS, MAX_DECAY = 1.0, 0.01
"""Numerical: longest step at which Φ is evaluated [s], and largest distance of its eigenvalues from 1: the logarithm is
then on the right branch."""

MIN_INTENSITY_SHARE = 1e-9
"""Numerical: intensity over the largest, below which it is rounding."""


class LoadShape:
    """One load model: its spectrum of some rank r, and its poles."""

    def __init__(self, load: LoadModel, names: Sequence[str]) -> None:
        """`names` are those of the model's loads (w,).

        Raises
        ------
        ConfigurationError
            If it turns with a rotor, or drives a load that the model has not.
        """
        self.name = load.states[0]
        self._outputs = np.zeros((len(names), len(load.states)))
        for name, rows in load.outputs.items():
            if len(rows) != 1 or name not in names:
                raise ConfigurationError(
                    f"load '{name}': expected a load of this model that does not turn with a rotor; use the joint "
                    f"formulation"
                )
            self._outputs[list(names).index(name)] += rows[0]
        self._drift = _drift(load)
        self.poles = np.linalg.eigvals(self._drift)
        intensity = -(self._drift @ load.cov + load.cov @ self._drift.T)
        size = 1.0 / np.sqrt(np.maximum(np.diag(load.cov), 1e-300))  # states have units of their own
        values, vectors = np.linalg.eigh(0.5 * (intensity + intensity.T) * size[:, None] * size)
        kept = values > MIN_INTENSITY_SHARE * values.max()
        self.rank = int(kept.sum())
        self._root = (vectors[:, kept] * np.sqrt(values[kept])) / size[:, None]

    def __call__(self, s: Complex) -> Complex:
        """h (K, w, r) at s (K,)."""
        resolvent = np.linalg.solve(
            s[:, None, None] * np.eye(len(self._drift)) - self._drift, self._root.astype(complex)
        )
        return np.asarray(self._outputs @ resolvent)


def load_shapes(loads: Sequence[LoadModel], names: Sequence[str]) -> tuple[LoadShape, ...]:
    """All of them."""
    return tuple(LoadShape(load, names) for load in loads)


def _drift(load: LoadModel) -> Array:
    """F (n, n)."""
    from scipy.linalg import logm

    step = MAX_STEP_SECONDS
    while (
        _turned(load, step) > MAX_DECAY or _turned(load, step / 7.0) > MAX_DECAY
    ):  # 7: a step of whole periods turns nothing
        step *= 0.1
    return np.asarray(logm(load.discretise(step)[0]).real / step, dtype=np.float64)


def _turned(load: LoadModel, step: float) -> float:
    """Distance of the eigenvalues of Φ from 1."""
    return float(np.abs(np.linalg.eigvals(load.discretise(step)[0]) - 1.0).max())
