"""The Campbell diagram: frequencies and damping ratios of all modes against rotor speed, with the intervals that follow
from a posterior.

Modes are found at each of a row of speeds (`windsysid.modal.analysis`) and linked (`windsysid.modal.tracking`). What is
computed from them: how far each stays from the harmonics nP of the rotor over the operating range, and whether any
grows (`windsysid.modal.stability`). Bands are ±2σ by the delta method, σ_f² = ∂f/∂θ Σ ∂f/∂θᵀ. Source: Burton et al.,
Wind Energy Handbook (3rd ed. 2021), ch. 5.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import ModalSpectrum, analyse, analyse_unlocked, directions_of
from windsysid.modal.campbell import Campbell
from windsysid.modal.stability import NEUTRAL_GROWTH, GroundResonance, meeting_speed, unstable_ranges
from windsysid.modal.tracking import Curve, bends, link
from windsysid.output.progress import Progress, unheard
from windsysid.results.coercion import PosteriorLike, as_posterior
from windsysid.results.posterior import SIGMAS, Posterior
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

__all__ = ["find_modes"]

DIAGRAM_SPEEDS = 41
"""Rotor speeds of a diagram; the operating range has `OPERATING_SPEEDS` of its own."""

OPERATING_SPEEDS = 9

REFINEMENT_ROUNDS = 5
"""Of refinement where a curve bends or ends: halfway between the speeds there."""

OPERATING_SHARE = 0.1
"""The operating range by default: the usual speed and this share of it to either side."""


def find_modes(
    source: "TurbineLike | PosteriorLike",
    *,
    speeds: tuple[float, float] | None = None,
    operating: tuple[float, float] | None = None,
    progress: Progress = unheard,
) -> Campbell:
    """Compute the modes over rotor speed (Campbell diagram) of a turbine file or of an identification.

    Parameters
    ----------
    source : Turbine, Identification, Posterior, str or Path
        A turbine, its packaged name or TOML file; or a result of `windsysid.identify`, or the folder it was saved in.
    speeds : (float, float), optional
        Lowest and highest rotor speed of the diagram [rad/s]; 0.1 and 1.3 times the usual one by default.
    operating : (float, float), optional
        Lowest and highest operating speed [rad/s]; 10 % around the usual one by default.
    progress : callable, optional
        Called with the present step and the share that is done, 0 to 1, or None if that is unknown.

    Returns
    -------
    Campbell
        Frequencies [Hz] and damping ratios [1] over rotor speed [rad/s], their distance from the harmonics, and, for an
        identification, the 95 % intervals of its posterior.

    Raises
    ------
    ConfigurationError
        If a range of speeds is empty, or no mode can be found in it.

    See Also
    --------
    read_linearisation : Modes of an OpenFAST model.
    oma : Modes from ambient vibration.

    References
    ----------
    Bir, Multiblade Coordinate Transformation and its Application to Wind Turbine Analysis, NREL/CP-500-42553, 2008.

    Examples
    --------
    >>> import windsysid as ws
    >>> diagram = ws.modes("tower")
    >>> usual = diagram.usual
    >>> for curve in diagram.curves:
    ...     print(f"{curve.name}: {curve.frequency[usual]:.3f} Hz, damping {100 * curve.damping[usual]:.1f} %")
    tower side-side: 0.316 Hz, damping 0.6 %
    tower fore-aft: 0.324 Hz, damping 6.0 %
    """
    posterior = _posterior(source)
    machine = _CompiledTurbine(posterior)
    chosen, working = _speed_ranges(machine.turbine, speeds, operating)
    usual = machine.turbine.rotor_speed
    reference = usual if chosen[0] <= usual <= chosen[1] else 0.5 * (working[0] + working[1])
    diagram = machine.diagram(chosen, working, reference, progress)
    progress("stability", None)
    known, method = diagram.known, diagram.known[float(diagram.speeds[diagram.at])].method
    unstable = unstable_ranges(lambda s: known[s].growth if s in known else machine.growth(s), diagram.speeds)
    N = machine.turbine.model.blades
    turns = any(working)
    return Campbell(
        machine.turbine.name, posterior.record or None, bool(posterior.parameters), diagram.speeds, diagram.at, working,
        tuple(sorted({1, N, 2 * N})) if turns and N else (),
        diagram.curves, tuple(unstable), tuple(machine.ground_resonance(working)) if turns else (), method,
        (*machine.notes(method, posterior), *diagram.notes),
    )  # fmt: skip


def _posterior(source: "TurbineLike | PosteriorLike") -> Posterior:
    """Coefficients of a turbine: its file's values, taken as exact, or those of an identification."""
    if isinstance(source, str | Path) and not Path(source).is_dir():
        source = as_turbine(source)
    if isinstance(source, Turbine):
        return Posterior(source, (), np.zeros(0), np.zeros((0, 0)), "", True)
    return as_posterior(source)


