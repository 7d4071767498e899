"""Constant clock lags of channels, estimated from mode shapes: phases grow in proportion to frequency.

A lightly damped mode has a real shape: its channels move in phase or in antiphase. A channel with the lag τ has the
phase −2π f τ in a mode of frequency f. With shapes φ_cj weighted by their standard deviations, u_cj = φ_cj / σ_cj, the
misfit of all shapes to real ones after removal of lags τ_c is

    Q(τ) = Σ_j ½ (Σ_c |u_cj|² − |Σ_c u_cj² exp(4πi f_j τ_c)|),

independently of the phase of each whole shape. The lags minimise Q. They are accepted if an F test rejects zero lag,
with the remaining complexity of the shapes as scatter, and if no other lag and no constant phase fits nearly as well.
Lags are relative: those of the largest group of channels that agree are zero.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import CONFLICT_SIGMAS, MODEL_CHANGE_PROBABILITY, OUTLIER_SIGMAS
from windsysid.spectral.modal_bands.limits import MAX_CLOSE_RATIO
from windsysid.spectral.oma import limits
from windsysid.spectral.oma.condition import Readings
from windsysid.spectral.oma.mode import DoubtKind, OperationalMode

__all__ = ["Lag", "aligned", "clock_lags", "lag_doubt", "lag_note"]

DOUBTS_WITHOUT_SHAPE: frozenset[DoubtKind] = frozenset({"scores"})
"""Kinds of doubts that do not concern the shape of a mode."""


class Lag(NamedTuple):
    """Lag of a channel's clock [s], negative if it leads, and its standard deviation [s]; other lags that fit nearly as
    well [s]; number of modes."""

    channel: int
    seconds: float
    std: float
    others: tuple[float, ...]
    modes: int


class _Shapes(NamedTuple):
    """Frequencies (r,) [Hz] of modes and their weighted shapes u (n, r)."""

    frequency: Array
    values: Complex

    def misfit(self, lags: Array) -> float:
        """Q of lags (n,) [s]."""
        along = np.abs(np.sum(self.values**2 * self._turned(lags[:, None]), axis=0))
        return float(0.5 * (np.sum(np.abs(self.values) ** 2) - along.sum()))

    def misfits(self, lags: Array, channel: int, tried: Array) -> Array:
        """Q (g,) for each of the lags (g,) of one channel, with fixed lags of the others."""
        square = self.values**2 * self._turned(lags[:, None])
        others = square.sum(axis=0) - square[channel]
        along = np.abs(others + self.values[channel] ** 2 * self._turned(tried[:, None]))
        return np.asarray(0.5 * (np.sum(np.abs(self.values) ** 2) - along.sum(axis=1)))

    def _turned(self, lags: Array) -> Complex:
        return np.asarray(np.exp(4j * np.pi * self.frequency * lags))

    @property
    def freedom(self) -> float:
        """Effective number of phases in the shapes, less one for each mode."""
        seen = np.abs(self.values) ** 2
        return float(np.sum(np.maximum(np.sum(seen / (1.0 + seen), axis=0) - 1.0, 0.0)))


def clock_lags(modes: Sequence[OperationalMode], readings: Readings) -> list[Lag]:
    """Estimate the clock lags of the channels of one record from the shapes of its modes."""
    channels = [i for i, sensor in enumerate(readings.sensors) if sensor is not None]
    used = [mode for mode in modes if {doubt.kind for doubt in mode.grounds} <= DOUBTS_WITHOUT_SHAPE]
    if len(channels) < 2 or not used:
        return []
    shapes = _weighted_shapes(used, channels)
    if shapes.frequency.max() < MAX_CLOSE_RATIO * shapes.frequency.min():
        return []
    return [lag._replace(channel=channels[lag.channel]) for lag in _tested_lags(shapes)]


def _weighted_shapes(modes: Sequence[OperationalMode], channels: Sequence[int]) -> _Shapes:
    """Shapes of modes in some channels, over their standard deviations."""
    shape = np.array([mode.shape[channels] for mode in modes]).T
    std = np.array([mode.shape_std[channels] for mode in modes]).T
    sigma = np.hypot(np.maximum(std, 1e-6), limits.SHAPE_PHASE_STD * np.abs(shape))
    return _Shapes(np.array([mode.frequency.estimate for mode in modes]), shape / sigma)


def aligned(readings: Readings, lags: Sequence[Lag]) -> Readings:
    """Remove the lags from the readings, which become a few samples shorter."""
    fixed = readings.fixed.copy()
    frequency = np.fft.rfftfreq(len(fixed), 1.0 / readings.rate)
    for lag in lags:
        moved = np.fft.rfft(fixed[:, lag.channel]) * np.exp(2j * np.pi * frequency * lag.seconds)
        fixed[:, lag.channel] = np.fft.irfft(moved, len(fixed))
    cut = 1 + int(np.ceil(max(abs(lag.seconds) for lag in lags) * readings.rate))
    inner = slice(cut, len(fixed) - cut)
    notes = (*readings.notes, *(lag_note(readings.names[lag.channel], lag) for lag in lags))
    return readings._replace(fixed=fixed[inner], turning=readings.turning[inner], notes=notes)


def lag_note(name: str, lag: Lag) -> str:
    """Note on a lag that was removed."""
    way = "late" if lag.seconds > 0.0 else "early"
    return (
        f"{name} was {abs(lag.seconds):.4g} s {way} (± {2.0 * lag.std:.2g} s): its phases grow with frequency over "
        f"{lag.modes} modes; it was aligned with the others"
    )


def lag_doubt(name: str, lag: Lag) -> str:
    """Doubt about a record with an ambiguous lag, which was not removed."""
    others = ", ".join(f"{seconds:+.4g}" for seconds in (lag.seconds, *lag.others)[:3])
    return f"{name} is not synchronous with the other channels: lags of {others} s fit equally well; check its clock"


def _tested_lags(shapes: _Shapes) -> list[Lag]:
    """Estimate lags, and test them by an F test together and one by one."""
    count = len(shapes.values)
    lags = _fitted(shapes, np.zeros(count), range(1, count) if count > 1 else ())
    together = _largest_group(shapes, lags)
    late = np.flatnonzero(~together).tolist()
    if not late:
        return []
    lags = _fitted(shapes, np.where(together, 0.0, lags - float(np.mean(lags[together]))), late)
    least = shapes.misfit(lags)
    freedom = limits.SHAPE_PHASE_FREEDOM + shapes.freedom - len(late)
    if freedom < limits.SHAPE_PHASE_FREEDOM:
        return []
    scatter = max(1.0, (limits.SHAPE_PHASE_FREEDOM + least) / freedom)
    found = []
    for channel in late:
        without = shapes.misfit(np.where(np.arange(count) == channel, 0.0, lags))
        if _chance((without - least) / scatter, freedom) < MODEL_CHANGE_PROBABILITY / count:
            if _constant_phase(shapes, lags, channel) - least < OUTLIER_SIGMAS**2 * scatter:
                return []
            others = _other_lags(shapes, lags, channel, least + OUTLIER_SIGMAS**2 * scatter)
            std = np.sqrt(scatter) * _std(shapes, lags, channel)
            found.append(Lag(channel, float(lags[channel]), std, others, len(shapes.frequency)))
    return found if len(found) == len(late) else []


def _chance(square: float, freedom: float) -> float:
    """Probability of a square of Student's t above the given one."""
    from scipy.special import fdtrc

    return float(fdtrc(1.0, freedom, max(square, 0.0)))


