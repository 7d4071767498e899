"""A turbine given by name, by the path of its file, or as it is."""

from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine


__all__ = ["TurbineLike", "as_turbine"]
TurbineLike: TypeAlias = "Turbine | str | Path"


def as_turbine(given: TurbineLike) -> "Turbine":
    """A turbine from itself, the name of a packaged one, or the path of a TOML file; else ConfigurationError."""
    from windsysid.turbine.file import load_turbine
    from windsysid.turbine.turbine import Turbine

    if isinstance(given, Turbine):
        return given
    if isinstance(given, str | Path):
        return load_turbine(given)
    raise ConfigurationError(
        f"turbine: expected a Turbine, the name of a packaged one or the path of a TOML file, got "
        f"{type(given).__name__}"
    )
