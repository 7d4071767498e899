"""A fuzz of the command line: whatever a user gives it ends in a right answer or in one clear line.

    python -m validation.fuzz_cli --inputs 1000 --seed 1

Each input is a folder of files and a command. It runs in a forked child of a process that has imported windsysid and
compiled its kernels, so that a crash or a hang stays in the child; signals and terminals also run in new processes. An
input is a violation unless

- it ends with exit code 0 and finite numbers, or with 2 and one line on standard error (a wrong option: the usage
message), or with 130
  or 143 after a signal;
- nothing that it prints is a traceback or a Python warning;
- every file that was there is there unchanged, and a refusal leaves no file behind.

Records that are written in another way (units, order, delimiter, format, a mapping) must give the estimates of the
plain one. Violating inputs are kept, with the command and what it printed, in the folder given by ``--keep``.
"""

import argparse
import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from windsysid import __main__
from windsysid.units import RPM

__all__ = ["Input", "Outcome", "Workshop", "judge", "run_inputs"]

Rng = np.random.Generator

LIMIT = 180.0
"""Seconds that one input may take: a turbine or sensors of another structure compile first."""

REAL = 0.1
"""Share of signals and terminals that run in a new process and not in a fork."""

NASTY = [
    "", "x", "-1", "0", "1e400", "-1e400", "1e308", "1e-320", "nan", "inf", "-inf", "true", "[]", "{}", "[1, 2]", '""',
    '"x"', '"1 kg"', '"-3 N/m"', '"1e999 kg"',
    '"nan kg"', '"0 N/m"', '"5 furlong"', '"12 rpm"', '"1 kg kg"', '"[red]markup[/red]"', '"[/]"', '"[bold"',
    '"\\u0000"', '"\\n"', '"\\u001b[31m"', '"ü漢字🌀"',
    "9" * 400, "2020-01-01", "0x10", "1_000", "'", '"', "1e5", "1000000", '"../../etc"', "1979-05-27T07:32:00Z",
    '"1e308 kg"', '"1e-308 m"', "0.999999999999",
]  # fmt: skip
"""Values that somebody could write into TOML, or a slip of the hand."""

OPTION_VALUES = [
    "",
    " ",
    "-1",
    "0",
    "1",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "1e308",
    "1e-300",
    "x",
    "ü",
    "[red]",
    "[/]",
    "12 rpm",
    "10 s",
    "1 h",
    "0 s",
    "-5 min",
    "9" * 400,
    "\t",
    "a\nb",
]


@dataclass
class Input:
    """One input: a command, the files it finds, and how it is run."""

    kind: str
    argv: list[str]
    files: dict[str, bytes | Path] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    encoding: str = "utf-8"
    signal: int = 0
    after: float = 0.0
    same: bool = False
    """The answer must be the plain record's."""


@dataclass
class Outcome:
    """End of a command: exit code as a shell gives it, None after the time limit."""

    code: int | None
    out: str
    err: str


class Workshop:
    """Good files that inputs are made of: a turbine, its record in every format, sensors, a mapping, results."""

    def __init__(self, folder: Path):
        from windsysid import cli
        from windsysid.records.formats import write_record
        from windsysid.records.record import Record
        from windsysid.simulation.record import simulate_record
        from windsysid.turbine.file import load_turbine

        self.folder = folder
        packaged = Path(cli.__file__).parents[1] / "turbine" / "packaged"
        self.turbines = {name: (packaged / f"{name}.toml").read_text("utf-8") for name in ("tower", "verne555")}
        self.record: Record = simulate_record(load_turbine("tower"), duration=40.0, rate=10.0, seed=1)
        self.sensors = "[[sensor]]" + self.turbines["tower"].split("[[sensor]]", 1)[1]
        self.records: dict[str, bytes] = {}
        for ending in ("csv", "nc", "parquet"):
            try:
                write_record(self.record, folder / f"r.{ending}")
            except Exception as error:
                if "pyarrow" not in str(error):
                    raise
                continue
            self.records[ending] = (folder / f"r.{ending}").read_bytes()
        self.records["outb"] = _outb(self.record)
        _warm_up(self.record, load_turbine("tower"), folder)
        self.results = folder / "result"
        first = Input(
            "plain",
            ["identify", str(folder / "r.csv"), "--turbine", "tower", "--output", str(self.results), "--no-report"],
        )
        ended = run(first, folder)
        if ended.code != 0:
            raise SystemExit(f"the plain record is refused, so there is nothing to fuzz: {ended.err}")
        self.truth = estimates(self.results)


