"""Coverage of ±2σ of modes from free decays, and refusal of ambient vibration.

    python -m validation.decays --runs 60

Decays are sums of damped sinusoids in closed form; their amplitudes and phases are drawn anew in each run. Ambient
vibration is that of oscillators under white noise, simulated exactly.
"""

import argparse
import time
from typing import NamedTuple

import numpy as np

import windsysid as ws
from windsysid._types import Array
from windsysid.errors import RecordError

__all__ = ["CASES", "Case", "Outcome", "ambient", "judge", "main", "records_of"]

RATE, CHANNELS = 50.0, 4


class Case(NamedTuple):
    """Modes (f [Hz], ζ), noise over the largest amplitude and its correlation from sample to sample, records."""

    name: str
    modes: tuple[tuple[float, float], ...]
    noise: float = 0.02
    correlation: float = 0.0
    records: int = 1
    ambient_before: float = 0.0


CASES = (
    Case("one mode", ((1.0, 0.01),)),
    Case("three modes", ((0.8, 0.012), (2.1, 0.008), (5.3, 0.015))),
    Case("close pair, 3 % apart", ((1.0, 0.01), (1.03, 0.012), (3.2, 0.008))),
    Case("noise of a tenth", ((1.0, 0.01), (2.7, 0.02)), noise=0.1),
    Case("coloured noise", ((1.0, 0.01), (2.7, 0.02)), noise=0.05, correlation=0.9),
    Case("20 s before the release", ((1.0, 0.01), (2.7, 0.02)), ambient_before=20.0),
    Case("22 short records", ((1.0, 0.01), (2.7, 0.02)), noise=0.1, records=22),
)


class Outcome(NamedTuple):
    """Modes that are true, found, and of grade A or B; other modes of these grades; errors [σ] (k, 2) of ln f, ln ζ."""

    true: int
    found: int
    usable: int
    spurious: int
    errors: Array


def records_of(case: Case, seed: int) -> list[ws.Record]:
    """Records of one run."""
    rng = np.random.default_rng(seed)
    duration = 12.0 if case.records > 1 else 60.0
    shapes = rng.normal(size=(len(case.modes), CHANNELS))
    return [_record(case, shapes, duration, rng) for _ in range(case.records)]


def _record(case: Case, shapes: Array, duration: float, rng: np.random.Generator) -> ws.Record:
    t = np.arange(0.0, case.ambient_before + duration, 1.0 / RATE)
    values = np.zeros((len(t), CHANNELS))
    after = np.maximum(t - case.ambient_before, 0.0)
    for (f, z), shape in zip(case.modes, shapes, strict=True):
        omega = 2.0 * np.pi * f
        wave = np.exp(-z * omega * after) * np.cos(omega * np.sqrt(1.0 - z**2) * after + rng.uniform(0.0, 2.0 * np.pi))
        values += np.outer(np.where(t >= case.ambient_before, wave, 0.0), shape)
    noise = rng.normal(size=values.shape)
    for k in range(1, len(t)):
        noise[k] = case.correlation * noise[k - 1] + np.sqrt(1.0 - case.correlation**2) * noise[k]
    values += case.noise * noise
    names = tuple(f"level_{i + 1}_acceleration" for i in range(CHANNELS))
    return ws.Record(t, values, names, ("m/s^2",) * CHANNELS)


def judge(case: Case, seed: int) -> Outcome:
    """Compare the modes of one run with the truth; one within 2 % and nearest counts as found."""
    modes = list(ws.free_decay(records_of(case, seed)).modes)
    errors, found, usable = [], 0, 0
    for f, z in case.modes:
        near = [mode for mode in modes if abs(mode.frequency.estimate / f - 1.0) < 0.012]
        if near:
            best = min(near, key=lambda mode: abs(mode.frequency.estimate - f))
            modes.remove(best)
            found, usable = found + 1, usable + best.trusted
            if best.trusted:
                step = np.log(best.frequency.estimate / f) / best.frequency.relative_std
                errors.append((step, np.log(best.damping_ratio.estimate / z) / best.damping_ratio.relative_std))
    spurious = sum(mode.trusted for mode in modes)
    return Outcome(len(case.modes), found, usable, spurious, np.array(errors).reshape(-1, 2))


def ambient(seed: int, duration: float) -> int:
    """Number of modes of grade A or B in ambient vibration that is taken for a decay."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / RATE)
    values = 0.01 * rng.normal(size=(len(t), CHANNELS))
    for f, z in ((1.0, 0.01), (2.7, 0.02)):
        omega = 2.0 * np.pi * f
        step = np.exp(omega * (-z + 1j * np.sqrt(1.0 - z**2)) / RATE)
        q = (rng.normal() + 1j * rng.normal()) / np.sqrt(2.0)
        wave = np.empty(len(t), dtype=np.complex128)
        for k in range(len(t)):
            q = step * q + np.sqrt(0.5 * (1.0 - abs(step) ** 2)) * (rng.normal() + 1j * rng.normal())
            wave[k] = q
        values += np.outer(wave.real, rng.normal(size=CHANNELS))
    names = tuple(f"level_{i + 1}_acceleration" for i in range(CHANNELS))
    try:
        return sum(m.trusted for m in ws.free_decay(ws.Record(t, values, names, ("m/s^2",) * CHANNELS)).modes)
    except RecordError:
        return 0


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=60, help="runs of each case")
    runs = parser.parse_args(arguments).runs
    print("| case | found | A or B | A or B, but none | f in ±2σ | ζ in ±2σ | rms z | seconds a run |")
    print("|---|---|---|---|---|---|---|---|")
    for case in CASES:
        begun = time.process_time()
        each = [judge(case, 7000 + seed) for seed in range(runs)]
        z = np.vstack([one.errors for one in each])
        inside, rms = 100.0 * np.mean(np.abs(z) < 2.0, axis=0), np.sqrt(np.mean(z**2, axis=0))
        true, found, usable, spurious = (sum(one[i] for one in each) for i in range(4))
        seconds = (time.process_time() - begun) / runs
        print(
            f"| {case.name} | {found} of {true} | {usable} | {spurious} | {inside[0]:.1f} % | {inside[1]:.1f} % "
            f"| {rms[0]:.2f}, {rms[1]:.2f} | {seconds:.2f} |"
        )
    for duration in (30.0, 120.0, 600.0):
        wrong = [ambient(9000 + seed, duration) for seed in range(runs)]
        print(f"ambient vibration of {duration:.0f} s: {sum(map(bool, wrong))} of {runs} records with a usable mode")


if __name__ == "__main__":
    main()
