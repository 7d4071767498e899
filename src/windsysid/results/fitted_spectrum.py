"""The spectrum that a fit gives a channel, with its interval."""

from typing import NamedTuple

from windsysid._types import Array

__all__ = ["FittedSpectrum"]


class FittedSpectrum(NamedTuple):
    """One-sided power spectral density of one channel under a fit, at the posterior mode.

    Attributes
    ----------
    channel
        Name of the channel, or of the combination of channels of several blades.
    turning
        Whether it is read in the frame that turns with the rotor.
    frequency
        Frequencies (F,) [Hz], increasing.
    density
        There (F,) [unit²/Hz].
    log_std
        Standard deviation of its logarithm (F,), of the posterior, by the delta method.
    measured
        Periodogram of the fit's data (F,) [unit²/Hz], averaged over the bins that share a spectrum; None where the fit
        is one in time.
    """

    channel: str
    turning: bool
    frequency: Array
    density: Array
    log_std: Array
    measured: Array | None = None
