"""Equations of motion and sensor readings → compiled kernels with exact Jacobians.

A model is written out as one readable Python module in the user's cache folder (`windsysid.mechanics.generate`), named
by a hash of what it was made from, and compiled from there; a warm run imports that module and never SymPy. Per model
there are two quantities, the rates ẋ and the readings y, each as a value kernel and as a kernel with its Jacobians,
with one fixed signature for all models (`windsysid.kernels.jit`). The Jacobian kernels can also be compiled for several
models side by side: the generated arithmetic is the same for numbers and for vectors (`windsysid.kernels.assemble`),
and what depends on inputs alone stays a number.
"""

import hashlib
import marshal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from windsysid.kernels.cache import SHIPPED, cache_folder, in_turn, keep, kept, logger, write_whole
from windsysid.kernels.ownership import read_own
from windsysid.mechanics.model import Model

__all__ = ["CompiledModel", "compile_model"]


@dataclass(frozen=True)
class CompiledModel:
    """Compiled equations of a model, with the names of their arguments in order.

    Kernels are compiled at their first use. Arguments are contiguous float64: x (n_x,), u (n_u,), p (n_p,), w (n_w,);
    `rates` writes ẋ (n_x,), `reading` y (m,); the Jacobians are (n_x or m) × n_x, × len(identified), × n_w.

    Attributes
    ----------
    module, source
        The generated module, and its text.
    """

    module: ModuleType
    source: str

    @property
    def name(self) -> str:
        """Name of the model."""
        return str(self.module.NAME)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states x."""
        return tuple(self.module.STATES)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs u."""
        return tuple(self.module.INPUTS)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters p, of the model and then of its instruments."""
        return tuple(self.module.PARAMETERS)

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the parameters with derivatives."""
        return tuple(self.module.IDENTIFIED)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads w."""
        return tuple(self.module.LOADS)

    @property
    def readings(self) -> int:
        """Number m of readings."""
        return int(self.module.READINGS)

    @cached_property
    def rates(self) -> Any:
        """Kernel of ẋ."""
        return self._kernel("rates", "VALUE")

    @cached_property
    def rates_jacobian(self) -> Any:
        """Kernel of ẋ with ∂ẋ/∂x, ∂ẋ/∂p, ∂ẋ/∂w."""
        return self._kernel("rates_jacobian", "JACOBIAN")

    @cached_property
    def reading(self) -> Any:
        """Kernel of y."""
        return self._kernel("reading", "VALUE")

    @cached_property
    def reading_jacobian(self) -> Any:
        """Kernel of y with ∂y/∂x, ∂y/∂p, ∂y/∂w."""
        return self._kernel("reading_jacobian", "JACOBIAN")

    @cached_property
    def rates_of_lanes(self) -> Any:
        """`rates_jacobian` for `windsysid.kernels.simd.LANES` models at once."""
        return self._kernel("rates_jacobian", "LANE_JACOBIAN")

    @cached_property
    def reading_of_lanes(self) -> Any:
        """`reading_jacobian` for `windsysid.kernels.simd.LANES` models at once."""
        return self._kernel("reading_jacobian", "LANE_JACOBIAN")

    def _kernel(self, name: str, signature: str) -> Any:
        from windsysid.kernels import jit  # with Numba, which a list of turbines does not need
        from windsysid.kernels.assemble import assembled

        return assembled(self.module, self.source, name, getattr(jit, signature))


def compile_model(
    model: Model, sensors: Sequence[Any] = (), identified: Sequence[str] = (), *, instruments: bool = False
) -> CompiledModel:
    """Compile `model` with the readings of `sensors` and the derivatives with respect to the parameters `identified`.

    Parameters
    ----------
    model : Equations or MechanicalModel
        Equations of motion.
    sensors : sequence of Reading or Sensor, optional
        One for each of the m readings.
    identified : sequence of str, optional
        Names of parameters.
    instruments : bool, default False
        Add errors of each sensor's gain and axis to the parameters, after those of the model
        (`windsysid.mechanics.sensors.instrument_parameters`): zero where an instrument is as its sensor says.

    Returns
    -------
    CompiledModel
        Kernels that are compiled at their first use.

    Raises
    ------
    ConfigurationError
        If a name in `identified` is not a parameter of the model, or appears twice.

    See Also
    --------
    compose : State-space model with loads and priors.

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> model = ws.models.compile_model(spring, [ws.models.Reading("position", q, noise=0.01)], identified=["k"])
    >>> rates = np.empty(2)
    >>> model.rates(np.array([1.0, 0.0]), np.empty(0), np.array([4.0]), np.zeros(1), rates)
    >>> rates.tolist()
    [0.0, -4.0]
    """
    asked = ["identified", *identified, *(["instruments"] if instruments else [])]
    text = "\n".join([*_structure(model, sensors), *asked, _version()])
    key = hashlib.sha256(text.encode()).hexdigest()[:20]
    cached = _loaded.get(key)
    if cached is None:
        own = path = cache_folder() / f"model_{key}.py"
        source = _kept_source(path)
        if source is None:
            path = SHIPPED / own.name
            source = _kept_source(path)
        if source is None:
            path = own
            _announce()
            from windsysid.mechanics.generate import generate_source

            with in_turn(path):
                source = _kept_source(path)
                if source is None:
                    source = generate_source(model, sensors, identified, instruments=instruments)
                    write_whole(path, f"{source}{_checksum(source)}\n".encode())
        cached = _loaded[key] = CompiledModel(_import(path, source), source)
    return cached


def _structure(model: Model, sensors: Sequence[Any]) -> list[str]:
    """Text on which the kernels depend.

    This package's own classes say it, and `_version` changes with their code. Of a foreign class it cannot see the
    code: there the expressions themselves are the text, at the cost of deriving them in every process.
    """
    if all(map(_is_own, (model, *sensors))):
        return [model.signature, *(getattr(sensor, "structure", None) or repr(sensor) for sensor in sensors)]
    from sympy import srepr

    return [model.equations().signature, *(str(srepr(expression)) for expression in model.readings(sensors))]


def _is_own(part: Any) -> bool:
    """Test whether a model or sensor is of a class of this package, and so is every model among its attributes."""
    inner = (value for value in getattr(part, "__dict__", {}).values() if hasattr(value, "equations"))
    return type(part).__module__.split(".")[0] == "windsysid" and all(map(_is_own, inner))


_loaded: dict[str, CompiledModel] = {}


@lru_cache(maxsize=1)
def _announce() -> None:
    """Say once per process that this run is slower than the next."""
    logger.info("first run with this model: deriving and compiling its equations; later runs start from the cache")


@lru_cache(maxsize=1)
def _version() -> str:
    """Text on which the generated source depends in addition to the model: this package's mechanics, and SymPy."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return f"{digest.hexdigest()} sympy {metadata.version('sympy')}"


def _checksum(source: str) -> str:
    """The last line of a model's file: it tells whether the file is whole and as it was written."""
    return f"# sha256 {hashlib.sha256(source.encode()).hexdigest()}"


def _kept_source(path: Path) -> str | None:
    """Read the source of a model from the cache; None if it is missing, cut off, damaged or another user's."""
    content = read_own(path)
    if content is None:
        return None
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return None
    body, newline, _ = text.removesuffix("\n").rpartition("\n")
    source = body + newline
    return source if text == f"{source}{_checksum(source)}\n" else None


def _import(path: Path, source: str) -> ModuleType:
    """The module that `source` says; its byte code is kept next to the file, with the source it was made from."""
    digest = hashlib.sha256(source.encode()).digest()
    beside = cache_folder() / path.with_suffix(f".{sys.implementation.cache_tag}-{sys.hexversion:x}.code").name
    payload = kept(beside)
    if payload is not None and payload.startswith(digest):
        code = marshal.loads(payload[len(digest) :])
    else:
        code = compile(source, path, "exec")
        keep(beside, digest + marshal.dumps(code))
    module = ModuleType(f"windsysid_{path.stem}")
    module.__file__ = str(path)
    exec(code, module.__dict__)
    return module
