"""Operational modal analysis of measured structures: do windows of one record agree as their bands say, and at what
cost?

The records come inside Python packages, which pip fetches into a folder (`--cache`); nothing of them is part of this
repository.

- Palisaden, a building: 6 accelerometers, 5 400 s at 100 Hz, nine windows of 600 s (pyOMA-2 0.5.2, test data).
- Three-storey L, three setups of 10 channels with three of reference, 600 s each at 100 Hz (the same package).
- LUMO, a lattice tower: 18 accelerometers, 60 s at 1651 Hz (modalyzer 1.2.2, example).

Agreement is the root mean square of the windows' differences from their weighted mean, in their own standard
deviations, for frequency and for ln ζ: 1 where bands are true and the structure did not change.

``python -m validation.measured [--cache FOLDER] [--peer PYTHON]`` prints the tables; PYTHON is an interpreter of an
environment with pyOMA-2 (benchmarks/peers.txt), run on the same windows with the
whole rate and its own choice of order, and as its example has it.
"""

import argparse
import json
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from validation.oma import table
from windsysid.records.record import Record
from windsysid.spectral.oma.analyse import analyse_vibration
from windsysid.spectral.oma.mode import OperationalMode
from windsysid.spectral.oma.mode_tracking import Seen, follow_modes
from windsysid.spectral.oma.result import OperationalModes

Array = np.ndarray

PALISADEN = "pyoma2/test_data/palisaden/Palisaden_dataset.npy"
SETUPS = tuple(f"pyoma2/test_data/3SL/set{k}.npy" for k in (1, 2, 3))
LUMO = "modalyzer-1.2.2/Examples/Example 4 - LUMO/data_lumo.csv"

WINDOW = 600.0
RANGE = (0.5, 8.0)
"""Of the building [Hz]: higher up machines' lines are many."""

PEER = """
import json, sys, time, logging, warnings
import numpy as np
warnings.simplefilter("ignore"); logging.disable(logging.CRITICAL)
from pyoma2.algorithms import SSI
from pyoma2.setup import SingleSetup
path, rate, near, settings = sys.argv[1], float(sys.argv[2]), json.loads(sys.argv[3]), json.loads(sys.argv[4])
begun = time.process_time()
setup = SingleSetup(np.load(path), fs=rate)
if settings["decimate"] > 1:
    setup.decimate_data(q=settings["decimate"])
setup.add_algorithms(SSI(name="ssi", method="cov", **settings["run"]))
setup.run_all()
try:
    setup.mpe("ssi", sel_freq=near, order_in=settings["order"])
    found = setup["ssi"].result
    answer = [np.asarray(found.Fn).ravel().tolist(), np.asarray(found.Xi).ravel().tolist()]
except Exception as error:
    answer = [[], []]
print("ANSWER", json.dumps([*answer, time.process_time() - begun]))
"""

DEFAULTS = {"decimate": 1, "run": {"br": 20, "ordmax": 50}, "order": "find_min"}
"""It has no default of br and ordmax."""

BEST = {"decimate": 5, "run": {"br": 30, "ordmax": 50, "step": 2}, "order": 20}


def fetched(cache: Path, member: str) -> Path:
    """A file of a package, fetched by pip where it is not there yet."""
    path = cache / member
    if path.exists():
        return path
    package = "pyOMA-2==0.5.2" if member.startswith("pyoma2/") else "modalyzer==1.2.2"
    form = ["--only-binary", ":all:"] if member.startswith("pyoma2/") else ["--no-binary", ":all:"]
    subprocess.run(
        [sys.executable, "-m", "pip", "download", "-q", "--no-deps", *form, "-d", str(cache), package], check=True
    )
    for archive in (*cache.glob("pyoma*0.5.2*.whl"), *cache.glob("modalyzer-1.2.2.tar.gz")):
        with zipfile.ZipFile(archive) if archive.suffix == ".whl" else tarfile.open(archive) as inside:
            names = inside.namelist() if isinstance(inside, zipfile.ZipFile) else inside.getnames()
            if member in names:
                inside.extract(member, cache)
    return path


