"""Every format that windsysid reads, written by somebody else's library: read bit for bit, cut, and damaged.

    python -m validation.formats [--files 200] [--seed 1]

For each format the table says what wrote the file; whether times, values, units and start are those that were written;
how many of files cut at random places are detected (refused, or read up to the cut saying so); and what became of
damaged ones: refused in one line, read as they were written, or read with other numbers, names or units, which a format
without checksums cannot show. An error that is not one line, or a record with another number of samples, is a fault,
and the command ends with exit code 1. Files are read in a process of their own: a damaged HDF5 file can make its
library hang or crash, which the last column counts and no reader of Python can help.
"""

import argparse
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from validation.format_samples import SAMPLES, Sample, files_of, truth
from windsysid.errors import WindsysidError
from windsysid.output.console import render
from windsysid.output.table import Table
from windsysid.records.formats import read_record
from windsysid.records.formats.access.probing import ProcessGuard
from windsysid.records.moments import moment
from windsysid.records.record import Record
from windsysid.units import si_unit, to_si

__all__ = ["check_format", "damaged"]

_SECONDS = 8  # of processor time for one file: more, and it hangs
_LONGEST = 600.0  # s that a file may take on a busy machine
_RESOLUTION = 1e-12  # s


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=200, help="damaged files of each format")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="formats whose name holds this")
    options = parser.parse_args()
    rows, faults = [], 0
    for name, sample in SAMPLES.items():
        if options.only and options.only not in name:
            continue
        row, wrong = check_format(name, sample, options.files, options.seed)
        rows.append(row)
        faults += wrong
        print(" · ".join(row), file=sys.stderr)
    headings = (
        "format", "written by", "read", "cut, told", "not told", "damage refused", "as written", "other numbers",
        "faults",
    )  # fmt: skip
    print(render(Table(headings, rows, f"{options.files} damaged files of each format, seed {options.seed}")))
    sys.exit(1 if faults else 0)