def _warm_up(record: Any, turbine: Any, folder: Path) -> None:
    """Import and compile what the children need, so that a fork has it already."""
    from windsysid.identification.identify import identify
    from windsysid.inspection import inspect_record
    from windsysid.modal.sweep import find_modes
    from windsysid.records.formats import read_record
    from windsysid.reports.identification import identification_report

    found = identify(read_record(folder / "r.csv"), turbine)
    str(found)
    found.save(folder / "warm")
    identification_report(found, record)
    str(find_modes(turbine))
    str(inspect_record(record))
    for ending in ("nc", "parquet"):
        if (folder / f"r.{ending}").is_file():
            read_record(folder / f"r.{ending}")


def estimates(folder: Path) -> dict[str, float]:
    """Estimates of a result by name."""
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    return {name: float(found["estimate"]) for name, found in summary["parameters"].items()}


# Inputs


def turbine_input(shop: Workshop, rng: Rng) -> Input:
    """A turbine file with slips."""
    text = damaged_toml(shop.turbines[str(rng.choice(["tower", "tower", "verne555"]))], rng)
    command = [["identify", "r.csv", "--turbine", "t.toml", "--output", "out", "--no-report"],
               ["modes", "--turbine", "t.toml"], ["inspect", "r.csv", "--turbine", "t.toml"],
               ["simulate", "--turbine", "t.toml", "--output", "new.csv", "--duration", "2", "--rate",
               "20"]][rng.choice(4, p=[0.4, 0.3, 0.15, 0.15])]  # fmt: skip
    return Input("turbine", command, {"t.toml": text, "r.csv": shop.records["csv"]})


def sensors_input(shop: Workshop, rng: Rng) -> Input:
    """A sensor list with slips."""
    argv = ["identify", "r.csv", "--turbine", "tower", "--sensors", "s.toml", "--output", "out", "--no-report"]
    return Input("sensors", argv, {"s.toml": damaged_toml(shop.sensors, rng), "r.csv": shop.records["csv"]})


def mapping_input(shop: Workshop, rng: Rng) -> Input:
    """A mapping with slips."""
    text = (
        'only_listed = true\n[time]\ncolumn = "time"\nunit = "s"\n[csv]\ndelimiter = ","\ndecimal = "."\nheader_row ='
        ' 1\nmissing = ["-9999"]\n'
    )
    for channel, unit in zip(shop.record.channels, shop.record.units, strict=True):
        text += f'[channels.{channel}]\nname = "{channel}"\nunit = "{unit}"\nsign = 1\nfactor = 1.0\n'
    argv = ["inspect", "r.csv", "--mapping", "m.toml"]
    if rng.random() < 0.5:
        argv = ["identify", "r.csv", "--turbine", "tower", "--mapping", "m.toml", "--output", "out", "--no-report"]
    return Input("mapping", argv, {"m.toml": damaged_toml(text, rng), "r.csv": shop.records["csv"]})


def record_input(shop: Workshop, rng: Rng) -> Input:
    """A damaged record in any format."""
    ending = str(rng.choice(list(shop.records)))
    content = shop.records[ending]
    damage = _damaged_text if ending == "csv" and rng.random() < 0.8 else _damaged_bytes
    name = f"r.{ending}" if rng.random() < 0.97 else str(rng.choice(["r.xyz", "r", "r.CSV", "[red].csv", "ü 漢.csv"]))
    argv = (
        ["inspect", name]
        if rng.random() < 0.5
        else ["identify", name, "--turbine", "tower", "--output", "out", "--no-report"]
    )
    return Input("record", argv, {name: damage(content, rng)})


def hostile_input(shop: Workshop, rng: Rng) -> Input:
    """A file that says more than it holds, or settings that no file has."""
    kind = int(rng.integers(len(HOSTILE)))
    name, content = HOSTILE[kind](shop, rng)
    files: dict[str, bytes | Path] = {name: content}
    if name != "m.toml":
        return Input("hostile", ["inspect", name], files)
    files["r.csv"] = shop.records["csv"]
    return Input("hostile", ["inspect", "r.csv", "--mapping", "m.toml"], files)


