"""Frequencies of tower and blades under wind, window by window, by pyOMA-2's stochastic subspace identification and by
windsysid.

    PYTHONPATH=. python benchmarks/subspace.py --openfast FOLDER      in an environment made from benchmarks/peers.txt

Both read the same sensors of two OpenFAST records (`validation.field`): the tower-top accelerometer, an accelerometer
at each blade's tip, and the azimuth. For the subspace method each blade's 1P line, which is gravity, is taken out by
least squares, and the blades go into multi-blade coordinates, in which the whirling modes stand still:

    a_0 = ⅓ Σ a_i,      a_c = ⅔ Σ a_i cos ψ_i,      a_s = ⅔ Σ a_i sin ψ_i.

It is given every advantage. Rates, block rows, orders and variants are tried (`SETTINGS`), and the setting with the
least error, the truth being known, is the one that is shown, for each length of window anew. The limits on the
complexity of a mode shape, which would throw out both whirls, are off. Of a mode are taken the poles that its
stabilisation diagram calls stable, of each order the one nearest to the truth within `REACH`, and of those the median
over the orders.

windsysid runs as in `validation.field`: packaged turbine files and priors up to 1.5 times off, `tower` for the
tower, the rotor's file for the blades, which takes minutes for a window. Windows are disjoint, of 60, 120 and 270 s.
Identifications in the output folder are used again, those of the field study among them.
"""

import argparse
import itertools
import logging
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from sheets import Sheet
from validation.field import FILES, ROTOR, TOWER, TRUTH, WINDY, Case, mode, results

from windsysid import read_record
from windsysid.errors import WindsysidError
from windsysid.records.record import Record
from windsysid.signals import resample

Array = np.ndarray

RECORDS = ("c2", "d1")
LENGTHS = (60.0, 120.0, 270.0)
MODES = ("tower", "lag backward", "lag collective", "lag forward")
TIPS = tuple(f"blade_{i}_tip_lag_acceleration" for i in (1, 2, 3))

REACH = 0.08
"""Largest relative distance from the truth at which a pole is taken for the mode."""

FEWEST = 3
"""Orders in which a mode must be stable to count as found."""

MISSED = 0.05
"""Relative error that a missed window counts in the choice of the setting."""


class Setting(NamedTuple):
    rate: float
    variant: str
    rows: int
    order: int

    def __str__(self) -> str:
        return f"{self.variant}, {self.rate:g} Hz, {self.rows} block rows, orders to {self.order}"


SETTINGS = tuple(
    Setting(*each)
    for each in itertools.product((4.0, 8.0), ("cov", "dat"), (30, 60), (40, 80))
    if each[3] <= each[2] + 40
)

Mode = tuple[float, float]
"""Frequency [Hz] and damping ratio."""


class Window(NamedTuple):
    record: str
    start: float
    end: float


def windows(length: float) -> list[Window]:
    first, last = WINDY
    count = int((last - first) / length + 1e-9)
    return [Window(record, first + k * length, first + (k + 1) * length) for record in RECORDS for k in range(count)]


def multi_blade(blades: Array, azimuth: Array) -> Array:
    """Collective, cosine and sine coordinate (T, 3) of three blades' readings (T, 3); blade 1 is at the azimuth (T,)
    [rad].
    """
    angle = azimuth[:, None] + 2.0 * np.pi * np.arange(3) / 3.0
    return np.column_stack(
        [blades.mean(axis=1), 2.0 / 3.0 * (blades * np.cos(angle)).sum(axis=1),
        2.0 / 3.0 * (blades * np.sin(angle)).sum(axis=1)]
    )  # fmt: skip


def without_gravity(blades: Array, azimuth: Array) -> Array:
    """Readings (T, 3) without their mean and their 1P line."""
    line = np.column_stack([np.ones_like(azimuth), np.cos(azimuth), np.sin(azimuth)])
    return np.asarray(blades - line @ np.linalg.lstsq(line, blades, rcond=None)[0])


def channels(record: Record, rate: float) -> Array:
    """Prepare the channels of the subspace method (T, 4): accelerations of the tower, and of the blades in multi-blade
    coordinates."""
    azimuth = np.unwrap(record["rotor_azimuth"])
    blades = without_gravity(np.column_stack([record[name] for name in TIPS]), azimuth)
    fixed = multi_blade(blades, azimuth)
    names = ("tower_x_acceleration", "collective", "cosine", "sine")
    values = np.column_stack([record["tower_x_acceleration"], fixed])
    slow = resample(Record(record.time, values, names, ("m/s^2",) * 4, name=record.name), rate).values
    return np.asarray(slow - slow.mean(axis=0))


def by_subspace(values: Array, setting: Setting, truth: Mapping[str, float]) -> dict[str, Mode]:
    """The modes that pyOMA-2 finds in values (T, 4)."""
    os.environ["TQDM_DISABLE"] = "1"
    from pyoma2.algorithms import SSI
    from pyoma2.setup import SingleSetup

    setup = SingleSetup(values, fs=setting.rate)
    method = SSI(
        name="ssi", method=setting.variant, br=setting.rows, ordmax=setting.order, step=2,
        hc={"xi_max": 0.1, "mpc_lim": None, "mpd_lim": None, "CoV_max": None},
        sc={"err_fn": 0.02, "err_xi": 0.2, "err_phi": 0.1},
    )  # fmt: skip
    setup.add_algorithms(method)
    setup.run_by_name("ssi")
    found = method.result
    stable = np.where(found.Lab == 1, found.Fn_poles, np.nan)
    modes = {}
    for name in MODES:
        off = np.abs(stable / truth[name] - 1.0)
        taken = [
            (int(np.nanargmin(column)), k)
            for k, column in enumerate(off.T)
            if np.nanmin(np.append(column, 9.0)) < REACH
        ]
        if len(taken) >= FEWEST:
            i, k = np.transpose(taken)
            modes[name] = float(np.median(stable[i, k])), float(np.median(found.Xi_poles[i, k]))
    return modes


