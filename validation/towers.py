"""Towers that are not as they are taken for: is a wrong number ever trusted?

A tower of two degrees of freedom, side-side and fore-aft, is integrated here by itself, by the classical Runge–Kutta
method at 100 Hz, from loads of first order, and read by accelerometers that measure gravity as the top leans. It shares
no code with windsysid's mechanics, simulation or filters; values are those of the packaged file ``tower``. Each kind
has one thing that the file does not say: in the structure, its loads or its instruments. Records are 600 s long at 20
Hz, identified by `identify` with priors drawn about the truth.

``python -m validation.towers [--runs N] [--first SEED] [--only NAME …]`` prints the grades of the coefficients of each
kind, how often ±2σ covers the true value, the worst error of a coefficient of grade A or B, and the reasons given
first.
"""

import argparse
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.signal import lfilter

from validation.adversary.campaign import cause_of
from windsysid._types import Array
from windsysid.identification.identify import identify
from windsysid.output.console import render
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["KINDS", "Kind", "main", "record", "simulate"]

STEPS, RATE = 100, 20
"""Of the integration and of the record, a second."""

DURATION, LEAD_IN = 600.0, 200.0
"""[s]"""

FRESH = 310_000

DIRECTIONS = ("side_side", "fore_aft")
MOTION = np.array([0.0064, 0.0132])
"""Standard deviations of the healthy tower's displacements [m]."""

SLIDE = 1e-4
"""[m/s] Over which dry friction turns round."""

Loads = Callable[[Array, np.random.Generator], Array]


@dataclass(frozen=True)
class Kind:
    """Properties of a tower that its file does not give.

    Parameters
    ----------
    hardening
        By how much its springs are stiffer at one standard deviation of its motion, as a share.
    friction
        Dry friction, as a share of the loads' standard deviations.
    drag
        By how much its dampers are stronger at one standard deviation of its velocity, as a share.
    play
        Half the gap in its springs, in standard deviations of its motion.
    drift
        By how much stiffness grows from the first sample to the last, as a share.
    damping
        How many times the file's its damping is, side to side.
    loads, reads
        What is done to the loads (T, 2) at `STEPS` a second, and to the readings (T, 2).
    """

    hardening: float = 0.0
    friction: float = 0.0
    drag: float = 0.0
    play: float = 0.0
    drift: float = 0.0
    damping: float = 1.0
    loads: Loads = lambda loads, rng: loads
    reads: Loads = lambda readings, rng: readings

    @property
    def tower(self) -> Turbine:
        """The file's tower with its own damping."""
        tower = load_turbine("tower")
        return tower.with_values({"c_side_side": self.damping * tower.values["c_side_side"]})


def _seconds(samples: int) -> Array:
    return np.asarray(np.arange(samples) / STEPS)


def _narrow(frequency: float, damping: float, level: float, which: int) -> Loads:
    """A narrow-band process in addition to the loads, its standard deviation in theirs."""

    def add(loads: Array, rng: np.random.Generator) -> Array:
        omega = 2.0 * math.pi * frequency
        pole = np.exp((-damping + 1j * math.sqrt(1.0 - damping**2)) * omega / STEPS)
        x = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(len(loads)))
        loads = loads.copy()
        loads[:, which] += level * loads[:, which].std() * x / x.std()
        return loads

    return add


def _line(frequency: float, share: float, which: int) -> Loads:
    """A sine in addition to the loads, with a share of their power."""

    def add(loads: Array, rng: np.random.Generator) -> Array:
        loads, phase = loads.copy(), rng.uniform(0.0, 2.0 * math.pi)
        sine = np.sin(2.0 * math.pi * frequency * _seconds(len(loads)) + phase)
        loads[:, which] += math.sqrt(2.0 * share) * loads[:, which].std() * sine
        return loads

    return add


def _waves(frequency: float, level: float, which: int) -> Loads:
    """Waves of a young sea in addition to the loads, Hasselmann's (JONSWAP) spectrum with a peak factor of 7 about a
    frequency [Hz], their standard deviation in the loads'."""

    def add(loads: Array, rng: np.random.Generator) -> Array:
        f = np.fft.rfftfreq(len(loads), 1.0 / STEPS)[1:] / frequency
        peak = 7.0 ** np.exp(-0.5 * np.square((f - 1.0) / np.where(f > 1.0, 0.09, 0.07)))
        size = np.sqrt(f**-5 * np.exp(-1.25 * f**-4.0) * peak)
        drawn = size * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
        x = np.fft.irfft(np.concatenate([[0.0], drawn]), len(loads))
        loads = loads.copy()
        loads[:, which] += level * loads[:, which].std() * x / x.std()
        return loads

    return add


def _swelling(factor: float, period: float) -> Loads:
    """Loads that grow and fall by a factor."""

    def swell(loads: Array, rng: np.random.Generator) -> Array:
        return np.asarray(loads * (factor ** np.sin(2.0 * math.pi * _seconds(len(loads)) / period))[:, None])

    return swell