def _hostile_times(shop: Workshop, rng: Rng) -> tuple[str, bytes]:
    """A gap or a time that no clock shows."""
    lines = shop.records["csv"].split(b"\n")
    row = int(rng.integers(2, len(lines) - 2))
    low = str(rng.choice(["1e9", "1e12", "1e300", "1e308", "-1e308", "nan", "inf", "1e-320", "1700000000"])).encode()
    lines[row] = low + lines[row][lines[row].index(b",") :]
    return "r.csv", b"\n".join(lines[: row + 1] if rng.random() < 0.5 else lines)


def _hostile_row(shop: Workshop, rng: Rng) -> tuple[str, bytes]:
    """A row of very many blanks, digits, quotes or delimiters."""
    lines = shop.records["csv"].split(b"\n")
    filling = [b" ", b" \t", b"1", b'"', b",", b"\xc2\xa0", b"'", b"["][int(rng.integers(8))]
    at = int(rng.integers(min(6, len(lines))))
    lines[at] = lines[at][:5] + filling * int(rng.integers(10**5, 10**6)) + lines[at][5:]
    return "r.csv", b"\n".join(lines)


def _hostile_mapping(shop: Workshop, rng: Rng) -> tuple[str, bytes]:
    """A pattern, an encoding or nested keys that are none."""
    codes = ("idna", "punycode", "undefined", "rot13", "base64", "unicode_escape", "utf-7", "utf-16", "hz", "cp037")
    texts = [
        f'[time]\nformat = "{"".join(rng.choice(["%Y", "%", "%d", "%z", "%Q", "[", "(", "%f", "%G"], 4))}"\n',
        f'[csv]\nencoding = "{rng.choice(codes)}"\n',
        ".".join("a" * int(rng.integers(10, 10**5))) + " = 1\n",
        "x = " + str(rng.choice(["[", "{ a = ", '"\\"', "-", "9"])) * int(rng.integers(10, 10**5)),
    ]
    return "m.toml", texts[int(rng.integers(len(texts)))].encode()


def _hostile_hdf5(shop: Workshop, rng: Rng) -> tuple[str, bytes]:
    """HDF5 whose groups are a graph, or whose values are nowhere or in another file."""
    import h5py

    kind = int(rng.integers(6))
    path = shop.folder / f"h{os.getpid()}.h5"
    with h5py.File(path, "w") as file:
        file["time"], file["sway_m"] = shop.record.time, shop.record.values[:, 0]
        group = file.create_group("g")
        if kind == 0:
            for _ in range(30):
                group["b"] = group.create_group("a")
                group = group["a"]
        elif kind == 1:
            group["up"] = file["/"]
        elif kind == 2:
            file.create_dataset("big", (int(10.0 ** rng.uniform(6.0, 12.0)),), "f8", chunks=(1000,))
        elif kind == 3:
            file.create_dataset("e", (100,), "u1", external=[("/etc/hostname", 0, 100)])
        elif kind == 4:
            file["l"] = h5py.ExternalLink("/etc/hostname", "/d")
        else:
            layout = h5py.VirtualLayout((shop.record.samples,), "f8")
            layout[:] = h5py.VirtualSource("other.h5", "d", (shop.record.samples,))
            file.create_virtual_dataset("v", layout)
    content = path.read_bytes()
    path.unlink()
    return "r.h5", content


def _hostile_counts(shop: Workshop, rng: Rng) -> tuple[str, bytes]:
    """A header of a universal file with counts that are none."""
    count = str(rng.choice(["inf", "nan", "1e11", "1e300", "-1", "²", "x", "99999999999"]))
    head = f"    -1\n    58\n{chr(10).join('NONE' for _ in range(5))}\n    1         0    1         0 a\n"
    numbers = f"         2{count:>10}         1  0.00000e+00  1.00000e-01  0.00000e+00\n"
    about = "        17    0    0    0 NONE                 s\n" * 4
    binary = "    -1\n    58b     1     2" + f"{count:>12}{count:>12}     0     0           0           0\n"
    text = binary if rng.random() < 0.5 else head + numbers + about + "  1.00000e+00\n    -1\n"
    return "r.uff", text.encode("latin-1")


HOSTILE: tuple[Callable[[Workshop, Rng], tuple[str, bytes]], ...] = (
    _hostile_times, _hostile_row, _hostile_mapping, _hostile_hdf5, _hostile_counts,
)  # fmt: skip
"""Makers of a file's name and content."""


