"""Identify stiffness and damping from a record too long for memory, segment by segment.

One streaming run (`windsysid.identification.streaming.run`) with the accumulator of a formulation: samples on disk, or
sums of spectra.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from windsysid.errors import ConfigurationError, as_numerical_error
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.prior_odds import check_odds
from windsysid.identification.streaming.run import StreamingJob, run_segments
from windsysid.identification.streaming.spectra import SpectraAccumulator
from windsysid.identification.streaming.time_domain import SampleAccumulator
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.turbine.coercion import TurbineLike, as_turbine

__all__ = ["identify_pieces"]


@one_thread()
@as_numerical_error("the identification")
def identify_pieces(
    pieces: Iterable[Record],
    turbine: TurbineLike,
    *,
    sensors: Sequence[Sensor] | None = None,
    prior: Prior | None = None,
    parameters: Sequence[str] | None = None,
    formulation: Literal["joint", "spectral"] = "joint",
    rate: float | None = None,
    loads: str = "auto",
    state: str = "auto",
    memory: float | None = None,
    checkpoint: str | Path | None = None,
    keep_checkpoint: bool = False,
    progress: Callable[[float], None] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Identification:
    """Identify stiffness and damping from a record that comes in pieces, in bounded memory.

    The estimate is what `windsysid.identify` would find. Samples are held on disk, next to the checkpoint or in the
    system's folder for temporary files: 8 bytes for each number that a filter reads. The diagnosis judges all
    innovations; kept are those of the last samples.

    Parameters
    ----------
    pieces
        Records in order, of one sampling rate: `windsysid.iterate_record` makes them of a file. Samples missing between
        two pieces are missing readings.
    turbine, sensors, prior, parameters, rate, loads, state
        As for `windsysid.identify`; sensors and state are chosen on the first piece.
    formulation
        joint, or spectral: then sums over blocks are all that is kept, pieces may be of several records of one machine
        in one state, and the result is within a third of a standard deviation of a whole record's
        (`windsysid.identification.streaming.spectra`).
    memory
        Of the spectral formulation: time [s] in which what was taken in comes to count as 1/e, so that the result is
        that of late; None where nothing is forgotten.
    checkpoint
        Where to write what is known after each piece, and to go on from if it is there; it is deleted at the end.
    keep_checkpoint
        Leave it there: who saves the result deletes it then, and nothing is lost if the disk is full or the process is
        killed before.
    progress
        Called with the time [s] reached after each piece.
    options
        Plain values that tell more of the call: kept with the result, and with the checkpoint, which another call does
        not take up.

    Returns
    -------
    Identification
        As of `windsysid.identify`; what was known on line is kept once for each estimate, not for each sample.

    Raises
    ------
    RecordError, ConfigurationError
        If a piece does not hold what is needed, an option is out of range, or the checkpoint belongs to another call.
    OutputError
        If the disk is full.
    WindsysidError
        As `windsysid.identify` raises it.
    """
    job = StreamingJob(
        as_turbine(turbine), sensors, prior or Prior(), parameters, formulation, rate, loads, memory,
        None if checkpoint is None else Path(checkpoint), keep_checkpoint, options or {}, state,
    )  # fmt: skip
    _check(job)
    begin = SampleAccumulator if formulation == "joint" else SpectraAccumulator
    return run_segments(pieces, job, begin, progress)


def _check(job: StreamingJob) -> None:
    """Refuse options that the formulation does not take, and prior odds of effects that there are not."""
    check_odds(job.turbine)
    if job.formulation == "spectral":
        if job.rate is not None:
            raise ConfigurationError("the spectral formulation chooses its frequency ranges itself: leave the rate out")
        if job.memory is not None and not job.memory > 0.0:
            raise ConfigurationError(f"memory: expected seconds greater than 0, got {job.memory:g}")
    elif job.formulation != "joint" or job.memory is not None:
        raise ConfigurationError(
            f"pieces: expected the formulation joint without a memory, or spectral, got '{job.formulation}'"
        )