def _correlated(loads: Array, rng: np.random.Generator) -> Array:
    size = loads.std(axis=0)
    a, b = (loads / size).T
    return np.asarray(np.column_stack([a, 0.7 * a + math.sqrt(1.0 - 0.49) * b]) * size)


def _turned(degrees: float) -> Loads:
    """Accelerometers off their axes."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return lambda readings, rng: np.asarray(readings @ np.array([[c, -s], [s, c]]))


def _wandering(exponent: float, level: float) -> Loads:
    """Offsets whose power falls with a power of frequency, their standard deviation [m/s²] over the record."""

    def read(readings: Array, rng: np.random.Generator) -> Array:
        f = np.fft.rfftfreq(len(readings), 1.0 / RATE)[1:]
        parts = rng.standard_normal((2, len(f), 2)) * f[:, None] ** (-0.5 * exponent)
        wander = np.fft.irfft(np.vstack([np.zeros(2), parts[0] + 1j * parts[1]]), len(readings), axis=0)
        return np.asarray(readings + level * wander / wander.std(axis=0))

    return read


def _silent(readings: Array, rng: np.random.Generator) -> Array:
    readings = readings.copy()
    readings[len(readings) // 2 :, 1] = 0.0
    return readings


KINDS: dict[str, Kind] = {
    "healthy": Kind(),
    "damping 3 × the file's": Kind(damping=3.0),
    "damping 6 × the file's": Kind(damping=6.0),
    "half the file's damping": Kind(damping=0.5),
    "friction of 3 %": Kind(friction=0.03),
    "friction of 10 %": Kind(friction=0.1),
    "hardening by 10 %": Kind(hardening=0.1),
    "hardening by 30 %": Kind(hardening=0.3),
    "drag": Kind(drag=1.0),
    "play of 0.3 σ": Kind(play=0.3),
    "stiffness drifts by 5 %": Kind(drift=0.05),
    "hump fore-aft, 0.36 Hz": Kind(loads=_narrow(0.36, 0.05, 0.3, 1)),
    "hump side-side, 0.30 Hz": Kind(loads=_narrow(0.30, 0.05, 0.3, 0)),
    "narrow band, 0.34 Hz": Kind(loads=_narrow(0.34, 0.003, 0.2, 1)),
    "faint band, 0.335 Hz": Kind(loads=_narrow(0.335, 0.003, 0.1, 1)),
    "faint and wide, 0.335 Hz": Kind(loads=_narrow(0.335, 0.015, 0.1, 1)),
    "all but a line, 0.31 Hz": Kind(loads=_narrow(0.31, 0.001, 0.4, 1)),
    "waves, 0.31 Hz": Kind(loads=_waves(0.31, 0.15, 1)),
    "line 5 % from fore-aft": Kind(loads=_line(0.34, 0.04, 1)),
    "loads swell 3 x in 100 s": Kind(loads=_swelling(3.0, 100.0)),
    "loads correlated 0.7": Kind(loads=_correlated),
    "sensors turned by 5°": Kind(reads=_turned(5.0)),
    "offsets wander": Kind(reads=_wandering(2.0, 0.05)),
    "flicker noise": Kind(reads=_wandering(1.0, 0.02)),
    "sensor silent for a half": Kind(reads=_silent),
    "readings cut off at 1.2 σ": Kind(reads=lambda y, rng: np.clip(y, -1.2 * y.std(axis=0), 1.2 * y.std(axis=0))),
}


@njit(cache=True)  # type: ignore[untyped-decorator]
def _acceleration(n: Array, j: int, q: float, rate: float, load: float, stiffness: float) -> float:
    m, k, c, hardening, friction, drag, play = n[:, j]
    bent = np.sign(q) * max(0.0, abs(q) - play) if play > 0.0 else q * (1.0 + hardening * q * q)
    spring = k * stiffness * bent
    damper = c * rate * (1.0 + drag * abs(rate)) + friction * np.tanh(rate / SLIDE)
    return float((load - spring - damper) / m)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _move(n: Array, loads: Array, drift: float, step: float, found: Array, accelerations: Array) -> None:
    for j in range(2):
        q, r = 0.0, 0.0
        for i in range(len(loads) - 1):
            now, then = loads[i, j], loads[i + 1, j]
            mid, stiffness = 0.5 * (now + then), 1.0 + drift * (i / len(loads) - 0.5)
            a1 = _acceleration(n, j, q, r, now, stiffness)
            found[i, j], accelerations[i, j] = q, a1
            r2 = r + 0.5 * step * a1
            a2 = _acceleration(n, j, q + 0.5 * step * r, r2, mid, stiffness)
            r3 = r + 0.5 * step * a2
            a3 = _acceleration(n, j, q + 0.5 * step * r2, r3, mid, stiffness)
            r4 = r + step * a3
            a4 = _acceleration(n, j, q + step * r3, r4, then, stiffness)
            q += step / 6.0 * (r + 2.0 * r2 + 2.0 * r3 + r4)
            r += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


def record(name: str, seed: int) -> Record:
    """A record of a kind."""
    return simulate(name, seed)[0]


def simulate(name: str, seed: int) -> tuple[Record, dict[str, float]]:
    """A record of a kind, and its tower's stiffness and damping: where drag or dry friction F act in addition to the
    damper, the linear one that takes as much power out of this motion, c (1 + drag E|q̇|³/E q̇²) + F E|q̇|/E q̇²."""
    kind, rng = KINDS[name], np.random.default_rng(seed)
    tower = kind.tower
    v, count = tower.values, int((DURATION + LEAD_IN) * STEPS) + 1
    given = {load.load: load for load in tower.loads}
    drawn, sizes = [], []
    for direction in DIRECTIONS:
        load = given[f"load_{direction}"]
        kept = math.exp(-1.0 / STEPS / load.time_constant)
        white = load.rms * math.sqrt(1.0 - kept**2) * rng.standard_normal(count)
        drawn.append(lfilter([1.0], [1.0, -kept], white))
        sizes.append(load.rms)
    loads = kind.loads(np.column_stack(drawn), rng)
    omega = np.sqrt([v[f"k_{d}"] / v[f"mass_{d}"] for d in DIRECTIONS])
    numbers = np.array([
        *([v[f"{what}_{d}"] for d in DIRECTIONS] for what in ("mass", "k", "c")), kind.hardening / MOTION**2,
        kind.friction * np.array(sizes), kind.drag / (MOTION * omega), kind.play * MOTION,
    ])  # fmt: skip
    q, a = np.zeros((count, 2)), np.zeros((count, 2))
    _move(numbers, np.ascontiguousarray(loads), kind.drift, 1.0 / STEPS, q, a)
    rate = np.abs(np.gradient(q[int(LEAD_IN * STEPS) : -1], 1.0 / STEPS, axis=0))
    power = numbers[2] * numbers[5] * np.mean(rate**3, axis=0) + numbers[4] * np.mean(rate, axis=0)
    more = power / np.mean(rate**2, axis=0)
    true = dict(v) | {f"c_{d}": v[f"c_{d}"] + float(c) for d, c in zip(DIRECTIONS, more, strict=True)}
    at = slice(int(LEAD_IN * STEPS), count - 1, STEPS // RATE)
    exact = a[at] - v["gravity"] * v["tilt"] * q[at]
    y = kind.reads(exact + rng.standard_normal(exact.shape) * [sensor.noise for sensor in tower.sensors], rng)
    time = np.arange(len(y)) / RATE
    turning = np.column_stack([np.mod(tower.rotor_speed * time, 2.0 * np.pi), np.full(len(y), tower.rotor_speed)])
    made = Record(
        time, np.column_stack([turning, y]),
        ("rotor_azimuth", "rotor_speed", *(sensor.channel for sensor in tower.sensors)),
        ("rad", "rad/s", *(sensor.unit for sensor in tower.sensors)), name=name,
    )  # fmt: skip
    return made, true


def main(given: Sequence[str] | None = None) -> None:
    """Print the table."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.towers", description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="records of each kind (10)")
    parser.add_argument("--first", type=int, default=FRESH, help=f"seed of the first ({FRESH})")
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="kinds whose names begin so (all)")
    options = parser.parse_args(given)
    table = Table(
        title="Towers by `identify`: grades and how often ±2σ holds, in % of coefficients", title_justify="left"
    )
    for heading in ("kind", "n", "A", "B", "C", "all", "of A and B", "worst of A and B, σ", "named first"):
        table.add_column(heading, justify="left" if heading in ("kind", "named first") else "right")
    tower = load_turbine("tower")
    for name in (name for name in KINDS if name.startswith(tuple(options.only))):
        errors, reasons = dict[str, list[float]](A=[], B=[], C=[]), Counter[str]()
        for seed in range(options.first, options.first + options.runs):
            made, true = simulate(name, seed)
            found = identify(made, tower, prior=DrawnPrior(seed=seed))
            for e in found.estimates:
                errors[e.grade].append((e.estimate - true[e.name]) / e.std)
            first = [finding for finding in found.findings if finding.severity == "reason"][:1]
            reasons.update(_cause(reason) for reason in first)
        usable = errors["A"] + errors["B"]
        every = usable + errors["C"]
        shares = [f"{100.0 * len(of) / len(every):.0f}" for of in errors.values()]
        held = [f"{100.0 * np.mean(np.abs(z) < 2.0):.0f}" if z else "" for z in (every, usable)]
        worst = f"{np.max(np.abs(usable)):.1f}" if usable else ""
        said = ", ".join(f"{cause} {count}" for cause, count in reasons.most_common())
        table.add_row(name, str(options.runs), *shares, *held, worst, said)
    print(render(table))


def _cause(reason: Finding) -> str:
    """Cause that a reason names."""
    return "disagreement" if reason.code == "formulations_disagree" else cause_of(reason.summary())


if __name__ == "__main__":
    main()
