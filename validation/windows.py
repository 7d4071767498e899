"""Tower frequencies of OpenFAST records in windows, compared with those of the program itself.

``python -m validation.windows --openfast FOLDER`` identifies records of the NREL 5 MW turbine on land and of the IEA
15 MW turbine on a monopile, clamped, idling and parked, as a user would: from two accelerometers at the tower top and a
tower file. The table has errors of frequencies in percent, in standard deviations for grades A and B, and the grades.
Air changes frequencies, too: fore-aft ones by 5 to 7 % in operation, side-side ones by 0.1 to 0.2 %, and by 2 % where a
parked rotor stands in 20 m/s of wind, whose side-side damping is then 3.6 % instead of 0.07 %. So the reference is a
decay in steady wind of the same speed where one was simulated: the difference of two runs of OpenFAST, one of which
starts deflected by 0.4 m fore-aft and 0.2 m side-side. For other records it is the linearised structure without air.
The 5 MW turbine is identified from a rotor file, too, whose sensors are at tower and blades: its side-side mode is
compared.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from validation.field import markdown
from windsysid.errors import WindsysidError
from windsysid.identification.identify import identify
from windsysid.records.formats import read_record
from windsysid.turbine.file import load_turbine, packaged_file
from windsysid.turbine.tables import parse_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["RECORDS", "Machine", "main"]

START, END = 60.0, {"land": 600.0, "sea": 660.0}
"""Setting: start of the first window and end of the last one [s]."""

IEA15 = {
    'name = "tower"': 'name = "iea15_tower"', "12.1 rpm": "7.56 rpm", "449214.6 kg": "1.7e6 kg", "0.3163 Hz": "0.17 Hz",
    "0.324 Hz": "0.17 Hz", "0.0209 rad/m": "0.0120 rad/m", '"20 kN"': '"40 kN"', '"80 kN"': '"160 kN"',
}  # fmt: skip
"""Replacements in the packaged tower file that give the IEA 15 MW turbine, in round numbers."""


class Machine(NamedTuple):
    """A record's file, whether it stands on land, and the frequencies [Hz] of its side-side and fore-aft modes without
    air (those of the 5 MW turbine fore-aft: in wind)."""

    file: str
    place: str
    side_side: float
    fore_aft: float


RECORDS = {
    "c2": Machine("c2_turb12_full", "land", 0.3153, 0.340),
    "d1": Machine("d1_turb12_full_KSS090", "land", 0.2986, 0.340),
    "m1": Machine("m1_mono10", "sea", 0.16428, 0.16495),
    "m2": Machine("m2_mono10_soil70", "sea", 0.16116, 0.16180),
    "k06": Machine("k06_mono", "sea", 0.1644, 0.1650),
    "k08": Machine("k08_mono", "sea", 0.1644, 0.1650),
    "k12": Machine("k12_mono", "sea", 0.1643, 0.1650),
    "k16": Machine("k16_mono", "sea", 0.1643, 0.1650),
    "k20": Machine("k20_mono", "sea", 0.1643, 0.1650),
    "k24": Machine("k24_mono", "sea", 0.1643, 0.1650),
    "l08": Machine("l08_clamped", "sea", 0.17228, 0.17296),
    "l12": Machine("l12_clamped", "sea", 0.17217, 0.17292),
    "l16": Machine("l16_clamped", "sea", 0.17217, 0.17292),
    "l20": Machine("l20_clamped", "sea", 0.17217, 0.17292),
    "p08": Machine("p08_idle", "sea", 0.1641, 0.1651),
    "p20": Machine("p20_parked", "sea", 0.16406, 0.16506),
}

IN_WIND = {
    "c2": {"side_side": 0.3157}, "d1": {"side_side": 0.2991},
    "k06": {"side_side": 0.1645, "fore_aft": 0.1734}, "k08": {"side_side": 0.1646, "fore_aft": 0.1733},
    "k24": {"side_side": 0.1646, "fore_aft": 0.1763}, "l08": {"side_side": 0.1725, "fore_aft": 0.1823},
    "p20": {"side_side": 0.1670, "fore_aft": 0.1653},
}  # fmt: skip
"""Frequencies [Hz] of decays in steady wind, structure and air."""


class Window(NamedTuple):
    """A part of a record."""

    record: str
    first: float
    last: float


def windows(records: Sequence[str], seconds: Sequence[float]) -> Iterator[Window]:
    """Windows of so many seconds one after the other; of 0 s one that has all of it."""
    for name in records:
        end = END[RECORDS[name].place]
        for length in seconds:
            length = min(length or end, end - START)
            for first in np.arange(START, end - length + 1e-6, length):
                yield Window(name, float(first), float(first + length))


def turbine_of(machine: Machine) -> Turbine:
    """Read the tower file of a machine."""
    text = packaged_file("tower")
    for old, new in IEA15.items() if machine.place == "sea" else ():
        assert old in text, old
        text = text.replace(old, new)
    return parse_turbine(text, "tower.toml")


def answer(folder: Path, window: Window, file: str) -> dict[str, Any]:
    """Identify a window with a tower file or a packaged rotor file; the summary of the result, or the error."""
    begun, machine = time.process_time(), RECORDS[window.record]
    try:
        record = read_record(folder / f"{machine.file}.outb")
        turbine = turbine_of(machine) if file == "tower" else load_turbine(file)
        found = identify(record, turbine, section=window[1:]).summary()
    except WindsysidError as error:
        found = {"error": str(error)}
    return {**window._asdict(), "seconds": time.process_time() - begun, "found": found}


def reference(record: str, mode: str) -> float:
    """Frequency [Hz] of a mode in wind, where it is known, or without air."""
    return float(IN_WIND.get(record, {}).get(mode, getattr(RECORDS[record], mode)))


def table(done: Sequence[Mapping[str, Any]]) -> str:
    """Errors of side-side and fore-aft frequencies of each record and length of window, and grades."""
    rows = []
    for record, seconds in dict.fromkeys((one["record"], round(one["last"] - one["first"])) for one in done):
        some = [one for one in done if (one["record"], round(one["last"] - one["first"])) == (record, seconds)]
        seen = [
            mode["frequency"] | {"damping": mode["damping_ratio"]["grade"], "name": mode["name"]}
            for one in some
            for mode in one["found"].get("modes", [])
        ]
        cells = [record, f"{seconds}", f"{len(some)}", f"{sum('error' in one['found'] for one in some)}"]
        for name, truth in (("side-side", reference(record, "side_side")), ("fore-aft", reference(record, "fore_aft"))):
            own = [one for one in seen if one["name"] in NAMES[name]]
            cells += _frequency_cells(own, truth)
        cells += ["".join(sorted(one["damping"] for one in seen))]
        rows.append((*cells, f"{max(one['seconds'] for one in some):.0f}"))
    return markdown(HEADINGS, rows)


def _frequency_cells(own: Sequence[Mapping[str, Any]], truth: float) -> list[str]:
    """Grades, worst error in percent, and worst error in standard deviations of those of grade A and B."""
    if not own:
        return ["", "", ""]
    usable = [one for one in own if one["grade"] != "C"]
    sigmas = [abs(one["estimate"] - truth) / ((one["high"] - one["low"]) / 4.0) for one in usable]
    return [
        "".join(sorted(one["grade"] for one in own)),
        f"{max(abs(one['estimate'] / truth - 1.0) for one in own):.2%}",
        f"{max(sigmas):.1f}" if sigmas else "",
    ]


def pooled(done: Sequence[Mapping[str, Any]]) -> str:
    """Grades and coverage of frequencies, of all windows of 180 s or more together."""
    lines = []
    for name, attribute in (("side-side", "side_side"), ("fore-aft", "fore_aft")):
        sigmas, count = [], 0
        for one in done:
            for mode in one["found"].get("modes", []):
                f = mode["frequency"]
                if mode["name"] in NAMES[name]:
                    count += 1
                    if f["grade"] != "C":
                        truth = reference(one["record"], attribute)
                        sigmas.append(abs(f["estimate"] - truth) / ((f["high"] - f["low"]) / 4.0))
        held = sum(one < 2.0 for one in sigmas)
        lines.append(
            f"{name}: found in {count} of {len(done)} windows, A or B {len(sigmas)}, of these ±2σ holds {held}, worst"
            f" {max(sigmas, default=0.0):.1f} σ"
        )
    return "\n".join(lines)


ROTOR_FILE = "nrel5mw_full"
"""Packaged file of the 5 MW turbine's rotor and tower."""

