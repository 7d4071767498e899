"""Batch identification of folders of records into an archive, each record once."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from windsysid.errors import ConfigurationError
from windsysid.fleet.archive import UNDATED, Known, claim_archive, day_of, known_sources, place_of
from windsysid.fleet.joining import check_clocks, join_late, read_scadas
from windsysid.fleet.members import Member, member_of, read_fleet, single
from windsysid.fleet.paths import record_paths, size_or_unknown
from windsysid.fleet.remote import is_remote
from windsysid.fleet.scada import Scada
from windsysid.fleet.work.engine import run_here, run_on_dask, share
from windsysid.fleet.work.guard import DeadWorkerError, HangingWorkerError, Worker
from windsysid.fleet.work.tasks import Task
from windsysid.kernels.threads import usable_processors
from windsysid.output.console import printable
from windsysid.output.progress import Progress, unheard
from windsysid.turbine.file import load_turbine
from windsysid.units import spell

__all__ = ["Batch", "batch"]

MAX_RECORD_SECONDS = 600.0
"""Time that a record may take before its worker counts as hanging."""

MAX_RUNS = 3
"""Runs in which a record that failed is tried again."""

FORMULATIONS = ("spectral", "joint", "auto")

_POLLS_PER_REPORT = 20

MIN_RECORDS_PER_WORKER = 50
"""Records whose begin is requested that are worth another worker's start."""

MAX_LISTED_REASONS = 3
"""Reasons for no result that the answer lists."""


@dataclass(frozen=True)
class Batch:
    """Result of `windsysid.batch`: numbers of records that were added to an archive.

    Attributes
    ----------
    archive
        Folder of the archive.
    taken
        Number of records that were ``ok``, ``refused`` or ``failed`` in this run.
    known
        Number of records that the archive had already.
    unmatched
        Number of files that fit no turbine's pattern.
    joined
        Number of records that the archive had already and that were now joined with SCADA data.
    notes
        Reasons of records without a result, and missing files.
    seconds
        Duration of the run [s].
    """

    archive: Path
    taken: dict[str, int] = field(default_factory=dict)
    known: int = 0
    unmatched: int = 0
    joined: int = 0
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    def __str__(self) -> str:
        """One line, and one for each note."""
        count = sum(self.taken.values())
        words = {"ok": "identified", "refused": "refused", "failed": "failed"}
        parts = [f"{self.taken.get(status, 0)} {word}" for status, word in words.items()]
        told = f"{count} record{'s' if count != 1 else ''} taken in {spell(self.seconds)}: {', '.join(parts)}"
        told += f"; {self.known} were there already" if self.known else ""
        told += f"; {self.unmatched} files fit no pattern" if self.unmatched else ""
        told += f"; SCADA joined to {self.joined} of them" if self.joined else ""
        return "\n".join(map(printable, (f"{told}; archive: {self.archive}", *self.notes)))


def batch(
    sources: str | Path | Iterable[str | Path],
    *,
    archive: str | Path,
    turbine: str | Path | None = None,
    fleet: str | Path | None = None,
    mapping: str | Path | None = None,
    sensors: str | Path | None = None,
    scada: str | Path | None = None,
    scada_mapping: str | Path | None = None,
    formulation: str = "spectral",
    workers: int | None = None,
    scheduler: str | None = None,
    limit: float = MAX_RECORD_SECONDS,
    progress: Progress = unheard,
) -> Batch:
    """Identify every record in folders and append one row for each to an archive.

    A record that cannot be identified gives a row with the reason. Records that the archive has are skipped, so that an
    interrupted run can be continued (docs/fleet.md).

    Parameters
    ----------
    sources : str, Path, or iterable of these
        Files, folders (with all below them) and patterns such as ``"data/2026-*/*.parquet"``; or addresses in an object
        store, ``"s3://bucket/data"`` (`windsysid.fleet.remote`).
    archive : str or Path
        Folder of the archive; made if it is missing.
    turbine : str or Path, optional
        Packaged turbine or path of a TOML file, if all records are of one turbine.
    fleet : str or Path, optional
        Fleet file, if they are of several turbines (`windsysid.fleet.members`).
    mapping, sensors, scada, scada_mapping : str or Path, optional
        Files of the one turbine; those of several turbines are named in the fleet file.
    formulation : str, default "spectral"
        As in `windsysid.identify`. The spectral formulation is the fastest, and refuses records that are not
        stationary.
    workers : int, optional
        Processes on this machine; one for each processor by default.
    scheduler : str, optional
        Address of a Dask scheduler whose workers are used instead.
    limit : float, default 600
        Time limit for one record [s]; its worker is then ended, and the row gives this as the reason.
    progress : callable, optional
        Called with the present step and the share that is done, 0 to 1, or None if that is unknown.

    Returns
    -------
    Batch
        Numbers of new and known records, and the reasons of those without a result.

    Raises
    ------
    ConfigurationError
        If an option or a file of a turbine is wrong, no record is found, or the archive was made with other settings.
    OutputError
        If the archive cannot be written; finished rows are kept, and the same call continues.

    See Also
    --------
    identify : One record.
    monitor : Drifts and jumps over many records.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> folder = Path(tempfile.mkdtemp())
    >>> ws.write_record(ws.simulate("tower", duration=600.0, rate=5.0), folder / "records" / "first.csv")
    >>> done = ws.batch(folder / "records", archive=folder / "archive", turbine="tower", workers=1)
    >>> done.taken, done.known
    ({'ok': 1}, 0)
    """
    _check_options(turbine, fleet, formulation, workers, limit)
    members = _members(turbine, fleet, mapping=mapping, sensors=sensors, scada=scada, scada_mapping=scada_mapping)
    if is_remote(str(archive)):
        raise ConfigurationError(
            f"archive {archive}: expected a folder: records may be in an object store, the archive not; copy it there"
        )
    begun, folder = time.monotonic(), Path(archive).resolve()
    settings = {member.name: _settings(member, formulation) for member in members}
    scadas, notes = read_scadas(members)
    progress("looking for records", None)
    theirs, unmatched = _assigned(record_paths(sources, folder), members)
    notes += _unused_patterns(theirs, members) if unmatched else ()
    with claim_archive(folder):
        known = {member.name: known_sources(folder, member.name) for member in members}
        _check_settings(folder, known, settings)
        new = {member: _new(theirs[member.name], known[member.name]) for member in members}
        there = sum(map(len, theirs.values())) - sum(map(len, new.values()))
        run = _ArchiveRun(folder, formulation, limit, settings, scadas, known)
        joined = _join_scada(run, members, progress)
        counted = _identify(run, new, workers or len(usable_processors()), scheduler, progress)
    return Batch(
        folder, dict(counted.taken), there, unmatched, joined, (*counted.reasons(), *notes), time.monotonic() - begun
    )


