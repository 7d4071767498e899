"""Checks by smoothed loads: amplitude dependence of stiffness or damping, and correlated loads.

Play, a spring that hardens and dry friction are forces on a degree of freedom that are no straight lines. A filter that
knows none of them takes them in as loads, and finds the stiffness and damping of this amplitude. Had the model a small
force κ f more, of known shape, the loads would be w + κ f, and what drives them e, about white, would move by κ d, d
being the steps of f from one sample to the next. The score of κ is their product, as expected from all readings:

    s = Σ e d,    t = Re Σ E*(f) D(f) / √(½ Σ |E(f)|² |D(f)|²),

E and D being the Fourier transforms of e and d, of the smoothed loads and of f along the smoothed motion. t is normal
with deviation 1, or less, where there is no such force: then E and D have no phase in common, and with phases at random
no tail of t is longer than the normal one's. In gusts loads and motion grow together: where s of parts of the record
scatters more than that, their scatter is the deviation. Of f, what goes with straight lines, the displacements and
velocities of all degrees of freedom, is taken out first: coefficients explain that. Motion is smoothed, since a force
of the kind shows where it turns round, and what happens a moment later tells when that was.

Shapes are tanh q/σ, q in its rms: what cubes of a Gaussian q leave looks nearly alike, and so does the sign of q, of
play, where a slow part of q is hidden from accelerometers; and the sign of q̇. Directions of one support are alike, and
so are blades: their t are judged one by one and as their sum over the root of their number.

In the same way two loads are held against each other, E against E: the score of a correlation that the model does not
have. Where blades turn, or one sensor measures two directions, what is not known of one load is shared with another,
and the score is none; so supports with a sensor for each direction are asked.

Source: Rao, Proc. Camb. Phil. Soc. 44, 1948, https://doi.org/10.1017/S0305004100023987 (score test); Masri &
Caughey, J. Appl. Mech. 46, 1979, https://doi.org/10.1115/1.3424568 (restoring forces from motion); Cappé, Moulines &
Rydén, Inference in Hidden Markov Models, 2005, section 10.1 (scores from smoothing, Fisher's identity).
"""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from statistics import NormalDist

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, MIN_NONLINEARITY_SAMPLES, MODEL_CHANGE_PROBABILITY
from windsysid.checks.nonlinearity import Bending, Law, standardised
from windsysid.filters import Info, smooth
from windsysid.identification.model.fit import check_finite
from windsysid.mechanics.model import Coordinate
from windsysid.results.smoothed_loads import CorrelatedLoads, SmoothedLoads
from windsysid.statespace.acting_loads import acting_loads
from windsysid.statespace.compose import StateSpace

__all__ = ["judge_smoothed_loads"]

TURN_Q_RMS, TURN_V_RMS = 1.0, 0.1
"""Setting: displacement and velocity, in their rms, about which a force turns round."""

CHUNK_SAMPLES = 4096
"""Setting: samples for which all H(ψ) are held at once."""

PARTS = 64
"""Setting: parts of a record over which a score scatters."""


def judge_smoothed_loads(
    model: StateSpace, inputs: Array, readings: Array, info: Info, *, freedoms: Sequence[Coordinate]
) -> SmoothedLoads | None:
    """Correlation of loads with the motion; None where it cannot be computed: of times that are unequal, of a record
    too short or at rest, and where no load is a state.

    Parameters
    ----------
    model, inputs, readings, info
        What was filtered (T, n_u + n_w), (T, m), and what came out; readings that were gated are left out.
    freedoms
        The n degrees of freedom; one whose load is no state is not asked.
    """
    names = acting_loads(model, inputs[:1])[0]
    asked = _testable(model, info, freedoms, names)
    if not asked:
        return None
    state = smooth(model, inputs, np.where(info.gated, np.nan, readings)).mean
    check_finite(state, state)
    n, tested = len(freedoms), [freedoms[j] for j in asked]
    driven = np.diff(_loads(model, inputs, state)[:, [names.index(one.load) for one in tested]], axis=0)
    scores = _scores(state[:, asked], state[:, [n + j for j in asked]], driven)
    bendings = [one for law, t in scores.items() for one in _bendings(law, t, tested)]
    apart = readings.shape[1] >= len(asked) and not any(one.blade for one in freedoms)
    largest = max(bendings, key=lambda one: abs(one.sigmas) / one.bound)
    return SmoothedLoads(largest, _most_correlated(tested, driven) if apart else None)


