"""What the tests of the verdict show on healthy records, beside their limits.

``python -m validation.adversary.limits [--folder FOLDER]`` reads the innovations that
``python -m validation.adversary`` kept. A limit that healthy records reach is a false alarm; one far beyond them hides
faults.
"""

import argparse
import json
import math
from pathlib import Path

import numpy as np

from validation.adversary.campaign import FOLDER, kept_as
from validation.adversary.scenarios import HEALTHY, LEAD_IN, SCENARIOS
from windsysid.output.console import render
from windsysid.results.diagnosis import CHANNEL_MAX_FACTOR, MAX_SIGMAS, NEAR_MAX_LEVEL, PEAK_MAX_LEVEL
from windsysid.results.steadiness import how_late
from windsysid.results.whiteness import examine
from windsysid.turbine.file import load_turbine

__all__ = ["measure"]

LIMITS = {
    "size of a channel, ln": math.log(CHANNEL_MAX_FACTOR),
    "level over time, σ": MAX_SIGMAS,
    "tails, σ": MAX_SIGMAS,
    "shared by two channels, σ": MAX_SIGMAS,
    "blades late, σ": MAX_SIGMAS,
    "peak": PEAK_MAX_LEVEL,
    "around a mode": NEAR_MAX_LEVEL,
    "line, over its bound": 1.0,
}


def measure(name: str, seed: int, rate: float, folder: Path) -> list[float]:
    """The statistics of `LIMITS` of a healthy record that was kept; a peak over its bound counts as one over both."""
    turbine = load_turbine("verne555")
    frequencies = [turbine.natural_frequency(one) / (2.0 * math.pi) for one in turbine.model.coordinates]
    z = np.load(folder / kept_as(name, seed))["whitened"].astype(np.float64)
    w = examine(z, names=[str(i) for i in range(z.shape[1])], rate=rate, frequencies=frequencies)
    psi = SCENARIOS[name].machine.speed * (LEAD_IN + np.arange(len(z)) / rate)
    late = how_late(z, psi, (0, 1), {2 + i: 2.0 * math.pi * i / 3.0 for i in range(3)})
    return [
        max(abs(math.log(c.nis)) for c in w.channels),
        max(c.unsteady_sigmas for c in w.channels),
        max(c.tails_sigmas for c in w.channels),
        0.0 if w.shared is None else w.shared.sigmas,
        late.sigmas,
        max(c.peak for c in w.channels) * PEAK_MAX_LEVEL / max(PEAK_MAX_LEVEL, w.spectrum_bound),
        max(c.near for c in w.channels),
        max(c.line for c in w.channels) / w.line_bound,
    ]


def main() -> None:
    """Print the table."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.adversary.limits", description=__doc__)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where results are kept (results/adversary)")
    folder = parser.parse_args().folder
    try:
        runs = [json.loads(line) for line in (folder / "runs.jsonl").read_text(encoding="utf-8").splitlines()]
    except OSError as error:
        parser.error(f"{folder}: expected results of python -m validation.adversary, got: {error}")
    healthy = [run for run in runs if SCENARIOS[run["scenario"]].wrong == HEALTHY and "z" in run]
    if not healthy:
        parser.error(f"{folder}: expected results of healthy records; run python -m validation.adversary first")
    found = np.array([measure(run["scenario"], run["seed"], run["rate"], folder) for run in healthy])
    table = Table(title=f"{len(found)} healthy records: {sum(not run['trusted'] for run in healthy)} not trusted")
    for heading in ("statistic", "median", "90 %", "highest", "limit", "records beyond"):
        table.add_column(heading, justify="left" if heading == "statistic" else "right")
    for (name, limit), column in zip(LIMITS.items(), found.T, strict=True):
        values = (float(np.median(column)), float(np.quantile(column, 0.9)), float(column.max()), limit)
        table.add_row(name, *(f"{value:.2f}" for value in values), str(int(np.sum(column > limit))))
    print(render(table))


if __name__ == "__main__":
    main()
