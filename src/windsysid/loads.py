"""Load models: stationary random processes that drive the mechanics, as linear blocks that `compose` puts together.

A block holds n states with

    dz = A z dt + noise,    cov(z) = P for all time,    w = H(ψ) z,
    H(ψ) = H₀ + Σ_k (C_k cos kψ + S_k sin kψ),

mean zero and mean-reverting. Several blocks may drive the same degree of freedom, and one block may drive several: that is how loads on
blades and hub are correlated. Over a step h the block is discretised exactly, Φ = exp(A h) and Q = P − Φ P Φᵀ.

A block is a `Process`, a scalar random process with a rational spectrum, put somewhere: on one degree of freedom (`load_on`), on one blade and
through it on the hub (`blade_force`), or on the whole rotor as a harmonic nP whose amplitudes wander (`rotor_harmonic`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid.errors import ConfigurationError

__all__ = [
    "BladeForces",
    "GaussMarkov",
    "LoadBlock",
    "LoadModel",
    "PlacedProcess",
    "Process",
    "blade_force",
    "first_order",
    "load_on",
    "rational",
    "rotor_harmonic",
    "second_order",
]

Array = NDArray[np.float64]

BEYOND = 1.08
"""Cut-off of a second-order Butterworth filter over the frequency of the low-pass: samples at twice that have the spectrum of a process cut off there to within 5 % rms."""


class LoadModel(Protocol):
    """What `compose` needs of a load model."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of its n states."""

    @property
    def cov(self) -> Array:
        """Their stationary covariance (n, n)."""

    @property
    def outputs(self) -> Mapping[str, Array]:
        """For each load that it drives, the rows H₀, C₁, S₁, C₂ … of H(ψ) (1 + 2K, n) [N or N·m per unit of state]."""

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` seconds, exact."""


@dataclass(frozen=True)
class GaussMarkov:
    """A first-order Gauss–Markov load on one degree of freedom: mean zero, correlation exp(−|t| / time_constant).

    With a `harmonic` n, the line nP whose amplitude wanders: a cos nψ + b sin nψ, where a and b are two such processes.

    Attributes
    ----------
    load
        Name of the model's load.
    rms
        Stationary standard deviation [N or N·m].
    time_constant
        [s].
    harmonic
        n; 0: the process itself.
    low_pass
        [Hz]; where the record went through an anti-aliasing low-pass, what it knows of the process did too: a Butterworth filter at `BEYOND` times that frequency.
        Without it the samples of the process hold power from above half the rate which those of the record do not, and a mode's damping pays for it.
    """

    load: str
    rms: float
    time_constant: float
    harmonic: int = 0
    low_pass: float = math.inf

    def __post_init__(self) -> None:
        if not (self.rms > 0.0 and self.time_constant > 0.0 and np.isfinite(self.rms * self.time_constant)):
            raise ConfigurationError(
                f"load '{self.load}': expected a positive rms and time constant, got {self.rms} and {self.time_constant}"
            )

    @property
    def states(self) -> tuple[str, ...]:
        """The load is its own state; a harmonic has two, a and b."""
        line = f"{self.load}_{self.harmonic}P"
        if self.harmonic:
            return (f"{line}_cosine", f"{line}_sine")
        return (
            (self.load,)
            if math.isinf(self.low_pass)
            else tuple(f"{self.load}{end}" for end in ("", "_rate", "_acceleration"))
        )

    @property
    def _passed(self) -> "Process | None":
        """The process behind the low-pass, where there is one."""
        if self.harmonic or math.isinf(self.low_pass):
            return None
        pole = 2.0 * math.pi * BEYOND * self.low_pass * complex(-math.sqrt(0.5), math.sqrt(0.5))
        return rational(self.rms, [-1.0 / self.time_constant, pole, pole.conjugate()])

    @property
    def cov(self) -> Array:
        """Stationary covariance (n, n)."""
        passed = self._passed
        return self.rms**2 * np.eye(len(self.states)) if passed is None else passed.cov

    @property
    def outputs(self) -> Mapping[str, Array]:
        """It drives its own degree of freedom."""
        if passed := self._passed:
            return {self.load: passed.value[None]}
        if not self.harmonic:
            return {self.load: np.ones((1, 1))}
        rows = np.zeros((1 + 2 * self.harmonic, 2))
        rows[-2:] = np.eye(2)
        return {self.load: rows}

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` seconds, exact."""
        if passed := self._passed:
            return _discretised(passed.drift, passed.cov, step)
        variance = self.rms**2 * -np.expm1(-2.0 * step / self.time_constant)
        one = np.eye(len(self.states))
        return np.exp(-step / self.time_constant) * one, variance * one


@dataclass(frozen=True, eq=False)
class LoadBlock:
    """Any stationary linear block.

    Attributes
    ----------
    states
        Names of its n states, its own among those of all blocks.
    drift
        A (n, n) [1/s], all eigenvalues in the left half plane.
    cov
        Stationary covariance P (n, n).
    outputs
        See `LoadModel`.
    """

    states: tuple[str, ...]
    drift: Array
    cov: Array
    outputs: Mapping[str, Array]

    def __post_init__(self) -> None:
        n, what = len(self.states), "/".join(self.states)
        for word, array in (("drift", self.drift), ("covariance", self.cov)):
            if np.shape(array) != (n, n) or not np.isfinite(array).all():
                raise ConfigurationError(f"load '{what}': expected a finite {word} {n} × {n}, got {np.shape(array)}")
        for load, rows in self.outputs.items():
            shape = np.shape(rows)
            if len(shape) != 2 or shape[1] != n or shape[0] % 2 == 0 or not np.isfinite(rows).all():
                raise ConfigurationError(
                    f"load '{what}' on '{load}': expected finite rows H₀, C₁, S₁ … of {n} numbers, got shape {shape}"
                )
        poles = self._poles
        if poles.size and poles.real.max() >= 0.0:
            raise ConfigurationError(f"load '{what}': expected a block that returns to its mean, got poles {poles}")

    @cached_property
    def _poles(self) -> NDArray[np.complex128]:
        return np.asarray(np.linalg.eigvals(self.drift), dtype=np.complex128)

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` seconds, exact."""
        return _discretised(np.asarray(self.drift, dtype=np.float64), self.cov, step)