def values_input(shop: Workshop, rng: Rng) -> Input:
    """A whole file whose values are wrong: dead, huge, missing, in other units."""
    from windsysid.records.formats import write_record

    values = shop.record.values.copy()
    for _ in range(int(rng.integers(1, 4))):
        column, rows = int(rng.integers(values.shape[1])), slice(*np.sort(rng.integers(0, values.shape[0] + 1, 2)))
        value = rng.choice([0.0, np.nan, 1e300, -1e300, 1e-300, 5e-324, 1e15, 57.3, 1e3])
        values[rows, column] = value if rng.random() < 0.5 else values[rows, column] * value
    record = type(shop.record)(
        shop.record.time, np.clip(values, -1e308, 1e308), shop.record.channels, shop.record.units
    )
    path = shop.folder / f"v{os.getpid()}.csv"
    write_record(record, path, overwrite=True)
    content = path.read_bytes()
    path.unlink()
    argv = (
        ["inspect", "r.csv"]
        if rng.random() < 0.3
        else ["identify", "r.csv", "--turbine", "tower", "--output", "out", "--no-report"]
    )
    return Input("values", argv, {"r.csv": content})


def same_input(shop: Workshop, rng: Rng) -> Input:
    """The plain record, written in another way."""
    argv = ["identify", "r.csv", "--turbine", "tower", "--output", "out", "--no-report"]
    how = str(rng.choice(["netcdf", "parquet", "units", "order", "semicolons", "mapping"]))
    if how in ("netcdf", "parquet") and {"netcdf": "nc", "parquet": "parquet"}[how] in shop.records:
        ending = {"netcdf": "nc", "parquet": "parquet"}[how]
        return Input("same", ["identify", f"r.{ending}", *argv[2:]], {f"r.{ending}": shop.records[ending]}, same=True)
    units = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("rpm", RPM), "m/s^2": ("mg", 1e3 / 9.80665)}
    names, columns, mapping = ["time [s]"], [shop.record.time], ""
    order = rng.permutation(len(shop.record.channels)) if how == "order" else range(len(shop.record.channels))
    for i in order:
        name, unit, column = shop.record.channels[i], shop.record.units[i], shop.record.values[:, i]
        written, factor = units.get(unit, (unit, 1.0)) if how in ("units", "mapping") else (unit, 1.0)
        if how == "mapping":
            mapping += f'[channels.c{i}]\nname = "{name}"\nunit = "{written}"\nsign = -1\n'
        names.append(f"c{i}" if how == "mapping" else f"{name} [{written}]")
        columns.append(column * factor * (-1.0 if how == "mapping" else 1.0))
    mark, point = (";", ",") if how == "semicolons" else (",", ".")
    rows = [mark.join(repr(float(x)).replace(".", point) for x in row) for row in np.column_stack(columns)]
    files: dict[str, bytes | Path] = {"r.csv": "\n".join([mark.join(names), *rows, ""]).encode()}
    if mapping:
        files["m.toml"], argv = mapping.encode(), [*argv, "--mapping", "m.toml"]
    return Input("same", argv, files, same=True)


def result_input(shop: Workshop, rng: Rng) -> Input:
    """A saved result that was damaged, with the commands that read results."""
    files: dict[str, bytes | Path] = {}
    for name in ("a", "b"):
        for path in (path for path in shop.results.iterdir() if path.is_file()):
            files[f"{name}/{path.name}"] = path.read_bytes()
    target = f"b/{rng.choice([p.name for p in shop.results.iterdir() if p.is_file()])}"
    content = files[target]
    assert isinstance(content, bytes)
    if rng.random() < 0.1:
        del files[target]
    elif target.endswith("json") and rng.random() < 0.7:
        files[target] = _damaged_json(content, rng)
    else:
        files[target] = _damaged_bytes(content, rng)
    commands = [
        ["compare", "a", "b"],
        ["modes", "b"],
        ["damping", "a", "b"],
        ["monitor", "a", "b"],
        ["compare", "b", "a", "--json"],
    ]
    return Input("result", commands[int(rng.integers(len(commands)))], files)


