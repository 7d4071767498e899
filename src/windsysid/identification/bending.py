"""Forces that a linear model does not have: whether a support's stiffness or damping goes with amplitude.

Play, a spring that hardens and dry friction are forces on a degree of freedom that are no straight lines. Had the model
a small one of them, κ f with f = (q/σ)³ or the sign of q̇, innovations z would change by κ d, and

    t = Σ d z / √(Σ d²)

is normal with deviation 1 where there is none: the score test (Rao 1948) of κ, once what goes with straight lines, the
displacements and velocities of all degrees of freedom, is taken out of d. f is known a reading before, from what the
filter predicts.

The filter takes known loads. So d is what innovations lose when f is given to it as one. Filters are all but linear:
one more pass, with pulses that come to each degree of freedom in turn, tells by how much a pulse moves innovations
after each lag, h(lag) = h₀ + h₁ cos ψ + h₂ sin ψ. All d are sums of lagged forces, weighted by h. Directions of one
support are alike, and so are blades: their t are judged one by one and as their sum over the root of their number.

Source: Rao, Proc. Camb. Phil. Soc. 44, 1948, https://doi.org/10.1017/S0305004100023987.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.filters import EKF, Info
from windsysid.mechanics.model import Coordinate
from windsysid.results.load_history import Loads
from windsysid.results.straightness import Bending, Law
from windsysid.statespace.compose import StateSpace

__all__ = ["find_bending"]

LAGS = 12
"""Samples after which innovations have forgotten a pulse."""

PULSE = 0.3
"""Size of a pulse, in rms of the load that it is added to."""

SMOOTH = 0.1
"""Velocity, in its rms, about which friction changes its sign."""

SETTLING = 0.02
"""Share of a record at its beginning that is left out."""

FEWEST = 500
"""Samples with a reading below which nothing is said."""

MAX_SIGMAS, MAX_SIGMAS_ALIKE = 3.9, 3.4
"""Standard deviations of chance that count, of one degree of freedom and of those that are alike together. Of five, the
ten and the four that are looked at exceed them in one healthy record of 270."""


def find_bending(
    model: StateSpace, inputs: Array, readings: Array, info: Info, *, loads: Loads, freedoms: Sequence[Coordinate]
) -> Bending | None:
    """What shows most that stiffness or damping goes with amplitude; None where that cannot be asked: of times that are
    unequal, and of a record too short or at rest.

    Parameters
    ----------
    model, inputs, readings, info
        What was filtered (T, n_u + n_w), (T, m), and what came out.
    loads
        The loads that are states; a degree of freedom without one is not asked.
    freedoms
        The n degrees of freedom.
    """
    names = [one.load for one in freedoms]
    asked = [j for j, name in enumerate(names) if name in loads.names and np.any(info.mean[:, j])]
    if model.blocks.step.size > 1 or np.isfinite(info.whitened).any(axis=1).sum() < FEWEST or not asked:
        return None
    columns = [model.inputs.index(names[j]) for j in asked]
    rms = np.array([float(np.std(loads.mean[:, loads.names.index(names[j])])) for j in asked])
    n = len(freedoms)
    found: list[Bending] = []
    motion = info.mean[:, asked], info.mean[:, [n + j for j in asked]]
    for law, t in _scores(model, inputs, readings, info, columns=columns, rms=rms, motion=motion).items():
        groups = [[i] for i in range(len(asked))]
        groups += [[i for i, j in enumerate(asked) if bool(freedoms[j].blade) is blade] for blade in (False, True)]
        for group in groups:
            if group:
                sigmas = float(t[group].sum()) / math.sqrt(len(group))
                bound = MAX_SIGMAS if len(group) == 1 else MAX_SIGMAS_ALIKE
                found.append(Bending(law, tuple(freedoms[asked[i]].name for i in group), sigmas, bound))
    return max(found, key=lambda one: abs(one.sigmas) / one.bound)


def _scores(
    model: StateSpace, inputs: Array, readings: Array, info: Info, *, columns: Sequence[int], rms: Array,
    motion: tuple[Array, Array],
) -> dict[Law, Array]:  # fmt: skip
    """How many standard deviations t (n,) each law of force is from none, on n degrees of freedom whose known loads are
    `columns` of the inputs and whose loads have those rms (n,)."""
    n, samples = len(columns), len(readings)
    pulses = np.zeros((samples, n))
    for j in range(n):  # not always at a reading, where there are several steps to one
        pulses[j * LAGS :: n * LAGS + 1, j] = PULSE * max(rms[j], 1e-300)
    pushed = inputs.copy()
    pushed[:, columns] += pulses
    kept = np.where(info.gated, np.nan, readings)
    moved = EKF.run(model, EKF.init(model), pushed, kept)[1].whitened - info.whitened
    used = np.isfinite(moved) & np.isfinite(info.whitened)
    used[: max(math.ceil(SETTLING * samples), n * LAGS)] = False
    turn = _turn(model, inputs)
    response = _response(pulses, moved, turn, used)
    q, v = _expected(*motion, step=float(model.blocks.step[0]))

    def change(force: Array, j: int) -> Array:
        """By how much a force (T, n), on degree of freedom j alone, moves the innovations that are used."""
        return np.asarray((_lagged(force[:, j], turn) @ response[j])[used])

    basis = np.linalg.qr(np.column_stack([change(line, j) for line in (q, v) for j in range(n)]))[0]
    z = info.whitened[used]
    found: dict[Law, Array] = {}
    forces: dict[Law, Array] = {"stiffness": q**3, "damping": np.tanh(v / SMOOTH)}
    for law, force in forces.items():
        d = np.column_stack([change(force, j) for j in range(n)])
        d -= basis @ (basis.T @ d)
        found[law] = d.T @ z / (np.maximum(np.linalg.norm(d, axis=0), 1e-300) * max(float(np.std(z)), 1e-300))
    return found


def _turn(model: StateSpace, inputs: Array) -> Array:
    """1, cos ψ and sin ψ (T, 3), or 1 alone (T, 1) where nothing turns."""
    one = np.ones((len(inputs), 1))
    if "rotor_azimuth" not in model.compiled.inputs:
        return one
    psi = inputs[:, [model.compiled.inputs.index("rotor_azimuth")]]
    return np.hstack([one, np.cos(psi), np.sin(psi)])


def _lagged(force: Array, turn: Array) -> Array:
    """A force (T,) at lags 0 … L−1, times each column of `turn` (T, b): (T, L b)."""
    late = np.zeros((len(force), LAGS))
    for lag in range(LAGS):
        late[lag:, lag] = force[: len(force) - lag]
    return np.asarray((late[:, :, None] * turn[:, None, :]).reshape(len(force), -1))


def _response(pulses: Array, moved: Array, turn: Array, used: NDArray[np.bool_]) -> list[Array]:
    """Of pulses (T, n) and of what they moved (T, m), the response of each channel to each force, n times (L b, m)."""
    n, m = pulses.shape[1], moved.shape[1]
    found = [np.zeros((LAGS * turn.shape[1], m)) for _ in range(n)]
    for j in range(n):
        rows = _lagged(pulses[:, j], turn)
        felt = rows.any(axis=1)
        for c in range(m):
            own = felt & used[:, c]
            if own.any():
                found[j][:, c] = np.linalg.lstsq(rows[own], moved[own, c], rcond=1e-6)[0]
    return found


def _expected(q: Array, v: Array, *, step: float) -> tuple[Array, Array]:
    """Displacements and velocities (T, n) as they were expected a step before, about their means, of rms 1."""
    ahead = np.zeros((2, *q.shape))
    ahead[0, 1:] = q[:-1] + step * v[:-1]
    ahead[1, 2:] = 2.0 * v[1:-1] - v[:-2]
    ahead -= np.mean(ahead, axis=1, keepdims=True)
    ahead /= np.maximum(np.std(ahead, axis=1, keepdims=True), 1e-300)
    return ahead[0], ahead[1]
