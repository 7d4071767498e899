"""Growth of the cost of whole analyses with length, sensors, modes, storeys and turbines: exponents.

    python benchmarks/growth.py [--short]        (make bench)

Processor time of one call after a small one that compiles and imports, and peak memory, each case in a process of its
own. The exponent is the slope of log cost against log size, by least squares over the upper half of the sizes: the
lower half pays for what every call does once. Vibration is a sum of modes under white loads (a chain of masses and
springs for storeys) at 20 Hz, of towers and turbines as `simulate_record` has it.
"""

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scaling import alone, peak_memory
from sheets import Sheet, number, present

import windsysid as ws
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record

RATE, USUAL = 20.0, 600.0
"""Sampling rate [Hz] and usual length of a record [s]."""

PIECE = 600.0
"""Length of a piece [s] of a record that is read in pieces."""


def vibration(seconds: int, sensors: int, frequencies: Sequence[float]) -> Record:
    """Readings of sensors along a beam that has modes of these frequencies [Hz], damped by 1 %, and 1 % of noise."""
    from scipy.signal import lfilter

    rng, samples = np.random.default_rng(1), round(seconds * RATE)
    y = np.zeros((samples, sensors))
    for k, frequency in enumerate(frequencies):
        pole = np.exp(2.0 * math.pi * frequency / RATE * (-0.01 + 1j))
        motion = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(samples))
        y += np.outer(motion / motion.std(), np.sin((k + 0.5) * math.pi * (np.arange(sensors) + 1.0) / sensors))
    y += 0.01 * y.std() * rng.standard_normal(y.shape)
    names = tuple(f"point_{i + 1}_acceleration" for i in range(sensors))
    return Record(np.arange(samples) / RATE, y, names, ("m/s^2",) * sensors)


def spread(modes: int) -> list[float]:
    """Frequencies [Hz] of so many modes between 0.5 Hz and 8 Hz, evenly."""
    return [0.5 + 7.5 * (k + 0.5) / modes for k in range(modes)]


def storeys_of(count: int) -> list[float]:
    """Frequencies [Hz] of a chain of so many equal storeys whose stiffest mode is near 8 Hz."""
    return [8.0 * math.sin((2 * k + 1) * math.pi / (4 * count + 2)) for k in range(count)]


# Cases: each is called by name in a process of its own and returns seconds of the processor.


def oma(_: str, seconds: int, sensors: int, modes: int) -> float:
    record = vibration(seconds, sensors, spread(modes))
    return _spent(lambda: ws.oma(record))


def storeys(_: str, count: int) -> float:
    record = vibration(round(USUAL), count, storeys_of(count))
    return _spent(lambda: ws.oma(record))


def tower(_: str, seconds: int) -> float:
    record = simulate_record("tower", duration=float(seconds), rate=RATE, seed=1)
    ws.identify(simulate_record("tower", duration=USUAL, rate=RATE, seed=2), "tower", formulation="spectral")
    return _spent(lambda: ws.identify(record, "tower", formulation="spectral"))


def pieces(_: str, seconds: int) -> float:
    def arriving() -> Iterator[Record]:
        for k in range(round(seconds / PIECE)):
            piece = simulate_record("tower", duration=PIECE, rate=RATE, seed=k)
            kept = piece.samples - piece.samples % 2 if piece.time[-1] < PIECE else round(PIECE * RATE)
            yield Record(piece.time[:kept] + k * PIECE, piece.values[:kept], piece.channels, piece.units, name="pieces")

    return _spent(lambda: ws.identify_pieces(arriving(), "tower", formulation="spectral"))


def inspect(_: str, seconds: int) -> float:
    record = simulate_record("tower", duration=float(seconds), rate=RATE, seed=1)
    return _spent(lambda: ws.inspect(record))


def _spent(run: Callable[[], object]) -> float:
    begun = time.process_time()
    run()
    return time.process_time() - begun


CASES = {f.__name__: f for f in (oma, storeys, tower, pieces, inspect)}


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Slope of log cost against log size over the upper half of the sizes, at least three."""
    upper = max(3, (len(sizes) + 1) // 2)
    return float(np.polyfit(np.log(sizes[-upper:]), np.log(costs[-upper:]), 1)[0])


def sheets(short: bool) -> Iterator[Sheet]:
    """The costs, and their exponents."""
    day = 3600 if short else 86_400
    of = [seconds for seconds in (600, 1800, 3600, 10_800, 28_800, 86_400) if seconds <= day]
    lengths = [60, *of]
    few = slice(0, 3) if short else slice(None)
    studies: list[tuple[str, str, str, list[tuple[int, tuple[int, ...]]]]] = [
        ("oma, 4 sensors, 4 modes", "length, s", "oma", [(n, (n, 4, 4)) for n in lengths]),
        ("inspect, a tower", "length, s", "inspect", [(n, (n,)) for n in (10, *lengths)]),
        ("identify, a tower by spectra", "length, s", "tower", [(n, (n,)) for n in of]),
        ("identify_pieces, a tower by spectra, simulation included", "length, s", "pieces", [(n, (n,)) for n in of]),
        ("oma, 4 modes", "sensors", "oma", [(n, (round(USUAL), n, 4)) for n in (1, 3, 10, 30, 100)[few]]),
        ("oma, 10 sensors", "modes", "oma", [(n, (round(USUAL), 10, n)) for n in (1, 5, 10, 20, 40)[few]]),
        ("oma of a chain, a sensor on each storey", "storeys", "storeys", [(n, (n,)) for n in (2, 5, 10, 20, 40)[few]]),
    ]
    rows, costs = [], {}
    for what, size, case, given in studies:
        found = [alone("", case, *arguments, script=__file__) for _, arguments in given]
        sizes, seconds = [n for n, _ in given], [one["seconds"] for one in found]
        slope = exponent(sizes, seconds)
        memory = f"{found[-len(of)]['peak']:.0f} → {found[-1]['peak']:.0f}" if size.startswith("length") else ""
        listed = ", ".join(f"{n}: {number(cost)}" for n, cost in zip(sizes, seconds, strict=True))
        rows.append((what, size, listed, f"{slope:.2f}", memory))
        costs |= {f"{what}, {size} {n}": cost for n, cost in zip(sizes, seconds, strict=True)}
    yield Sheet(
        "Growth: seconds of the processor by size, and the exponent of the upper half",
        ("analysis", "size", "cost, s", "exponent", "peak memory, MB, 600 s → longest"), rows, costs,
    )  # fmt: skip


def main() -> None:
    if "--case" not in sys.argv:
        present(__doc__, sheets)
        return
    _, _, case, folder, *arguments = sys.argv
    print(json.dumps({"seconds": CASES[case](folder, *map(int, arguments)), "peak": peak_memory()}))


if __name__ == "__main__":
    main()
