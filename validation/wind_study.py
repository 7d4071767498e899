"""The published study under wind that changes direction, in figures and numbers (`windsysid.study.wind`).

python -m validation.wind_study --output DIR [--seed N]
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.errors import WindsysidError
from windsysid.output.console import render
from windsysid.simulation.wind import (
    packaged_wind,
)
from windsysid.study.wind import (
    ARMS,
    SPREAD_DEG,
    WINDOW,
    DirectionChangeStudy,
    direction_change_figure,
    direction_change_study,
    load_spectra_figure,
    mean_spectrum,
)

__all__ = ["main", "peak_ratios", "summary"]


def summary(study: DirectionChangeStudy) -> str:
    """The numbers as text."""
    once = study.turbine.rotor_speed / (2.0 * np.pi)
    wind, acted = study.steady.wind, study.steady.reference.inputs[:, 3:]
    conditions, _ = packaged_wind(study.turbine.name)
    rms = acted.std(axis=0)
    lines = [
        f"wind {conditions.speed:.2f} m/s, turbulence {100 * conditions.turbulence_intensity:.1f} %, "
        f"direction ±{SPREAD_DEG:g} deg, turning by {study.change_deg:.1f} deg at {WINDOW[0]:g} s "
        f"and back by {WINDOW[1]:g} s",
        f"hub wind: std {wind.hub_speed.std():.3f} m/s (target {conditions.std:.3f})",
        "load rms: " + ", ".join(
            f"{name} {value:.1f}" for name, value in zip(study.turbine.model.loads, rms, strict=True)
        ),
    ]  # fmt: skip
    blades = peak_ratios(wind.loads[:, 2:], once)
    hub = peak_ratios(wind.loads[:, :2], once)
    for label, ratios in (("blade lag moment", blades), ("hub forces", hub)):
        lines.append(f"{label}: peak over neighbourhood " + ", ".join(f"{m}P {r:.1f}" for m, r in ratios.items()))
    lines.append(
        "wander of the on-line estimate from 20 s to 40 s, % of the reference (in brackets: the wind not turning):"
    )
    for arm in ARMS:
        cells = [
            f"{name} {100 * study.wander(arm, name):.2f} ({100 * study.wander(arm, name, changed=False):.2f})"
            for name in ("k_x", "k_y", "c_x", "c_y")
        ]
        lines.append(f"  {arm}: " + ", ".join(cells))
    lines.append("estimate at the end, of the reference:")
    for arm in ARMS:
        found = study.arms[arm]
        cells = [f"{n} {found[n].estimate / study.turbine.values[n]:.4f}" for n in ("k_x", "k_y", "c_x", "c_y")]
        lines.append(f"  {arm}: " + ", ".join(cells))
    lines.append("damping when only the loads at rest are known (in brackets: structure + mean of C's diagonal):")
    own = dict(zip(study.turbine.model.coordinates, np.diagonal(study.under.wind.damping.mean(axis=0)), strict=True))
    cells = [
        f"c_{n} {study.loads_at_rest[f'c_{n}'].estimate:.2f} ({study.turbine.values[f'c_{n}']:g} + {own[n]:.2f})"
        for n in ("x", "y", "beta_1")
    ]
    lines.append("  " + ", ".join(cells))
    return "\n".join(lines)


def peak_ratios(loads: Array, once: float) -> dict[int, float]:
    """Height of the loads' (T, …) spectrum at 1P, 2P, 3P: peak over the median within ±0.45P."""
    frequency, spectrum = mean_spectrum(loads)
    ratios = {}
    for multiple in (1, 2, 3):
        away = np.abs(frequency / once - multiple)
        ratios[multiple] = float(spectrum[away < 0.05].max() / np.median(spectrum[(away < 0.45) & (away > 0.1)]))
    return ratios


def main(arguments: Sequence[str] | None = None) -> int:
    """Write ``direction_change.png`` and ``load_spectra.png`` and print the numbers."""
    parser = argparse.ArgumentParser(prog="python -m validation.wind_study", description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, required=True, help="folder of the two figures")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        study = direction_change_study(options.seed)
        direction_change_figure(study).savefig(options.output / "direction_change.png", dpi=150)
        load_spectra_figure(study).savefig(options.output / "load_spectra.png", dpi=150)
    except (WindsysidError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(render(summary(study)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
