"""Modes of a result of `windsysid.oma`, or of the folder that it was saved in, for comparisons and diagrams."""

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from windsysid._types import Complex
from windsysid.errors import ConfigurationError
from windsysid.modal.campbell import MeasuredMode
from windsysid.output.folders import summary_of, without
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.posterior import SIGMAS, section_name
from windsysid.spectral.modal_bands.scoring import DAMPING_PRIOR
from windsysid.spectral.oma.result import ANALYSIS, OperationalModes

__all__ = ["KnownMode", "KnownModes", "ModesLike", "as_modes", "holds_modes", "in_channels", "without_damping_prior"]


class KnownMode(NamedTuple):
    """Mode: its name, ln f and ln ζ with their standard deviations, its shape by channel, whether it was trusted, the
    standard deviations of its shape, and the kinds of its doubts."""

    name: str
    ln_frequency: float
    ln_frequency_std: float
    ln_damping: float
    ln_damping_std: float
    shape: dict[str, complex]
    trusted: bool
    shape_std: Mapping[str, float] = MappingProxyType({})
    doubts: tuple[str, ...] = ()

    @property
    def values(self) -> tuple[IntervalEstimate, IntervalEstimate]:
        """Frequency [Hz] and damping ratio with their intervals."""
        f, z = math.exp(self.ln_frequency), math.exp(self.ln_damping)
        std = f * self.ln_frequency_std
        return IntervalEstimate.normal(f, std, "Hz"), IntervalEstimate.lognormal(z, self.ln_damping_std, "1")


class KnownModes(NamedTuple):
    """Modes of a record.

    Attributes
    ----------
    record
        Its name, and its section if that is known.
    start, section, record_hash
        As in `windsysid.results.posterior.Posterior`.
    modes
        By rising frequency.
    trusted
        False if there are doubts about the whole record.
    rotor_speed
        [rad/s]; 0 if none turned.
    """

    record: str
    start: str | None
    section: tuple[float, float] | None
    record_hash: str | None
    modes: tuple[KnownMode, ...]
    trusted: bool
    rotor_speed: float = 0.0

    def measured(self) -> list[MeasuredMode]:
        """Modes to be drawn in a Campbell diagram."""
        return [
            MeasuredMode(self.record, mode.name, self.rotor_speed, *mode.values, mode.trusted) for mode in self.modes
        ]


ModesLike: TypeAlias = OperationalModes | KnownModes | str | Path


def holds_modes(given: object) -> bool:
    """True for a result of `windsysid.oma`, or the folder of one."""
    if isinstance(given, OperationalModes | KnownModes):
        return True
    return isinstance(given, str | Path) and summary_of(given).get("analysis") == ANALYSIS


def as_modes(given: ModesLike) -> KnownModes:
    """Modes of a result, or of the folder that it was saved in; ConfigurationError if there are none."""
    if isinstance(given, KnownModes):
        return given
    summary = given.summary() if isinstance(given, OperationalModes) else summary_of(given)
    if summary.get("analysis") != ANALYSIS:
        raise ConfigurationError(without("a result of windsysid oma", str(given)))
    try:
        return _read(summary)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(
            f"result {given}: expected a summary.json as windsysid oma writes it ({error.__class__.__name__}): analyse "
            "the record again"
        ) from None


def without_damping_prior(mode: KnownMode) -> tuple[float, float]:
    """ln ζ and its standard deviation by the likelihood alone: the prior of damping is divided out."""
    centre, spread = DAMPING_PRIOR
    information = mode.ln_damping_std**-2.0 - spread**-2.0
    if information <= 1e-3 * spread**-2.0:
        return mode.ln_damping, math.inf
    mean = (mode.ln_damping * mode.ln_damping_std**-2.0 - centre * spread**-2.0) / information
    return mean, information**-0.5


def _read(summary: dict[str, Any]) -> KnownModes:
    modes = []
    for one in summary["modes"]:
        f, z, shape = one["frequency" if "frequency" in one else "frequency_hz"], one["damping_ratio"], one["shape"]
        values: Complex = np.array(shape["real"]) + 1j * np.array(shape["imaginary"])
        name = str(one["name"])
        f_std, z_std = (f["high"] - f["low"]) / (2.0 * SIGMAS), math.log(z["high"] / z["low"]) / (2.0 * SIGMAS)
        by_channel = dict(zip(shape["sensors"], values.tolist(), strict=True))
        logs = (math.log(f["estimate"]), f_std / f["estimate"], math.log(z["estimate"]), z_std)
        stds = dict(zip(shape["sensors"], map(float, shape["std"]), strict=True))
        modes.append(KnownMode(name, *logs, by_channel, bool(one["trusted"]), stds, tuple(one.get("doubt_kinds", ()))))
    start, stop = (float(value) for value in summary["section"])
    several = "parts" in summary
    record = str(summary["record"])
    return KnownModes(
        record if several else section_name(record, start, stop),
        summary["start"],
        (start, stop),
        summary["record_hash"],
        tuple(modes),
        not summary["doubts"],
        float(summary["rotor_speed_rad_s"]),
    )


def in_channels(mode: KnownMode, channels: list[str]) -> Complex:
    """Shape in a list of channels, NaN for those without a value."""
    return np.array([mode.shape.get(channel, math.nan) for channel in channels], dtype=np.complex128)
