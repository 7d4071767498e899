"""Checks of the numbers of models."""

from typing import TYPE_CHECKING

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.limits import MAX_GYRATION, MIN_GYRATION, STEEL_SOUND_SPEED

if TYPE_CHECKING:
    from windsysid.turbine.models.input_file import InputFile, StationTable

__all__ = ["check_gyration", "gyration_problem"]


def gyration_problem(stiffness_per_mass: Array, length: float) -> str:
    """Report an error of EI over mass per length (n,) [N·m³/kg] of a beam; '' if there is none.

    The median section is judged by its radius of gyration, as its material has about steel's speed of sound.
    """
    if not np.all(np.isfinite(stiffness_per_mass)) or np.any(stiffness_per_mass <= 0.0):
        return "expected stiffness and mass above 0"
    share = float(np.sqrt(np.median(stiffness_per_mass))) / STEEL_SOUND_SPEED / length
    if MIN_GYRATION <= share <= MAX_GYRATION:
        return ""
    return (
        f"stiffness over mass means a section of {share * length:.2g} m radius in a beam of {length:.3g} m: expected "
        f"{MIN_GYRATION * length:.2g} to {MAX_GYRATION * length:.2g} m; check units (N·m², kg/m)"
    )


def check_gyration(
    file: "InputFile", table: "StationTable", column: str, stiffness_per_mass: Array, length: float
) -> None:
    """Refuse a column of stiffness whose size does not fit the mass, with file and line."""
    if problem := gyration_problem(stiffness_per_mass, length):
        file.fail(table.first, f"{column}: {problem}")
