"""A mode under ambient loads: its values with their intervals, its shape, and reasons for doubt."""

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.checks.widening import grade_of
from windsysid.modal.matching.result import ModeCandidate
from windsysid.modal.shapes import along_axis, phase_collinearity, phase_deviation
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.mode import Mode

__all__ = ["Doubt", "DoubtKind", "OperationalMode"]

DoubtKind = Literal[
    "search", "short", "line", "border", "history", "shape", "faint", "image", "load", "background", "scores",
    "records", "record",
]  # fmt: skip


class Doubt(NamedTuple):
    """Remark on a mode, or reason why it is not to be used: its kind, a sentence, and the quantity that it affects."""

    kind: DoubtKind
    text: str
    of: Literal["mode", "frequency", "damping ratio"] = "mode"


@dataclass(frozen=True, kw_only=True)
class OperationalMode(Mode):
    """Mode of a structure under ambient loads, or in a free decay.

    Attributes
    ----------
    name
        ``mode 1`` …; if a rotor turns, the part that moves most: ``lag forward``.
    frequency, damping_ratio
        [Hz], [1], with their 95 % intervals as widened, grades, and the turbine file's value; the interval of the
        damping ratio is that of its logarithm.
    shape, shape_std
        (n,) complex, 1 in the channel with the largest motion, as accelerations; standard deviations of real and
        imaginary part.
    load, ln_load_std
        One-sided spectrum of the load on the mode, per modal mass where the shape is 1 [unit²/Hz], and the standard
        deviation of its logarithm.
    band
        Lowest and highest frequency that were used [Hz].
    grounds
        Reasons why it, or one of its quantities, is not to be used.
    remarks
        Causes of wider intervals.
    widening
        Factors on the standard deviations of frequency and ln ζ that the model gives.
    shape_cov
        Covariance (2 n, 2 n) of the shape's real parts and then its imaginary ones; None if it was not kept.
    steadiness
        Density of the variation of its amplitude, phase and frequency if it is a machine whose speed varies, over that
        of random response [1].
    segments
        (K, 3) middles of segments of the record [s], and frequency [Hz] and damping ratio in each, by one step of
        scoring from those of the whole; None if the record is too short for segments.
    candidates
        Modes of the turbine file that it may be, and other causes, with their probabilities; the best one first.
    """

    shape: Complex
    shape_std: Array
    load: float
    ln_load_std: float
    band: tuple[float, float]
    grounds: tuple[Doubt, ...]
    shape_cov: Array | None = None
    remarks: tuple[Doubt, ...] = ()
    widening: tuple[float, float] = (1.0, 1.0)
    steadiness: float = 1.0
    segments: Array | None = None
    candidates: tuple[ModeCandidate, ...] = ()

    def __post_init__(self) -> None:
        """Grade frequency and damping ratio by their widening and the reasons against them."""
        for (name, one), factor in zip(self.quantities, self.widening, strict=True):
            grade = grade_of(factor, excluded=any(reason.of in ("mode", name) for reason in self.grounds))
            object.__setattr__(self, name.replace(" ", "_"), replace(one, grade=grade))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why it, or one of its quantities, is not to be used, in sentences."""
        return tuple(doubt.text for doubt in self.grounds)

    def doubted_for(self, *kinds: DoubtKind) -> bool:
        """True if it has a doubt of one of these kinds."""
        return any(doubt.kind in kinds for doubt in self.grounds)

    @property
    def mpc(self) -> float:
        """Modal phase collinearity of the shape [1]: 1 for a real shape, NaN for fewer than three channels."""
        return phase_collinearity(self.shape)

    @property
    def mpd(self) -> float:
        """Mean phase deviation of the shape [rad]: 0 for a real shape."""
        return phase_deviation(self.shape)

    @property
    def complexity(self) -> float:
        """Share of the squared shape that is out of phase: 0 for a real shape, ½ for a travelling wave."""
        turned = along_axis(self.shape)
        return float(np.sum(turned.imag**2) / np.sum(np.abs(turned) ** 2))

    def full_summary(self, channels: tuple[str, ...], units: tuple[str, ...]) -> dict[str, Any]:
        """Plain values for JSON, with the shape by `channels` in their `units`."""
        unit = f"({units[int(np.argmax(np.abs(self.shape)))]})^2/Hz"
        return {
            **self.summary(),
            "shape": {
                "sensors": list(channels),
                "real": self.shape.real.tolist(),
                "imaginary": self.shape.imag.tolist(),
                "std": self.shape_std.tolist(),
                "complexity": self.complexity,
                "mpc": self.mpc,
                "mpd_rad": self.mpd,
            },
            "load_level": IntervalEstimate.lognormal(self.load, self.ln_load_std, unit).summary(),
            "band_hz": list(self.band),
            "segments": None if self.segments is None else self.segments.tolist(),
            **({"candidates": [one._asdict() for one in self.candidates]} if self.candidates else {}),
            "trusted": self.trusted,
            "doubts": list(self.doubts),
            "doubt_kinds": [doubt.kind for doubt in self.grounds],
            "remarks": [remark.text for remark in self.remarks],
        }
