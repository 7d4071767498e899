"""Turbines from models: the reader for each kind of file, by its ending."""

from pathlib import Path
from typing import TYPE_CHECKING

from windsysid.errors import ConfigurationError, as_numerical_error

if TYPE_CHECKING:
    from windsysid.turbine.models.machine import Machine
    from windsysid.turbine.turbine import Turbine

__all__ = ["ENDINGS", "KINDS", "is_model", "model_files", "turbine_file_from", "turbine_from"]

ENDINGS = (".fst", ".htc", ".yaml", ".yml", ".csv")
"""Endings of models: main input files of OpenFAST and HAWC2, windIO, and a table of a drawing."""

KINDS = ("tower", "rotor")


def is_model(path: str | Path) -> bool:
    """Test whether a path has the ending of a model."""
    return Path(path).suffix.lower() in ENDINGS


def turbine_from(path: str | Path, kind: str = "tower") -> "Turbine":
    """Make a turbine from the model of another program.

    Parameters
    ----------
    path
        Main input file of OpenFAST 1 to 5 or FAST 7 and 8 (``.fst``) or of HAWC2 (``.htc``), a turbine of windIO
        (``.yaml``, needs PyYAML), or a table of a drawing (``.csv``, docs/how_to/bring_your_machine.md).
    kind
        ``tower``: side-side and fore-aft under a rigid rotor. ``rotor``: equivalent-hinge blades on a tower that moves
        sideways.

    Returns
    -------
    Turbine
        In SI units.

    Raises
    ------
    ConfigurationError
        In one line with file and line number: what is missing, out of order, or not known.

    Notes
    -----
    Frequencies are those of the model with its rotor turning. Damping is that of the machine: ElastoDyn's ratio refers
    to the tower without its top mass, so 1 % there may be 0.35 % here; HAWC2's and windIO's factors of stiffness hold
    as they are. Air is a guess with a wide prior.

    Examples
    --------
    >>> import windsysid as ws
    >>> tower = ws.turbine_from("5MW_Land.fst")  # doctest: +SKIP
    """
    from windsysid.turbine.tables import parse_turbine

    return parse_turbine(turbine_file_from(path, kind), str(path))


def model_files(path: str | Path) -> tuple[Path, ...]:
    """List all files of a model, which nothing may replace.

    Raises
    ------
    ConfigurationError
        As `turbine_from`.
    """
    return _machine(Path(path)).files


def turbine_file_from(path: str | Path, kind: str = "tower") -> str:
    """Make the text of a turbine file as `turbine_from` does, each number with its file and line as a comment.

    Raises
    ------
    ConfigurationError
        As `turbine_from`.
    """
    from windsysid.turbine.models.write import turbine_text

    if kind not in KINDS:
        raise ConfigurationError(f"kind: expected {' or '.join(KINDS)}, got {kind!r:.40}")
    machine = _machine(Path(path))
    with as_numerical_error(f"{path}: the modes of the model"):
        return turbine_text(machine, kind)


def _machine(path: Path) -> "Machine":
    from windsysid.turbine.models.drawing import read_drawing
    from windsysid.turbine.models.hawc2.read import read_hawc2
    from windsysid.turbine.models.openfast import read_openfast
    from windsysid.turbine.models.windio import read_windio

    readers = dict(zip(ENDINGS, (read_openfast, read_hawc2, read_windio, read_windio, read_drawing), strict=True))
    if (reader := readers.get(path.suffix.lower())) is None:
        inside = [f", such as {one}" for one in sorted(path.glob("*")) if one.suffix.lower() in readers]
        raise ConfigurationError(
            f"{path}: no model: expected a file that ends in {' or '.join(ENDINGS)}{''.join(inside[:1])}"
        )
    with as_numerical_error(f"{path}: the model"):
        return reader(path)
