"""Filters and the spectral likelihood, relative to hand-written C and to the limits of one core.

    python benchmarks/roofline.py [--short]      (make bench)

*Spectral likelihood*: value, gradient and Fisher's information of a band of `oma` (`windsysid.spectral.modal_bands`) in
each row of bins, and `spectral.c`, the same equations with sizes that the compiler knows. Results are compared before
anything is timed. *Roofline* (Williams, Waterman & Patterson, CACM 52(4), 2009, doi:10.1145/1498765.1498785): flops and
bytes of a sample and of a row, counted from the sizes of all products and from the generated equations, over the limits
that `roofline.c` measures in the same run. Padding of rows to whole vectors is not counted.
"""

import ast
import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from sheets import Sheet, number, present
from speed import AGREES, FLAGS, in_turns

from windsysid import load_turbine
from windsysid.filters import EKF
from windsysid.filters.bank import LANES, bank_of, run_bank
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.kernels.threads import one_thread
from windsysid.models import StateSpace
from windsysid.simulation.record import simulate_record
from windsysid.spectral.modal_bands.model import Modes, Scores, scores
from windsysid.spectral.transforms.dft import Band, band_data

Array = np.ndarray
HERE = Path(__file__).parent

SIZES = ((2, 1), (4, 2), (8, 3))
"""Readings and modes of a band."""

SINE_FLOPS = 20
"""Flops of a sine or a cosine: argument reduction and a polynomial."""

REPEATS = 40


def built(folder: Path, source: str, *flags: str) -> ctypes.CDLL:
    """A C file as a library, linked without -ffast-math, which would change the rounding of this whole process."""
    name = folder / f"{Path(source).stem}{''.join(flags).replace('=', '')}"
    subprocess.run(["gcc", *FLAGS, *flags, "-c", str(HERE / source), "-o", str(name.with_suffix(".o"))], check=True)
    subprocess.run(
        ["gcc", "-shared", str(name.with_suffix(".o")), "-o", str(name.with_suffix(".so")), "-lm"], check=True
    )
    return ctypes.CDLL(str(name.with_suffix(".so")))


def band_of(m: int, r: int) -> tuple[Modes, Band]:
    """Ten minutes of noise at 10 Hz, of which 0.9 Hz are a band, and r modes in it."""
    rng = np.random.default_rng([m, r])
    shape = rng.standard_normal((m, r)) + 0.1j * rng.standard_normal((m, r))
    shape[0] = np.abs(shape[0])
    load = np.tril(rng.standard_normal((r, r)) + 1j * rng.standard_normal((r, r)), -1) + np.diag(1.0 + np.arange(r))
    rest = np.tril(0.1 * (rng.standard_normal((m, m)) + 1j * rng.standard_normal((m, m))), -1) + np.eye(m)
    modes = Modes(np.linspace(1.2, 1.7, r + 2)[1:-1], np.full(r, 0.01), shape, load, 0.5, rest, -0.5)
    return modes, band_data(rng.standard_normal((6000, m)), np.arange(600, 1140), 6000, 10.0)


class SpectralReference:
    """`spectral.c`, compiled for m readings and r modes."""

    def __init__(self, folder: Path, m: int, r: int) -> None:
        self._score = built(folder, "spectral.c", f"-DM={m}", f"-DR={r}").score
        self._score.restype = ctypes.c_double

    def run(self, modes: Modes, band: Band) -> Scores:
        """Scores of a band, as `scores` gives them."""
        rows, fine, width = len(band.frequency), len(band.fine), band.window.shape[1]
        numbers = np.array(
            [np.sqrt(band.frequency[0] * band.frequency[-1]), modes.load_slope, modes.rest_slope], dtype=np.float64
        )
        gradient, fisher = np.empty(modes.size), np.empty((modes.size, modes.size))
        room, tilts = np.empty((3, fine, len(modes.frequency)), dtype=np.complex128), np.empty((2, fine))
        arrays = (
            band.power, band.counts.astype(np.float64), band.frequency, band.fine, band.first, band.window,
            modes.frequency, modes.damping, modes.shape, modes.load, modes.rest, numbers, modes.real, room, tilts,
            gradient, fisher,
        )  # fmt: skip
        kept = [np.ascontiguousarray(array) for array in arrays]
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in kept)
        cost = self._score(*(ctypes.c_long(size) for size in (rows, fine, width)), *pointers)
        return Scores(cost, gradient, fisher)