def options_input(shop: Workshop, rng: Rng) -> Input:
    """Good files and options that are not."""
    commands: list[tuple[list[str], list[str]]] = [
        (["identify", "r.csv", "--turbine", "tower", "--output", "out", "--no-report"],
         ["--section", "--rate", "--loads", "--prior-scale", "--add-noise", "--seed", "--in-pieces", "--formulation",
         "--sensors", "--mapping", "--turbine"]),
        (["inspect", "r.csv"], ["--section-length", "--turbine", "--mapping", "--output"]),
        (["simulate", "--turbine", "tower", "--output", "new.csv", "--duration", "2", "--rate", "20"],
         ["--duration", "--rate", "--seed", "--loads", "--turbine", "--output"]),
        (["modes", "tower"], ["--speeds", "--operating", "--output"]),
        (["turbines"], ["--x"]),
        (["compare", "result", "result"], ["--output", "--json"]),
    ]  # fmt: skip
    argv, options = commands[rng.choice(len(commands), p=[0.4, 0.15, 0.2, 0.15, 0.02, 0.08])]
    argv = list(argv)
    for option in rng.choice(options, size=int(rng.integers(1, 3))):
        value = [str(rng.choice(OPTION_VALUES))]
        if option in ("--section", "--speeds", "--operating"):
            value.append(str(rng.choice(OPTION_VALUES)))
        if option in ("--duration", "--rate", "--seed") and argv[0] == "simulate" and value[0] in ("1e308", "9" * 400):
            value = ["1e400"]  # a simulation of many years is a right answer that takes too long
        argv += [str(option), *([] if option == "--json" else value)]
    files: dict[str, bytes | Path] = {"r.csv": shop.records["csv"]}
    if argv[0] == "compare":
        files |= {f"result/{path.name}": path.read_bytes() for path in shop.results.iterdir() if path.is_file()}
    return Input("options", argv, files)


def terminal_input(shop: Workshop, rng: Rng) -> Input:
    """A terminal of another width, encoding or kind."""
    commands = [["identify", "r.csv", "--turbine", "tower", "--output", "out", "--no-report"], ["inspect", "r.csv"],
                ["turbines"], ["modes", "tower"],
                ["identify", "none.csv", "--turbine", "tower", "--output", "out"]]  # fmt: skip
    environment = {
        "COLUMNS": str(rng.choice([1, 20, 79, 80, 300])),
        "TERM": str(rng.choice(["dumb", "xterm-256color", "", "unknown"])),
        "LC_ALL": str(rng.choice(["C", "C.UTF-8", "xx_XX"])), "NO_COLOR": str(rng.choice(["", "1"])),
    }  # fmt: skip
    encoding = str(rng.choice(["utf-8", "ascii", "latin-1", "cp1252", "cp437", "utf-16"]))
    files: dict[str, bytes | Path] = {"r.csv": shop.records["csv"]}
    return Input("terminal", commands[int(rng.integers(len(commands)))], files, environment, encoding)


def signal_input(shop: Workshop, rng: Rng) -> Input:
    """A signal at a random instant."""
    pieces = ["--in-pieces", "10 s"] if rng.random() < 0.3 else []
    commands = [["identify", "r.csv", "--turbine", "tower", "--output", "out", *pieces],
                ["inspect", "r.csv", "--output", "out"],
                ["simulate", "--turbine", "tower", "--output", "new.csv", "--duration", "600"]]  # fmt: skip
    files: dict[str, bytes | Path] = {"r.csv": shop.records["csv"]}
    chosen = signal.SIGINT if rng.random() < 0.5 else signal.SIGTERM
    argv = commands[int(rng.integers(len(commands)))]
    return Input("signal", argv, files, signal=int(chosen), after=float(rng.uniform(0.0, 0.8)))


KINDS: dict[Callable[[Workshop, Rng], Input], float] = {
    turbine_input: 0.22, sensors_input: 0.12, mapping_input: 0.08, record_input: 0.16, hostile_input: 0.08,
    values_input: 0.08,
    same_input: 0.04, result_input: 0.08,
    options_input: 0.08, terminal_input: 0.03, signal_input: 0.03,
}  # fmt: skip


# Damage


