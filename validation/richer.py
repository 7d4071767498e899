"""Errors of a hinged blade on a leaning tower, their cost, and the degree of freedom that earns its
place.

OpenFAST's NREL 5 MW turbine is the truth: its own numbers, and its linearisation at 12.1 rpm, of the small model of
record a2 (the tower's first side-side mode, one edgewise mode per blade) and of the full one of c2 (two tower modes in
each direction, two flap modes and one edgewise per blade). Three models meet them: roll locked, roll tied to the
tower's lean, and roll partly free.

First the modes at the program's own numbers. What is then left in the whirl modes is put on the blade's stiffness, and
what that leaves is weighed against the least standard deviation that a record of T seconds allows a mode under
broadband load, σ_f/f = √(ζ / (ω T)): a degree of freedom that moves the modes by less cannot be distinguished from
none. Then what the accelerometer at a blade's tip reads that the model cannot, and last the records themselves, from
tower-top and blade-tip accelerometers: errors of what is identified.

``python -m validation.richer --openfast FOLDER`` prints the tables; FOLDER holds the records a2 and c2.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from validation.field import READ
from windsysid._types import Array
from windsysid.errors import RecordError, WindsysidError
from windsysid.identification.condition.readings import add_noise, with_noise
from windsysid.identification.identify import identify
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.sensors import PlacedSensor
from windsysid.modal.analysis import modes
from windsysid.output.console import render
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "MODES",
    "ROLLS",
    "TRUTH",
    "edge_factor",
    "frequencies",
    "identified",
    "published_tower",
    "resolution",
    "unexplained",
    "with_roll",
]

Roll = Literal["locked", "tied", "free"]

ROLLS: tuple[Roll, ...] = ("locked", "tied", "free")
MODES = ("tower x", "lag backward", "lag collective", "lag forward")


class Truth(NamedTuple):
    """Frequencies [Hz] and damping ratios of OpenFAST's linearisation at 12.1 rpm, as in `MODES`, and its file."""

    frequency: tuple[float, float, float, float]
    damping: tuple[float, float, float, float]
    file: str


TRUTH: Mapping[str, Truth] = {
    "a2": Truth((0.3155, 0.8955, 1.1112, 1.3052), (0.00349, 0.00582, 0.00482, 0.00404), "a2_rot12_decay_min.outb"),
    "c2": Truth((0.3153, 0.8908, 1.0402, 1.2990), (0.00349, 0.00575, 0.00434, 0.00399), "c2_turb12_full.outb"),
}

SECTION = (60.0, 330.0)
"""[s] of c2: enough for the modes, and half the time."""


def with_roll(roll: Roll) -> Turbine:
    """The NREL 5 MW turbine with that roll, its tower's effective mass kept."""
    if roll == "free":
        return load_turbine("nrel5mw_full").exact()
    tied = load_turbine("nrel5mw").exact()
    if roll == "tied":
        return tied
    blades = 3.0 * tied.values["blade_mass_1"]
    return tied.with_values({"hub_mass_x": tied.inertia("x") - blades}).with_model(replace(tied.rotor, roll="locked"))


def frequencies(turbine: Turbine, *, edge: float = 1.0) -> Array:
    """Frequencies [Hz] of `MODES` at 12.1 rpm, the blades' stiffness times `edge`."""
    turbine = turbine.with_values(
        {f"k_beta_{i}": edge * turbine.values[f"k_beta_{i}"] for i in turbine.rotor.blade_numbers}
    )
    model = compile_model(turbine.model, (), turbine.model.coefficients)
    p = np.array([turbine.values[name] for name in model.parameters])
    found = {name: f for name, f, _ in modes(turbine.model, model, p, turbine.rotor_speed)}
    return np.array([found[name] for name in MODES])


def edge_factor(turbine: Turbine, truth: Truth) -> float:
    """The factor on the blades' stiffness with which backward and forward whirl are right in the mean."""
    from scipy.optimize import brentq

    def off(edge: float) -> float:
        return float(np.sum(frequencies(turbine, edge=edge)[[1, 3]] / np.array(truth.frequency)[[1, 3]] - 1.0))

    return float(brentq(off, 0.9, 1.1, xtol=1e-6))


