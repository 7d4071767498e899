"""Speed of windsysid, relative to hand-written C of the same filter on the same record, in one run.

    python benchmarks/speed.py       (make bench)

The record is 100 s at 100 Hz of the scale model, five accelerometers, some readings missing. `reference.c` is compiled
with gcc, where there is one, for the model's sizes; its equations of motion are windsysid's own, translated. The
results of both are compared before anything is timed. Filters run in turns on one core and are charged for processor
time, so that a busy machine is busy for all; of each the least of many runs counts. Searches for the mode use the
library's own threads, whose processor time is added up.
"""

import ast
import ctypes
import math
import os
import platform
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from types import ModuleType

import numpy as np
from rich.console import Console
from rich.table import Table

from windsysid import load_turbine
from windsysid.filters import EKF, FILTERS, Info
from windsysid.filters.bank import LANES, bank_of, run_bank
from windsysid.filters.protocol import empty_info
from windsysid.identification.estimate.scoring import posterior_mode
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.kernels.threads import one_thread
from windsysid.models import StateSpace
from windsysid.simulation.record import simulate_record

Array = np.ndarray
HERE = Path(__file__).parent

FLAGS = ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-fPIC", "-Wno-psabi")
"""All that makes it fast, but for NaN, which is data here."""

SAMPLES, REPEATS = 1000, 60
"""Samples of one run of a filter on one core, and how many runs there are of each."""

AGREES = 1e-9
"""Largest difference between C and windsysid, in standard deviations or relative to them."""


def main() -> None:
    turbine, console = load_turbine("verne555").exact(), Console(width=120)
    record = simulate_record(turbine, duration=100.0, rate=100.0, seed=1)
    problem = pose(record, turbine, turbine.sensors, Prior())
    readings = problem.readings.copy()
    readings[50:80, 1] = readings[100:105] = np.nan
    console.print("\n".join(surroundings()), highlight=False)
    everywhere = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else None
    if everywhere:
        os.sched_setaffinity(0, {max(everywhere)})
    console.print(on_one_core(problem, problem.inputs[:SAMPLES], readings[:SAMPLES], console))
    if everywhere:
        os.sched_setaffinity(0, everywhere)
    console.print(searches(problem, readings))