def damaged_toml(text: str, rng: Rng) -> bytes:
    """TOML with up to three slips."""
    for _ in range(int(rng.choice(4, p=[0.1, 0.5, 0.25, 0.15]))):
        lines = text.split("\n")
        filled = [i for i, line in enumerate(lines) if "=" in line and not line.startswith("#")] or [0]
        i, how = int(rng.choice(filled)), rng.random()
        key, _, value = lines[i].partition("=")
        if how < 0.55:
            lines[i] = f"{key}= {rng.choice(NASTY)}"
        elif how < 0.65:
            del lines[i]
        elif how < 0.72:
            lines.insert(i, lines[i])
        elif how < 0.8:
            lines[i] = f"{rng.choice(['x', 'k_z', 'name', '[a]', '', 'ü'])} ={value}"
        elif how < 0.9:
            digits = [j for j, letter in enumerate(lines[i]) if letter.isdigit()]
            if digits:
                j = int(rng.choice(digits))
                lines[i] = lines[i][:j] + str(rng.choice(["-", "", "e", "9999", ".", "0", " "])) + lines[i][j + 1 :]
        else:
            return _damaged_bytes("\n".join(lines).encode(), rng)
        text = "\n".join(lines)
    return text.encode("utf-8", "surrogatepass")


def _damaged_bytes(content: bytes, rng: Rng) -> bytes:
    data, how = bytearray(content), rng.random()
    if how < 0.2:
        return bytes(data[: rng.integers(0, len(data))])
    for _ in range(int(rng.integers(1, 6)) if data else 0):
        at = int(rng.integers(len(data) if how < 0.6 else min(len(data), 400)))
        data[at] = int(rng.integers(256))
    return bytes(data) if how < 0.95 else b""


def _damaged_text(content: bytes, rng: Rng) -> bytes:
    cells = [
        "",
        "nan",
        "inf",
        "1e400",
        "x",
        "1,5",
        '"',
        "[red]",
        "1 2",
        "-",
        "é",
        "1e308",
        "0x1F",
        "TRUE",
        "NULL",
        "9" * 300,
    ]
    lines = [line.split(",") for line in content.decode().split("\n")]
    for _ in range(int(rng.integers(1, 4))):
        row, how = int(rng.choice([0, 0, int(rng.integers(len(lines)))])), rng.random()
        column = int(rng.integers(len(lines[row])))
        if how < 0.5:
            lines[row][column] = (
                str(rng.choice(cells))
                if row
                else str(rng.choice([*cells, lines[0][column].split(" [")[0], "time", "a [furlong]"]))
            )
        elif how < 0.6:
            del lines[row][column]
        elif how < 0.7:
            lines[row], lines[-2] = lines[-2], lines[row]
        elif how < 0.8:
            del lines[row : row + int(rng.integers(1, len(lines)))]
        elif how < 0.9:
            lines.insert(row, list(lines[row]))
        else:
            for line in lines:
                del line[column : column + 1]
        lines = [line for line in lines if line] or [["time"]]
        if len(lines) < 2:
            lines.append([""])
    return "\n".join(map(",".join, lines)).encode()


def _damaged_json(content: bytes, rng: Rng) -> bytes:
    tree = json.loads(content)
    node: Any = tree
    while True:
        keys: list[Any] = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = keys[int(rng.integers(len(keys)))]
        child = node[key]
        if isinstance(child, (dict, list)) and child and rng.random() < 0.7:
            node = child
            continue
        if rng.random() < 0.3:
            del node[key]
        else:
            node[key] = [None, "x", "", -1, 0, 1e308, [], {}, True, "[red]", "2020", math.inf][int(rng.integers(12))]
        return json.dumps(tree).encode()


def _outb(record: Any) -> bytes:
    """The record as OpenFAST would have written it: packed binary, format 2."""
    import struct

    ours = {"rotor_speed": ("RotSpeed", "(rad/s)"), "rotor_azimuth": ("Azimuth", "(rad)"),
            "tower_x_acceleration": ("YawBrTAgyp", "(m/s^2)"),
            "tower_z_acceleration": ("YawBrTAgxp", "(m/s^2)")}  # fmt: skip
    chosen = [channel for channel in record.channels if channel in ours]
    names, units = [ours[c][0] for c in chosen], [ours[c][1] for c in chosen]
    values = np.column_stack([record[c] for c in chosen])
    scale = 30000.0 / np.maximum(np.abs(values).max(axis=0), 1e-6)
    text = b"".join(cell.ljust(10).encode() for cell in ["Time", *names, "(s)", *units])
    head = struct.pack("<hiidd", 2, len(names), len(values), 0.0, 1.0 / record.rate)
    return bytes(
        head + scale.astype("<f4").tobytes() + np.zeros(len(names), "<f4").tobytes() + struct.pack("<i",
        4) + b"fuzz" + text
        + np.round(values * scale).astype("<i2").tobytes()
    )  # fmt: skip


