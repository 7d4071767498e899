r"""Integration of a stream: the same motion above a cut-off, from the past alone, at the price of a phase.

A third-order Butterworth high-pass s³ / B(s), B = s³ + 2 ω_c s² + 2 ω_c² s + ω_c³, leaves of the integrals

    v/a = s² / B(s),     x/a = s / B(s),

so that a bias dies away. Discretised by the trapezoidal rule (bilinear), which loses (ω Δt)²/12 of v and twice that of
x. Above the cut-off the result leads the motion by about 2 f_c / f rad, which is 2 f_c / (2π f²) seconds early and
never late: `causal_response` gives it exactly. Nothing is delayed, because what is taken out is slow.

The filter and its state are values, as with ``scipy.signal.sosfilt(sos, x, zi=…)``: a stream in pieces gives, bit for
bit, what the whole gives.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.signals.band import check_cutoff
from windsysid.signals.integration import Motion

__all__ = ["CausalIntegrator", "CausalState", "causal_integrator", "causal_response", "integrate_causally"]


class CausalIntegrator(NamedTuple):
    """Filters from acceleration to velocity and displacement.

    Attributes
    ----------
    velocity, displacement
        Second-order sections (2, 6) each, as SciPy's ``sos`` [1].
    rate, cutoff
        Sampling rate, and the frequency below which motion is removed [Hz].
    """

    velocity: Array
    displacement: Array
    rate: float
    cutoff: float


class CausalState(NamedTuple):
    """State of a causal integrator between two pieces of a stream.

    Attributes
    ----------
    velocity, displacement
        States of both filters (2, 2) each, as SciPy's ``zi``.
    last
        The last acceleration that was not missing [m/s² or rad/s²].
    """

    velocity: Array
    displacement: Array
    last: float


def causal_integrator(rate: float, *, cutoff: float) -> CausalIntegrator:
    """Design causal filters that integrate a stream of accelerations.

    Parameters
    ----------
    rate : float
        Sampling rate [Hz].
    cutoff : float
        Frequency below which motion is removed [Hz].

    Returns
    -------
    CausalIntegrator
        Filters for `integrate_causally`.

    Raises
    ------
    RecordError
        If the cut-off lies outside 0 … rate / 2.

    See Also
    --------
    integrate : Zero-phase integration of a whole record.

    Examples
    --------
    >>> import windsysid as ws
    >>> integrator = ws.signals.causal_integrator(20.0, cutoff=0.1)
    >>> integrator.velocity.shape, integrator.displacement.shape
    ((2, 6), (2, 6))
    """
    check_cutoff(cutoff, rate)
    from scipy.signal import bilinear_zpk, buttap, lp2hp_zpk, zpk2sos

    _, poles, _ = lp2hp_zpk(*buttap(3), wo=2.0 * np.pi * cutoff)

    def sections(zeros: int) -> Array:
        z, p, gain = bilinear_zpk(np.zeros(zeros), poles, 1.0, rate)
        return np.asarray(zpk2sos(z.astype(np.complex128), p, gain), dtype=np.float64)  # type: ignore[arg-type]

    return CausalIntegrator(sections(2), sections(1), float(rate), float(cutoff))


def integrate_causally(
    integrator: CausalIntegrator, acceleration: ArrayLike, state: CausalState | None = None
) -> tuple[CausalState, Motion]:
    """Integrate the next samples of a stream of accelerations to velocity and displacement.

    Parameters
    ----------
    integrator : CausalIntegrator
        From `causal_integrator`.
    acceleration : array_like
        (T,) [m/s² or rad/s²], T ≥ 0; at a NaN the last known value is used, and the result is NaN.
    state : CausalState, optional
        State after the samples before; None at the beginning of the stream, which then starts as if the first reading
        had been constant before, so that a bias raises no transient.

    Returns
    -------
    state, motion
        State for the next call, and velocity and displacement (T,).

    Raises
    ------
    RecordError
        If the acceleration is not (T,) or infinite.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> integrator = ws.signals.causal_integrator(20.0, cutoff=0.1)
    >>> acceleration = np.sin(2.0 * np.pi * 0.5 * np.arange(0.0, 60.0, 0.05))
    >>> state, first = ws.signals.integrate_causally(integrator, acceleration[:600])
    >>> state, second = ws.signals.integrate_causally(integrator, acceleration[600:], state)
    >>> round(float(second.displacement[-40:].max()), 4)  # 1 / (2π 0.5)² = 0.1013 m
    0.1007
    """
    from scipy.signal import sosfilt, sosfilt_zi

    values = np.asarray(acceleration, dtype=np.float64)
    if values.ndim != 1 or np.isinf(values).any():
        raise RecordError(f"acceleration: expected (T,) finite or NaN, got {values.shape}")
    missing = np.isnan(values)
    if state is None:
        state = CausalState(np.zeros((2, 2)), np.zeros((2, 2)), np.nan)
    if np.isnan(state.last):  # nothing has been read yet
        if missing.all():
            return state, Motion(values.copy(), values.copy())
        first = int(np.argmin(missing))
        start = float(values[first])
        state = CausalState(start * sosfilt_zi(integrator.velocity), start * sosfilt_zi(integrator.displacement), start)
        nothing = np.full(first, np.nan)
        state, rest = integrate_causally(integrator, values[first:], state)
        return state, Motion(*(np.concatenate([nothing, part]) for part in rest))
    if not len(values):
        return state, Motion(values.copy(), values.copy())
    held = np.concatenate([[state.last], values])
    latest = np.maximum.accumulate(np.where(np.isnan(held), 0, np.arange(len(held))))
    held = held[latest][1:]
    velocity, zi_velocity = sosfilt(integrator.velocity, held, zi=state.velocity)
    displacement, zi_displacement = sosfilt(integrator.displacement, held, zi=state.displacement)
    velocity[missing] = displacement[missing] = np.nan
    return CausalState(zi_velocity, zi_displacement, float(held[-1])), Motion(velocity, displacement)


def causal_response(integrator: CausalIntegrator, frequency: ArrayLike) -> tuple[Array, Array]:
    """Compute the gain of velocity and displacement relative to the true integrals.

    Parameters
    ----------
    integrator : CausalIntegrator
        From `causal_integrator`.
    frequency : array_like
        (n,) or one number [Hz].

    Returns
    -------
    velocity, displacement
        Complex gains (n,) each [1]; 1 is perfect. The angle is the phase by which the result leads: angle / (2π f)
        seconds.

    Raises
    ------
    ValueError
        If the frequencies are no numbers.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> integrator = ws.signals.causal_integrator(20.0, cutoff=0.1)
    >>> velocity, displacement = ws.signals.causal_response(integrator, 1.0)  # at 1 Hz
    >>> abs(displacement).round(3).tolist(), np.degrees(np.angle(displacement)).round(1).tolist()
    ([0.984], [11.4])
    """
    from scipy.signal import sosfreqz

    f = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    s = 2j * np.pi * f
    _, velocity = sosfreqz(integrator.velocity, f, fs=integrator.rate)
    _, displacement = sosfreqz(integrator.displacement, f, fs=integrator.rate)
    return np.asarray(velocity * s), np.asarray(displacement * s**2)
