"""The modes of a fit, with the masses of the turbine file."""

from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.model.fit import Outcome
from windsysid.mechanics.compile import CompiledModel
from windsysid.modal.analysis import modes_with_slopes
from windsysid.results.mode import Mode
from windsysid.turbine.turbine import Turbine

__all__ = ["FittedModes", "modes_of"]


class FittedModes(NamedTuple):
    """Modes at the estimates.

    A vibration shows ratios of stiffness and damping to masses. So modes are given for the masses of the file, with the
    coefficients that the record implies if those are right.

    Attributes
    ----------
    turbine
        The file with those coefficients.
    speed
        Mean rotor speed [rad/s].
    modes, slopes
        The modes, and the slopes of frequencies and damping ratios to the parameters.
    given_masses
        Covariance of all unknowns, given the masses of the file.
    """

    turbine: Turbine
    speed: float
    modes: tuple[Mode, ...]
    slopes: Any
    given_masses: Array


def modes_of(outcome: Outcome, compiled: CompiledModel | None = None) -> FittedModes:
    """Compute the modes of a fit, whose equations are those of its state-space model by default."""
    file, model, n = outcome.turbine, outcome.model, len(outcome.theta)
    at_masses, given_masses = outcome.given("masses")
    final = file.with_values({q.name: float(q.physical(t)) for q, t in zip(model.parameters, at_masses, strict=True)})
    compiled = compiled or model.compiled
    at_reference = np.array([file.values[name] for name in compiled.parameters])
    turning = [i for i, name in enumerate(compiled.inputs) if name == "rotor_speed"]
    speed = float(outcome.rotor[:, turning[0]].mean()) if turning else file.rotor_speed
    modes, slopes = modes_with_slopes(
        file.model, compiled, at_reference, speed, model.parameters, at_masses, given_masses[:n, :n]
    )
    return FittedModes(final, speed, modes, slopes, given_masses)
