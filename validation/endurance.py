"""A day of vibration through the on-line estimate: time, memory, and what is known at its end.

``python -m validation.endurance [--hours 24]`` simulates the reference scenario at 100 Hz piece by piece, never held as
a whole, and identifies it as it comes. With ``--checkpoint FILE`` it can be interrupted and goes on when started again.
"""

import argparse
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.mechanics.compile import compile_model
from windsysid.output.console import render
from windsysid.records.record import Record
from windsysid.simulation.integrate import integrate
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["simulated_pieces"]


RATE = 100.0
PIECE = 60_000
"""Samples of a piece: ten minutes."""


def simulated_pieces(turbine: Turbine, samples: int, seed: int) -> Iterator[Record]:
    """The reference scenario in pieces, motion and loads going on from one to the next."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    model = compile_model(turbine.model, turbine.sensors)
    p = np.array([turbine.values[name] for name in model.parameters])
    rms = np.array([load.rms for load in turbine.loads])
    factor = np.array([np.exp(-1.0 / (RATE * load.time_constant)) for load in turbine.loads])
    column = [model.loads.index(load.load) for load in turbine.loads]
    noise = [sensor.noise for sensor in turbine.sensors]
    load, state, before = rms * rng.standard_normal(len(rms)), np.zeros(len(model.states)), None
    for first in range(0, samples, PIECE):
        count = min(PIECE, samples - first)
        clock = (first + np.arange(count)) / RATE
        inputs = np.zeros((count, 3 + len(model.loads)))
        inputs[:, 0], inputs[:, 1] = turbine.rotor_speed * clock, turbine.rotor_speed
        for j in range(len(rms)):
            kicks = rms[j] * np.sqrt(1.0 - factor[j] ** 2) * rng.standard_normal(count)
            inputs[:, 3 + column[j]], _ = lfilter([1.0], [1.0, -factor[j]], kicks, zi=[factor[j] * load[j]])
            load[j] = inputs[-1, 3 + column[j]]
        joined = inputs if before is None else np.vstack([before, inputs])
        response = integrate(model, p, joined, rate=RATE, start=state, substeps=1)
        state, before = response.states[-1].copy(), inputs[-1]
        readings = response.readings[-count:] + noise * rng.standard_normal((count, len(noise)))
        yield Record(
            time=clock,
            values=np.hstack([np.mod(inputs[:, :1], 2.0 * np.pi), inputs[:, 1:2], readings]),
            channels=("rotor_azimuth", "rotor_speed", *(sensor.channel for sensor in turbine.sensors)),
            units=("rad", "rad/s", *(sensor.unit for sensor in turbine.sensors)),
            name=f"from {clock[0]:g} s",
        )


def main() -> None:
    """Run, and print time and memory."""
    from rich.console import Console
    from rich.progress import Progress, TimeElapsedColumn

    parser = argparse.ArgumentParser(prog="python -m validation.endurance", description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--checkpoint", type=Path, help="file to go on from")
    options = parser.parse_args()
    turbine, samples = load_turbine("verne555").exact(), round(options.hours * 3600.0 * RATE)
    memory: list[float] = []
    started = time.perf_counter()
    with Progress(*Progress.get_default_columns(), TimeElapsedColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task(f"{options.hours:g} h at {RATE:g} Hz", total=samples / RATE)

        def taken(seconds: float) -> None:
            bar.update(task, completed=seconds)
            memory.append(
                resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
            )

        found = identify_pieces(
            simulated_pieces(turbine, samples, 0),
            turbine,
            prior=Prior(1.3, 1.3),
            checkpoint=options.checkpoint,
            progress=taken,
        )
    elapsed = time.perf_counter() - started
    print(render(found.table()))
    print(
        f"{samples} samples in {elapsed:.0f} s ({1e6 * elapsed / samples:.1f} µs each, simulation included); "
        f"peak memory {memory[0]:.0f} MB after the first piece, {memory[-1]:.0f} MB at the end"
    )


if __name__ == "__main__":
    main()
