"""Shear frames of N storeys: do the bands of spectra hold stiffness and damping of every storey, from output alone?

Unit masses; springs k_i and dampers c_i between floors, and a damper a from every floor to the ground, so that the
lowest and the highest mode have 1 % (Rayleigh). Unmeasured white forces act on every floor; a geophone with 1 %
of noise on every floor; 600 s at 50 Hz. The frame is sampled exactly, by the matrix exponential. Priors are drawn about
the truth: 30 % for stiffness, 50 % for damping, a factor 2 for the levels of forces and noise. Seeds begin at `FRESH`.

``python -m validation.frames [--storeys N …] [--runs R] [--seconds S]`` prints the table.
"""

import argparse
import math
import time
from typing import NamedTuple

import numpy as np
import sympy as sp

import windsysid as ws
from validation.oma import record, responses
from windsysid._types import Array

FRESH = 64_000
RATE = 50.0
HIGHEST = 12.0
"""Of the natural frequencies [Hz]."""

DAMPING = 0.01
"""Of the lowest mode and the highest."""

WHITE = 1e-3
"""Time constant of the forces' model [s]: white as far as the modes reach."""


class Frame(NamedTuple):
    """Equations, readings (noise 1), true parameters, modes (f, ζ) and shapes for unit modal masses (N, N)."""

    equations: ws.models.Equations
    velocities: tuple[sp.Symbol, ...]
    truth: dict[str, float]
    modes: list[tuple[float, float]]
    shapes: Array


def shear_frame(storeys: int) -> Frame:
    """A frame whose storeys are alike; who identifies it does not know that."""
    x, v, k, c, w = ([sp.Symbol(f"{n}_{i}", real=True) for i in range(1, storeys + 1)] for n in "xvkcw")
    a = sp.Symbol("a", real=True)
    drift = [x[0], *(x[i] - x[i - 1] for i in range(1, storeys))]
    rate = [v[0], *(v[i] - v[i - 1] for i in range(1, storeys))]
    shear = [k[i] * drift[i] + c[i] * rate[i] for i in range(storeys)]
    above = [*shear[1:], sp.Integer(0)]
    accelerations = [w[i] - shear[i] + above[i] - a * v[i] for i in range(storeys)]
    equations = ws.models.Equations(
        f"frame_{storeys}", (*x, *v), (), (*k, *c, a), tuple(w), (*v, *accelerations)
    )  # fmt: skip
    pattern = 2.0 * np.eye(storeys) - np.eye(storeys, k=1) - np.eye(storeys, k=-1)
    pattern[-1, -1] = 1.0
    squares, shapes = np.linalg.eigh(pattern)
    omega = 2.0 * math.pi * HIGHEST * np.sqrt(squares / squares[-1])
    stiffness = float(omega[-1] ** 2 / squares[-1])
    low, high = omega[0], omega[-1]
    beta, alpha = 2.0 * DAMPING / (low + high), 2.0 * DAMPING * low * high / (low + high)
    truth = {f"k_{i}": stiffness for i in range(1, storeys + 1)}
    truth |= {f"c_{i}": beta * stiffness for i in range(1, storeys + 1)} | {"a": alpha}
    modes = [(float(o / (2.0 * math.pi)), float(0.5 * (alpha / o + beta * o))) for o in omega]
    return Frame(equations, tuple(v), truth, modes, shapes)


def errors(frame: Frame, seed: int, seconds: float) -> tuple[Array, Array, float, bool]:
    """Errors of the stiffness and of the damping in their σ, processor time [s], and whether the result was trusted."""
    rng = np.random.default_rng(seed)
    y = responses(frame.modes, frame.shapes.T, RATE, round(seconds * RATE), rng) @ frame.shapes.T
    noise = 0.01 * y.std(axis=0)
    measured = record(y + noise * rng.normal(size=y.shape), RATE)
    parameters = []
    for name, value in frame.truth.items():
        if name.startswith("k"):
            parameters.append(ws.models.Parameter(name, value * math.exp(0.3 * rng.normal()), 0.3))
        else:
            centre = value * (1.0 + 0.5 * rng.normal())
            parameters.append(ws.models.Parameter(name, centre, 0.5 * value, logarithmic=False, scale=value))
    level = math.sqrt(0.5 / WHITE)  # two-sided density 2 σ² τ = 1
    loads = [
        ws.models.GaussMarkov(f"w_{i + 1}", level * math.exp(0.7 * rng.normal()), WHITE)
        for i in range(len(frame.velocities))
    ]
    sensors = [
        ws.models.Reading(channel, velocity, float(n) * math.exp(0.7 * rng.normal()))
        for channel, velocity, n in zip(measured.channels, frame.velocities, noise, strict=True)
    ]
    started = time.process_time()
    found = ws.models.fit(
        frame.equations, measured, parameters=parameters, sensors=sensors, loads=loads, formulation="spectral"
    )
    elapsed = time.process_time() - started
    truth = np.array([q.coordinate(frame.truth[q.name]) for q in parameters])
    z, stiff = (found.mean[-1] - truth) / found.std[-1], np.array([q.name.startswith("k") for q in parameters])
    return z[stiff], z[~stiff], elapsed, found.diagnosis is not None and found.diagnosis.trusted


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--storeys", type=int, nargs="+", default=[5, 10, 20], help="of the frames (5 10 20)")
    parser.add_argument("--runs", type=int, default=10, help="records of each frame (10)")
    parser.add_argument("--seconds", type=float, default=600.0, help="length of a record (600)")
    given = parser.parse_args()
    print("| storeys | ±2σ holds k | c, a | mean error/σ | rms error/σ | trusted | processor time |")
    print("|---|---|---|---|---|---|---|")
    for storeys in given.storeys:
        frame = shear_frame(storeys)
        errors(frame, FRESH - 1, 60.0)  # compiles
        found = [errors(frame, FRESH + i, given.seconds) for i in range(given.runs)]
        k, c = (np.concatenate([f[i] for f in found]) for i in (0, 1))
        z = np.concatenate([k, c])
        held = [100.0 * float(np.mean(np.abs(part) < 2.0)) for part in (k, c)]
        print(
            f"| {storeys} | {held[0]:.1f} % | {held[1]:.1f} % | {z.mean():+.2f} | {np.sqrt(np.mean(z**2)):.2f} "
            f"| {sum(f[3] for f in found)} of {given.runs} | {np.median([f[2] for f in found]):.1f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main()