class _ArchiveRun(NamedTuple):
    """The archive of one run, how its records are identified, and by turbine the settings, SCADA and known records."""

    folder: Path
    formulation: str
    limit: float
    settings: dict[str, str]
    scadas: dict[str, Scada]
    known: dict[str, dict[str, Known]]


def _check_options(
    turbine: str | Path | None, fleet: str | Path | None, formulation: str, workers: int | None, limit: float
) -> None:
    if (turbine is None) == (fleet is None):
        raise ConfigurationError(
            "batch: whose records are they? Expected one of turbine (T, of all) and fleet (FILE, of several), got "
            + ("none" if fleet is None else "both")
        )
    if formulation not in FORMULATIONS:
        raise ConfigurationError(f"formulation: expected {', '.join(FORMULATIONS)}; got '{formulation}'")
    if workers is not None and workers < 1:
        raise ConfigurationError(f"workers: expected 1 or more, got {workers}")
    if not limit > 0.0:
        raise ConfigurationError(f"limit: expected a time above 0 s, got {limit:g}")


def _members(
    turbine: str | Path | None, fleet: str | Path | None, **files: str | Path | None
) -> tuple[Member, ...]:  # fmt: skip
    """The turbines of a fleet file, or the one turbine with its files."""
    if fleet is None:
        return (single(str(turbine), **files),)
    if any(files.values()):
        raise ConfigurationError("batch: a fleet file names mapping, sensors and SCADA itself: leave them out")
    return read_fleet(fleet)


def _unused_patterns(theirs: Mapping[str, Sequence[str]], members: Sequence[Member]) -> tuple[str, ...]:
    bare = (member for member in members if not theirs[member.name])
    return tuple(
        f"no file fits the pattern of '{member.name}': {member.pattern}" for member in islice(bare, MAX_LISTED_REASONS)
    )


def _join_scada(run: _ArchiveRun, members: Sequence[Member], progress: Progress) -> int:
    """Join SCADA to the records that the archive has already; how many changed."""
    joined = 0
    for member in members:
        known = run.known[member.name]
        if member.name in run.scadas and known:
            progress(f"joining SCADA to records of {member.name}", None)
            usual = load_turbine(member.turbine).rotor_speed
            joined += join_late(run.folder, member.name, run.scadas[member.name], usual, known)
    return joined


def _identify(
    run: _ArchiveRun, new: Mapping[Member, Sequence[str]], workers: int, scheduler: str | None, progress: Progress
) -> "_Counted":
    """Identify the new records of each turbine, here or on Dask."""
    with ExitStack() as stack:
        team = [stack.enter_context(closing(Worker(run.limit))) for _ in range(workers)]
        tasks = _tasks(run, new, team, progress)
        total = sum(len(task.sources) for task in tasks)
        counted = _Counted(total, progress)
        if scheduler is None:
            run_here(tasks, team[:total], counted.tell)
        else:
            stack.close()
            run_on_dask(tasks, scheduler, counted.tell)
    return counted