def check_format(name: str, sample: Sample, files: int, seed: int) -> tuple[tuple[str, ...], int]:
    """The row of one format, and how many faults there are."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"x{sample.ending}"
        try:
            sample.write(path, *truth(sample))
        except ImportError as error:
            return (name, sample.writer, f"not tried: {error}", *[""] * 6), 0
        good = read_record(path, mapping=sample.mapping)
        read = _compared(good, sample)
        wholes = {target: target.read_bytes() for target in files_of(sample, path)}
        reader, rng = _Reader(name), np.random.default_rng(seed)
        numbers = next(iter(wholes.items()))
        cuts = Counter(_outcome(reader, path, numbers, _cut(numbers[1], rng), good) for _ in range(files // 4))
        chosen = [list(wholes.items())[k % len(wholes)] for k in range(files)]
        found = Counter(_outcome(reader, path, one, _damaged(sample, one[1], rng), good) for one in chosen)
        reader.close()
    faults = {kind: cuts[kind] + found[kind] for kind in ("fault", "crash", "hang")}
    lost = cuts["other numbers"]
    listed = ", ".join(f"{count} {kind}" for kind, count in faults.items() if count) or "0"
    row = (
        name, sample.writer, read, f"{cuts['refused'] + cuts['said']} of {cuts.total()}", str(lost),
        str(found["refused"]), str(found["as written"] + found["said"]), str(found["other numbers"]), listed,
    )  # fmt: skip
    return row, faults["fault"] + (read != "bit-exact")


def _damaged(sample: Sample, whole: bytes, rng: np.random.Generator) -> bytes:
    spared = sample.spared(whole)
    return whole[:spared] + damaged(whole[spared:], rng)


def damaged(whole: bytes, rng: np.random.Generator) -> bytes:
    """A file with bits flipped, bytes changed, lost, added, repeated, zeroed or moved."""
    content = bytearray(whole)
    at, size = int(rng.integers(0, len(whole))), int(rng.integers(1, 200))
    kind = rng.integers(0, 7)
    if kind == 0:
        content[at] ^= 1 << int(rng.integers(0, 8))
    elif kind == 1:
        for place in rng.integers(0, len(whole), 5):
            content[place] = rng.integers(0, 256)
    elif kind == 2:
        del content[at : at + size]
    elif kind == 3:
        content[at:at] = rng.bytes(size)
    elif kind == 4:
        content[at:at] = content[at : at + size]
    elif kind == 5:
        content[at : at + size] = bytes(len(content[at : at + size]))
    else:
        other = int(rng.integers(0, len(whole)))
        content[at], content[other] = content[other], content[at]
    return bytes(content)


def _compared(record: Record, sample: Sample) -> str:
    """Test whether a record is the one that was written."""
    time, values = truth(sample)
    expected = np.column_stack([values[:, i] * to_si(1.0, unit) for i, unit in enumerate(sample.units)])
    if record.channels != sample.names or record.units != tuple(map(si_unit, sample.units)):
        return "other channels"
    if np.max(np.abs(record.time - time - sample.begin)) > _RESOLUTION:
        return "other times"
    if (record.start and moment(record.start)) != (sample.start and moment(sample.start)):
        return "other start"
    if record.values.tobytes() == expected.tobytes():
        return "bit-exact"
    close = np.max(np.abs(record.values - expected)) <= 1e-12 * np.max(np.abs(expected))
    return "bit-exact" if sample.scaled and close else "other values"


class _Reader:
    """Reads files in a process of its own, which is ended where it hangs: a library in C listens to nothing else."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, far = context.Pipe()
        self.process = context.Process(target=_serve, args=(far, self.name), daemon=True)
        self.process.start()
        far.close()

    def read(self, path: Path) -> Record | str:
        """The record, or what became of the file."""
        try:
            self.pipe.send(path)
            if self.pipe.poll(_LONGEST):
                answer: Record | str = self.pipe.recv()
                return answer
            what = "hang"
        except EOFError:
            self.process.join()
            what = "hang" if self.process.exitcode == -signal.SIGXCPU else "crash"
        self.process.kill()
        self._start()
        return what

    def close(self) -> None:
        self.process.kill()


def _serve(pipe: Connection, name: str) -> None:
    mapping = SAMPLES[name].mapping
    ProcessGuard.on = True
    warnings.simplefilter("error")
    while True:
        path = pipe.recv()
        limit = int(time.process_time()) + _SECONDS + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.getrlimit(resource.RLIMIT_CPU)[1]))
        try:
            pipe.send(read_record(path, mapping=mapping))
        except WindsysidError as error:
            pipe.send("fault: two lines" if "\n" in str(error) else "refused")
        except Exception as error:
            pipe.send(f"fault: {type(error).__name__}: {error}")


def _parts(record: Record) -> tuple[object, ...]:
    return record.time.tobytes(), record.values.tobytes(), record.channels, record.units, record.start


def _cut(whole: bytes, rng: np.random.Generator) -> bytes:
    return whole[: rng.integers(1, len(whole))]


def _outcome(reader: _Reader, path: Path, target: tuple[Path, bytes], content: bytes, good: Record) -> str:
    """Outcome of one file with this content; `target` is the file and its content, which it holds again after."""
    target[0].write_bytes(content or b"\n")
    found = reader.read(path)
    target[0].write_bytes(target[1])
    if isinstance(found, str):
        if found != "refused":
            print(f"{reader.name}: {found}", file=sys.stderr)
        return found.split(":")[0]
    if _parts(found) == _parts(good):
        return "as written"
    if "cut_off" in found.attributes:
        return "said"
    if found.samples != good.samples and SAMPLES[reader.name].counted:
        print(f"{reader.name}: {found.samples} samples of {good.samples}", file=sys.stderr)
        return "fault"
    return "other numbers"


if __name__ == "__main__":
    main()
