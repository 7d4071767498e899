"""A saved answer, back from its folder."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from windsysid.configuration import parse_json
from windsysid.errors import ConfigurationError
from windsysid.output.answers import Answer
from windsysid.output.folders import result_file, without
from windsysid.output.table import Table
from windsysid.results.serialization import as_plain, from_plain

__all__ = ["Reported", "holds_result", "kept", "load_result"]

ANSWER = "answer.json"
"""The file that holds an answer whole."""

KEPT = frozenset(
    ["Campbell", "Comparison", "LinearisedModes", "ModeMatch", "OperationalModes", "Plan", "Separation", "Watch"]
)
"""Answers that have that file. An identification has ``identification.nc``; the page of an inspection shows its record,
and that of an overview its archive."""


def kept(answer: object) -> dict[str, bytes]:
    """``answer.json`` of an answer that is kept whole, by name."""
    name = type(answer).__name__
    if name not in KEPT:
        return {}
    return {ANSWER: (json.dumps({"answer": name, "fields": as_plain(answer)}) + "\n").encode()}


def load_result(folder: str | Path) -> Answer:
    """Load a result from the folder in which a command, or its ``save``, left it.

    Estimates, intervals, posterior and diagnosis are the same numbers as before; histories agree to about the last
    digit.

    Parameters
    ----------
    folder : str or Path
        Folder that ``identify``, ``study``, ``oma``, ``compare``, ``monitor``, ``damping``, ``modes`` or ``plan``
        wrote.

    Returns
    -------
    Answer
        An `Identification`, `Fit`, `OperationalModes`, `Comparison`, `Watch`, `Separation`, `Campbell`,
        `LinearisedModes`, `ModeMatch` or `Plan`.

    Raises
    ------
    ConfigurationError
        If the folder holds no result, or one that was damaged or written by an older version.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> folder = Path(tempfile.mkdtemp()) / "tower"
    >>> _ = ws.identify(record, "tower", formulation="spectral").save(folder)
    >>> print(f"{ws.load_result(folder)['k_side_side'].estimate / 1e6:.2f} MN/m")
    1.76 MN/m
    """
    from windsysid import reports

    folder = Path(folder)
    if result_file(folder, "identification.nc").exists():
        return _load_identification(folder)
    path = result_file(folder, ANSWER)
    if not path.exists():
        raise ConfigurationError(without("a result of windsysid", folder))
    try:
        said = parse_json(path.read_text(encoding="utf-8"))
        found: Answer = from_plain(reports.answer_class(_known(said["answer"])), said["fields"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigurationError(
            f"result {folder}: {ANSWER} is damaged or of another version ({type(error).__name__}): give the command"
            " again"
        ) from None
    return found


def holds_result(folder: str | Path) -> bool:
    """Test whether `load_result` would look into a folder."""
    return any(result_file(folder, name).exists() for name in ("identification.nc", ANSWER))


class Reported:
    """A saved answer with its page, for an identification without the record."""

    def __init__(self, folder: str | Path) -> None:
        self._found: Any = load_result(folder)

    def __str__(self) -> str:
        return str(self._found)

    def contents(self) -> Sequence[Table | str]:
        """Those of the answer."""
        found: Sequence[Table | str] = self._found.contents()
        return found

    def to_json(self) -> str:
        """Content of ``summary.json``."""
        return str(self._found.to_json())

    def files(self) -> dict[str, bytes]:
        """Those of the answer, and its page."""
        from windsysid.reports.identification import identification_report
        from windsysid.results.identification import Identification

        files: dict[str, bytes] = self._found.files()
        if isinstance(self._found, Identification):
            files["report.html"] = identification_report(self._found)
        return files


def _load_identification(folder: Path) -> Answer:
    from windsysid.identification.fit_equations import Fit
    from windsysid.results.identification import Identification
    from windsysid.results.storage import read_fields

    fields: dict[str, Any] = read_fields(folder)
    return Fit(**fields) if "states" in fields else Identification(**fields)


def _known(name: str) -> str:
    if name not in KEPT:
        raise ValueError(name)
    return name
