"""The process that opens records: it may hang or die without harm to others.

It reads one request a line from standard input and writes one answer a line: JSON, paths or samples in, rows out.
``python -m windsysid.fleet.work.worker`` is started by `windsysid.fleet.work.guard` only.

Models are compiled once a host: the first identification of each turbine is made under a lock, one process at a time.
The one that waits says so, since waiting is not hanging.
"""

import json
import os
import sys
import time
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.fleet.joining import join
from windsysid.fleet.members import Member
from windsysid.fleet.paths import size_or_unknown, why_missing
from windsysid.fleet.remote import fetched, size_of
from windsysid.fleet.rows import Row, empty_row, failed_row, row_of
from windsysid.fleet.scada import Scada, read_scada
from windsysid.kernels.cache import cache_folder
from windsysid.mechanics.sensor_lists import read_sensors
from windsysid.mechanics.sensors import Sensor
from windsysid.output.locks import release, try_lock
from windsysid.records.formats import format_of, load_mapping, read_record
from windsysid.records.formats.access.files import named_after
from windsysid.records.formats.access.probing import ProcessGuard
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.moments import shift_moment
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.results.serialization import finite
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["main", "pack_samples", "take", "take_samples"]

POLL_SECONDS = 0.2
"""Interval at which a lock that another process holds is tried again [s]."""

Say = Callable[[dict[str, Any]], None]

_compiled: set[str] = set()
"""Turbines whose models this process has."""


def main() -> None:
    """Answer requests until standard input ends."""
    ProcessGuard.on = True
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print is no answer

    def say(answer: dict[str, Any]) -> None:
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    say({"event": "ready"})
    for line in sys.stdin:
        request = json.loads(line)
        member = Member(**request["member"])
        if request["do"] == "look":
            say({"event": "done", "start": _start_of(request["source"], member)})
        elif request["do"] == "samples":
            begun = time.process_time()
            row, spectra = take_samples(request, member, request["formulation"], request["settings"], say)
            seconds = time.process_time() - begun
            say({"event": "done", "row": finite(row), "seconds": seconds, "spectra": spectra})
        else:
            row = take(request["source"], member, request["formulation"], request["settings"], say)
            say({"event": "done", "row": finite(row)})


def _start_of(source: str, member: Member) -> str | None:
    """When a record begins, by its header; None where it does not say it or cannot be opened."""
    try:
        with fetched(source) as path, named_after(path):
            opened = format_of(path).open(path, _mapping(member.mapping))
        if opened.start is None:
            return None
        return shift_moment(opened.start, opened.first if opened.first == opened.first else 0.0)
    except Exception:  # taking it will say what is wrong
        return None


def take(source: str, member: Member, formulation: str, settings: str, say: Say) -> Row:
    """The row of a record, whatever happens."""
    size = size_or_unknown(source)
    try:
        if (why := why_missing(source)) is not None:
            return failed_row(source, size, settings, why)
        size = size_of(source)
        row = empty_row(source, size, settings)
        machine = _turbine(member.turbine)
        sensors = _sensors(member.sensors)
        with fetched(source) as path:
            try:
                record = read_record(path, mapping=_mapping(member.mapping))
            except (RecordError, ConfigurationError) as error:
                return row | {"status": "refused", "why": " ".join(str(error).replace(str(path), source).split())}
        with _one_compiles(member.turbine, say):
            row = row_of(row, record, machine, sensors, formulation)
        scada = None
        with suppress(RecordError, ConfigurationError):  # being written just now: the next run joins it
            scada = _scada(member.scada, member.scada_mapping)
        return row if scada is None else join(row, scada, machine.rotor_speed)
    except Exception as error:  # whatever it is: the row says so, and the run goes on
        return failed_row(source, size, settings, f"{type(error).__name__}: {' '.join(str(error).split())}")


def pack_samples(record: Record, rate: float) -> dict[str, Any]:
    """A record whose times are k/rate, as a request that `take_samples` takes."""
    return {
        "do": "samples", "source": record.name, "channels": record.channels, "units": record.units,
        "rate": rate, "start": record.start, "values": b64encode(record.values.data).decode(),
    }  # fmt: skip


def take_samples(
    request: dict[str, Any], member: Member, formulation: str, settings: str, say: Say
) -> tuple[Row, list[str]]:
    """Row of the samples in the request, without SCADA of files, and plots of their spectra as JSON."""
    from windsysid.reports.interactive.identification import compact_spectra
    from windsysid.reports.interactive.plot import to_json

    source, size = request["source"], -1
    results: list[Identification] = []
    try:
        values = np.frombuffer(b64decode(request["values"])).reshape(-1, len(request["channels"]))
        size = values.nbytes
        row = empty_row(source, size, settings)
        machine = _turbine(member.turbine)
        sensors = _sensors(member.sensors)
        record = Record(
            np.arange(len(values)) / request["rate"], values, request["channels"], request["units"], name=source,
            start=request["start"],
        )  # fmt: skip
        with _one_compiles(member.turbine, say):
            row = row_of(row, record, machine, sensors, formulation, results.append)
        return row, [to_json(plot) for result in results for plot in compact_spectra(result, record)]
    except Exception as error:  # as `take`
        return failed_row(source, size, settings, f"{type(error).__name__}: {' '.join(str(error).split())}"), []


@contextmanager
def _one_compiles(turbine: str, say: Say) -> Iterator[None]:
    """Hold the lock of this host's cache while a turbine's model may be compiled for the first time."""
    if turbine in _compiled:
        yield
        return
    lock = cache_folder() / ".compiling"
    handle = try_lock(lock)
    while handle is None:
        say({"event": "waiting"})
        time.sleep(POLL_SECONDS)
        handle = try_lock(lock)
    try:
        say({"event": "compiling"})
        yield
        _compiled.add(turbine)
    finally:
        release(handle, lock)


@cache
def _turbine(name: str) -> Turbine:
    return load_turbine(name)


@cache
def _sensors(path: str | None) -> tuple[Sensor, ...] | None:
    return None if path is None else read_sensors(path)


@cache
def _mapping(path: str | None) -> Mapping:
    return Mapping() if path is None else load_mapping(path)


@lru_cache(maxsize=4)
def _scada(path: str | None, mapping: str | None) -> Scada | None:
    """SCADA of a turbine; None where there is none yet: the rows get it when it is there."""
    return None if path is None or not Path(path).exists() else read_scada(path, mapping)


if __name__ == "__main__":
    main()