class Process(NamedTuple):
    """A scalar stationary process v = c z, dz = A z dt + noise.

    Attributes
    ----------
    drift, cov
        A and the stationary covariance of z (n, n).
    value
        c (n,).
    """

    drift: Array
    cov: Array
    value: Array

    @property
    def variance(self) -> float:
        """Of v."""
        return float(self.value @ self.cov @ self.value)

    def times(self, factor: float) -> "Process":
        """The process times a factor."""
        return self._replace(cov=factor**2 * self.cov)

    def spectrum(self, frequency: ArrayLike) -> Array:
        """Two-sided power spectral density at frequencies [Hz]: its integral from −∞ to ∞ is the variance."""
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency, dtype=np.float64))
        resolvent = np.linalg.solve(s[:, None, None] * np.eye(len(self.value)) - self.drift, self.cov @ self.value)
        return np.asarray(2.0 * (resolvent @ self.value).real)


def first_order(rms: float, time_constant: float) -> Process:
    """Correlation rms² exp(−|t| / time_constant)."""
    return rational(rms, [-1.0 / time_constant])


def second_order(rms: float, frequency: float, damping: float) -> Process:
    """White noise through a low-pass of second order with natural frequency [Hz] and damping ratio: S(f) ∝ 1 / |1 − (f/f₀)² + 2iζ f/f₀|²."""
    w = 2.0 * np.pi * frequency
    root = w * np.sqrt(complex(damping**2 - 1.0))
    return rational(rms, [-damping * w + root, -damping * w - root])


def rational(rms: float, poles: ArrayLike, zeros: ArrayLike = ()) -> Process:
    """A process with S(ω) ∝ Π|iω − zero|² / Π|iω − pole|².

    Parameters
    ----------
    rms
        Its standard deviation.
    poles, zeros
        [rad/s], fewer zeros than poles, all poles in the left half plane, complex ones in pairs.

    Raises
    ------
    ConfigurationError
        If poles or zeros are not as they must be, or the rms is not positive.

    Notes
    -----
    Companion form in units of the poles' geometric mean frequency; P from Lyapunov's equation.
    """
    poles, zeros = np.atleast_1d(np.asarray(poles, dtype=np.complex128)), np.asarray(zeros, dtype=np.complex128)
    paired = all(
        abs(np.poly(roots).imag).max() <= 1e-9 * abs(np.poly(roots)).max() for roots in (poles, zeros) if roots.size
    )
    finite = bool(np.isfinite([*poles, *zeros, rms]).all())
    if not (finite and paired and len(zeros) < len(poles) and (poles.real < 0.0).all() and rms > 0.0):
        raise ConfigurationError(
            "rational spectrum: expected a positive rms, poles in the left half plane, fewer zeros than poles, and complex ones in pairs, got "
            f"rms {rms}, poles {poles} and zeros {zeros}"
        )
    n, unit = len(poles), float(np.exp(np.mean(np.log(np.abs(poles)))))
    denominator = np.poly(poles / unit).real
    drift = unit * np.eye(n, k=1)
    drift[-1] = -unit * denominator[:0:-1]
    cov = np.diag(denominator[-1] ** np.arange(n)) if n <= 2 else _stationary(drift)
    value = np.zeros(n)
    value[: len(zeros) + 1] = np.atleast_1d(np.poly(zeros / unit)).real[::-1]
    process = Process(drift, cov, value)
    return process.times(rms / math.sqrt(process.variance))


