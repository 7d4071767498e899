"""Channels whose clock is late by a constant: their phases in mode shapes grow in proportion to frequency.

A lightly damped mode has a real shape: its channels move in phase or against it. A channel that is late by τ has
the phase −2π f τ in a mode of frequency f. With shapes φ_cj, weighted by their standard deviations,
u_cj = φ_cj / σ_cj, how far all shapes are from real ones after lags τ_c are taken out is

    Q(τ) = Σ_j ½ (Σ_c |u_cj|² − |Σ_c u_cj² exp(4πi f_j τ_c)|),

whatever the phase of each whole shape. Lags are where Q is least. They count if an F test says so, for shapes that
stay as complex as they are found, if no other lag is nearly as good, and if no constant phase is. Lags are relative:
the largest group of channels that agree is on time.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.spectral.oma_data import Readings
from windsysid.spectral.operational import DoubtKind, OperationalMode

__all__ = ["Lag", "clock_lags", "lag_doubt", "lag_note", "on_time"]

USUAL_COMPLEXITY = 0.03
"""Phase that shapes of real structures have [rad]: a standard deviation, added to their uncertainty."""

PRIOR_FREEDOM = 2.0
"""Degrees of freedom with which that is known."""

FALSE_ALARM = 1e-4
"""Probability of the F test below which a channel is late, over all channels of a record."""

CLEARLY = 25.0
"""Of Q, in units of its scatter, by which other lags and a constant phase have to be worse: 5 σ."""

MIN_MODES = 2

OF_NO_SHAPE: tuple[DoubtKind, ...] = ("channels", "halves", "neighbour")
"""Doubts that do not touch a mode's shape."""

MIN_FREQUENCY_RATIO = 1.5
"""Of the highest to the lowest mode: between nearer ones a lag and a constant phase are alike."""

MAX_PERIODS, SEARCHED_PERIODS = 0.5, 2.0
"""Largest lag that is put right, and that is tried, in periods of the highest mode."""

STEPS = 80
"""Lags that are tried in a period of the highest mode."""

SWEEPS = 20

TOGETHER_SIGMAS = 4.0
"""Standard deviations by which channels of one clock may differ in lag."""


class Lag(NamedTuple):
    """A channel's clock: how late it is, negative where early, with its standard deviation [s]; other lags that are
    nearly as likely [s]; how many modes tell."""

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
        """Q (g,) for each lag (g,) that is tried for one channel, the others' being as they are."""
        square = self.values**2 * self._turned(lags[:, None])
        others = square.sum(axis=0) - square[channel]
        along = np.abs(others + self.values[channel] ** 2 * self._turned(tried[:, None]))
        return np.asarray(0.5 * (np.sum(np.abs(self.values) ** 2) - along.sum(axis=1)))

    def _turned(self, lags: Array) -> Complex:
        return np.asarray(np.exp(4j * np.pi * self.frequency * lags))

    @property
    def freedom(self) -> float:
        """How many phases the shapes tell beside one for each mode."""
        seen = np.abs(self.values) ** 2
        return float(np.sum(np.maximum(np.sum(seen / (1.0 + seen), axis=0) - 1.0, 0.0)))


def clock_lags(modes: Sequence[OperationalMode], readings: Readings) -> list[Lag]:
    """The channels of one record that are late or early, from the shapes of its modes."""
    channels = [i for i, sensor in enumerate(readings.sensors) if sensor is not None]
    used = [mode for mode in modes if all(doubt.kind in OF_NO_SHAPE for doubt in mode.grounds)]
    frequency = np.array([mode.frequency for mode in used])
    if len(channels) < 2 or len(used) < MIN_MODES or frequency.max() < MIN_FREQUENCY_RATIO * frequency.min():
        return []
    shape = np.array([mode.shape[channels] for mode in used]).T
    std = np.array([mode.shape_std[channels] for mode in used]).T
    sigma = np.hypot(np.maximum(std, 1e-6), USUAL_COMPLEXITY * np.abs(shape))
    shapes = _Shapes(frequency, shape / sigma)
    return [lag._replace(channel=channels[lag.channel]) for lag in _late(shapes)]


def on_time(readings: Readings, lags: Sequence[Lag]) -> Readings:
    """The readings with late channels moved to their time, a few samples shorter."""
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
    """What was done about a lag."""
    way = "late" if lag.seconds > 0.0 else "early"
    return (
        f"{name} was {abs(lag.seconds):.4g} s {way} (± {2.0 * lag.std:.2g} s): its phases grow with frequency over "
        f"{lag.modes} modes; it was moved by that"
    )


def lag_doubt(name: str, lag: Lag) -> str:
    """Why a lag was not put right."""
    others = ", ".join(f"{seconds:+.4g}" for seconds in (lag.seconds, *lag.others)[:3])
    return f"{name} is not on time with the others, by {others} s: its modes cannot tell by which; check its clock"


