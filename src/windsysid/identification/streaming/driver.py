"""One pass over the pieces of a record: what takes them in is begun with the first and concludes after the last."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Protocol

from windsysid.errors import RecordError
from windsysid.identification.condition.readings import screened, usable_sensors
from windsysid.inspection.fault import Fault
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.turbine.turbine import Turbine

__all__ = ["take_in"]


class _Run(Protocol):
    def take(self, piece: Record, /) -> None:
        """The next piece as it was recorded."""

    def conclude(self, started: float, faults: Sequence[Fault], /) -> Identification:
        """The result, with the faults of all pieces."""


def take_in(
    pieces: Iterable[Record], turbine: Turbine, sensors: Sequence[Sensor] | None,
    begin: Callable[[Record, tuple[Sensor, ...]], _Run], started: float, *, checkpoint: Path | None,
    keep_checkpoint: bool, progress: Callable[[float], None] | None,
) -> Identification:  # fmt: skip
    """Take in piece by piece, and conclude; a checkpoint that is not kept goes then.

    Raises
    ------
    RecordError
        If there is no piece.
    """
    run: _Run | None = None
    faults: list[Fault] = []
    found: tuple[Sensor, ...] = ()
    for piece in pieces:
        if run is None:
            found = usable_sensors(piece, turbine, sensors)
            faults += screened(piece, turbine, found)
            run = begin(piece, found)
            run.take(piece)
        else:
            run.take(piece)
            faults += screened(piece, turbine, found, refuse=False)
        if progress:
            progress(float(piece.time[-1]))
    if run is None:
        raise RecordError("no pieces: expected at least one, got an empty record")
    result = run.conclude(started, faults)
    if checkpoint is not None and not keep_checkpoint:
        checkpoint.unlink(missing_ok=True)
    return result