@dataclass(frozen=True)
class PlacedProcess:
    """Independent copies of a process, and what they drive.

    Attributes
    ----------
    states
        Names of its states, those of one copy after those of another.
    process
        The process.
    rows
        For each copy, the rows H₀, C₁, S₁ … (1 + 2K,) of what its value drives.
    """

    states: tuple[str, ...]
    process: Process
    rows: Sequence[Mapping[str, Array]]

    @property
    def cov(self) -> Array:
        """Stationary covariance (n, n)."""
        return self._copied(self.process.cov)

    @property
    def outputs(self) -> Mapping[str, Array]:
        """See `LoadModel`."""
        n, found = len(self.process.value), {}
        for load in dict.fromkeys(load for rows in self.rows for load in rows):
            found[load] = np.zeros((max(len(rows.get(load, ())) for rows in self.rows), len(self.states)))
            for k, rows in enumerate(self.rows):
                if load in rows:
                    found[load][: len(rows[load]), k * n : (k + 1) * n] = rows[load][:, None] * self.process.value
        return found

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` seconds, exact."""
        transition, noise = _discretised(self.process.drift, self.process.cov, step)
        return self._copied(transition), self._copied(noise)

    def _copied(self, matrix: Array) -> Array:
        n = len(matrix)
        whole = np.zeros((len(self.states),) * 2)
        for k in range(len(self.rows)):
            whole[k * n : (k + 1) * n, k * n : (k + 1) * n] = matrix
        return whole


@dataclass(frozen=True)
class BladeForces:
    """How forces in the plane of the rotor, one on each blade, push its degrees of freedom.

    A moment F_i about the blade's link is a force F_i / lever along the tangent t_i = (−sin ψ_i, cos ψ_i), with the rotation. It pushes the lag angle with F_i,
    the hub with F_i / lever, and a roll with F_i (1 + hinge_offset / lever).

    Attributes
    ----------
    loads
        Names of the loads that are driven: ``load_x``, ``load_y``, ``load_roll``, ``load_beta_1`` …
    blades
        N.
    hinge_offset
        d [m].
    kappa
        Where x leans the rotor, r = κ x [rad/m]; 0 elsewhere.
    """

    loads: tuple[str, ...]
    blades: int = 3
    hinge_offset: float = 0.0
    kappa: float = 0.0

    def harmonic(self, n: int, lever: float, *, sine: bool = False, moments: bool = True) -> dict[str, Array]:
        """What F_i = cos nψ_i, or sin nψ_i, drives: rows H₀, C₁, S₁ … of each load."""
        return _at_lever(_harmonic(self, n, sine), lever, self.hinge_offset, moments=moments)

    def single(self, blade: int, lever: float) -> dict[str, Array]:
        """What F = 1 on one blade, counted from 1, drives."""
        return _at_lever(_single(self, blade), lever, self.hinge_offset, moments=True)


def load_on(load: str, process: Process) -> PlacedProcess:
    """A process on one degree of freedom."""
    return _placed(load, process, [{load: np.ones(1)}])


def blade_force(process: Process, blade: int, to: BladeForces, lever: float, name: str) -> PlacedProcess:
    """A process in the frame of one blade, its moment about the link [N·m], with what it does to the hub."""
    return _placed(name, process, [to.single(blade, lever)])


def rotor_harmonic(
    process: Process, n: int, to: BladeForces, lever: float, name: str, *, moments: bool = True
) -> PlacedProcess:
    """Forces that turn with the rotor, F_i = a(t) cos nψ_i + b(t) sin nψ_i, a and b two independent copies of a process.

    This is one term of the series in azimuth of any load that is homogeneous over the disc: its terms are uncorrelated, and slow in the fixed frame,
    where the blades cut through them n times a turn (Sørensen, Hansen & Rosas 2002, https://doi.org/10.1016/S0167-6105(02)00260-X). A blade feels nP,
    the hub the two neighbours (n ± 1)P as far as they are multiples of N.

    Parameters
    ----------
    n
        0 or more; for 0 there is no b.
    moments
        Whether the forces have moments about the links; without, they push the hub alone.
    """
    phases = (False, True) if n else (False,)
    return _placed(name, process, [to.harmonic(n, lever, sine=sine, moments=moments) for sine in phases])


def _placed(name: str, process: Process, rows: Sequence[Mapping[str, Array]]) -> PlacedProcess:
    """Copies of a process under a name."""
    order = ("",) if len(process.value) == 1 else tuple(f"_{k}" for k in range(len(process.value)))
    phases = ("", "_sine")[: len(rows)]
    return PlacedProcess(tuple(f"{name}{phase}{k}" for phase in phases for k in order), process, rows)


def _discretised(drift: Array, cov: Array, step: float) -> tuple[Array, Array]:
    """exp(A h) and P − exp(A h) P exp(A h)ᵀ."""
    transition = _exponential(drift * step)
    noise = cov - transition @ cov @ transition.T
    return transition, 0.5 * (noise + noise.T)


def _exponential(A: Array) -> Array:
    """exp(A); for two states by Cayley and Hamilton, exp(A) = e^μ (cosh δ I + sinh δ/δ (A − μ I)), μ = tr A/2, δ² = μ² − det A."""
    if len(A) > 2:
        from scipy.linalg import expm

        return np.asarray(expm(A))
    if len(A) == 1:
        return np.asarray(np.exp(A), dtype=np.float64)
    mean = 0.5 * (A[0, 0] + A[1, 1])
    root = np.sqrt(complex(mean**2 - A[0, 0] * A[1, 1] + A[0, 1] * A[1, 0]))
    slope = np.sinh(root) / root if abs(root) > 1e-8 else 1.0 + 0.0j
    even = np.exp(mean) * (np.cosh(root).real * np.eye(2) + slope.real * (A - mean * np.eye(2)))
    return np.asarray(even, dtype=np.float64)


def _stationary(drift: Array) -> Array:
    """P of white noise that enters the last state."""
    from scipy.linalg import solve_continuous_lyapunov

    noise = np.zeros_like(drift)
    noise[-1, -1] = 1.0
    cov = np.asarray(solve_continuous_lyapunov(drift, -noise), dtype=np.float64)
    return np.asarray(0.5 * (cov + cov.T), dtype=np.float64)


class _Pushed(NamedTuple):
    """What unit moments drive on the blades, and what forces of unit moment and unit lever drive elsewhere: rows of each load."""

    by_moment: Mapping[str, Array]
    by_force: Mapping[str, Array]
    by_offset: Mapping[str, Array]


@lru_cache(maxsize=256)
def _harmonic(to: BladeForces, n: int, sine: bool) -> _Pushed:
    turns = np.exp(2j * np.pi * n * np.arange(to.blades) / to.blades)
    return _pushed(to, [{n: (-1j if sine else 1.0) * turn} for turn in turns])


@lru_cache(maxsize=256)
def _single(to: BladeForces, blade: int) -> _Pushed:
    return _pushed(to, [{0: 1.0 + 0j} if i == blade else {} for i in range(1, to.blades + 1)])


def _pushed(to: BladeForces, forces: Sequence[Mapping[int, complex]]) -> _Pushed:
    """What forces F_i(ψ) = Re Σ_n f_n e^{inψ} drive, f given for each blade."""
    found: list[dict[str, dict[int, complex]]] = [{name: {} for name in to.loads} for _ in _Pushed._fields]

    def push(kind: int, name: str, n: int, amount: complex) -> None:
        if name in found[kind]:
            n, amount = (n, amount) if n >= 0 else (-n, amount.conjugate())
            found[kind][name][n] = found[kind][name].get(n, 0.0) + amount

    for i, force in enumerate(forces):
        turn = np.exp(2j * np.pi * i / to.blades)
        for n, amount in force.items():
            push(0, f"load_beta_{i + 1}", n, amount)
            for name, share in (("load_roll", 1.0), ("load_x", to.kappa)):
                push(2, name, n, share * amount)
            for side, towards in (
                (1, turn),
                (-1, turn.conjugate()),
            ):  # −sin ψ_i = Re(i e^{iψ_i}), cos ψ_i = Re(e^{iψ_i})
                push(1, "load_x", n + side, 0.5j * side * towards * amount)
                push(1, "load_y", n + side, 0.5 * towards * amount)
    highest = max(n for kind in found for series in kind.values() for n in series)
    rows = ({name: _rows(series, highest) for name, series in kind.items()} for kind in found)
    return _Pushed(*({name: row for name, row in kind.items() if row.any()} for kind in rows))


def _at_lever(pushed: _Pushed, lever: float, hinge_offset: float, *, moments: bool) -> dict[str, Array]:
    """Rows of every load that moments with this lever drive."""
    total: dict[str, Array] = {}
    for kind, factor in zip(pushed, (float(moments), 1.0 / lever, 1.0 + hinge_offset / lever), strict=True):
        for name, rows in kind.items():
            if factor != 0.0:
                total[name] = factor * rows + total.get(name, 0.0)
    return total


def _rows(series: Mapping[int, complex], highest: int) -> Array:
    """H₀, C₁, S₁ … of Re Σ_n c_n e^{inψ}, n ≥ 0, without what is left of terms that cancel between the blades."""
    rows = np.zeros(1 + 2 * highest)
    for n, c in series.items():
        if abs(c) > 1e-12:
            rows[max(2 * n - 1, 0)] = c.real
            if n > 0:
                rows[2 * n] = -c.imag
    return rows