def apart(found: Scores, expected: Scores) -> float:
    """Largest difference, relative to the square roots of Fisher's information."""
    size = np.sqrt(np.diagonal(expected.fisher))
    return max(
        abs(found.cost / expected.cost - 1.0),
        float(np.abs((found.gradient - expected.gradient) / size).max()),
        float(np.abs((found.fisher - expected.fisher) / np.outer(size, size)).max()),
    )


def spectral(folder: Path, repeats: int) -> tuple[Sheet, dict[str, tuple[float, float, float, float]]]:
    """µs per row of bins, and what the roofline needs of it."""
    rows, costs, counted = [], {}, {}
    for m, r in SIZES:
        modes, band = band_of(m, r)
        reference, count = SpectralReference(folder, m, r), len(band.frequency)
        difference = apart(reference.run(modes, band), scores(modes, band))
        if not difference < AGREES:
            raise SystemExit(f"spectral.c: expected agreement to {AGREES:g}, got {difference:.1e}")
        runs: dict[str, Callable[[], object]] = {
            "windsysid": lambda modes=modes, band=band: scores(modes, band),
            "C": lambda reference=reference, modes=modes, band=band: reference.run(modes, band),
        }
        each = {name: 1e6 * seconds / count for name, seconds in in_turns(runs, repeats).items()}
        rows.append(
            (
                str(m), str(r), str(modes.size), str(count), number(each["windsysid"]), number(each["C"]),
                number(each["windsysid"] / each["C"]), f"{difference:.0e}",
            )
        )  # fmt: skip
        costs[f"spectral likelihood, {m} readings, {r} modes"] = each["windsysid"]
        title = f"spectral likelihood, a row of bins, {m} readings, {r} modes"
        counted[title] = (*spectral_work(m, r, modes.size, band), each["windsysid"])
    headings = ("readings", "modes", "unknowns", "rows", "windsysid", "C", "÷ C", "difference")
    return Sheet("Spectral likelihood with gradient and information, µs per row", headings, rows, costs), counted


def spectral_work(m: int, r: int, p: int, band: Band) -> tuple[float, float, float]:
    """Flops of a row, bytes that its products read and write, and bytes of the data."""
    width, points = band.window.shape[1], len(band.fine) / len(band.frequency)
    flops = points * r * 60.0  # responses and their derivatives
    flops += 8.0 * width * r * (2 * r + r + 1)  # D and its derivatives
    flops += 8.0 * (m * r * r + 0.5 * m * m * r) + 4.0 * m**3 / 3.0  # S and its root
    flops += 8.0 * 0.5 * m * m * (2 * m + r) + 8.0 * m**3  # whitening, misfit
    flops += p * 8.0 * m * m  # derivatives
    flops += p * (p + 1.0) * m * m + 2.0 * p * m * m  # information and gradient
    moved = 8.0 * (2.0 * p * m * m + p * p) + 16.0 * (4.0 * m * m + 3.0 * m * r + 3.0 * width * r)
    return flops, moved, 16.0 * m * m + 8.0 * (width + 3.0)


def filter_work(model: StateSpace) -> tuple[float, float, float]:
    """Flops of a sample of the filter, bytes that its products read and write, and bytes of record and results."""
    nx, nz, _, nt, nu, nw = (int(size) for size in model.blocks.sizes)
    n, m, r, moving = len(model.states), len(model.readings), model.blocks.load_within.shape[2], nx + nz
    columns = nx + 2 * nw + nt
    products = [
        *[(nx, nx, columns)] * 3,  # sensitivities of the stages
        *[(nx, nw, nz)] * 2, (nx, nz, nz), *[(nx, nz, r)] * 2,  # Γ and how noise within a step reaches x
        (nx, n, n), (nz, nz, n), (nx, n, moving), (nz, nz, moving),  # F P, F P Fᵀ
        (moving, nz, nz), (moving, nz, moving), (nx, r, moving),  # Γ Q Γᵀ, V Vᵀ
        (m, n, n), (m, nw, nz), (n, m, n),  # H P, the readings' loads, P − K V
    ]  # fmt: skip
    flops = sum(2.0 * a * b * c for a, b, c in products) + 12.0 * nx * columns + 2.0 * n * m * (m + 3.0)
    moved = 8.0 * sum(a * b + b * c + a * c for a, b, c in products)
    source = ast.parse(model.compiled.source)
    work = {f.name: _operations(f) for f in source.body if isinstance(f, ast.FunctionDef)}
    flops += 4.0 * work["rates_jacobian"] + work["reading_jacobian"]
    return flops, moved, 8.0 * (nu + nw + m + 2 * n + 4 * m + 1)


