"""Shapes of a model's modes at sensors: of a turbine by its equations, of a linearisation by its degrees of freedom.

Channels are those of `windsysid.oma`: of y_b = Re Y_b e^{λt} on blades at the azimuths ψ_b, the mean is collective, and
2/N Σ Y_b e^{±iψ_b} are the forward and the backward part, averaged over a turn.
"""

import math
from collections.abc import Sequence

import numpy as np

from windsysid._types import Array, Complex
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.modal.analysis import AVERAGED_AZIMUTHS, ModalSpectrum, analyse
from windsysid.modal.linearisation.eigenmodes import LinearisedMode
from windsysid.spectral.transforms.multiblade import blade_sets
from windsysid.turbine.turbine import Turbine

__all__ = ["linearised_shape", "turbine_shapes"]

FORE_AFT = ("tower_z_acceleration", "tower_z_acceleration_kinematic", "nacelle_z_acceleration_kinematic",
    "nacelle_z_acceleration")  # fmt: skip
"""Channels at the tower top along the wind."""

SIDE_SIDE = ("tower_x_acceleration", "tower_x_acceleration_kinematic", "nacelle_x_acceleration_kinematic",
    "nacelle_x_acceleration")  # fmt: skip
"""Channels at the tower top across the wind."""

TIPS = ("blades_tip_lag_acceleration", "blades_tip_lag_acceleration_kinematic")
"""Channels of blade tips in multi-blade coordinates, without their pattern."""


def turbine_shapes(turbine: Turbine, rotor_speed: float) -> tuple[ModalSpectrum, list[dict[str, complex]]]:
    """Modes of a turbine at a rotor speed [rad/s], and their shapes by channel of its sensors."""
    sensors = [sensor for sensor in turbine.sensors if sensor.quantity == "acceleration"]
    compiled = compile_model(turbine.model, sensors)
    p = np.array([turbine.values[name] for name in compiled.parameters])
    found = analyse(turbine.model, compiled, p, rotor_speed, method="Coleman")
    axes = turbine.model.modes()
    psi = np.arange(AVERAGED_AZIMUTHS) * 2.0 * math.pi / AVERAGED_AZIMUTHS if axes.turns else np.zeros(1)
    weights = axes.weights(dict(zip(compiled.parameters, p.tolist(), strict=True)))
    xi = found.shapes.T / np.sqrt(weights)[:, None]
    T = axes.transform(psi)
    q = T[0] @ xi
    state = np.concatenate([q, (T[0] @ xi) * found.exponents + rotor_speed * (T[1] @ xi)], axis=1)
    readings = _slopes(compiled, p, psi, rotor_speed) @ state
    return found, _by_channel(readings, [sensor.channel for sensor in sensors], psi, bool(rotor_speed))


def _slopes(compiled: CompiledModel, p: Array, psi: Array, rotor_speed: float) -> Array:
    """Derivatives of readings to states (K, m, n) at rest, at azimuths (K,)."""
    n, m, loads = len(compiled.states), compiled.readings, len(compiled.loads)
    found = np.zeros((len(psi), m, n))
    inputs, value = np.zeros(len(compiled.inputs)), np.zeros(m)
    D, E = np.zeros((m, len(compiled.identified))), np.zeros((m, loads))
    for slope, angle in zip(found, psi.tolist(), strict=True):
        for name, known in (("rotor_azimuth", angle), ("rotor_speed", rotor_speed)):
            if name in compiled.inputs:
                inputs[compiled.inputs.index(name)] = known
        compiled.reading_jacobian(np.zeros(n), inputs, p, np.zeros(loads), value, slope, D, E)
    return found


def _by_channel(readings: Complex, channels: list[str], psi: Array, turning: bool) -> list[dict[str, complex]]:
    """Shape of each mode by channel, of readings (K, m, modes) at azimuths (K,)."""
    sets, _ = blade_sets(channels) if turning else ([], [])
    parts = {name: readings[:, i].mean(axis=0) for i, name in enumerate(channels)}
    for one in sets:
        Y = readings[:, list(one.columns)]
        count = len(one.columns)
        angle = psi[:, None] + 2.0 * math.pi * np.arange(count) / count
        parts[f"blades_{one.what} collective"] = Y.mean(axis=(0, 1))
        for way, sign in (("forward", 1j), ("backward", -1j)):
            pattern = np.mean(np.sum(Y * np.exp(sign * angle)[:, :, None], axis=1), axis=0)
            parts[f"blades_{one.what} {way}"] = 2.0 / count * pattern
    return [{name: complex(values[j]) for name, values in parts.items()} for j in range(readings.shape[2])]


def linearised_shape(mode: LinearisedMode, rotor_speed: float, channels: Sequence[str]) -> dict[str, complex]:
    """Shape of a mode of a linearised model at the tower top and the blade tips, as accelerations by channel.

    Deflections of ElastoDyn are those of the tower top and of blade tips; side-side is positive against sway. Not in
    the file are the height, by which a platform's rotations move the top the same way, and the roll of the top, which
    moves all tips alike: the collective part is left out where the tower moves more. Azimuths of OpenFAST are a
    quarter turn smaller.
    """
    omega, ratio = 2.0 * math.pi * mode.frequency.estimate, mode.damping_ratio.estimate
    exponent = complex(-ratio * omega / math.sqrt(max(1.0 - ratio**2, 1e-6)), omega)

    def part(kind: str) -> complex:
        return mode.shape.get(kind, 0.0j)

    square = exponent**2
    along = square * (part("tower fore-aft") + part("platform surge"))
    across = square * (part("platform sway") - part("tower side-side"))
    found = {**dict.fromkeys(FORE_AFT, along), **dict.fromkeys(SIDE_SIDE, across)}
    together = -square * part("edge collective")
    for name in TIPS:
        if abs(together) > abs(across):
            found[f"{name} collective"] = together
        for way, turn in (("forward", 1j), ("backward", -1j)):
            own = (exponent - turn * rotor_speed) ** 2 * part(f"edge {way}")
            found[f"{name} {way}"] = -turn * (own + across)
    return {name: value for name, value in found.items() if name in channels}
