r"""The rotor's azimuth and speed from its own harmonics in the vibration, for records without any rotor signal.

A symmetric rotor of N blades shakes its tower at N P, 2N P, …: the phase of that line turns N times as fast as the
rotor. So the tower gives speed, and azimuth up to a constant (the phase between rotor and line is the structure's
business). A blade's accelerometer turns with the blade and measures gravity: along the lag direction it reads

    y_b = a_b + g cos ψ_b,     ψ_b = ψ + 2π (b − 1) / N,

a line at 1 P whose phase is the blade's azimuth itself; y_1 + y_2 e^{−2πi/N} + … adds the blades up and cancels what
they have in common.

A line is followed in two steps: a path through the spectrogram with the largest energy whose frequency changes slowly
(dynamic programming), then the phase that is left when the record is turned back by that path, low-passed with zero
phase, repeated until nothing is left.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.signals.band import bridged
from windsysid.signals.rotor import RotorMotion, smooth_slope

__all__ = ["HarmonicPhase", "follow_line", "rotor_from_blades", "rotor_from_tower"]

ComplexArray = NDArray[np.complex128]

_TAPER = 6.0  # turns faded in and out; over two thirds of them the speed is taken to be constant
_MIN_CLARITY = 5.0
_SURE_CLARITY = 30.0  # noise, followed where it is loudest, looks up to half as clear as this


class HarmonicPhase(NamedTuple):
    """A line followed through a record: its phase, unwrapped (T,) [rad], its amplitude (T,), and how clear it is.

    `clarity` is the power within a quarter of 1P of the line, against as much bandwidth next to it. Noise reaches 15,
    because it is followed where it is loudest; below 30 nothing is to be trusted. `worst` is the same for the worst 16
    turns: where the line drowns, its phase may lose a turn.
    """

    phase: Array
    amplitude: Array
    clarity: float
    worst: float

    @property
    def is_clear(self) -> bool:
        """True if the line is significant as a whole, and at no time below the noise."""
        return self.clarity > _SURE_CLARITY and self.worst > _MIN_CLARITY


def rotor_from_tower(
    accelerations: Sequence[ArrayLike] | ArrayLike,
    rate: float,
    *,
    rotor_speed: float,
    blades: int = 3,
    search: float = 0.15,
) -> RotorMotion:
    """Estimate rotor speed, and azimuth up to a constant, from the blade-passing frequency in tower accelerations.

    Parameters
    ----------
    accelerations : array_like
        One channel (T,) or several, any unit; NaN = missing, bridged. The channel with the clearest line is used.
    rate : float
        Sampling rate [Hz].
    rotor_speed : float
        The turbine's usual speed Ω [rad/s].
    blades : int, default 3
        Number of blades N.
    search : float, default 0.15
        Largest relative deviation of the mean speed from `rotor_speed`.

    Returns
    -------
    RotorMotion
        Azimuth, speed and acceleration (T,) each.

    Raises
    ------
    RecordError
        If no channel shows the line.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 60.0, 0.05)
    >>> passing = np.sin(3 * 1.2 * time) + 0.1 * np.random.default_rng(0).standard_normal(time.size)
    >>> found = ws.signals.rotor_from_tower(passing, 20.0, rotor_speed=1.25)
    >>> round(float(found.speed[600]), 2), found.known_up_to_constant
    (1.2, True)
    """
    channels = np.atleast_2d(np.asarray(accelerations, dtype=np.float64))
    lines = [
        follow_line(
            bridged(channel, "to find the rotor's harmonic in"), rate, blades, rotor_speed=rotor_speed, search=search
        )
        for channel in channels
    ]
    line = max(lines, key=lambda found: found.clarity)
    if not line.is_clear:
        raise RecordError(
            f"no {blades}P line stands out near {blades * rotor_speed / (2 * np.pi):.3g} Hz in the tower's acceleration"
            f" ({_how_clear(line)}); record the rotor, or choose another section"
        )
    psi = line.phase / blades
    speed = smooth_slope(psi, rate)
    note = (
        f"from the {blades}P line, {line.clarity:.3g} times above its surroundings: the azimuth is known up to a"
        " constant, the blade numbers are not, with drift by wind"
    )
    return RotorMotion(psi, speed, smooth_slope(speed, rate), True, note)


def rotor_from_blades(
    accelerations: ArrayLike, rate: float, *, rotor_speed: float, search: float = 0.15
) -> RotorMotion:
    """Estimate azimuth and speed of the rotor from accelerometers on the blades, by the gravity they measure.

    Parameters
    ----------
    accelerations : array_like
        (N, T) [m/s²], blade b in row b − 1, along the blade's lag direction, positive with the rotation, gravity
        included; a row of NaN for a blade without sensor; NaN = missing, bridged.
    rate : float
        Sampling rate [Hz].
    rotor_speed : float
        The turbine's usual speed Ω [rad/s].
    search : float, default 0.15
        Largest relative deviation of the mean speed from `rotor_speed`.

    Returns
    -------
    RotorMotion
        Azimuth, speed and acceleration (T,) each.

    Raises
    ------
    RecordError
        If there is no 1P line, or the blades' phases contradict their order or signs.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> azimuth = 1.2 * np.arange(0.0, 60.0, 0.05) + 2.0 * np.pi / 3.0 * np.arange(3)[:, None]  # one row for each blade
    >>> found = ws.signals.rotor_from_blades(9.81 * np.cos(azimuth), 20.0, rotor_speed=1.25)
    >>> round(float(found.speed[600]), 2), round(float(found.psi[600]), 1)
    (1.2, 36.0)
    """
    rows = np.asarray(accelerations, dtype=np.float64)
    if rows.ndim != 2:
        raise RecordError(f"blade accelerations: expected (N, T), one row per blade, got {rows.shape}")
    blades = len(rows)
    fitted = [b for b in range(blades) if np.isfinite(rows[b]).any()]
    if not fitted:
        raise RecordError("blade accelerations: expected numbers on a blade at least, got none")
    whole = {b: bridged(rows[b], f"of blade {b + 1}") for b in fitted}
    whole = {b: y - y.mean() for b, y in whole.items()}
    # One blade finds the line; then every blade's phase is read against it.
    leading = whole[fitted[0]]
    line = follow_line(leading, rate, 1, rotor_speed=rotor_speed, search=search)
    if not line.is_clear:
        raise RecordError(
            f"blade {fitted[0] + 1}: no 1P line stands out near {rotor_speed / (2 * np.pi):.3g} Hz"
            f" ({_how_clear(line)}); does the sensor measure gravity, along the lag direction?"
        )
    width = 0.25 * rotor_speed / (2.0 * np.pi)
    turned = {b: _low_passed(y * np.exp(-1j * line.phase), rate, width) for b, y in whole.items()}
    seen = {b: complex(values.mean()) for b, values in turned.items()}
    _check_order(seen, blades)
    total = np.asarray(sum(turned[b] * np.exp(-2j * np.pi * b / blades) for b in fitted), dtype=np.complex128)
    psi = line.phase + np.unwrap(np.angle(total))
    psi -= 2.0 * np.pi * np.floor(psi[0] / (2.0 * np.pi))
    speed = smooth_slope(psi, rate)
    gravity = 2.0 * float(np.median(np.abs(total))) / len(fitted)
    note = (
        f"from gravity in {len(fitted)} of {blades} blades ({gravity:.3g} m/s² at 1P); if all sensors are reversed, the"
        " azimuth is half a turn off, undetected"
    )
    if len(fitted) == 1 and blades > 1:
        note += "; the order of the blades is not checked, one blade alone being fitted"
    return RotorMotion(psi, speed, smooth_slope(speed, rate), False, note)


def _straight_ends(phase: Array, n: int) -> Array:
    """`phase` continued over the first and last n samples at the mean speed of the n samples next to them."""
    result = phase.copy()
    n = min(n, len(phase) // 4)
    if n > 0:
        run = np.arange(1, n + 1)
        result[:n] = phase[n] - (phase[2 * n] - phase[n]) / n * run[::-1]
        result[-n:] = phase[-n - 1] + (phase[-n - 1] - phase[-2 * n - 1]) / n * run
    return result


def _how_clear(line: HarmonicPhase) -> str:
    return (
        f"{line.clarity:.2g} times its surroundings, {line.worst:.2g} at the worst, expected more than"
        f" {_SURE_CLARITY:g} and {_MIN_CLARITY:g}"
    )


def _check_order(seen: dict[int, complex], blades: int) -> None:
    """Refuse phases that are not 2π (b − 1)/N apart, with the likely cause."""
    first = min(seen)
    for b, value in seen.items():
        expected = 2.0 * np.pi * (b - first) / blades
        off = float(np.angle(value / seen[first] * np.exp(-1j * expected)))
        if abs(off) < np.radians(20.0):
            continue
        mirrored = float(np.angle(value / seen[first] * np.exp(1j * expected)))
        if abs(abs(off) - np.pi) < np.radians(20.0):
            what = f"blade {b + 1} reads with the opposite sign of blade {first + 1}: reverse one of them"
        elif abs(mirrored) < np.radians(20.0):
            what = "the blades are numbered the other way round: exchange two of them"
        else:
            what = f"blade {b + 1} is {np.degrees(off):.0f}° from its expected position: check channels and axes"
        raise RecordError(f"blade accelerations: expected blade b at ψ + 360° (b − 1)/{blades}; {what}")


def follow_line(
    values: ArrayLike, rate: float, harmonic: int, *, rotor_speed: float, search: float = 0.15
) -> HarmonicPhase:
    """Follow the line near `harmonic` · `rotor_speed` through a channel (T,) without gaps.

    Raises
    ------
    RecordError
        If the record is shorter than ten turns, or sampled too slowly for the line.
    """
    y = np.asarray(values, dtype=np.float64)
    y = y - y.mean()
    turn = rotor_speed / (2.0 * np.pi)
    if not (rotor_speed > 0.0 and 0.0 < search < 0.5):
        raise RecordError(
            f"rotor harmonic: expected a positive speed and a search below 0.5, got {rotor_speed:g}, {search:g}"
        )
    if len(y) < 10.0 * rate / turn:
        raise RecordError(
            f"rotor harmonic: expected ten turns ({10.0 / turn:.3g} s) or more, got {len(y) / rate:.3g} s"
        )
    centre = harmonic * turn
    if not centre * (1.0 + search) + turn < rate / 2.0:
        raise RecordError(
            f"rotor harmonic: the line at {centre:.3g} Hz needs more than {2 * (centre + turn):.3g} Hz sampling, got"
            f" {rate:g}"
        )
    width = 0.25 * turn  # a line's neighbours are a turn away, modes seldom nearer than this
    phase = (
        2.0
        * np.pi
        * np.concatenate([[0.0], np.cumsum(_ridge(y, rate, centre, search * centre, 1.0 / width))[:-1]])
        / rate
    )
    # A smooth taper keeps strong neighbours of the line from leaking into it where the record begins and ends.
    n = min(round(_TAPER / turn * rate), len(y) // 4)
    ramp = np.sin(0.5 * np.pi * (np.arange(n) + 0.5) / n) ** 4
    y = y * np.concatenate([ramp, np.ones(len(y) - 2 * n), ramp[::-1]])
    base = np.empty(0, dtype=np.complex128)
    for _ in range(3):
        base = _low_passed(y * np.exp(-1j * phase), rate, width)
        phase = _straight_ends(phase + np.unwrap(np.angle(base)), round(2 * n / 3))
    # Clarity: what lies within the width, against as much again next to it; medians, away from the ends.
    wide = _low_passed(y * np.exp(-1j * phase), rate, 2.0 * width)
    base = _low_passed(y * np.exp(-1j * phase), rate, width)
    inner = slice(n, len(y) - n)
    inside, beside = np.abs(base[inner]) ** 2, np.abs(wide - base)[inner] ** 2
    pieces = max(1, int(len(inside) / (16.0 * rate / turn)))
    worst = min(
        _ratio(a, b) for a, b in zip(np.array_split(inside, pieces), np.array_split(beside, pieces), strict=True)
    )
    return HarmonicPhase(phase, 2.0 * np.abs(base), _ratio(inside, beside), worst)


def _ratio(inside: Array, beside: Array) -> float:
    return float(np.median(inside) / max(float(np.median(beside)), 1e-300))


def _ridge(y: Array, rate: float, centre: float, reach: float, window: float) -> Array:
    """Frequency (T,) [Hz] of the most energetic path within `reach` of `centre` that changes by little per frame."""
    length = min(len(y), round(4.0 * window * rate))
    hop = max(1, length // 16)
    bins = np.linspace(centre - reach, centre + reach, 4 * round(reach * length / rate) + 5)
    starts = np.arange(0, len(y) - length + 1, hop)
    shape = np.kaiser(length, 14.0) * np.exp(-2j * np.pi * np.outer(bins, np.arange(length)) / rate)
    energy = np.array([np.abs(shape @ y[s : s + length]) ** 2 for s in starts])
    cost = -np.log(energy + 1e-9 * energy.max() + 1e-300)
    stay = 2.0 * ((bins[:, None] - bins) * length / rate) ** 2  # a bin's width per frame costs as much as two nepers
    best, back = cost[0], np.zeros(energy.shape, dtype=np.int64)
    for k in range(1, len(starts)):
        through = best[None, :] + stay
        back[k] = np.argmin(through, axis=1)
        best = cost[k] + through.min(axis=1)
    path = np.empty(len(starts), dtype=np.int64)
    path[-1] = int(np.argmin(best))
    for k in range(len(starts) - 1, 0, -1):
        path[k - 1] = back[k][path[k]]
    return np.interp(np.arange(len(y)), starts + length / 2.0, bins[path])


def _low_passed(values: ComplexArray, rate: float, cutoff: float) -> ComplexArray:
    """Zero-phase Butterworth low-pass, sixth order on either pass, continued by even reflection."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(6, cutoff, fs=rate, output="sos")
    pad = min(len(values) - 1, int(3.0 * rate / cutoff))
    parts = (sosfiltfilt(sos, part, padtype="even", padlen=pad) for part in (values.real, values.imag))
    return np.asarray(next(parts) + 1j * next(parts), dtype=np.complex128)