def record(values: Array, rate: float, name: str, channels: Sequence[str] = ()) -> Record:
    """Accelerations (T, n) as a record."""
    names = tuple(channels) or tuple(f"sensor_{i}_acceleration" for i in range(1, values.shape[1] + 1))
    return Record(
        np.arange(len(values)) / rate, np.ascontiguousarray(values), names, ("m/s^2",) * len(names), name=name
    )


def agreement(values: Sequence[float], stds: Sequence[float]) -> float:
    """Root mean square of the distances from the weighted mean, in standard deviations."""
    v, weight = np.array(values), np.array(stds) ** -2.0
    off = v - weight @ v / weight.sum()
    return float(np.sqrt(weight @ off**2 / max(len(v) - 1, 1)))


def windows(values: Array, rate: float) -> list[OperationalModes]:
    """Each window's modes."""
    size = int(WINDOW * rate)
    found = []
    for k in range(len(values) // size):
        found.append(
            analyse_vibration(record(values[k * size : (k + 1) * size], rate, f"window {k + 1}"), limits=RANGE)
        )
        print(f"window {k + 1}: {len(found[-1].modes)} modes, {found[-1].elapsed:.1f} s", file=sys.stderr, flush=True)
    return found


def followed(results: Sequence[OperationalModes]) -> list[list[OperationalMode]]:
    """The modes that most windows trust, where they do."""
    sure = [[mode for mode in result.modes if mode.trusted] for result in results]
    seen = [[Seen(mode.frequency.estimate, mode.shape) for mode in modes] for modes in sure]
    tracks = [[sure[w][j] for w, j in track.items()] for track in follow_modes(seen)]
    return [track for track in tracks if 2 * len(track) > len(results)]


def building(values: Array, rate: float, peer: str | None) -> Iterator[tuple[str, ...]]:
    """The building's modes over windows, compared with pyOMA-2."""
    results = windows(values, rate)
    modes = followed(results)
    seconds = float(np.median([result.elapsed for result in results]))
    each = seconds / float(np.median([len(result.modes) for result in results]))
    near = [float(np.median([m.frequency.estimate for m in track])) for track in modes]
    for f, sure in zip(near, modes, strict=True):
        damping = [np.log(mode.damping_ratio.estimate) for mode in sure]
        stds = [mode.damping_ratio.relative_std for mode in sure]
        yield (
            "windsysid", f"{f:.4f}", f"{100 * np.median([m.frequency.relative_std for m in sure]):.2f} %",
            f"{agreement([np.log(m.frequency.estimate) for m in sure], [m.frequency.relative_std for m in sure]):.2f}",
            f"{100 * np.std([m.frequency.estimate for m in sure], ddof=1) / f:.2f} %",
            f"{100 * np.exp(np.median(damping)):.2f} %", f"{100 * np.median(stds):.0f} %",
            f"{agreement(damping, stds):.2f}", f"{100 * np.std(damping, ddof=1):.0f} %",
            f"{len(sure)} of {len(results)}", f"{seconds:.1f}, {each:.2f} a mode",
        )  # fmt: skip
    if peer is not None:
        yield from _peers(values, rate, peer, near)


def _peers(values: Array, rate: float, peer: str, near: Sequence[float]) -> Iterator[tuple[str, ...]]:
    """Windows by pyOMA-2, with given frequencies."""
    size = int(WINDOW * rate)
    for name, settings in (("pyOMA-2, 100 Hz, its own order", DEFAULTS), ("pyOMA-2, as its example", BEST)):
        found, seconds = [], []
        with tempfile.TemporaryDirectory() as folder:
            for k in range(len(values) // size):
                path = Path(folder) / "window.npy"
                np.save(path, values[k * size : (k + 1) * size])
                told = [str(path), str(rate), json.dumps(list(near)), json.dumps(settings)]
                done = subprocess.run([peer, "-c", PEER, *told], capture_output=True, text=True, check=False)
                answer = [line for line in done.stdout.splitlines() if line.startswith("ANSWER ")]
                fn, xi, spent = json.loads(answer[-1][7:]) if answer else ([], [], float("nan"))
                seconds.append(spent)
                found.append([(f, z) for f, z in zip(fn, xi, strict=False) if f is not None and np.isfinite(f)])
        for f in near:
            own = [min(one, key=lambda pair: abs(pair[0] - f)) for one in found if one]
            own = [pair for pair in own if abs(pair[0] / f - 1.0) < 0.03 and pair[1] > 0.0]
            spread = np.std([np.log(p[0]) for p in own], ddof=1) if len(own) > 1 else np.nan
            of_damping = np.std([np.log(p[1]) for p in own], ddof=1) if len(own) > 1 else np.nan
            middle = np.median(own, axis=0) if own else (np.nan, np.nan)
            yield (
                name, f"{middle[0]:.4f}", "", "", f"{100 * spread:.2f} %", f"{100 * middle[1]:.2f} %", "", "",
                f"{100 * of_damping:.0f} %", f"{len(own)} of {len(found)}", f"{np.nanmedian(seconds):.1f}",
            )  # fmt: skip


def listed(found: OperationalModes, most: int) -> Iterator[tuple[str, ...]]:
    """Modes as rows."""
    for mode in found.modes[:most]:
        f, z = mode.frequency, mode.damping_ratio
        said = "yes" if mode.trusted else f"no: {mode.doubts[0]}"
        yield (
            f"{f.estimate:.4f}", f"{f.low:.4f} … {f.high:.4f}", f"{100 * z.estimate:.2f}",
            f"{100 * z.low:.2f} … {100 * z.high:.2f}", said,
        )  # fmt: skip


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, default=Path("results/measured"), help="folder of what pip fetched")
    parser.add_argument("--peer", help="a Python that has pyOMA-2")
    parser.add_argument("--windows", type=int, default=9, help="of the building (9)")
    given = parser.parse_args()
    began = time.time()
    given.cache.mkdir(parents=True, exist_ok=True)
    values = np.load(fetched(given.cache, PALISADEN), allow_pickle=True).astype(np.float64)
    values = values[: int(given.windows * WINDOW * 100.0)]
    of = ("", "f [Hz]", "σ", "rms z", "scatter", "ζ", "σ of ln ζ", "rms z", "scatter", "windows", "seconds a window")
    table(f"Palisaden, {given.windows} windows of {WINDOW:g} s", of, building(values, 100.0, given.peer))
    headings = ("f [Hz]", "±2σ", "ζ [%]", "±2σ", "trusted")
    sets = []
    for k, member in enumerate(SETUPS, start=1):
        data = np.load(fetched(given.cache, member), allow_pickle=True).astype(np.float64)
        names = [f"place_{i}_acceleration" if i < 3 else f"place_{k}_{i}_acceleration" for i in range(data.shape[1])]
        sets.append(record(data, 100.0, f"setup {k}", names))
    joined = analyse_vibration(sets, limits=(1.0, 20.0))
    title = f"three-storey L, three setups together, {len(joined.channels)} channels, {joined.elapsed:.1f} s"
    table(title, headings, listed(joined, 20))
    data = np.loadtxt(fetched(given.cache, LUMO), delimiter=",")
    tower = analyse_vibration(record(data[:, :18], 1651.0, "LUMO"), limits=(1.0, 110.0))
    table(f"LUMO, 60 s, {len(tower.modes)} modes, {tower.elapsed:.1f} s", headings, listed(tower, 20))
    print(f"{time.time() - began:.0f} s")


if __name__ == "__main__":
    main()