class TowerTop(NamedTuple):
    """The side-side bending of a tower with masses on it, seen from its top: displacement x, roll κ x + ρ towards the
    lean.

    Attributes
    ----------
    kappa, k_roll
        Lean per displacement under a force at the top [rad/m]; stiffness of what is left, ρ [N·m/rad].
    inertia
        [[m, s], [s, J]] of (x, roll): kg, kg·m, kg·m².
    """

    kappa: float
    k_roll: float
    inertia: Array


def published_tower() -> TowerTop:
    """Modes from the published distribution and the simulator's two side-side shapes; nothing is fitted.

    Source: NREL/TP-500-38060, table 6-1; ElastoDyn's file.
    """
    height, points = 87.6, np.linspace(0.0, 1.0, 2001)
    density = np.interp(points, np.linspace(0.0, 1.0, 11), _TOWER_DENSITY)
    bending = np.interp(points, np.linspace(0.0, 1.0, 11), _TOWER_BENDING)
    shapes = [np.polynomial.Polynomial([0.0, 0.0, *coefficients]) for coefficients in _TOWER_SHAPES]
    bare, slope, curvature = (
        np.array([shape.deriv(n)(points) if n else shape(points) for shape in shapes]) / height**n for n in range(3)
    )
    carried = sum(mass for mass, _ in _TOWER_TOP) + height * np.array(
        [np.trapezoid(density[i:], points[i:]) for i in range(len(points))]
    )
    along = height * points
    stiffness = np.trapezoid(bending * curvature[:, None] * curvature, along)
    stiffness -= np.trapezoid(9.80665 * carried * slope[:, None] * slope, along)
    inertia = np.trapezoid(density * bare[:, None] * bare, along)
    top = np.linalg.inv(np.array([[1.0, 1.0], [slope[0, -1], slope[1, -1]]]))
    stiffness, inertia = top.T @ stiffness @ top, top.T @ inertia @ top
    for mass, above in _TOWER_TOP:
        inertia += mass * np.outer([1.0, above], [1.0, above])
    return TowerTop(float(-stiffness[0, 1] / stiffness[1, 1]), float(stiffness[1, 1]), inertia)


_TOWER_DENSITY = (5590.87, 5232.43, 4885.76, 4550.87, 4227.75, 3916.41, 3616.83, 3329.03, 3053.01, 2788.75, 2536.27)
_TOWER_BENDING = tuple(
    1e9 * EI
    for EI in (614.343, 534.821, 463.267, 399.131, 341.883, 291.011, 246.027, 206.457, 171.851, 141.776, 115.820)
)
_TOWER_SHAPES = (
    (1.385, -1.7684, 3.0871, -2.2395, 0.5357),
    (-121.2097, 184.415, -224.9037, 298.536, -135.838),
)
"""Coefficients of (z/H)² … (z/H)⁶."""
_TOWER_TOP = ((240_000.0, 1.75), (109_389.84, 2.40))
"""Nacelle and rotor: mass [kg], height of its centre above the tower's top [m]."""


def resolution(truth: Truth, seconds: float) -> Array:
    """σ_f/f (4,) of `MODES`, the least that a record of that length allows."""
    return np.asarray(np.sqrt(np.array(truth.damping) / (2.0 * math.pi * np.array(truth.frequency) * seconds)))


def identified(folder: Path, name: str, roll: Roll, *, flap: bool = True) -> Identification:
    """Result of the record `name` with that roll: a2 with 1 % noise, c2 as `study.field` reads it, the tips' sensors
    with flap or not.

    Raises
    ------
    RecordError
        If the record is not in `folder`.
    """
    truth, turbine = TRUTH[name], with_roll(roll)
    record, sensors = read_record(_path(folder, truth)), turbine.sensors
    channels = [sensor.channel for sensor in sensors]
    if name == "a2":
        record, added = add_noise(record, channels, 1.0, 1)
        return identify(record, turbine, sensors=with_noise(sensors, added), formulation="joint")
    windy = load_turbine("nrel5mw_full").exact()
    loads = tuple(load for load in windy.loads if load.load in turbine.model.loads)
    sensors = windy.sensors if flap else load_turbine("nrel5mw").exact().sensors
    return identify(
        record, replace(turbine, loads=loads), sensors=sensors, formulation="joint", section=SECTION, rate=READ,
        loads="rotor-wind",
    )  # fmt: skip