# Running


def run(given: Input, folder: Path, *, real: bool = False, limit: float = LIMIT) -> Outcome:
    """Run one input in `folder`, in a fork of this process or (`real`) in a new one."""
    out, err = folder / ".stdout", folder / ".stderr"
    if real:
        environment = {**os.environ, **given.environment, "PYTHONIOENCODING": given.encoding}
        with out.open("wb") as o, err.open("wb") as e:
            pid = subprocess.Popen(
                [sys.executable, "-m", "windsysid", *given.argv], cwd=folder, env=environment, stdout=o, stderr=e,
                stdin=subprocess.DEVNULL
            ).pid  # fmt: skip
    else:
        sys.stdout.flush()
        sys.stderr.flush()
        pid = os.fork()
        if pid == 0:
            _child(given, folder, out, err)
    code = _wait(pid, given, limit)
    texts = [path.read_bytes().decode(given.encoding, "replace") for path in (out, err)]
    out.unlink()
    err.unlink()
    return Outcome(code, *texts)


def _child(given: Input, folder: Path, out: Path, err: Path) -> NoReturn:
    code = 70
    try:
        os.chdir(folder)
        os.environ.update(given.environment)
        for path, number in ((out, 1), (err, 2)):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(descriptor, number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), encoding=given.encoding, write_through=True)
        sys.stderr = io.TextIOWrapper(
            io.FileIO(2, "w", closefd=False), encoding=given.encoding, errors="backslashreplace", write_through=True
        )
        sys.argv = ["windsysid", *given.argv]
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        try:
            __main__.main()
            code = 0
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else (0 if ended.code is None else 1)
        except BaseException:
            import traceback

            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _wait(pid: int, given: Input, limit: float) -> int | None:
    began, sent = time.monotonic(), given.signal == 0
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return 128 - code if code < 0 else code
        elapsed = time.monotonic() - began
        if not sent and elapsed >= given.after:
            os.kill(pid, given.signal)
            sent = True
        if elapsed > limit:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            return None
        time.sleep(0.005)


def judge(given: Input, ended: Outcome, folder: Path, truth: dict[str, float]) -> str:
    """Defect in the end of an input; empty if there is none."""
    said = ended.out + ended.err
    if ended.code is None:
        return "takes too long"
    if "Traceback (most recent call last)" in said:
        return (
            "traceback: " + next((line for line in reversed(ended.err.strip().splitlines()) if line.strip()), "")[:160]
        )
    allowed = {0, 2, 130, 143} if given.signal else {0, 2}
    if ended.code not in allowed:
        return f"exit code {ended.code}: {ended.err.strip()[-160:]}"
    if "Warning:" in ended.err:
        return "a Python warning: " + next(line for line in ended.err.splitlines() if "Warning:" in line)[:160]
    left = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} - set(given.files)
    for name, content in given.files.items():
        path = folder / name
        if not path.is_file() or (isinstance(content, bytes) and path.read_bytes() != content):
            return f"lost or changed {name}"
    if ended.code == 2:
        lines = [
            line for line in ended.err.splitlines() if line.strip() and not line.startswith("windsysid: first run")
        ]
        usage = bool(lines) and lines[0].lstrip().startswith("Usage:")
        if not usage and (len(lines) != 1 or not lines[0].startswith("windsysid: ")):
            return f"{len(lines)} lines: {' / '.join(lines)[:200]}"
        if left:
            return f"leaves {sorted(left)[0]} behind"
        if any(ord(letter) < 32 and letter != "\t" for line in lines for letter in line):
            return "prints control characters"
        return ""
    if ended.code in (130, 143):
        hidden = [name for name in left if name.startswith(".") and "checkpoint" not in name]
        return f"leaves {hidden[0]} behind" if hidden else ""
    return _wrong_answer(given, folder, truth)


