"""Real instruments and loggers: gain, angle, clock, converter, noise, and failures."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from validation.adversary.machine import RATE

__all__ = ["CHANNELS", "NOISE", "Instruments"]

Array = NDArray[np.float64]

CHANNELS = ("tower_x_acceleration", "tower_y_acceleration", *(f"blade_{i}_lag_acceleration" for i in (1, 2, 3)))
NOISE = np.array([0.05, 0.05, 0.1, 0.1, 0.1])
"""Of one reading, [m/s²] and [rad/s²]."""


class Instruments(NamedTuple):
    """Two accelerometers on the support and one on each blade.

    Attributes
    ----------
    gain
        What each reads of one unit (5,).
    angle
        By how much the accelerometer along x is turned towards y, and that along y towards −x [deg] (2,).
    late, drift
        By how much the blades' logger is late at first [s], and how much more in each second [s/s].
    noise
        Over that of the data sheet (5,).
    colour
        Correlation of the noise of neighbouring readings.
    tails
        Degrees of freedom of Student's t for the noise; 0: normal.
    bits
        Of a converter over ±4 rms; 0: none.
    clipped
        Beyond how many rms the first blade's channel is cut off; 0: nowhere.
    lost
        From when to when the first blade's channel repeats its last value [s].
    dead
        From when to when it reads nothing but noise [s].
    drawn
        Standard deviations of what is drawn for each record: gain, angle [deg], lateness [s].
    offset
        What is added to each channel, in its unit (5,).
    wander
        How far offsets walk in a second, in standard deviations of `NOISE`.
    stamps
        By how much time stamps are off the times at which readings are taken, at most [s].
    azimuth
        Standard deviation of what is added to the rotor's azimuth [deg].
    """

    gain: tuple[float, ...] = (1.0,) * 5
    angle: tuple[float, float] = (0.0, 0.0)
    late: float = 0.0
    drift: float = 0.0
    noise: tuple[float, ...] = (1.0,) * 5
    colour: float = 0.0
    tails: float = 0.0
    bits: int = 0
    clipped: float = 0.0
    lost: tuple[float, float] = (0.0, 0.0)
    dead: tuple[float, float] = (0.0, 0.0)
    drawn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset: tuple[float, ...] = (0.0,) * 5
    wander: float = 0.0
    stamps: float = 0.0
    azimuth: float = 0.0

    def read(self, motion: Array, lead: int, duration: float, rate: float, rng: np.random.Generator) -> Array:
        """Readings (T, 5) at so many a second of accelerations (n, 5) at `RATE`, from their row `lead` on."""
        time = np.arange(round(duration * rate)) / rate
        gain = np.array(self.gain) * (1.0 + self.drawn[0] * rng.standard_normal(5))
        angle = np.radians(np.array(self.angle) + self.drawn[1] * rng.standard_normal(2))
        late = self.late + self.drawn[2] * rng.standard_normal()
        own = _at(motion[:, :2], lead + RATE * time)
        x = np.cos(angle[0]) * own[:, 0] + np.sin(angle[0]) * own[:, 1]
        y = np.cos(angle[1]) * own[:, 1] - np.sin(angle[1]) * own[:, 0]
        blades = _at(motion[:, 2:], lead + RATE * (time - late - self.drift * time))
        readings = gain * np.column_stack([x, y, blades])
        hurt = slice(*(round(rate * t) for t in self.dead))
        readings[hurt, 2] = 0.0
        readings += NOISE * np.array(self.noise) * self._noise(len(time), rng)
        readings += np.array(self.offset)
        if self.wander:
            readings += NOISE * self.wander * np.cumsum(rng.standard_normal(readings.shape), axis=0) / np.sqrt(rate)
        rms = np.sqrt(np.mean(readings**2, axis=0))
        if self.bits:
            step = 8.0 * rms / 2**self.bits
            readings = np.clip(step * np.round(readings / step), -4.0 * rms, 4.0 * rms)
        if self.clipped:
            readings[:, 2] = np.clip(readings[:, 2], -self.clipped * rms[2], self.clipped * rms[2])
        stuck = slice(*(round(rate * t) for t in self.lost))
        if stuck.stop > stuck.start:
            readings[stuck, 2] = readings[stuck.start, 2]
        return np.asarray(readings)

    def stamp(self, time: Array, rng: np.random.Generator) -> Array:
        """Time stamps of readings that are taken at times [s]."""
        return time + self.stamps * rng.uniform(-1.0, 1.0, len(time)) if self.stamps else time

    def turned(self, psi: Array, rng: np.random.Generator) -> Array:
        """Reading of an azimuth [rad]."""
        noise = np.radians(self.azimuth) * rng.standard_normal(len(psi)) if self.azimuth else 0.0
        return np.asarray(np.mod(psi + noise, 2.0 * np.pi))

    def _noise(self, n: int, rng: np.random.Generator) -> Array:
        if self.tails:
            return np.asarray(rng.standard_t(self.tails, (n, 5)) / np.sqrt(self.tails / (self.tails - 2.0)))
        white = rng.standard_normal((n, 5))
        return np.asarray(lfilter([np.sqrt(1.0 - self.colour**2)], [1.0, -self.colour], white, axis=0))


def _at(motion: Array, where: Array) -> Array:
    """Rows of (n, m) at places that need not be whole, by a cubic through four neighbours."""
    low = np.clip(np.floor(where).astype(np.int64), 1, len(motion) - 3)
    x = (where - low)[:, None]
    before, here, after, beyond = (motion[low + k] for k in (-1, 0, 1, 2))
    return np.asarray(
        here
        + 0.5
        * x
        * (
            after
            - before
            + x * (2 * before - 5 * here + 4 * after - beyond + x * (3 * (here - after) + beyond - before))
        )
    )
