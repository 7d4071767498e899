"""A turbine as numbers: masses, dimensions, reference coefficients, usual instruments; TOML in and out.

Everything is SI inside; how a turbine file is written, `windsysid.turbine.tables` says. Coefficients are references:
the prior is centred on them, and results are compared with them.
"""

from importlib import resources
from pathlib import Path

from windsysid.configuration import read_toml
from windsysid.errors import ConfigurationError, unreadable
from windsysid.output.files import claim_file
from windsysid.turbine.models.read import ENDINGS, is_model, turbine_from
from windsysid.turbine.turbine import Turbine

__all__ = ["load_turbine", "packaged_file", "packaged_turbines", "write_turbine"]


def write_turbine(turbine: Turbine, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a turbine as TOML, every value with its unit, so that `load_turbine` reads the same turbine.

    Parameters
    ----------
    turbine : Turbine
        Turbine to write.
    path : str or Path
        File to write; a missing folder is made.
    overwrite : bool, default False
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> tower = ws.load_turbine("tower")
    >>> path = Path(tempfile.mkdtemp()) / "softer.toml"
    >>> ws.write_turbine(tower.with_values({"k_side_side": 1.7e6}), path)
    >>> ws.load_turbine(path).values["k_side_side"]
    1700000.0
    """
    import tomli_w

    from windsysid.turbine.tables import as_tables

    content = tomli_w.dumps(as_tables(turbine)).encode()
    with claim_file(path, overwrite=overwrite) as write:
        write(lambda file: file.write(content))


def packaged_turbines() -> tuple[str, ...]:
    """List the names of the turbines that come with windsysid.

    Returns
    -------
    tuple of str
        Names that `load_turbine` takes.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.packaged_turbines()
    ('hammond', 'nrel5mw', 'nrel5mw_full', 'tower', 'verne555')
    """
    folder = resources.files("windsysid.turbine") / "packaged"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def packaged_file(name: str) -> str:
    """The file of a packaged turbine as text, to begin one's own from.

    Parameters
    ----------
    name
        One of `packaged_turbines`.

    Returns
    -------
    str
        TOML, with its comments.

    Raises
    ------
    ConfigurationError
        If no packaged turbine has that name.
    """
    if name not in packaged_turbines():
        raise ConfigurationError(f"no packaged turbine '{name}': expected one of {', '.join(packaged_turbines())}")
    return (resources.files("windsysid.turbine") / "packaged" / f"{name}.toml").read_text(encoding="utf-8")


def load_turbine(name_or_path: str | Path) -> Turbine:
    """Load a packaged turbine by name, any turbine from a TOML file, or the tower of a model (`turbine_from`).

    Parameters
    ----------
    name_or_path : str or Path
        One of `packaged_turbines`, or the path of a file that ends in ``.toml``, or of a model (`turbine_from`).

    Returns
    -------
    Turbine
        In SI units.

    Raises
    ------
    ConfigurationError
        If there is no such turbine or file, or a value in it is missing or wrong; the message names it.

    See Also
    --------
    write_turbine : Write a turbine as TOML.

    Examples
    --------
    >>> import windsysid as ws
    >>> tower = ws.load_turbine("tower")
    >>> tower.model.kind, round(tower.rotor_speed, 3), [sensor.channel for sensor in tower.sensors]
    ('tower', 1.267, ['tower_x_acceleration', 'tower_z_acceleration'])
    """
    from windsysid.turbine.tables import parse_turbine

    text = str(name_or_path)
    if text in packaged_turbines():
        return parse_turbine(packaged_file(text), text)
    path = Path(name_or_path)
    if is_model(path):
        return turbine_from(path)
    if path.suffix != ".toml":
        raise ConfigurationError(
            f"no turbine '{text}': expected one of {', '.join(packaged_turbines())}, or the path of a .toml file "
            f"or of a model ({', '.join(ENDINGS)})"
        )
    try:
        content = read_toml(path)
    except (OSError, ValueError) as error:
        raise ConfigurationError(unreadable(text, "a turbine file", error)) from None
    return parse_turbine(content, text)