def _wrong_answer(given: Input, folder: Path, truth: dict[str, float]) -> str:
    if given.argv[0] != "identify" or not (folder / "out" / "summary.json").is_file():
        return ""
    try:
        found = estimates(folder / "out")
    except (ValueError, KeyError, TypeError) as error:
        return f"writes a summary that cannot be read: {error!r}"[:160]
    if not all(math.isfinite(value) for value in found.values()):
        return f"estimates that are no numbers: {found}"[:160]
    if given.same:
        off = {name: found.get(name, math.nan) / value - 1.0 for name, value in truth.items()}
        worst = max(off, key=lambda name: abs(off[name]) if math.isfinite(off[name]) else math.inf)
        if not abs(off[worst]) < 1e-3:
            return f"the same record gives {worst} {off[worst]:.3g} off"
    return ""


def make_input(shop: Workshop, seed: int, index: int) -> Input:
    """Input `index` of a seed, the same on every machine."""
    rng = np.random.default_rng([seed, index])
    kinds = list(KINDS)
    return kinds[rng.choice(len(kinds), p=np.array(list(KINDS.values())))](shop, rng)


def run_inputs(
    inputs: int,
    seed: int,
    keep: Path | None,
    *,
    kinds: Sequence[str] = (),
    tell: Callable[[str], object] = lambda _: None,
) -> tuple[dict[str, Counter[str]], list[str]]:
    """Run inputs of a seed; counts by kind, and one line for each violation."""
    table: dict[str, Counter[str]] = {}
    violations: list[str] = []
    with tempfile.TemporaryDirectory(prefix="fuzz_cli_") as name:
        base = Path(name)
        (base / "good").mkdir()
        shop = Workshop(base / "good")
        for index in range(inputs):
            given = make_input(shop, seed, index)
            if kinds and given.kind not in kinds:
                continue
            folder = base / "input"
            for file, content in given.files.items():
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                (folder / file).write_bytes(content if isinstance(content, bytes) else content.read_bytes())
            folder.mkdir(exist_ok=True)
            real = given.kind in ("terminal", "signal") and np.random.default_rng([seed, index, 1]).random() < REAL
            ended = run(given, folder, real=real)
            wrong = judge(given, ended, folder, shop.truth)
            counts = table.setdefault(given.kind, Counter())
            counts["inputs"] += 1
            counts[f"exit {ended.code}"] += 1
            if wrong:
                counts["violations"] += 1
                line = f"{index} {given.kind}: windsysid {' '.join(given.argv)}: {wrong}"
                violations.append(" ".join(line.split()))
                tell(violations[-1])
                if keep is not None:
                    kept = keep / f"{seed}_{index}_{given.kind}"
                    shutil.copytree(folder, kept, dirs_exist_ok=True)
                    about = {"argv": given.argv, "environment": given.environment, "encoding": given.encoding,
                             "signal": given.signal, "after": given.after, "code": ended.code,
                             "wrong": wrong}  # fmt: skip
                    (kept / "FUZZ.json").write_text(json.dumps(about, indent=2), encoding="utf-8")
                    (kept / "FUZZ_stdout.txt").write_text(ended.out, encoding="utf-8", errors="replace")
                    (kept / "FUZZ_stderr.txt").write_text(ended.err, encoding="utf-8", errors="replace")
            shutil.rmtree(folder)
    return table, violations


def main() -> None:
    """Run the fuzz and print a table by kind."""
    parser = argparse.ArgumentParser(description="Fuzz windsysid's command line.")
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("results/fuzz_cli"), help="folder for violating inputs")
    parser.add_argument("--kinds", nargs="*", default=[], help="only these kinds")
    options = parser.parse_args()
    began = time.monotonic()
    table, violations = run_inputs(
        options.inputs, options.seed, options.keep, kinds=options.kinds, tell=lambda line: print(line, flush=True)
    )
    print(f"\n{'kind':<12}{'inputs':>8}{'exit 0':>8}{'exit 2':>8}{'130/143':>9}{'violations':>12}")
    total: Counter[str] = Counter()
    for kind, counts in [*sorted(table.items()), ("all", total)]:
        if kind != "all":
            total += counts
        signals = counts["exit 130"] + counts["exit 143"]
        print(
            f"{kind:<12}{counts['inputs']:>8}{counts['exit 0']:>8}{counts['exit 2']:>8}{signals:>9}"
            f"{counts['violations']:>12}"
        )
    print(
        f"{time.monotonic() - began:.0f} s; violating inputs: {options.keep}"
        if violations
        else f"{time.monotonic() - began:.0f} s"
    )
    sys.exit(1 if violations else 0)


if __name__ == "__main__":
    main()