def _testable(model: StateSpace, info: Info, freedoms: Sequence[Coordinate], names: Sequence[str]) -> list[int]:
    """Numbers of the degrees of freedom that move and whose load is a state; none where times are unequal, or the
    record is too short."""
    if model.blocks.step.size > 1 or np.isfinite(info.whitened).any(axis=1).sum() < MIN_NONLINEARITY_SAMPLES:
        return []
    return [j for j, one in enumerate(freedoms) if one.load in names and np.any(info.mean[:, j])]


def _bendings(law: Law, t: Array, freedoms: Sequence[Coordinate]) -> Iterator[Bending]:
    """Scores t (n,) of a law of force for each of n degrees of freedom, and for those of the support and of the blades
    together."""
    groups = [[i] for i in range(len(freedoms))]
    groups += [[i for i, one in enumerate(freedoms) if bool(one.blade) is blade] for blade in (False, True)]
    for group in filter(None, groups):
        sigmas = float(t[group].sum()) / math.sqrt(len(group))
        bound = _bound(MODEL_CHANGE_PROBABILITY if len(group) == 1 else FALSE_ALARM_PROBABILITY)
        yield Bending(law, tuple(freedoms[i].name for i in group), sigmas, bound)


def _most_correlated(freedoms: Sequence[Coordinate], driven: Array) -> CorrelatedLoads | None:
    """The two loads of n degrees of freedom of strongest correlation, by their drives (T, n); None with fewer. Where
    sensors may be misaligned, the fit leaves a third of a correlation."""
    bound = _bound(FALSE_ALARM_PROBABILITY)
    pairs = [
        CorrelatedLoads((freedoms[i].load, freedoms[j].load), float(_score(driven[:, i], driven[:, j])), bound)
        for i, j in combinations(range(len(freedoms)), 2)
    ]
    return max(pairs, key=lambda one: abs(one.sigmas), default=None)


def _bound(chance: float) -> float:
    """Size of a standard normal value that chance exceeds with this probability, to either side."""
    return -NormalDist().inv_cdf(0.5 * chance)


def _loads(model: StateSpace, inputs: Array, state: Array) -> Array:
    """The loads that are states (T, n_w), of their states (T, n)."""
    nx, nz = model.blocks.sizes[:2]
    parts = [slice(first, first + CHUNK_SAMPLES) for first in range(0, len(inputs), CHUNK_SAMPLES)]
    return np.concatenate(
        [np.einsum("twz,tz->tw", acting_loads(model, inputs[at])[1], state[at, nx : nx + nz]) for at in parts]
    )


def _scores(q: Array, v: Array, driven: Array) -> dict[Law, Array]:
    """Statistic t (n,) of each law of force, of smoothed displacements and velocities of n degrees of freedom (T, n)
    and of what drives their loads (T − 1, n). A load that goes with −q̇, as friction does, counts as positive."""
    q, v = standardised(q), standardised(v)
    lines = np.linalg.qr(np.diff(np.hstack([q, v]), axis=0))[0]
    forces: dict[Law, Array] = {"stiffness": np.tanh(q / TURN_Q_RMS), "damping": -np.tanh(v / TURN_V_RMS)}
    found: dict[Law, Array] = {}
    for law, force in forces.items():
        steps = np.diff(force, axis=0)
        steps -= lines @ (lines.T @ steps)
        found[law] = _score(driven, steps)
    return found


def _score(e: Array, d: Array) -> Array:
    """By how many standard deviations of chance two series (T, …) go together (…,)."""
    power = [np.abs(np.fft.rfft(one, axis=0)) ** 2 for one in (e, d)]
    parts = np.add.reduceat(e * d, np.linspace(0, len(e), PARTS, endpoint=False, dtype=np.intp), axis=0)
    stationary = np.sqrt(2.0 * np.sum(power[0] * power[1], axis=0)) / len(e)
    chance = np.maximum(stationary, math.sqrt(PARTS) * np.std(parts, axis=0, ddof=1))
    return np.asarray(parts.sum(axis=0) / np.maximum(chance, 1e-300))