def _fitted(shapes: _Shapes, lags: Array, free: Sequence[int]) -> Array:
    """Minimise Q over the lags (n,) of the channels `free`, by coordinate descent."""
    highest = float(shapes.frequency.max())
    lags = lags.copy()
    reach = limits.MAX_LAG_PERIODS / highest
    grid = np.linspace(-reach, reach, 2 * round(limits.MAX_LAG_PERIODS * limits.LAGS_PER_PERIOD) + 1)
    for sweep in range(limits.LAG_SWEEPS):
        fine = 0.5 ** max(0, sweep - limits.LAG_SWEEPS // 2)
        for channel in free:
            tried = (
                grid
                if sweep < limits.LAG_SWEEPS // 2
                else lags[channel] + fine * np.linspace(-1.0, 1.0, 9) * (grid[1] - grid[0])
            )
            lags[channel] = tried[int(np.argmin(shapes.misfits(lags, channel, tried)))]
    return lags


def _std(shapes: _Shapes, lags: Array, channel: int) -> float:
    """Standard deviation of one lag [s], from the curvature of Q."""
    step = 1e-3 / float(shapes.frequency.max())
    below, here, above = shapes.misfits(lags, channel, lags[channel] + step * np.array([-1.0, 0.0, 1.0]))
    return float(step / np.sqrt(max(0.5 * (below - 2.0 * here + above), 1e-12)))


def _largest_group(shapes: _Shapes, lags: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the largest group of channels with equal lags."""
    std = np.array([_std(shapes, lags, channel) for channel in range(len(lags))])
    together = np.abs(lags[:, None] - lags) <= CONFLICT_SIGMAS * np.hypot(std[:, None], std)
    return np.asarray(together[int(np.argmax(together.sum(axis=1)))])


def _constant_phase(shapes: _Shapes, lags: Array, channel: int) -> float:
    """Smallest Q if one channel has a constant phase instead of a lag, as from a filter or a wrong kind of sensor."""
    square = shapes.values**2 * np.exp(4j * np.pi * shapes.frequency * lags[:, None])
    others = square.sum(axis=0) - square[channel]
    phases = np.exp(2j * np.linspace(0.0, np.pi, 181))[:, None]
    along = np.abs(others + shapes.values[channel] ** 2 * phases).sum(axis=1)
    return float(0.5 * (np.sum(np.abs(shapes.values) ** 2) - along.max()))


def _other_lags(shapes: _Shapes, lags: Array, channel: int, bound: float) -> tuple[float, ...]:
    """Other lags of one channel with Q below a bound [s], the smallest Q first."""
    reach = limits.MAX_SEARCHED_PERIODS / float(shapes.frequency.max())
    tried = np.linspace(-reach, reach, 2 * round(limits.MAX_SEARCHED_PERIODS * limits.LAGS_PER_PERIOD) + 1)
    q = shapes.misfits(lags, channel, tried)
    inner = np.arange(1, len(q) - 1)
    minima = inner[(q[inner] <= q[inner - 1]) & (q[inner] < q[inner + 1]) & (q[inner] < bound)]
    apart = minima[np.abs(tried[minima] - lags[channel]) > 2.0 * (tried[1] - tried[0])]
    return tuple(tried[apart[np.argsort(q[apart])]].tolist())
