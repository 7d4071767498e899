"""Compile time of the generated functions of a model: by `windsysid.kernels.assemble`, and by Numba alone.

    python benchmarks/compiling.py             (make bench)

Both ways compile the same source with the same options, in an empty cache, after a first model that loads the compiler.
Vectors of several models at once have no way but the first. The greatest difference is of values and derivatives at one
random point, as a share of the largest of each array.
"""

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from sheets import Sheet, present

from windsysid import load_turbine
from windsysid.kernels.assemble import assembled
from windsysid.kernels.jit import JACOBIAN, VALUE, compiled
from windsysid.mechanics.compile import CompiledModel, compile_model

FUNCTIONS = {"rates": VALUE, "reading": VALUE, "rates_jacobian": JACOBIAN, "reading_jacobian": JACOBIAN}


def sheets(_short: bool) -> Iterator[Sheet]:
    """Two rotors' equations."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["WINDSYSID_CACHE"] = folder
        _both_ways(_model("tower"), "rates")  # loads the compiler
        rows, costs = [], {}
        for turbine in ("verne555", "nrel5mw"):
            model = _model(turbine)
            for name in FUNCTIONS:
                seconds, longer, off = _both_ways(model, name)
                rows.append((turbine, name, f"{1e3 * seconds:.0f}", f"{longer:.1f}", f"{off:.1g}"))
                costs[f"compile {name} of {turbine}"] = seconds
    yield Sheet(
        "Compiling generated functions (ms); how many times as long Numba takes; greatest relative difference",
        ("turbine", "function", "assembled", "Numba ×", "difference"),
        rows,
        costs,
    )


def _model(turbine: str) -> CompiledModel:
    machine = load_turbine(turbine)
    identified = [name for name in machine.values if name.startswith(("k_", "c_"))]
    return compile_model(machine.model, machine.sensors, identified)


def _both_ways(model: CompiledModel, name: str) -> tuple[float, float, float]:
    """Seconds of the first way, how many times as long the second takes, and the greatest relative difference."""
    signature, file = FUNCTIONS[name], Path(str(model.module.__file__))
    start = time.process_time()
    one = assembled(model.module, model.source, name, signature)
    middle = time.process_time()
    other = compiled(getattr(model.module, name), signature, borrows=True, source=file)
    seconds, longer = middle - start, time.process_time() - middle
    pairs = zip(_values(model, name, one), _values(model, name, other), strict=True)
    off = max(float(np.abs(a - b).max() / max(np.abs(b).max(), 1e-300)) for a, b in pairs if a.size)
    return seconds, longer / seconds, off


def _values(model: CompiledModel, name: str, kernel: Any) -> list[np.ndarray[Any, np.dtype[np.float64]]]:
    rng = np.random.default_rng(1)
    sizes = [len(names) for names in (model.states, model.inputs, model.parameters, model.loads)]
    arguments = [rng.uniform(0.5, 1.5, size) for size in sizes]
    rows = len(model.states) if name.startswith("rates") else model.readings
    found = [np.zeros(rows)]
    if FUNCTIONS[name] is JACOBIAN:
        found += [np.zeros((rows, n)) for n in (sizes[0], len(model.identified), sizes[3])]
    kernel(*arguments, *found)
    return found


if __name__ == "__main__":
    present(__doc__, sheets)