def _operations(kernel: ast.FunctionDef) -> int:
    """Flops of a generated function."""
    nodes = list(ast.walk(kernel))
    return sum(isinstance(node, ast.BinOp) for node in nodes) + SINE_FLOPS * sum(
        isinstance(node, ast.Call) for node in nodes
    )


def limits(folder: Path) -> dict[str, float]:
    """Largest Gflop/s and GB/s of one core: multiply-adds, reading of 16 KiB (cache), of 256 MiB (memory)."""
    library = built(folder, "roofline.c")
    for function in (library.multiply_add, library.read_all):
        function.restype = ctypes.c_double
    found = {"flops": library.flops() * 1e6 / _least(lambda: library.multiply_add(ctypes.c_long(1_000_000))) / 1e9}
    for name, size, turns in (("cache", 1 << 14, 20_000), ("memory", 1 << 28, 1)):
        values = np.ones(size // 8 + 8)
        at = values.ctypes.data + -values.ctypes.data % 64
        arguments = ctypes.c_void_p(at), ctypes.c_long(size // 8), ctypes.c_long(turns)
        found[name] = size * turns / _least(lambda given=arguments: library.read_all(*given)) / 1e9
    return found


def _least(run: Callable[[], object], repeats: int = 7) -> float:
    """Least processor time [s]."""
    taken = []
    for _ in range(repeats):
        begun = time.thread_time()
        run()
        taken.append(time.thread_time() - begun)
    return min(taken)


def filters(repeats: int) -> dict[str, tuple[float, float, float, float]]:
    """Flops, bytes in the cache, bytes of memory and µs of a sample of filters of the scale model."""
    turbine = load_turbine("verne555").exact()
    problem = pose(simulate_record(turbine, duration=10.0, rate=100.0, seed=1), turbine, turbine.sensors, Prior())
    models = {"joint extended Kalman filter": problem.model, "coefficients given": problem.build(problem.prior[0])}
    bank = bank_of([models["coefficients given"]] * LANES)
    runs: dict[str, Callable[[], object]] = {
        f"{name}, a sample, {len(model.states)} states": lambda model=model: EKF.run(
            model, EKF.init(model), problem.inputs, problem.readings
        )
        for name, model in models.items()
    }
    works = dict(zip(runs, map(filter_work, models.values()), strict=True))
    side_by_side = f"the same, {LANES} side by side, each"
    works[side_by_side] = [*works.values()][-1]
    runs[side_by_side] = lambda: run_bank(bank, problem.inputs, problem.readings)
    taken = in_turns(runs, repeats)
    taken[side_by_side] /= LANES
    return {name: (*works[name], 1e6 * taken[name] / len(problem.inputs)) for name in runs}


def roofline(limit: dict[str, float], counted: dict[str, tuple[float, float, float, float]]) -> Sheet:
    """Table of the distance of each kernel from the limits of the core."""
    most = f"{limit['flops']:.0f} Gflop/s", f"{limit['cache']:.0f} GB/s", f"{limit['memory']:.0f} GB/s"
    rows = [("limits of the core", "", "", "", *most, "", "")]
    for title, (flops, moved, streamed, measured) in counted.items():
        bounds = [
            1e-3 * work / limit[name] for name, work in (("flops", flops), ("cache", moved), ("memory", streamed))
        ]
        rows.append(
            (
                title, number(flops / 1e3), number(moved / 1e3), number(streamed / 1e3), *(f"{b:.3f}" for b in bounds),
                number(measured), number(measured / max(bounds)),
            )
        )  # fmt: skip
    headings = (
        "kernel", "kflop", "kB in the cache", "kB of memory", "µs, flops", "µs, cache", "µs, memory", "µs measured",
        "÷ largest limit",
    )  # fmt: skip
    return Sheet("Roofline", headings, rows, {})


def sheets(short: bool) -> Iterator[Sheet]:
    if shutil.which("gcc") is None:
        print("no gcc here: neither C nor the limits of the machine")
        return
    repeats = 10 if short else REPEATS
    with tempfile.TemporaryDirectory() as name, one_thread():
        table, counted = spectral(Path(name), repeats)
        yield table
        yield roofline(limits(Path(name)), {**filters(repeats), **counted})


if __name__ == "__main__":
    present(__doc__, sheets)