def surroundings() -> Iterable[str]:
    """Machine, versions, commit."""
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        processor = next(line.split(":", 1)[1].strip() for line in info.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        processor = platform.processor() or platform.machine()
    yield f"{processor}, {os.cpu_count()} cores, {platform.system()}"
    versions = " ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "numba", "llvmlite"))
    compiler = _said("gcc", "-dumpfullversion")
    yield f"Python {platform.python_version()}, {versions}, gcc {compiler or 'missing'}"
    changed = ", with changes" if _said("git", "status", "--porcelain", "--untracked-files=no") else ""
    yield (
        f"windsysid {metadata.version('windsysid')}, commit"
        f" {_said('git', 'rev-parse', '--short', 'HEAD') or 'unknown'}{changed}"
    )


def _said(*command: str) -> str:
    """Run a command and return its standard output; empty if it does not exist or prints nothing."""
    if shutil.which(command[0]) is None:
        return ""
    return subprocess.run(command, capture_output=True, text=True, cwd=HERE, check=False).stdout.strip()


def on_one_core(problem: TurbineProblem, inputs: Array, readings: Array, console: Console) -> Table:
    """Microseconds per sample: windsysid, C, their ratios."""
    joint, state_only = problem.model, problem.build(problem.prior[0])
    runs: dict[str, Callable[[], object]] = {}
    for f in FILTERS:
        runs[f.name] = lambda f=f: f.run(joint, f.init(joint), inputs, readings)
    runs["state-only"] = lambda: EKF.run(state_only, EKF.init(state_only), inputs, readings)
    bank = bank_of([state_only] * LANES)
    runs["bank"] = lambda: run_bank(bank, inputs, readings)
    with tempfile.TemporaryDirectory() as folder:
        if shutil.which("gcc") is None:
            console.print("no gcc here: windsysid alone, without the C reference")
        else:
            for model, name in ((joint, EKF.name), (state_only, "state-only")):
                for flags, how in (((), "C"), (("-DVECTORS",), "C, vectors")):
                    reference = Reference(model, Path(folder) / f"{name} {how}.so", flags)
                    _check(
                        reference.run(inputs, readings),
                        EKF.run(model, EKF.init(model), inputs, readings)[1],
                        console,
                        how,
                        model,
                    )
                    runs[f"{name}, {how}"] = lambda reference=reference: reference.run(inputs, readings)
            side_by_side = LanesReference(state_only, Path(folder) / "lanes.so")
            found, expected = side_by_side.score(inputs, readings), run_bank(bank, inputs, readings)[1]
            lanes = side_by_side.lanes
            worst = max(
                float(np.abs(one - other[..., :lanes]).max()) for one, other in zip(found, expected[:2], strict=True)
            )
            console.print(f"C of {lanes} lanes and windsysid's bank agree to {worst:.1e}", highlight=False)
            if not worst < AGREES:
                raise SystemExit(f"expected agreement to {AGREES:g}")
            runs["bank, C, vectors"] = lambda: side_by_side.score(inputs, readings)
        least = in_turns(runs, REPEATS)
    each = {name: 1e6 * seconds / len(inputs) for name, seconds in least.items()}
    each["bank"] /= LANES
    if "bank, C, vectors" in each:
        each["bank, C, vectors"] /= lanes
    table = Table(title="One core, µs per sample", title_justify="left")
    for heading in ("filter", "states", "windsysid", "C", "÷ C", "C, vectors", "÷ C, vectors", "÷ EKF"):
        table.add_column(heading, justify="left" if heading == "filter" else "right")
    rows = [
        (EKF.name, EKF.name, EKF.name, joint),
        ("the same, coefficients given", "state-only", "state-only", state_only),
        (f"the same, {LANES} side by side, each", "bank", "bank", state_only),
        *((f.name, f.name, "", joint) for f in FILTERS if f is not EKF),
    ]
    for title, name, floor, model in rows:
        cells = [title, str(len(model.states)), f"{each[name]:.2f}"]
        for how in ("C", "C, vectors"):
            found = each.get(f"{floor}, {how}")
            cells += [f"{found:.2f}", f"{each[name] / found:.2f}"] if found else ["", ""]
        table.add_row(*cells, f"{each[name] / each[EKF.name]:.2f}" if model is joint else "")
    return table


def in_turns(runs: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Least processor time of each [s]."""
    for run in runs.values():
        run()
    least = dict.fromkeys(runs, np.inf)
    for _ in range(repeats):
        for name, run in runs.items():
            begun = time.thread_time()
            run()
            least[name] = min(least[name], time.thread_time() - begun)
    return least


def searches(problem: TurbineProblem, readings: Array) -> Table:
    """Processor time of all threads to the mode of the posterior of a whole record [s], from the first pass on."""
    table = Table(title=f"Mode of the posterior, {len(readings)} samples", title_justify="left")
    for heading in ("unknowns", "number", "steps", "seconds"):
        table.add_column(heading, justify="left" if heading == "unknowns" else "right")
    mean, cov = problem.prior
    given = np.zeros(len(problem.statistics))
    for title, n in (
        ("coefficients, statistics given", len(problem.parameters)),
        ("coefficients and statistics", len(mean)),
    ):
        least, mode = np.inf, None
        for _ in range(3):
            begun = time.process_time()
            with one_thread():  # as `identify` does
                start, start_cov = problem.start(problem.inputs, readings)
                mode = posterior_mode(
                    lambda unknowns: problem.build(np.concatenate([unknowns, given])[: len(mean)]),
                    problem.inputs, readings,
                    prior=(mean[:n], cov[:n, :n]), start=(start[:n], start_cov[:n, :n]),
                )  # fmt: skip
            least = min(least, time.process_time() - begun)
        table.add_row(title, str(n), str(mode.iterations), f"{least:.2f}")
    return table


class Reference:
    """`reference.c`, compiled for a model."""

    def __init__(self, model: StateSpace, library: Path, flags: Iterable[str]) -> None:
        blocks, self.model = model.blocks, model
        within = blocks.load_within[0] @ blocks.load_within[0].T
        of_loads = [blocks.load_transition[0], blocks.load_noise[0], within]
        diagonal = [np.diag(np.diag(matrix)) for matrix in of_loads]
        fits = (
            len(blocks.step) == 1 and np.array_equal(blocks.load_output,
            np.eye(blocks.sizes[1])[None]) and blocks.sizes[2] == 0
            and np.array_equal(diagonal, of_loads) and not blocks.walk.any()
        )  # fmt: skip
        if not fits:
            raise ValueError(
                "reference.c expects one interval, one first-order load on each degree of freedom, no biases and no"
                " walks"
            )
        library.with_suffix(".d").mkdir()
        (library.with_suffix(".d") / "model.h").write_text(header(model.compiled.module), encoding="utf-8")
        # linked without -ffast-math, which would change the rounding of this whole process
        subprocess.run(
            [
                "gcc",
                *FLAGS,
                *flags,
                "-I",
                library.with_suffix(".d"),
                "-c",
                HERE / "reference.c",
                "-o",
                library.with_suffix(".o"),
            ],
            check=True,
        )
        subprocess.run(["gcc", "-shared", library.with_suffix(".o"), "-o", library, "-lm"], check=True)
        self._run = ctypes.CDLL(str(library)).run
        self._arrays = [
            blocks.p, blocks.chosen, blocks.reference, blocks.logarithmic,
            *(np.diag(matrix).copy() for matrix in diagonal), blocks.noise,
        ]  # fmt: skip
        self._numbers = _Model(blocks.step[0], *(array.ctypes.data for array in self._arrays))

    def run(self, inputs: Array, readings: Array) -> Info:
        """Filter T samples from the model's prior."""
        samples = len(inputs)
        outputs = empty_info(samples, len(self.model.states), len(self.model.readings))
        arrays = (self.model.mean, self.model.cov, np.ascontiguousarray(inputs), np.ascontiguousarray(readings))
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
        where = _Outputs(*(array.ctypes.data for array in outputs[:-1]))
        self._run(ctypes.byref(self._numbers), ctypes.c_long(samples), *pointers, where)
        return outputs


class LanesReference(Reference):
    """`reference.c` for as many filters at once as a register holds numbers, here of one model."""

    def __init__(self, model: StateSpace, library: Path) -> None:
        wide = "__AVX512F__" in _said("gcc", "-march=native", "-dM", "-E", "-x", "c", os.devnull)
        self.lanes = LANES if wide else LANES // 2
        super().__init__(model, library, (f"-DLANES={self.lanes}",))
        step, _, chosen, scale, logarithmic, *_ = (getattr(self._numbers, name) for name, _ in _Model._fields_)
        p, _, _, _, *rest = self._arrays
        self._arrays = [*self._arrays, *map(self._in_lanes, (p, *rest, model.mean, model.cov))]
        p, phi, q, within, r, *self._prior = (array.ctypes.data for array in self._arrays[-7:])
        self._numbers = _Model(step, p, chosen, scale, logarithmic, phi, q, within, r)

    def score(self, inputs: Array, readings: Array) -> tuple[Array, Array]:
        """Whitened innovations of T samples and the logarithms of their standard deviations (T, m, lanes)."""
        whitened, std, every = map(self._in_lanes, (readings, readings, np.zeros(len(inputs))))
        outputs = _Outputs(None, None, None, None, whitened.ctypes.data, std.ctypes.data, every.ctypes.data)
        given = np.ascontiguousarray(inputs), np.ascontiguousarray(readings)
        pointers = [ctypes.c_void_p(place) for place in (*self._prior, *(array.ctypes.data for array in given))]
        self._run(ctypes.byref(self._numbers), ctypes.c_long(len(inputs)), *pointers, outputs)
        return np.nan_to_num(whitened), np.nan_to_num(np.log(std))

    def _in_lanes(self, values: Array) -> Array:
        """Copy values into all lanes, the last axis, at a place that is a multiple of a vector."""
        room = np.empty(values.size * self.lanes + self.lanes)
        first = -room.ctypes.data // room.itemsize % self.lanes
        lanes = room[first : first + values.size * self.lanes].reshape(*values.shape, self.lanes)
        lanes[...] = values[..., None]
        return lanes


class _Outputs(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in Info._fields[:-1]]  # nothing is gated


class _Model(ctypes.Structure):
    _fields_ = [
        ("step", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("p", "chosen", "scale", "logarithmic", "phi", "q", "within", "r")),
    ]


def _check(found: Info, expected: Info, console: Console, how: str, model: StateSpace) -> None:
    """Stop where C computes something else."""
    worst = farthest_apart(found, expected)
    console.print(f"{how} and windsysid, {len(model.states)} states, agree to {worst:.1e}", highlight=False)
    if not worst < AGREES:
        raise SystemExit(f"expected agreement to {AGREES:g}")


def farthest_apart(found: Info, expected: Info) -> float:
    """Largest difference of two filters' outputs, in standard deviations or relative to them; infinite where one has
    what the other lacks."""
    units = (
        expected.std,
        expected.std,
        expected.innovation_std,
        expected.innovation_std,
        1.0,
        expected.whitening_std,
        1.0,
    )
    worst = 0.0
    for array, other, unit in zip(found, expected, units, strict=False):
        if not np.array_equal(np.isnan(array), np.isnan(other)):
            return math.inf
        worst = max(worst, float(np.nanmax(np.abs(array - other) / unit)))
    return worst


def header(module: ModuleType) -> str:
    """A generated model's sizes and Jacobian kernels in C."""
    sizes = {
        "NX": len(module.STATES), "NZ": len(module.LOADS), "NT": len(module.IDENTIFIED), "NU": len(module.INPUTS),
        "NP": len(module.PARAMETERS), "M": module.READINGS,
    }  # fmt: skip
    source = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    kernels = [f for f in source.body if isinstance(f, ast.FunctionDef) and f.name.endswith("_jacobian")]
    return "\n".join([*(f"#define {name} {size}" for name, size in sizes.items()), *map(_function, kernels)])


def _function(kernel: ast.FunctionDef) -> str:
    kinds = {"_u": "const double", **dict.fromkeys(("_x", "_p", "_w"), "const real")}
    arguments = ", ".join(f"{kinds.get(a.arg, 'real')} *restrict {a.arg}" for a in kernel.args.args)
    lines = []
    for statement in kernel.body:
        if isinstance(statement, ast.Assign):
            (target,) = statement.targets
            declared = "const real " if isinstance(target, ast.Name) else ""
            lines.append(f"    {declared}{_c(target)} = ALL({_c(statement.value)});")
    return "\n".join([f"static inline void {kernel.name}({arguments})", "{", *lines, "}"])


_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_ROW = {"_dx": "NX", "_dp": "NT", "_dw": "NZ"}


def _c(node: ast.expr) -> str:
    """A Python expression of a generated kernel in C."""
    match node:
        case ast.BinOp(left, ast.Pow(), ast.Constant(2)):
            return f"({_c(left)} * {_c(left)})"
        case ast.BinOp(left, ast.Pow(), right):
            return f"pow({_c(left)}, {_c(right)})"
        case ast.BinOp(left, operator, right):
            return f"({_c(left)} {_OPERATORS[type(operator)]} {_c(right)})"
        case ast.UnaryOp(ast.USub(), operand):
            return f"(-{_c(operand)})"
        case ast.Constant(value):
            return repr(float(value))
        case ast.Name(name):
            return "M_PI" if name == "pi" else name
        case ast.Call(ast.Name(name), arguments):
            return f"{ {'abs': 'fabs', 'max': 'fmax'}.get(name, name) }({', '.join(map(_c, arguments))})"
        case ast.Subscript(ast.Name(name), ast.Tuple([ast.Constant(row), ast.Constant(column)])):
            return f"{name}[{row} * {_ROW[name]} + {column}]"
        case ast.Subscript(ast.Name(name), ast.Constant(index)):
            return f"{name}[{index}]"
    raise ValueError(f"no C for {ast.unparse(node)}")


if __name__ == "__main__":
    main()