NAMES = {"side-side": ("tower side-side", "tower x"), "fore-aft": ("tower fore-aft",)}
"""Names of both modes with a tower file and with a rotor file."""

HEADINGS = (
    "record", "window [s]", "n", "errors", "side-side: grades", "worst error", "worst of A, B [σ]", "fore-aft: grades",
    "worst error", "worst of A, B [σ]", "damping: grades", "longest [s of processor]",
)  # fmt: skip


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m validation.windows", description=__doc__.splitlines()[0])
    parser.add_argument("--openfast", type=Path, required=True, help="folder of the records (*.outb)")
    parser.add_argument("--records", nargs="+", default=list(RECORDS), help="names of records (all)")
    parser.add_argument("--seconds", nargs="+", type=float, default=[540.0, 270.0, 180.0], help="lengths of windows")
    parser.add_argument("--keep", type=Path, help="file of all results, a line of JSON each")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    on_land = [name for name in asked.records if RECORDS[name].place == "land"]
    for file, records in (("tower", asked.records), (ROTOR_FILE, on_land)):
        done, parts = [], list(windows(records, asked.seconds))
        with ProcessPoolExecutor(asked.jobs) as pool:
            for one in pool.map(answer, [asked.openfast] * len(parts), parts, [file] * len(parts)):
                done.append(one)
                print(one["record"], one["first"], one["last"], f"{one['seconds']:.1f} s", file=sys.stderr, flush=True)
        if asked.keep:
            with asked.keep.open("a", encoding="utf-8") as kept:
                kept.writelines(json.dumps({"file": file, **one}) + "\n" for one in done)
        if done:
            print(f"with the file {file}:\n\n{table(done)}\n\n{pooled(done)}\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
