"""The turbine file of any mechanical model: its own fields, every parameter by name, loads and sensors as lists.

What `windsysid.mechanics.model.register_model` made known can be written and read that way, so that results with it can
be saved, compared and followed; the module that registers it must be imported first.
"""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Annotated, Any

from pydantic import Field

from windsysid.errors import ConfigurationError
from windsysid.mechanics.model import MODELS, MechanicalModel
from windsysid.mechanics.sensors import Sensor
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.entries import File, FileTable, Positive, RotorEntry, quantity, read_quantity
from windsysid.turbine.turbine import Turbine
from windsysid.units import parse_quantity

__all__ = ["ModelFile", "model_tables"]


class _LoadEntry(FileTable):
    """Random load: its degree of freedom, rms, time constant, and harmonic of the rotor."""

    load: str
    rms: str
    time_constant: Annotated[float, quantity("s"), Positive]
    harmonic: int = Field(default=0, ge=0)


class ModelFile(File):
    """Tables ``[model]`` with ``kind`` and the model's fields, ``[rotor]``, ``[values]`` and ``[[load]]``."""

    model: dict[str, Any]
    rotor: RotorEntry
    values: dict[str, str]
    load: tuple[_LoadEntry, ...] = ()

    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        """The turbine with this model."""
        model = self._model()
        units = {known.name: known.unit for known in model.parameters}
        if set(self.values) != set(units):
            raise ConfigurationError(
                f"turbine '{self.name}': [values]: expected {', '.join(units)}, got {', '.join(self.values) or 'none'}"
            )
        return Turbine(
            name=self.name,
            description=self.description,
            source=self.source,
            assumed=self.assumed,
            model=model,
            values={name: self._quantity(f"values.{name}", text, units[name]) for name, text in self.values.items()},
            rotor_speed=self.rotor.speed,
            spread=(self.prior.stiffness, self.prior.damping),
            mass_tolerance=self.tolerances.masses,
            loads=tuple(
                GaussMarkov(
                    one.load,
                    self._quantity(f"rms of {one.load}", one.rms, model.freedom(one.load).load_unit, read_quantity),
                    one.time_constant,
                    one.harmonic,
                )
                for one in self.load
            ),
            sensors=sensors,
        )

    def _model(self) -> MechanicalModel:
        own = {key: value for key, value in self.model.items() if key != "kind"}
        kind = MODELS[self.model["kind"]]
        known: list[str] = [field.name for field in fields(kind)] if is_dataclass(kind) else []
        if unknown := sorted(set(own) - set(known)):
            raise ConfigurationError(
                f"turbine '{self.name}': model: unknown key '{unknown[0]}': expected some of "
                f"{', '.join(known) or 'none'}"
            )
        return kind(**own)

    def _quantity(self, what: str, text: str, unit: str, read: Callable[[str, str], float] = parse_quantity) -> float:
        """Read a value by its name; user-defined models have no limits of sizes."""
        try:
            return read(text, unit)
        except ConfigurationError as error:
            raise ConfigurationError(f"turbine '{self.name}': {what}: {error}, got {text!r:.80}") from None


def model_tables(turbine: Turbine) -> dict[str, Any]:
    """A turbine with any registered model as the tables of its file."""
    model = turbine.model
    own: dict[str, Any] = {f.name: getattr(model, f.name) for f in fields(model)} if is_dataclass(model) else {}
    return {
        "model": {"kind": model.kind, **own},
        "rotor": {"speed": f"{turbine.rotor_speed!r} rad/s"},
        "values": {known.name: f"{turbine.values[known.name]!r} {known.unit}" for known in model.parameters},
        "load": [
            {
                "load": load.load,
                "rms": f"{load.rms!r} {model.freedom(load.load).load_unit}",
                "time_constant": f"{load.time_constant!r} s",
                "harmonic": load.harmonic,
            }
            for load in turbine.loads
        ],
    }