def by_windsysid(case: Case, folder: Path, kept: Path) -> dict[str, Mode]:
    """The modes that windsysid finds; none where it refuses the window."""
    try:
        result = results([case], folder, kept)[case]
    except WindsysidError as error:
        print(f"{case.name}: {error}", file=sys.stderr)
        return {}
    modes = {}
    for name in MODES:
        own = ("tower side-side" if case.turbine == TOWER else "tower x") if name == "tower" else name
        frequency, ratio = (mode(result, own, what) for what in ("frequency", "damping_ratio"))
        if frequency is not None and ratio is not None:
            modes[name] = frequency.estimate, ratio.estimate
    return modes


def errors(found: Mapping[Window, Mapping[str, Mode]], record: str, mode: str) -> tuple[Array, Array, int]:
    """Relative errors of frequency, damping ratios, and how many windows there are."""
    of = [modes for window, modes in found.items() if window.record == record]
    have = [modes[mode] for modes in of if mode in modes]
    f, z = np.array(have).reshape(-1, 2).T
    return f / TRUTH[record][mode] - 1.0, z, len(of)


def best(found: Mapping[Setting, Mapping[Window, Mapping[str, Mode]]]) -> Setting:
    """The setting with the least error of frequency over all windows and modes, a missed one counting `MISSED`."""

    def cost(setting: Setting) -> float:
        total = 0.0
        for record, name in itertools.product(RECORDS, MODES):
            error, _, count = errors(found[setting], record, name)
            total += float(np.sum(error**2)) + (count - len(error)) * MISSED**2
        return total

    return min(found, key=cost)


def rms(values: Array) -> float:
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else math.nan


def cell(error: Array, count: int) -> str:
    """rms in per cent, and in how many windows the mode was found where not in all."""
    share = "" if len(error) == count else f" ({len(error)} of {count})"
    return (f"{100.0 * rms(error):.2f} %" if len(error) else "not found") + share


def sheets(folder: Path, kept: Path, lengths: Sequence[float], with_rotor: Sequence[float]) -> Iterator[Sheet]:
    records = {name: read_record(folder / FILES[name]) for name in RECORDS}
    headings = ("window", "record", "mode", "subspace", f"windsysid, {TOWER}", f"windsysid, {ROTOR}")
    rows, damping, chosen = [], [], []
    for length in lengths:
        parts = windows(length)
        by_setting: dict[Setting, dict[Window, dict[str, Mode]]] = {setting: {} for setting in SETTINGS}
        for w in parts:
            part = records[w.record].section(w.start, w.end)
            readings = {rate: channels(part, rate) for rate in {setting.rate for setting in SETTINGS}}
            for setting in SETTINGS:
                by_setting[setting][w] = by_subspace(readings[setting.rate], setting, TRUTH[w.record])
        setting = best(by_setting)
        chosen.append((f"{length:g} s", str(setting)))
        of = [by_setting[setting]]
        for turbine in (TOWER, *((ROTOR,) if length in with_rotor else ())):
            of.append({w: by_windsysid(Case(w.record, turbine, 0, (w.start, w.end)), folder, kept) for w in parts})
        for record, name in itertools.product(RECORDS, MODES):
            found = [errors(each, record, name) for each in of]
            cells = [cell(error, count) for error, _, count in found]
            if name != "tower":
                cells[1] = ""
            rows.append((f"{length:g} s", record, name, *cells, *[""] * (3 - len(cells))))
            if (record, name) == ("c2", "tower"):
                truth = TRUTH["c2"]["tower damping"]
                cells = [cell(ratios / truth - 1.0, count) for _, ratios, count in found]
                damping.append((f"{length:g} s", *cells, *[""] * (3 - len(cells))))
    yield Sheet("rms error of frequency over disjoint windows", headings, rows, {})
    yield Sheet("c2, tower: rms error of the damping ratio", ("window", *headings[3:]), damping, {})
    yield Sheet("settings of the subspace method, the best of those tried", ("window", "setting"), chosen, {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--openfast", type=Path, required=True, help=f"folder of {FILES['c2']} and {FILES['d1']}")
    parser.add_argument(
        "--output", type=Path, default=Path("results/field"), help="where identifications are kept (results/field)"
    )
    parser.add_argument("--lengths", type=float, nargs="+", default=LENGTHS, help="of windows [s] (60 120 270)")
    parser.add_argument(
        "--rotor",
        type=float,
        nargs="*",
        default=LENGTHS,
        metavar="LENGTH",
        help="of windows for the rotor's file, which takes minutes each (all)",
    )
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    for sheet in sheets(given.openfast, given.output / "identifications", given.lengths, given.rotor):
        Console(width=140).print(sheet.table(), highlight=False)
        print(sheet.markdown(), "\n")


if __name__ == "__main__":
    main()
