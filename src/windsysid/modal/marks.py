"""Modes that a user adds or removes by hand, in a TOML file that the page of `oma` writes.

add = [[0.9, 1.1]]      # frequency ranges [Hz] to fit modes in
remove = [2.345]        # frequencies [Hz] of modes to leave out
"""

from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from windsysid.configuration import read_tables
from windsysid.errors import ConfigurationError
from windsysid.mechanics.sensor_lists import first_problem

__all__ = ["ModeMarks", "read_mode_marks"]


class ModeMarks(BaseModel):
    """Modes that are added and removed by hand.

    Attributes
    ----------
    add
        Frequency ranges (lowest, highest) [Hz] in which modes are fitted.
    remove
        Frequencies [Hz] of modes to leave out.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> marks = ws.results.ModeMarks(add=((0.25, 0.4),), remove=(0.58,))
    >>> len(ws.oma(record, bands=marks).modes)
    2
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    add: tuple[tuple[float, float], ...] = Field(default=())
    remove: tuple[float, ...] = Field(default=())

    @field_validator("add")
    @classmethod
    def _rises(cls, value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for low, high in value:
            if not 0.0 <= low < high:
                raise ValueError("expected two rising frequencies in Hz")
        return value

    def index_of(self, frequency: float, modes: list[tuple[float, float]]) -> int | None:
        """Index of the mode (frequency, half-width [Hz]) that a frequency to be removed is nearest to and within three
        half-widths of; None if there is none.

        Parameters
        ----------
        frequency
            Of the mode that is to be left out [Hz].
        modes
            Frequency and half-width of each mode [Hz].

        Examples
        --------
        >>> ModeMarks().index_of(1.01, [(1.0, 0.01), (2.0, 0.01)]), ModeMarks().index_of(1.5, [(1.0, 0.01)])
        (0, None)
        """
        near = [i for i, (f, half) in enumerate(modes) if abs(f - frequency) <= max(3.0 * half, 0.001 * f)]
        return min(near, key=lambda i: abs(modes[i][0] - frequency)) if near else None

    def kept(self, modes: Sequence[tuple[float, float]]) -> tuple[list[int], list[str]]:
        """Indices of the modes (frequency, half-width [Hz]) that are not removed, and a note on each removal."""
        left, notes = list(range(len(modes))), list[str]()
        for frequency in self.remove:
            at = self.index_of(frequency, [modes[i] for i in left])
            missing = f"no mode is near {frequency:.4g} Hz, which was to be removed by hand"
            notes.append(missing if at is None else f"the mode at {modes[left.pop(at)][0]:.4g} Hz was removed by hand")
        return left, notes


def read_mode_marks(path: str | Path) -> ModeMarks:
    """Read modes that were added or removed by hand.

    Parameters
    ----------
    path : str or Path
        TOML file with ``add`` and ``remove``, as the page of ``oma`` saves it.

    Returns
    -------
    ModeMarks
        Ranges to add and frequencies to remove [Hz].

    Raises
    ------
    ConfigurationError
        If the file is missing or has another content.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> path = Path(tempfile.mkdtemp()) / "modes.toml"
    >>> _ = path.write_text("remove = [2.345]")
    >>> ws.results.read_mode_marks(path).remove
    (2.345,)
    """
    expected = 'expected a file with add = [[LOW, HIGH], …] and remove = [F, …] in Hz, as the page of "oma" saves it'
    content = read_tables(Path(path), expected.removeprefix("expected "))
    try:
        return ModeMarks.model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(f"{path}: {first_problem(error)}; {expected}") from None