class Unexplained(NamedTuple):
    """Of what blade 1's tip accelerometer reads in a band [Hz], what edgewise bending, roll, tower and gravity leave.

    Attributes
    ----------
    low, high, reading, left
        The band; rms of the reading and of what is left [m/s²].
    gain, share
        Of the tip's out-of-plane acceleration in what is left, and of the power of what is left that goes with it.
    """

    low: float
    high: float
    reading: float
    left: float
    gain: float
    share: float


def unexplained(record: Record) -> list[Unexplained]:
    """From the simulator's own coordinates of c2, which no sensor gives: nothing is identified."""
    from scipy.signal import csd

    turbine, step = load_turbine("nrel5mw_full").exact(), 1.0 / record.rate
    sensor = next(sensor for sensor in turbine.sensors if isinstance(sensor, PlacedSensor) and sensor.blade == 1)
    lever, g, speed = turbine.tip_lever, turbine.values["gravity"], float(record["rotor_speed"].mean())
    turned = np.exp(-1j * np.unwrap(record["rotor_azimuth"]))
    roll, beta = record["tower_roll"], -record["Q_B1E1"] / lever

    def rate(signal: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(np.gradient(signal, step))

    inboard = turbine.values["hinge_offset"] + sensor.position[0] - lever
    tip = inboard * np.exp(1j * roll) + lever * np.exp(1j * (roll + beta))
    x = record["tower_x_displacement"].astype(np.complex128)
    force = (rate(rate(x)) + 1j * g) * turned + rate(rate(tip)) + 2j * speed * rate(tip) - speed**2 * tip
    reading = record[sensor.channel]
    left = reading - (force * np.exp(-1j * (roll + sensor.slope * beta))).imag
    flap = rate(rate(record["OoPDefl1"].astype(np.complex128))).real
    signals = np.array([signal[10:-10] for signal in (reading, left, flap)])
    frequency, spectra = csd(signals[:, None], signals[None], record.rate, nperseg=4096)
    found = []
    for low, high in pairwise(BANDS):
        band = spectra[:, :, (frequency >= low) & (frequency < high)].sum(axis=2) * frequency[1]
        (read, rest, out), cross = np.diag(band).real.tolist(), complex(band[2, 1])
        share = abs(cross) ** 2 / (rest * out)
        found.append(Unexplained(low, high, math.sqrt(read), math.sqrt(rest), cross.real / out, share))
    return found


BANDS = (0.3, 0.8, 1.0, 1.2, 1.4, 2.0, 3.0)
"""[Hz]"""


def _path(folder: Path, truth: Truth) -> Path:
    path = folder / truth.file
    if not path.is_file():
        raise RecordError(
            f"{folder}: expected OpenFAST's record {truth.file}, found none: name the folder that holds it with"
            " --openfast"
        )
    return path


def main() -> int:
    """Print the tables; 0, or 2 where the records are not there."""
    parser = argparse.ArgumentParser(prog="python -m validation.richer", description=__doc__.partition("\n")[0])
    parser.add_argument("--openfast", type=Path, required=True, metavar="FOLDER", help="where a2's and c2's .outb are")
    folder = parser.parse_args().openfast
    try:
        for truth in TRUTH.values():
            _path(folder, truth)
        print(
            render(_at_the_numbers(), _what_is_left(), _of_the_tower(), _in_the_reading(folder), width=150), flush=True
        )
        for table in _from_the_records(folder):
            print(render(table, width=150), flush=True)
    except WindsysidError as error:
        print(f"windsysid: {error}", file=sys.stderr)
        return 2
    return 0


def _of_the_tower() -> str:
    top, given = published_tower(), load_turbine("nrel5mw_full").exact().values
    return (
        f"roll without the blades, published tower (turbine file): κ {top.kappa:.5f} ({abs(given['kappa']):.5f}) rad/m,"
        f" spring {top.k_roll:.3g} ({given['k_roll']:.3g}) N·m/rad, inertia {top.inertia[1, 1]:.3g}"
        f" ({given['roll_inertia']:.3g}) kg·m², coupled to x by {top.inertia[0, 1]:.2g} (0) kg·m"
    )


def _at_the_numbers() -> "Table":
    table = _table("Modes at 12.1 rpm from the program's own numbers: Hz, and error [%] of its linearisation", "roll")
    for name, truth in TRUTH.items():
        table.add_row(name, "linearisation", *(f"{f:.4f}" for f in truth.frequency))
        for roll in ROLLS:
            found = frequencies(with_roll(roll))
            errors = 100.0 * (found / np.array(truth.frequency) - 1.0)
            cells = (f"{f:.4f} ({e:+.2f})" for f, e in zip(found, errors, strict=True))
            table.add_row(name, roll, *cells, end_section=roll == ROLLS[-1])
    return table


def _what_is_left() -> "Table":
    truth, seconds = TRUTH["c2"], 540.0
    table = _table(
        "c2, what is left with the blades' stiffness times the factor that suits the whirl modes [%]", "roll"
    )
    for roll in ROLLS:
        turbine = with_roll(roll)
        factor = edge_factor(turbine, truth)
        errors = 100.0 * (frequencies(turbine, edge=factor) / np.array(truth.frequency) - 1.0)
        table.add_row("c2", f"{roll}, {factor:.4f}", *(f"{e:+.3f}" for e in errors))
    table.add_row("", f"σ_f/f of {seconds:.0f} s", *(f"{100.0 * r:.3f}" for r in resolution(truth, seconds)))
    return table


def _in_the_reading(folder: Path) -> "Table":
    from rich.table import Table

    title = (
        "c2, the accelerometer at the tip of blade 1: what edgewise bending, roll, tower and gravity leave of its"
        " reading"
    )
    table = Table(title=title, title_justify="left")
    for heading in ("Hz", "reading [m/s²]", "left [m/s²]", "out-of-plane acceleration in it", "share of its power"):
        table.add_column(heading, justify="right")
    for u in unexplained(read_record(_path(folder, TRUTH["c2"])).section(60.0, 600.0)):
        table.add_row(
            f"{u.low} … {u.high}", f"{u.reading:.3f}", f"{u.left:.3f}", f"{u.gain:+.3f} ×", f"{100.0 * u.share:.0f} %"
        )
    return table


CASES: Mapping[str, Sequence[tuple[Roll, bool]]] = {
    "a2": (("tied", True),),
    "c2": (("tied", True), ("free", False), ("free", True)),
}
"""Identified parameters from each record: roll, and whether the tips' sensors include flap."""


def _from_the_records(folder: Path) -> Iterator["Table"]:
    for name, cases in CASES.items():
        table = _table(f"{name} identified: error [%] of the program's value, ± the result's own 2σ", "roll")
        coefficients = ("k_x", "k_beta", "c_x", "c_beta") if name == "a2" else ("k_x", "k_beta", "k_roll")
        for heading in (*coefficients, "s"):
            table.add_column(heading, justify="right")
        for roll, flap in cases:
            found = identified(folder, name, roll, flap=flap)
            of = {mode.name: mode.frequency for mode in found.modes}
            cells = [
                _error(of[mode].estimate, of[mode].low, of[mode].high, f)
                for mode, f in zip(MODES, TRUTH[name].frequency, strict=True)
            ]
            cells += [_coefficient(found, c, with_roll(roll)) for c in coefficients]
            table.add_row(name, roll if flap else f"{roll}, flap unsaid", *cells, f"{found.elapsed:.0f}")
        yield table


def _coefficient(found: Identification, name: str, turbine: Turbine) -> str:
    """Error of a coefficient, that of the blades in the mean over them; nothing where there is none."""
    names = [e.name for e in found.estimates if e.name == name or e.name.startswith(f"{name}_")]
    if not names:
        return ""
    middle, low, high = (
        float(np.mean([getattr(found[n], part) / turbine.values[n] for n in names]))
        for part in ("estimate", "low", "high")
    )
    return _error(middle, low, high, 1.0)


def _error(value: float, low: float, high: float, truth: float) -> str:
    return f"{100.0 * (value / truth - 1.0):+.2f} ± {50.0 * (high - low) / truth:.2f}"


def _table(title: str, *headings: str) -> "Table":
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for heading in ("record", *headings, *MODES):
        table.add_column(heading)
    return table


if __name__ == "__main__":
    sys.exit(main())
