"""Measured modes with the modes of a model that they may be."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from windsysid.modal.matching.limits import MAX_ODDS
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.table import Table
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.posterior import SIGMAS
from windsysid.units import with_half_width

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["MatchedMode", "ModeCandidate", "ModeMatch", "odds_text"]


class ModeCandidate(NamedTuple):
    """A mode of the model, or another cause, that a measured mode may be.

    Attributes
    ----------
    name
        Of the mode; or ``3P, blade passing``, ``4P``, ``load`` or ``unknown``.
    probability
        [1].
    frequency, damping_ratio
        Of the model [Hz], [1]; None for other causes.
    mac
        Modal assurance criterion with its 95 % interval; None if shapes have fewer than two channels in common.
    """

    name: str
    probability: float
    frequency: float | None = None
    damping_ratio: float | None = None
    mac: tuple[float, float, float] | None = None


class MatchedMode(NamedTuple):
    """Measured mode, and its candidates in the model.

    Attributes
    ----------
    name
        As measured.
    frequency, damping_ratio
        [Hz], [1], with their 95 % intervals.
    trusted
        True if its grades are A or B.
    candidates
        First that of the most probable one-to-one assignment, then the others by probability.
    """

    name: str
    frequency: IntervalEstimate
    damping_ratio: IntervalEstimate
    trusted: bool
    candidates: tuple[ModeCandidate, ...]

    @property
    def best(self) -> ModeCandidate:
        """The candidate of the most probable assignment."""
        return self.candidates[0]

    @property
    def reference(self) -> tuple[float | None, float | None]:
        """Frequency [Hz] and damping ratio of the model's mode that it is, with odds above 1 : 1; None without one."""
        likely = self.best.probability > 0.5
        return (self.best.frequency, self.best.damping_ratio) if likely else (None, None)


@dataclass(frozen=True)
class ModeMatch(SummarisedAnswer):
    """Assignment of measured modes to the modes of a model.

    Attributes
    ----------
    record, model
        Names.
    rotor_speed
        [rad/s].
    modes
        The measured modes, by frequency.
    notes
        Remarks, such as modes of the model that were not measured.
    """

    record: str
    model: str
    rotor_speed: float
    modes: tuple[MatchedMode, ...]
    notes: tuple[str, ...]

    def table(self) -> Table:
        """Measured modes with the candidate of the best assignment, its odds and MAC, and the next candidate."""
        headings = ("mode", "f ± 95 % [Hz]", "is", "odds", "f off by", "MAC", "or")
        rows = [
            (
                mode.name, with_half_width(mode.frequency.estimate, SIGMAS * mode.frequency.std, 4),
                *candidate_cells(mode),
                next((f"{c.name}, {c.probability:.2f}" for c in mode.candidates[1:] if c.probability > 0.05), ""),
            )
            for mode in self.modes
        ]  # fmt: skip
        return Table(headings, rows, f"modes of {self.record} in {self.model}", (0, 2, 6))

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each measured mode and candidate: ``mode``, ``frequency`` [Hz], ``frequency_std``,
        ``damping_ratio``, ``damping_ratio_std``, ``candidate``, ``probability``, ``model_frequency`` [Hz],
        ``model_damping_ratio``, ``mac``, ``mac_low``, ``mac_high``; NaN where there is none."""
        import pandas as pd

        rows = [
            {
                "mode": mode.name, "frequency": mode.frequency.estimate, "frequency_std": mode.frequency.std,
                "damping_ratio": mode.damping_ratio.estimate, "damping_ratio_std": mode.damping_ratio.std,
                "candidate": one.name, "probability": one.probability, "model_frequency": one.frequency,
                "model_damping_ratio": one.damping_ratio,
                **dict(zip(("mac", "mac_low", "mac_high"), one.mac or (None, None, None), strict=True)),
            }
            for mode in self.modes
            for one in mode.candidates
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON."""
        modes = [
            {
                **m._asdict(), "frequency": m.frequency.summary(), "damping_ratio": m.damping_ratio.summary(),
                "candidates": [one._asdict() for one in m.candidates],
            }
            for m in self.modes
        ]  # fmt: skip
        return {"record": self.record, "model": self.model, "rotor_speed_rad_s": self.rotor_speed, "modes": modes,
            "notes": list(self.notes)}  # fmt: skip

    def contents(self) -> list[Table | str]:
        """The table and the notes."""
        return [self.table(), *self.notes]


def candidate_cells(mode: MatchedMode) -> tuple[str, str, str, str]:
    """Name, odds, difference of the frequency from the model's, and MAC with its interval, of the best candidate."""
    best = mode.best
    off = "" if best.frequency is None else f"{100.0 * (mode.frequency.estimate / best.frequency - 1.0):+.2f} %"
    mac = "" if best.mac is None else "{:.2f} ({:.2f} … {:.2f})".format(*best.mac)
    return best.name, odds_text(best.probability), off, mac


def odds_text(probability: float) -> str:
    """Odds of a probability as text, ``12 : 1`` or ``1 : 3``, up to the limit to which they are calibrated.

    Examples
    --------
    >>> odds_text(0.9), odds_text(0.25), odds_text(1.0)
    ('9 : 1', '1 : 3', '> 1000 : 1')
    """
    odds = probability / max(1.0 - probability, 1e-12)
    if odds > MAX_ODDS:
        return f"> {MAX_ODDS:.0f} : 1"
    larger = float(f"{max(odds, min(1.0 / max(odds, 1e-12), MAX_ODDS)):.2g}")
    return f"{larger:g} : 1" if odds >= 1.0 else f"1 : {larger:g}"
