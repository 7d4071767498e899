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

    The estimate is that of `windsysid.identify`. Samples are kept on disk, next to the checkpoint or in the system's
    folder for temporary files: 8 bytes for each number that the filter reads. All innovations enter the diagnosis;
    those of the last samples are kept.

    Parameters
    ----------
    pieces : iterable of Record
        Records in order, of one sampling rate, such as `windsysid.iterate_record` yields. Samples missing between two
        pieces are missing readings.
    turbine, sensors, prior, parameters, rate, loads, state
        As in `windsysid.identify`; sensors and state are chosen on the first piece.
    formulation : {"joint", "spectral"}, default "joint"
        ``"spectral"`` keeps only sums over blocks; pieces may then be of several records of one turbine in one state,
        and the estimate is within a third of a standard deviation of that of the whole record
        (`windsysid.identification.streaming.spectra`).
    memory : float, optional
        Time constant of exponential forgetting [s] (spectral formulation); by default nothing is forgotten.
    checkpoint : str or Path, optional
        File for the state after each piece, from which an interrupted call continues; deleted at the end.
    keep_checkpoint : bool, default False
        Keep it at the end, so that the caller can delete it once the result is saved.
    progress : callable, optional
        Called with the time [s] reached after each piece.
    options : mapping, optional
        Further values (plain types) that describe the call; kept with the result and with the checkpoint, which a call
        with other options does not continue.

    Returns
    -------
    Identification
        As of `windsysid.identify`; the history of the filter is kept once for each estimate, not for each sample.

    Raises
    ------
    RecordError, ConfigurationError
        If a piece lacks a channel, an option is out of range, or the checkpoint belongs to another call.
    OutputError
        If the disk is full.
    WindsysidError
        As raised by `windsysid.identify`.

    See Also
    --------
    iterate_record : Read a file in pieces.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> pieces = [record.section(0.0, 300.0), record.section(300.0, 600.0)]
    >>> result = ws.identify_pieces(pieces, "tower", formulation="spectral")
    >>> print(f"{result['k_fore_aft'].estimate / 1e6:.2f} MN/m")
    1.88 MN/m
    """
    if isinstance(pieces, str | Path | Record):
        raise ConfigurationError(
            f"pieces: expected records in order, as iterate_record yields them, got one {type(pieces).__name__}: use"
            " identify, or iterate_record for a file that does not fit into memory"
        )
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
