"""The Campbell diagram: frequencies and damping ratios of all modes against rotor speed, with the bands that follow
from a posterior.

Modes are found at each of a row of speeds (`windsysid.modal.analysis`) and linked (`windsysid.modal.tracking`). What is
asked of them: how far each stays from the harmonics nP of the rotor over the operating range, and whether any grows
(`windsysid.modal.stability`). Bands are ±2σ by the delta method, σ_f² = ∂f/∂θ Σ ∂f/∂θᵀ. Source: Burton et al., Wind
Energy Handbook (3rd ed. 2021), ch. 5.
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import Spectrum, analyse, analyse_unlocked, directions_of
from windsysid.modal.stability import NEUTRAL_GROWTH, GroundResonance, meeting_speed, unstable_ranges
from windsysid.modal.tracking import bends, link
from windsysid.output.progress import Progress, unheard
from windsysid.results.coercion import PosteriorLike, as_posterior
from windsysid.results.posterior import SIGMAS, Posterior
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

if TYPE_CHECKING:
    pass

from windsysid.modal.campbell import Campbell

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
    """Modes against rotor speed: of a turbine file, without bands, or of an identification, with the bands of its
    posterior.

    Parameters
    ----------
    source
        A turbine, its packaged name or TOML file; or what was identified, or the folder it was saved in.
    speeds
        Least and greatest rotor speed of the diagram [rad/s]; 0.1 and 1.3 times the usual one by default.
    operating
        Least and greatest operating speed [rad/s]; 10 % around the usual one by default.
    progress
        Told what is being done and its share that is done, 0 to 1; None where nobody knows.

    Returns
    -------
    Campbell
        Frequencies [Hz] and damping ratios [1] over rotor speed [rad/s], and their distance from the harmonics.

    Raises
    ------
    ConfigurationError
        If a range of speeds is none, or no mode can be found in it.
    """
    if isinstance(source, str | Path) and not Path(source).is_dir():
        source = as_turbine(source)
    if isinstance(source, Turbine):
        posterior = Posterior(source, (), np.zeros(0), np.zeros((0, 0)), "", True)
    else:
        posterior = as_posterior(source)
    machine = _Machine(posterior)
    usual = machine.turbine.rotor_speed
    parked = usual == 0.0 and operating is None
    usually = (0.1 * usual, 1.3 * usual) if usual > 0.0 else (0.0, 0.5 * machine.turbine.slowest_frequency)
    chosen = _checked("speeds", speeds or usually)
    working = (0.0, 0.0)
    if not parked:
        working = _checked(
            "operating range", operating or ((1.0 - OPERATING_SHARE) * usual, (1.0 + OPERATING_SHARE) * usual)
        )
    chosen = (min(chosen[0], working[0]), max(chosen[1], working[1]))
    reference = usual if chosen[0] <= usual <= chosen[1] else 0.5 * (working[0] + working[1])
    known: dict[float, Spectrum] = {}
    left_out: dict[str, list[float]] = {}
    new = [*np.linspace(*chosen, DIAGRAM_SPEEDS).tolist(), *np.linspace(*working, OPERATING_SPEEDS).tolist(), reference]
    for _ in range(REFINEMENT_ROUNDS):
        for i, speed in enumerate(new):
            progress(f"modes at {speed * RPM:.3g} rpm", i / len(new))
            try:
                known[speed] = machine.spectrum(speed)
            except ConfigurationError as error:
                left_out.setdefault(str(error), []).append(speed)
        if not known:
            raise ConfigurationError(next(iter(left_out)))
        grid = np.array(sorted(known))
        grid = grid[np.diff(grid, prepend=-1.0) > 1e-9 * grid[-1]]
        found = [known[speed] for speed in grid.tolist()]
        at = int(np.argmin(np.abs(grid - reference)))
        curves = link(found, grid, at, posterior.cov)
        new = bends(curves, grid)
        if not new:
            break
    if not curves:
        raise ConfigurationError(
            f"turbine '{machine.turbine.name}': nothing oscillates between {grid[0] * RPM:.3g} and"
            f" {grid[-1] * RPM:.3g} rpm"
        )
    progress("stability", None)
    unstable = unstable_ranges(lambda s: known[s].growth if s in known else machine.growth(s), grid)
    notes = [*machine.notes(found[at].method, posterior), *(
        f"left out, {len(where)} speeds up to {max(where) * RPM:.3g} rpm: {why}" for why, where in left_out.items()
    )]  # fmt: skip
    N = machine.turbine.model.blades
    return Campbell(
        machine.turbine.name, posterior.record or None, bool(posterior.parameters), grid, at, working,
        () if parked or not N else tuple(sorted({1, N, 2 * N})),
        curves, tuple(unstable), () if parked else tuple(machine.ground_resonance(working)), found[at].method,
        tuple(notes),
    )  # fmt: skip


class _Machine:
    """A turbine compiled, with what is known of its coefficients."""

    def __init__(self, posterior: Posterior) -> None:
        self.turbine, self.parameters = posterior.turbine, posterior.parameters
        self.cov = posterior.cov
        self.model = compile_model(self.turbine.model)
        self.p = np.array([self.turbine.values[name] for name in self.model.parameters])
        self.directions = directions_of(self.model, self.parameters, posterior.theta)

    def spectrum(self, speed: float) -> Spectrum:
        """The modes at a speed, or a hair beside it where a mode is locked so narrowly that its band would vanish."""
        return analyse_unlocked(self.turbine.model, self.model, self.p, speed, self.directions)

    def growth(self, speed: float) -> float:
        return analyse(self.turbine.model, self.model, self.p, speed).growth

    def notes(self, method: str, posterior: Posterior) -> list[str]:
        """How it was computed, and from what."""
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
            how + (f"; bands are ±{SIGMAS:g}σ of the posterior, by exact derivatives" if posterior.parameters else "")
        ]
        if method == "Floquet" and self.turbine.model.blades == 2:
            notes.append(
                "two blades: lag differential is given as the blades feel it; the ground feels it at f − Ω, backward"
                " where f > Ω, and at f + Ω, forward"
            )
        if not posterior.parameters:
            notes.append(
                "the turbine file's values are taken as exact: bands come with the result of an identification"
            )
        elif not posterior.trusted:
            notes.append(
                "WARNING: the identification is not trusted (its summary says why): the bands may be too narrow"
            )
        return notes

    def ground_resonance(self, operating: tuple[float, float]) -> list[GroundResonance]:
        """Where lag and support meet, for each direction in which the support moves."""
        turbine = self.turbine
        if turbine.model.modes().hinged_blades < 2:
            return []
        found = []
        for axis in ("x", "y"):
            if axis not in turbine.model.coordinates:
                continue
            centre = meeting_speed(turbine, axis)
            if centre is None:
                continue
            slopes = []
            for q, direction in zip(self.parameters, self.directions, strict=True):
                step = 1e-4 * float(np.abs(direction).max())
                moved = (
                    meeting_speed(turbine.with_values({q.name: turbine.values[q.name] + sign * step}), axis)
                    for sign in (1, -1)
                )
                above, below = (value if value is not None else centre for value in moved)
                slopes.append((above - below) / 2e-4)
            std = math.sqrt(max(float(np.array(slopes) @ self.cov @ np.array(slopes)), 0.0)) if slopes else 0.0
            speed = (centre, centre - SIGMAS * std, centre + SIGMAS * std)
            low, high = operating
            end = high if centre > high else low
            margin = (
                tuple(value / end - 1.0 for value in speed) if not low <= centre <= high and end > 0.0 else (0.0,) * 3
            )
            try:
                there = self.spectrum(centre)
            except ConfigurationError:
                continue
            i = int(np.argmin(there.damping))
            slope = there.frequency_and_damping_slopes()[1][i]
            spread = SIGMAS * math.sqrt(max(float(slope @ self.cov @ slope), 0.0))
            z = float(there.damping[i])
            found.append(
                GroundResonance(
                    axis,
                    speed,
                    (margin[0], margin[1], margin[2]),
                    (z, z - spread, z + spread),
                    there.growth > NEUTRAL_GROWTH * centre,
                )
            )
        return found


def _checked(what: str, ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not (math.isfinite(low) and math.isfinite(high) and 0.0 <= low <= high and high > 0.0):
        raise ConfigurationError(
            f"{what}: expected two rotor speeds from 0 on, the lower first, got {low * RPM:.4g} and"
            f" {high * RPM:.4g} rpm"
        )
    return low, high