def _late(shapes: _Shapes) -> list[Lag]:
    """The channels that are late, by an F test together and alone."""
    count = len(shapes.values)
    lags = _fitted(shapes, np.zeros(count), range(1, count) if count > 1 else ())
    late = _not_in_step(shapes, lags)
    if not late:
        return []
    lags = _fitted(shapes, np.where(np.isin(np.arange(count), late), lags - _common(shapes, lags), 0.0), late)
    least = shapes.misfit(lags)
    freedom = PRIOR_FREEDOM + shapes.freedom - len(late)
    if freedom < PRIOR_FREEDOM:
        return []
    scatter = max(1.0, (PRIOR_FREEDOM + least) / freedom)
    found = []
    for channel in late:
        without = shapes.misfit(np.where(np.arange(count) == channel, 0.0, lags))
        if _chance((without - least) / scatter, freedom) < FALSE_ALARM / count:
            if _constant_phase(shapes, lags, channel) - least < CLEARLY * scatter:
                return []
            others = _others(shapes, lags, channel, least + CLEARLY * scatter)
            std = np.sqrt(scatter) * _std(shapes, lags, channel)
            found.append(Lag(channel, float(lags[channel]), std, others, len(shapes.frequency)))
    return found if len(found) == len(late) else []


def _chance(square: float, freedom: float) -> float:
    """Of so large a square of Student's t."""
    from scipy.special import fdtrc

    return float(fdtrc(1.0, freedom, max(square, 0.0)))


def _fitted(shapes: _Shapes, lags: Array, free: Sequence[int]) -> Array:
    """Lags (n,) where Q is least in some channels, one after the other."""
    highest = float(shapes.frequency.max())
    lags = lags.copy()
    reach = MAX_PERIODS / highest
    grid = np.linspace(-reach, reach, 2 * round(MAX_PERIODS * STEPS) + 1)
    for sweep in range(SWEEPS):
        fine = 0.5 ** max(0, sweep - SWEEPS // 2)
        for channel in free:
            tried = (
                grid if sweep < SWEEPS // 2 else lags[channel] + fine * np.linspace(-1.0, 1.0, 9) * (grid[1] - grid[0])
            )
            lags[channel] = tried[int(np.argmin(shapes.misfits(lags, channel, tried)))]
    return lags


def _std(shapes: _Shapes, lags: Array, channel: int) -> float:
    """Standard deviation of one lag [s], from the curvature of Q."""
    step = 1e-3 / float(shapes.frequency.max())
    below, here, above = shapes.misfits(lags, channel, lags[channel] + step * np.array([-1.0, 0.0, 1.0]))
    return float(step / np.sqrt(max(0.5 * (below - 2.0 * here + above), 1e-12)))


def _groups(shapes: _Shapes, lags: Array) -> NDArray[np.bool_]:
    """Which channels (n, n) agree in lag."""
    std = np.array([_std(shapes, lags, channel) for channel in range(len(lags))])
    return np.asarray(np.abs(lags[:, None] - lags) <= TOGETHER_SIGMAS * np.hypot(std[:, None], std))


def _common(shapes: _Shapes, lags: Array) -> float:
    """The lag of the largest group of channels that agree."""
    together = _groups(shapes, lags)
    return float(np.mean(lags[together[int(np.argmax(together.sum(axis=1)))]]))


def _not_in_step(shapes: _Shapes, lags: Array) -> list[int]:
    """The channels outside the largest group."""
    together = _groups(shapes, lags)
    return np.flatnonzero(~together[int(np.argmax(together.sum(axis=1)))]).tolist()


def _constant_phase(shapes: _Shapes, lags: Array, channel: int) -> float:
    """Least Q if one channel has a constant phase and no lag, as a filter or a wrong kind of sensor gives it."""
    square = shapes.values**2 * np.exp(4j * np.pi * shapes.frequency * lags[:, None])
    others = square.sum(axis=0) - square[channel]
    phases = np.exp(2j * np.linspace(0.0, np.pi, 181))[:, None]
    along = np.abs(others + shapes.values[channel] ** 2 * phases).sum(axis=1)
    return float(0.5 * (np.sum(np.abs(shapes.values) ** 2) - along.max()))


def _others(shapes: _Shapes, lags: Array, channel: int, bound: float) -> tuple[float, ...]:
    """Other lags of one channel whose Q is below a bound, the least Q first [s]."""
    reach = SEARCHED_PERIODS / float(shapes.frequency.max())
    tried = np.linspace(-reach, reach, 2 * round(SEARCHED_PERIODS * STEPS) + 1)
    q = shapes.misfits(lags, channel, tried)
    inner = np.arange(1, len(q) - 1)
    minima = inner[(q[inner] <= q[inner - 1]) & (q[inner] < q[inner + 1]) & (q[inner] < bound)]
    apart = minima[np.abs(tried[minima] - lags[channel]) > 2.0 * (tried[1] - tried[0])]
    return tuple(tried[apart[np.argsort(q[apart])]].tolist())