def _speed_ranges(
    turbine: Turbine, speeds: tuple[float, float] | None, operating: tuple[float, float] | None
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Rotor speeds [rad/s] of the diagram and of operation; both zero for the operation of a parked rotor."""
    usual = turbine.rotor_speed
    usually = (0.1 * usual, 1.3 * usual) if usual > 0.0 else (0.0, 0.5 * turbine.slowest_frequency)
    chosen, working = _checked("speeds", speeds or usually), (0.0, 0.0)
    if usual != 0.0 or operating is not None:
        around = ((1.0 - OPERATING_SHARE) * usual, (1.0 + OPERATING_SHARE) * usual)
        working = _checked("operating range", operating or around)
    return (min(chosen[0], working[0]), max(chosen[1], working[1])), working


class _Diagram(NamedTuple):
    """Speeds (S,) [rad/s] with the index of the reference, linked curves, spectra by speed, and omitted speeds."""

    speeds: Array
    at: int
    curves: tuple[Curve, ...]
    known: dict[float, ModalSpectrum]
    notes: list[str]


class _CompiledTurbine:
    """A compiled turbine, with the knowledge on its coefficients."""

    def __init__(self, posterior: Posterior) -> None:
        self.turbine, self.parameters = posterior.turbine, posterior.parameters
        self.cov = posterior.cov
        self.model = compile_model(self.turbine.model)
        self.p = np.array([self.turbine.values[name] for name in self.model.parameters])
        self.directions = directions_of(self.model, self.parameters, posterior.theta)

    def spectrum(self, speed: float) -> ModalSpectrum:
        """The modes at a speed, or a hair next to it where a mode is locked so narrowly that its interval would
        vanish."""
        return analyse_unlocked(self.turbine.model, self.model, self.p, speed, self.directions)

    def diagram(
        self, chosen: tuple[float, float], working: tuple[float, float], reference: float, progress: Progress
    ) -> _Diagram:
        """Modes at speeds of both ranges, refined where a curve bends or ends."""
        known: dict[float, ModalSpectrum] = {}
        left_out: dict[str, list[float]] = {}
        new = [*np.linspace(*chosen, DIAGRAM_SPEEDS), *np.linspace(*working, OPERATING_SPEEDS), reference]
        for _ in range(REFINEMENT_ROUNDS):
            for i, speed in enumerate(map(float, new)):
                progress(f"modes at {speed * RPM:.3g} rpm", i / len(new))
                try:
                    known[speed] = self.spectrum(speed)
                except ConfigurationError as error:
                    left_out.setdefault(str(error), []).append(speed)
            if not known:
                raise ConfigurationError(next(iter(left_out)))
            grid = np.array(sorted(known))
            grid = grid[np.diff(grid, prepend=-1.0) > 1e-9 * grid[-1]]
            at = int(np.argmin(np.abs(grid - reference)))
            curves = link([known[speed] for speed in grid.tolist()], grid, at, self.cov)
            new = bends(curves, grid)
            if not new:
                break
        if not curves:
            raise ConfigurationError(
                f"turbine '{self.turbine.name}': no mode oscillates between {grid[0] * RPM:.3g} and"
                f" {grid[-1] * RPM:.3g} rpm"
            )
        notes = [f"left out, {len(s)} speeds up to {max(s) * RPM:.3g} rpm: {why}" for why, s in left_out.items()]
        return _Diagram(grid, at, curves, known, notes)

    def growth(self, speed: float) -> float:
        return analyse(self.turbine.model, self.model, self.p, speed).growth

    def notes(self, method: str, posterior: Posterior) -> list[str]:
        """Method and inputs of the computation."""
        why = self.turbine.model.modes().obstacles(dict(zip(self.model.parameters, self.p.tolist(), strict=True)))
        how = {
            "Coleman": (
                "multi-blade coordinates (Coleman): three or more equal blades, nothing that pulls in the rotor plane"
            ),
            "Floquet": (
                f"Floquet's theory about the periodic motion, Coleman's transform does not apply: {', '.join(why)}"
            ),
            "constant": "the equations are constant: the rotor is rigid",
        }[method]
        notes = [
            how + ("; 95 % intervals are those of the posterior, by exact derivatives" if posterior.parameters else "")
        ]
        if method == "Floquet" and self.turbine.model.blades == 2:
            notes.append(
                "two blades: lag differential is given in the rotating frame; in the fixed frame it is at f −"
                " Ω, backward"
                " where f > Ω, and at f + Ω, forward"
            )
        if not posterior.parameters:
            notes.append(
                "the turbine file's values are taken as exact: intervals come with the result of an identification"
            )
        elif not posterior.trusted:
            notes.append(
                "WARNING: the identification is not trusted (its summary says why): the intervals may be too narrow"
            )
        return notes

    def ground_resonance(self, operating: tuple[float, float]) -> list[GroundResonance]:
        """Coincidence of lag and support, for each direction in which the support moves."""
        if self.turbine.model.modes().hinged_blades < 2:
            return []
        found = (self._meeting(axis, operating) for axis in ("x", "y") if axis in self.turbine.model.coordinates)
        return [one for one in found if one is not None]

    def _meeting(self, axis: str, operating: tuple[float, float]) -> GroundResonance | None:
        """Coincidence of lag and support in a direction; None if there is none, or modes cannot be found there."""
        centre = meeting_speed(self.turbine, axis)
        if centre is None:
            return None
        std = self._meeting_std(axis, centre)
        speed = (centre, centre - SIGMAS * std, centre + SIGMAS * std)
        low, high = operating
        end = high if centre > high else low
        apart = not low <= centre <= high and end > 0.0
        margin = tuple(value / end - 1.0 for value in speed) if apart else (0.0,) * 3
        try:
            there = self.spectrum(centre)
        except ConfigurationError:
            return None
        i = int(np.argmin(there.damping))
        slope = there.frequency_and_damping_slopes()[1][i]
        spread = SIGMAS * math.sqrt(max(float(slope @ self.cov @ slope), 0.0))
        z = float(there.damping[i])
        grows = there.growth > NEUTRAL_GROWTH * centre
        return GroundResonance(axis, speed, (margin[0], margin[1], margin[2]), (z, z - spread, z + spread), grows)

    def _meeting_std(self, axis: str, centre: float) -> float:
        """Standard deviation [rad/s] of the speed at which lag and support meet."""
        slopes = []
        for q, direction in zip(self.parameters, self.directions, strict=True):
            step = 1e-4 * float(np.abs(direction).max())
            moved = (
                meeting_speed(self.turbine.with_values({q.name: self.turbine.values[q.name] + sign * step}), axis)
                for sign in (1, -1)
            )
            above, below = (value if value is not None else centre for value in moved)
            slopes.append((above - below) / 2e-4)
        return math.sqrt(max(float(np.array(slopes) @ self.cov @ np.array(slopes)), 0.0)) if slopes else 0.0


def _checked(what: str, ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not (math.isfinite(low) and math.isfinite(high) and 0.0 <= low <= high and high > 0.0):
        raise ConfigurationError(
            f"{what}: expected two rotor speeds from 0 on, the lower first, got {low * RPM:.4g} and"
            f" {high * RPM:.4g} rpm"
        )
    return low, high