class _Counted:
    """Counter of records, with their rate."""

    def __init__(self, total: int, progress: Progress) -> None:
        self.total, self.progress, self.taken, self.whys = total, progress, Counter[str](), Counter[tuple[str, str]]()
        self.begun = time.monotonic()

    def tell(self, status: str, why: str) -> None:
        """One more."""
        self.taken[status] += 1
        if status != "ok":
            self.whys[status, why] += 1
        done, seconds = sum(self.taken.values()), time.monotonic() - self.begun
        told = f"{done} of {self.total} records, {done / max(seconds, 1e-9):.2g} a second"
        bad = done - self.taken["ok"]
        self.progress(f"{told}, {bad} without a result" if bad else told, done / self.total)

    def reasons(self) -> list[str]:
        """A sentence for each of the commonest reasons why there is no result."""
        told = [f"{count} {status}: {why}" for (status, why), count in self.whys.most_common(MAX_LISTED_REASONS)]
        more = len(self.whys) - MAX_LISTED_REASONS
        return [*told, f"{more} other reasons: column why of the archive"] if more > 0 else told


def _settings(member: Member, formulation: str) -> str:
    try:
        return member.settings(formulation)
    except ConfigurationError as error:
        raise ConfigurationError(f"'{member.name}': {error}") from None


def _assigned(files: Sequence[str], members: Sequence[Member]) -> tuple[dict[str, list[str]], int]:
    """The records of each turbine, and how many files fit none; SCADA files are no records."""
    tables = {member.scada for member in members}
    theirs: dict[str, list[str]] = {member.name: [] for member in members}
    unmatched = 0
    for path in files:
        if path in tables:
            continue
        member = member_of(Path(path), members)
        if member is None:
            unmatched += 1
        else:
            theirs[member.name].append(path)
    if not any(theirs.values()):
        raise ConfigurationError(
            f"no file fits a pattern, {members[0].pattern} of '{members[0].name}' for one; got {len(files)},"
            f" {files[0]} for one"
        )
    return theirs, unmatched


def _check_settings(archive: Path, known: dict[str, dict[str, Known]], settings: dict[str, str]) -> None:
    for name, rows in known.items():
        if any(row.settings != settings[name] for row in rows.values()):
            raise ConfigurationError(
                f"archive {archive}: '{name}' is there with another turbine file, sensors, mapping or formulation:"
                " choose another"
            )


def _new(paths: Sequence[str], known: dict[str, Known]) -> list[str]:
    """Records that are not known, have another size than they had, or failed and may be tried again."""
    found = []
    for path in paths:
        row = known.get(path)
        if row is None or row.size != size_or_unknown(path) or (row.status == "failed" and row.tries < MAX_RUNS):
            found.append(path)
    return found


def _tasks(
    run: _ArchiveRun, new: Mapping[Member, Sequence[str]], team: Sequence[Worker], progress: Progress
) -> list[Task]:
    """Records of a turbine and day together, in order; ConfigurationError where all have another clock than
    their SCADA: SCADA says its zone, and they do not, or the other way round."""
    known, of = run.known, {member.name: member for member in new}
    asked = [(member, path) for member, paths in new.items() for path in paths if _unknown(path, known[member.name])]
    begins = _begins(asked, team, progress)
    days: dict[tuple[str, str], list[tuple[str, int]]] = {}
    for name, member in of.items():
        for path in new[member]:
            day, tries = _day_and_tries(path, known[name].get(path), begins)
            days.setdefault((name, day), []).append((path, tries))
        starts = set(filter(None, map(begins.get, new[member])))
        if name in run.scadas and starts:
            check_clocks(name, run.scadas[name], starts)
    settings, limit = run.settings, run.limit
    return [
        Task(
            of[name], day, str(place_of(run.folder, name, day)), tuple(sources), run.formulation, settings[name], limit
        )
        for (name, day), sources in sorted(days.items())  # turbine by turbine: each worker reads its SCADA once
    ]


def _day_and_tries(path: str, row: Known | None, begins: Mapping[str, str | None]) -> tuple[str, int]:
    return (day_of(begins.get(path), path), 0) if row is None else (row.day, row.tries)


def _unknown(path: str, known: dict[str, Known]) -> bool:
    """Test whether a record has to be opened for its day: a remote one with a date in its name is not copied twice."""
    return path not in known and not (is_remote(path) and not day_of(None, path).startswith(UNDATED))


def _begins(asked: Sequence[tuple[Member, str]], team: Sequence[Worker], progress: Progress) -> dict[str, str | None]:
    """When records begin, by path; None where they do not say it, or cannot be opened."""
    found: dict[str, str | None] = {}

    def hear(path: str, start: str | None) -> None:
        found[path] = start
        if len(found) % _POLLS_PER_REPORT == 0:
            progress("when the records began", len(found) / len(asked))

    share(asked, team[: math.ceil(len(asked) / MIN_RECORDS_PER_WORKER)], _look, hear)
    return found


def _look(one: tuple[Member, str], worker: Worker, say: Callable[[str, str | None], None]) -> None:
    member, path = one
    try:
        say(path, worker.ask({"do": "look", "source": path, "member": asdict(member)})["start"])
    except (DeadWorkerError, HangingWorkerError):
        say(path, None)
