"""Modes of a linearised model as an answer: a Campbell diagram whose modes have participations."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from windsysid.modal.campbell import Campbell
from windsysid.modal.linearisation.eigenmodes import LinearisedMode
from windsysid.modal.tracking import Curve
from windsysid.output.table import Table
from windsysid.results.posterior import SIGMAS
from windsysid.units import RPM

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["LinearisedModes", "OperatingPoint"]

MIN_DIGITS = 7
"""Setting: number of digits of A below which the number format is warned of: those of single precision."""


class OperatingPoint(NamedTuple):
    """One operating point of a linearised model.

    Attributes
    ----------
    rotor_speed, wind_speed
        [rad/s], [m/s].
    files
        Names of the files that were averaged.
    azimuths
        Of blade 1 [rad].
    digits
        Significant digits with which A is written.
    modes
        By frequency.
    """

    rotor_speed: float
    wind_speed: float
    files: tuple[str, ...]
    azimuths: tuple[float, ...]
    digits: int
    modes: tuple[LinearisedMode, ...]


@dataclass(frozen=True, eq=False, repr=False)
class LinearisedModes(Campbell):
    """Modes of a model that OpenFAST linearised, at one or several rotor speeds.

    Frequencies are damped ones, Im λ / 2π; intervals are those that the number format of the files leaves.

    Attributes
    ----------
    points
        The operating points, by rotor speed.
    """

    points: tuple[OperatingPoint, ...] = ()

    @property
    def modes(self) -> tuple[LinearisedMode, ...]:
        """Those at the usual rotor speed, which is the highest, by frequency."""
        return self.points[self.usual].modes

    def mode_of(self, curve: Curve, i: int) -> LinearisedMode:
        """Mode of a curve at operating point `i`, where its name may be another one than that of the `curve`."""
        f = float(curve.frequency[i])
        return min(self.points[i].modes, key=lambda mode: (abs(mode.frequency.estimate - f), mode.name != curve.name))

    @property
    def band_source(self) -> str:
        """Source of the intervals."""
        return "of the digits in the files"

    @property
    def warnings(self) -> list[str]:
        """Warnings of operating points whose files have too few digits."""
        found = []
        for point in self.points:
            ratio, name = max(((SIGMAS * m.frequency.relative_std, m.name) for m in point.modes), default=(0.0, ""))
            if point.digits < MIN_DIGITS:
                found.append(
                    f"Warning: {point.files[0]} has {point.digits} digits: rounding moves {name} by ± "
                    f"{100.0 * ratio:.2g} % (95 % interval); set OutFmt to ES20.12E3 and linearise again."
                )
        return found

    def modes_table(self) -> Table:
        """Frequencies, damping ratios and participations at the usual rotor speed."""
        curves = {curve.name: curve for curve in self.curves}
        rows = [
            (*(self.values_text(curves[m.name]) if self.banded else m.values_text), m.main_parts) for m in self.modes
        ]
        at = f"{self.speeds[self.usual] * RPM:.3g} rpm"
        return Table(("mode", "damped Hz", "damping [%]", "participation"), rows, f"modes at {at}", (0, 3))

    def contents(self) -> list[Table | str]:
        """Warnings, the modes, then the parts of every diagram."""
        return [*self.warnings, self.modes_table(), *super().contents()]

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each operating point and mode: ``speed`` [rad/s], ``wind_speed`` [m/s], ``mode``, ``frequency``
        [Hz] and ``damping_ratio`` with their standard deviations, and the participation of each kind, ``in KIND``."""
        import pandas as pd

        return pd.DataFrame([
            {
                "speed": point.rotor_speed, "wind_speed": point.wind_speed, "mode": mode.name,
                "frequency": mode.frequency.estimate, "frequency_std": mode.frequency.std,
                "damping_ratio": mode.damping_ratio.estimate, "damping_ratio_std": mode.damping_ratio.std,
                **{f"in {kind}": share for kind, share in mode.participation.items()},
            }
            for point in self.points for mode in point.modes
        ])  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """As plain values, with the operating points."""
        points = [{**point._asdict(), "modes": [_plain(mode) for mode in point.modes]} for point in self.points]
        return {**super().summary(), "warnings": self.warnings, "operating_points": points}


def _plain(mode: LinearisedMode) -> Mapping[str, Any]:
    shape = {kind: [value.real, value.imag] for kind, value in mode.shape.items()}
    return {**mode.summary(), "participation": dict(mode.participation), "shape": shape}
