"""Equations of one's own, linearised about a working point, in the frequency domain.

About a working point x̄, where ẋ = f(x̄, ū, p, w̄) = 0, the equations and the readings are ẋ = A x + G w, y = C x + E
w, so that at s = iω the loads reach the readings through T = C X G + E, X = (s − A)⁻¹. A parameter moves T by

    dT = [C X | 1] [[dA, dG], [dC, dE]] [X G ; 1] = L B R,

and B has a low rank r, one for a spring or a damper: B = Σ_j l_j r_jᵀ. Then with the loads' spectrum S_w the spectrum
of the readings moves by dS = Σ_j p_j q_jᴴ + q_j p_jᴴ, p_j = L l_j, q_jᴴ = r_jᵀ R S_w Tᴴ: vectors instead of matrices,
which is what keeps structures of many parts cheap.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import CompiledModel

__all__ = ["LinearSystem", "LowRankSlopes", "is_stable", "linearise", "low_rank", "resolve"]

MAX_NEWTON_STEPS = 50
"""Numerical: largest number of Newton steps to the working point."""

MAX_RELATIVE_STEP = 1e-9
"""Numerical: length of the last step over that of the working point."""

MIN_SINGULAR_VALUE = 1e-7
"""Numerical: singular values of a derivative over the largest, below which they are rounding."""

MAX_CONDITION = 1e8
"""Numerical: condition of the eigenvectors beyond which they are not used: a free body has too few."""


class LinearSystem(NamedTuple):
    """A (V, n, n), G (V, n, w), C (V, m, n) and E (V, m, w) at V sets of parameters."""

    A: Array
    G: Array
    C: Array
    E: Array

    @property
    def block(self) -> Array:
        """[[A, G], [C, E]] (V, n + m, n + w)."""
        return np.concatenate([np.concatenate([self.A, self.G], 2), np.concatenate([self.C, self.E], 2)], 1)


class LowRankSlopes(NamedTuple):
    """Derivatives of [[A, G], [C, E]] as Σ_j l_j r_jᵀ.

    Attributes
    ----------
    left, right
        l (n + m, R) and r (n + w, R) of all parameters.
    owner
        Which parameter each belongs to (R,).
    """

    left: Array
    right: Array
    owner: NDArray[np.intp]


def linearise(compiled: CompiledModel, parameters: Array, inputs: Array, loads: Array, start: Array) -> LinearSystem:
    """The system about the working point of each set of parameters.

    Parameters
    ----------
    parameters
        (V, n_p).
    inputs, loads
        Constant ū (n_u,) and w̄ (n_w,).
    start
        Where the working point is looked for (n,).

    Raises
    ------
    ConfigurationError
        If there is none near.
    """
    sets, n, m = len(parameters), len(compiled.states), compiled.readings
    count, driven = len(compiled.identified), len(compiled.loads)
    found = LinearSystem(
        np.zeros((sets, n, n)), np.zeros((sets, n, driven)), np.zeros((sets, m, n)), np.zeros((sets, m, driven))
    )
    x, rates, reading = np.array(start, dtype=np.float64), np.empty(n), np.empty(m)
    B, D = np.zeros((n, count)), np.zeros((m, count))
    for v, p in enumerate(np.ascontiguousarray(parameters, dtype=np.float64)):
        A, G, C, E = (matrix[v] for matrix in found)
        for _ in range(MAX_NEWTON_STEPS):
            A[:], G[:] = 0.0, 0.0
            compiled.rates_jacobian(x, inputs, p, loads, rates, A, B, G)
            if not (np.isfinite(A).all() and np.isfinite(rates).all()):
                raise _no_working_point(compiled.name)
            step = np.linalg.lstsq(A, -rates, rcond=None)[0] if rates.any() else np.zeros(n)
            if np.abs(step).max(initial=0.0) <= MAX_RELATIVE_STEP * (1e-3 + np.abs(x).max(initial=0.0)):
                break
            x = x + step
        else:
            raise _no_working_point(compiled.name)
        compiled.reading_jacobian(x, inputs, p, loads, reading, C, D, E)
    return found


def low_rank(derivatives: Array) -> LowRankSlopes:
    """Derivatives (n_θ, n + m, n + w) as sums of products."""
    left, right, owner = [], [], []
    for which, matrix in enumerate(derivatives):
        rows = np.abs(matrix).max(axis=1, keepdims=True)
        scale = np.where(rows > 0.0, rows, 1.0)  # readings and rates have units of their own
        U, values, V = np.linalg.svd(matrix / scale, full_matrices=False)
        for j in range(int(np.sum(values > MIN_SINGULAR_VALUE * max(values.max(initial=0.0), 1e-300)))):
            left.append(scale[:, 0] * U[:, j] * values[j])
            right.append(V[j])
            owner.append(which)
    shape = derivatives.shape
    if not left:
        return LowRankSlopes(np.zeros((shape[1], 0)), np.zeros((shape[2], 0)), np.zeros(0, dtype=np.intp))
    return LowRankSlopes(np.column_stack(left), np.column_stack(right), np.array(owner, dtype=np.intp))


def resolve(system: LinearSystem, s: Complex) -> tuple[Complex, Complex, Complex]:
    """C X (K, m, n), X G (K, n, w) and T (K, m, w) of one system at s (K,).

    Raises
    ------
    LinAlgError
        Where a pole is at s, or the system is unstable: it has no stationary vibration.
    """
    A, G, C, E = (matrix[0] for matrix in system)
    poles, vectors = np.linalg.eig(A)
    if not is_stable(poles):
        raise np.linalg.LinAlgError("the system is unstable")
    if poles.size and np.linalg.cond(vectors) < MAX_CONDITION:
        back = np.linalg.inv(vectors)
        gain = 1.0 / (s[:, None] - poles)
        left = ((C @ vectors) * gain[:, None, :]) @ back
        right = vectors @ (gain[:, :, None] * (back @ G))
    else:
        X = np.linalg.inv(s[:, None, None] * np.eye(len(A)) - A)
        left, right = C @ X, X @ G
    return np.asarray(left), np.asarray(right), np.asarray(left @ G + E)


def is_stable(poles: Complex) -> bool:
    """True if all motions are stable."""
    return not poles.size or bool(poles.real.max() <= 1e-9 * np.abs(poles).max())


def _no_working_point(name: str) -> ConfigurationError:
    return ConfigurationError(
        f"model '{name}': expected a state at rest near the prior's mean to linearise about, found none: give `mean`"
    )
