"""Does the page of a fleet name what is wrong, and nothing else? Years of ten turbines of the type.

``python -m validation.fleet --years 3``: years of ten turbines of the type, one 10-minute record an hour, simulated as
what the records would say (as validation/years.py does; bands from `windsysid.plan`). Turbines of the type scatter by 1
%. One is softened by 3 % in May, the sensor of one fails in July, one is iced in the first hard frost from December on:
ice grows for half a day and falls off when a day was above 1 °C; then the same of healthy turbines of the type. All
turbines of the type have the same weather; turbines stop, and idle in little wind. With ``--levelled`` damping follows
the wind no further than from 3.2 to 14.4 m/s, which no straight line does.

``python -m validation.fleet --healthy 20 --rate 1``: false alarms of healthy years, stated so often that they can be
counted.

``python -m validation.fleet --raw 2``: three raw days of the same ten turbines of the type, so many hours of records a
day, spread over it: vibrations are simulated, written as CSV and Parquet with SCADA next to them, and taken by
``windsysid batch``, twice. Softened by 3 % on the third day, a sensor that spikes from noon of the second, ice of 4 %
for 18 hours of frost.
"""

import argparse
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from validation.years import Site, site
from windsysid._types import Array
from windsysid.fleet.archive import add_rows, place_of, table_of
from windsysid.fleet.overview import Overview, oversee, overview_of
from windsysid.fleet.rows import Row, empty_row
from windsysid.monitoring.watch import YEAR
from windsysid.records.formats import write_record
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

__all__ = ["Fault", "main", "simulate_fleet"]

BEGIN = datetime(2025, 9, 1, tzinfo=UTC)
HOUR = 3600.0
YEAR_HOURS = 8766
SCATTER = 0.01
"""Standard deviation of true coefficients from turbine to turbine."""


class Fault(NamedTuple):
    """Fault of one turbine: which, what, from when to when."""

    turbine: str
    kind: str
    begin: datetime
    end: datetime


FAULTS = (
    Fault("T03", "soft", datetime(2026, 5, 12, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC)),
    Fault("T05", "sensor", datetime(2026, 7, 6, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC)),
    Fault("T08", "ice", datetime(2025, 12, 1, tzinfo=UTC), datetime(2026, 3, 1, tzinfo=UTC)),
)
"""3 % less stiffness; spikes; 4 % less stiffness from the first frost between these dates until it thaws."""

ICE_BELOW, ICE_ABOVE, ICE_GROWS = -3.0, 1.0, 12
"""Mean temperature [°C] of the last day at which ice begins to grow, and falls off; hours that it grows."""

_KINDS = {fault.turbine: fault.kind for fault in FAULTS}

NAMED = {"T03": "turbine", "T05": "sensor", "T08": "ice"}
"""Names that the page should give them."""

RAW_BEGIN = datetime(2025, 12, 1, tzinfo=UTC)
RAW_DAYS, RAW_RATE, RAW_SECONDS = 3, 20.0, 600.0
"""Days, samples a second [Hz] and seconds of the records of raw days."""

RAW_HOURS = {"T03": (48.0, 72.0), "T05": (36.0, 72.0), "T08": (42.0, 60.0)}
"""From which hour to which something is wrong with these turbines on raw days."""

OFF = ("T03", "outlier")
"""The softened one is off the turbines of its type, too, where its scatter is on that side: true, and not requested."""


def simulate_fleet(
    place: Site,
    seed: int,
    *,
    turbines: int = 10,
    hours: int = YEAR_HOURS,
    faults: tuple[Fault, ...] = (),
    levelled: bool = False,
) -> Iterator[tuple[str, list[Row]]]:
    """Turbines and their rows, one an hour."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, HOUR * hours, HOUR)
    year = 2.0 * np.pi * (time + (BEGIN - datetime(BEGIN.year, 1, 15, tzinfo=UTC)).total_seconds()) / (365.25 * 86400.0)
    season = 8.0 - 10.0 * np.cos(year) + 4.0 * np.sin(2.0 * np.pi * time / 86400.0)
    temperature = season + 3.0 * _memory(rng, hours, 72.0)
    wind = 8.0 * np.exp(0.35 * _memory(rng, hours, 12.0) - 0.06)
    for number in range(1, turbines + 1):
        name = f"T{number:02d}"
        mine = [fault for fault in faults if fault.turbine == name]
        own = np.random.default_rng([seed, number])
        heard = wind * np.exp(0.05 * _memory(own, hours, 3.0))
        yield name, _rows(place, own, name, time, temperature, heard, mine, levelled)


def _rows(
    place: Site,
    rng: np.random.Generator,
    name: str,
    time: Array,
    temperature: Array,
    wind: Array,
    faults: list[Fault],
    levelled: bool,
) -> list[Row]:
    """Rows of one turbine."""
    hours = len(time)
    parked = np.zeros(hours, dtype=bool)
    for begin in rng.integers(0, hours, 12):  # stops of half a day to two days
        parked[begin : begin + int(rng.integers(12, 48))] = True
    idle = ~parked & (wind < 4.0)
    state = np.where(parked, "parked", np.where(idle, "idling", "running"))
    inside = {
        fault.kind: (time >= (fault.begin - BEGIN).total_seconds()) & (time < (fault.end - BEGIN).total_seconds())
        for fault in faults
    }
    iced = _ice(temperature, inside["ice"]) if "ice" in inside else np.zeros(hours)
    columns = {}
    failing = inside.get("sensor", np.zeros(hours, dtype=bool)) & (rng.random(hours) < 0.6)
    for coefficient, sigma in zip(place.names, place.sigma, strict=True):
        stiff = coefficient.startswith("k_")
        steps = (0.0002 if stiff else 0.01) / math.sqrt(24.0) * rng.standard_normal(hours)
        truth = np.cumsum(steps) + SCATTER * rng.standard_normal()
        if stiff:
            truth = truth - 0.0003 * (temperature - 8.0)
            truth = truth + math.log(0.97) * inside.get("soft", 0.0) + math.log(0.96) * iced
        else:
            air = 1.0 + 0.5 * (wind / 8.0 - 1.0)
            truth = (1.0 + truth) * np.where(parked | idle, 0.5, np.clip(air, 0.7, 1.4) if levelled else air)
        bad = rng.random(hours) < 0.005
        errors = 1.2 * sigma * rng.standard_normal(hours) * np.where(bad, 10.0, 1.0)
        errors += np.where(failing, 6.0 * sigma * rng.standard_normal(hours), 0.0)
        columns[coefficient] = truth + errors
    lost = rng.random(hours) < 0.03
    out = int(rng.integers(0, hours - 24 * 14))
    lost[out : out + 24 * 7] = True
    refused = failing & (rng.random(hours) < 0.3)
    rows = []
    for i in np.flatnonzero(~lost):
        start = BEGIN + timedelta(seconds=float(time[i]))
        row = empty_row(f"/data/{name}/{start:%Y%m%d_%H%M}.csv", 1, "simulated")
        row |= {
            "status": "refused" if refused[i] else "ok", "why": "spikes" if refused[i] else None,
            "start": start.isoformat().replace("+00:00", "Z"), "duration": 600.0, "state": str(state[i]),
            "trusted": None if refused[i] else bool(not failing[i]), "scada_wind_speed": float(wind[i]),
            "scada_temperature": float(temperature[i]),
            "rotor_speed": 0.0 if parked[i] else 0.2 if idle[i] else float(np.clip(0.11 * wind[i], 0.7, 1.267)),
        }  # fmt: skip
        if failing[i]:
            row["health"] = [
                {"channel": "tower_x_acceleration", "kind": "spikes", "severity": "warning", "text": "", "count": 9}
            ]
        if not refused[i]:
            row["parameters"] = [
                _parameter(name, float(columns[name][i]), float(sigma))
                for name, sigma in zip(place.names, place.sigma, strict=True)
            ]
        rows.append(row)
    return rows


def _ice(temperature: Array, may: NDArray[np.bool_]) -> Array:
    """Amount of ice (T,), 0 to 1, by the hour: once, in the first frost of the time in which there may be."""
    day = np.convolve(temperature, np.full(24, 1.0 / 24.0))[: len(temperature)]
    frosts = np.flatnonzero(may & (day < ICE_BELOW))
    if not frosts.size:
        return np.zeros(len(temperature))
    begin = int(frosts[0])
    thaws = np.flatnonzero(day[begin:] > ICE_ABOVE)
    grown = np.clip(np.arange(1, len(temperature) - begin + 1) / ICE_GROWS, 0.0, 1.0)
    if thaws.size:
        grown[thaws[0] :] = 0.0
    return np.append(np.zeros(begin), grown)


def _parameter(name: str, own: float, sigma: float) -> Row:
    stiff = name.startswith("k_")
    return {
        "name": name, "unit": "N/m" if stiff else "N*s/m", "kind": "stiffness" if stiff else "damping",
        "prior_centre": 1.8e6 if stiff else 2e4, "prior_spread": 0.3, "logarithmic": stiff, "coordinate_scale": 2e4,
        "own": own, "own_std": sigma,
    }  # fmt: skip


def _memory(rng: np.random.Generator, count: int, hours: float) -> Array:
    """A first-order Gauss–Markov series of unit variance (count,)."""
    from scipy.signal import lfilter

    a = math.exp(-1.0 / hours)
    noise = math.sqrt(1.0 - a * a) * rng.standard_normal(count)
    return np.asarray(lfilter([1.0], [1.0, -a], noise, zi=[a * rng.standard_normal()])[0])


def write_fleet(place: Site, seed: int, archive: Path, **options: Any) -> None:
    """An archive of simulated rows, day by day."""
    for name, rows in simulate_fleet(place, seed, **options):
        days: dict[str, list[Row]] = {}
        for row in rows:
            days.setdefault(row["start"][:10], []).append(row)
        for day, of in days.items():
            add_rows(place_of(archive, name, day), of)


def years(fleets: int, first: int, *, levelled: bool = False) -> None:
    """Print what the pages of some fleets name, with faults and without."""
    place = site("tower", 12.0)
    rates = ", ".join(f"{name} {100.0 * s:.2g} %" for name, s in zip(place.names, place.sigma, strict=True))
    print(f"σ of a record: {rates}")
    for faults in (FAULTS, ()):
        right = wrong = 0
        for seed in range(first, first + fleets):
            page = _page(place, seed, faults, levelled, 0.1)
            kinds = {(name, event.kind) for event in page.events for name in event.turbine.split(", ")}
            wanted = set(NAMED.items()) if faults else set()
            right += len(wanted & kinds)
            wrong += len(kinds - wanted - ({OFF} if faults else set()))
            print(f"seed {seed}:", *page.sentences, sep="\n  ", flush=True)
        told = f"{right} of {len(NAMED) * fleets} named as they should be, " if faults else "healthy: "
        print(f"{told}{wrong} turbines named that should not be, in {fleets} years of ten turbines")


def healthy(fleets: int, first: int, rate: float, *, levelled: bool = False) -> None:
    """Print how many false alarms healthy fleets have at a stated rate, and how many were to be expected."""
    place = site("tower", 12.0)
    alarms, outliers, expected = [], 0, 0.0
    for seed in range(first, first + fleets):
        page = _page(place, seed, (), levelled, rate)
        alarms.append(sum(len(one.changes) for one in page.watches.values()))
        outliers += any(event.kind == "outlier" for event in page.events)
        spans = [one.blocks.time[-1] - one.blocks.time[one.begins] for one in page.watches.values()]
        expected += rate * float(np.mean(spans)) / YEAR
        print(f"seed {seed}: {alarms[-1]}", flush=True)
    print(
        f"{sum(alarms)} false alarms in {fleets} healthy years of ten turbines, {expected:.1f} expected at {rate:g} a"
        f" year; an outlier on {outliers} of {fleets} pages"
    )


def raw_days(hours: float, seed: int, home: Path) -> bool:
    """Print what the page of three raw days names, and whether a second run had nothing to do."""
    written = _write_raw(hours, seed, home)
    command = [
        sys.executable, "-m", "windsysid", "batch", str(home / "data"), "--fleet", str(home / "fleet.toml"),
        "--output", str(home / "archive"),
    ]  # fmt: skip
    for _ in range(2):
        run = subprocess.run(command, capture_output=True, text=True)
        print((run.stdout or run.stderr).strip().replace(str(home), "").splitlines()[0])
    page = oversee(home / "archive")
    print(*page.sentences, sep="\n")
    kinds = {(name, event.kind) for event in page.events for name in event.turbine.split(", ")}
    wanted = set(NAMED.items())
    identified = sum(glance.identified for glance in page.glances.values())
    print(
        f"{identified} of {written} records identified; {len(wanted & kinds)} of {len(wanted)} turbines named as they"
        f" should be, {len(kinds - wanted - {OFF})} named that should not be"
    )
    return "0 records taken" in run.stdout


def _write_raw(hours: float, seed: int, home: Path) -> int:
    """Files of raw days, SCADA and the fleet file; how many records."""
    rng = np.random.default_rng(seed)
    machine = load_turbine("tower").exact()
    each = max(round(6.0 * hours), 1)
    begins = np.arange(each * RAW_DAYS) * 24.0 / each  # [h]
    cold = (begins >= RAW_HOURS["T08"][0]) & (begins < RAW_HOURS["T08"][1])
    temperature = np.where(cold, -4.0, 4.0) + 3.0 * np.sin(2.0 * np.pi * begins / 24.0)
    text = ""
    for number in range(1, 11):
        name = f"T{number:02d}"
        text += f'[[turbine]]\nname = "{name}"\npattern = "{name}/*"\nturbine = "tower"\nscada = "{name}.csv"\n'
        own = {key: value * math.exp(SCATTER * rng.standard_normal()) for key, value in machine.values.items()}
        for i, hour in enumerate(begins):
            start = RAW_BEGIN + timedelta(hours=float(hour))
            wrong = name in RAW_HOURS and RAW_HOURS[name][0] <= hour < RAW_HOURS[name][1]
            soft = {"soft": 0.97, "ice": 0.96}.get(_KINDS.get(name, ""), 1.0) if wrong else 1.0
            soft *= math.exp(-0.0003 * temperature[i])
            values = {key: value * soft if key.startswith("k_") else value for key, value in own.items()}
            record = simulate_record(
                machine.with_values(values), duration=RAW_SECONDS, rate=RAW_RATE, seed=10**6 * seed + 1000 * number + i
            )
            if wrong and _KINDS[name] == "sensor":
                record = _spiked(record, rng)
            stamped = replace(record, start=start.isoformat().replace("+00:00", "Z"))
            write_record(stamped, home / "data" / name / f"{start:%Y%m%d_%H%M}.{'csv' if number % 2 else 'parquet'}")
        lines = [
            f"{(RAW_BEGIN + timedelta(hours=float(hour))).isoformat()},{degrees:.2f}"
            for hour, degrees in zip(begins, temperature, strict=True)
        ]
        (home / f"{name}.csv").write_text("time,temperature [degC]\n" + "\n".join(lines) + "\n")
    (home / "fleet.toml").write_text(text)
    return 10 * len(begins)


def _spiked(record: Record, rng: np.random.Generator) -> Record:
    """A record whose first channel has nine spikes."""
    values = record.values.copy()
    values[rng.integers(0, record.samples, 9), 0] += 30.0 * values[:, 0].std() * rng.choice([-1.0, 1.0], 9)
    return replace(record, values=values)


def _page(place: Site, seed: int, faults: tuple[Fault, ...], levelled: bool, rate: float) -> Overview:
    fleet = simulate_fleet(place, seed, faults=faults, levelled=levelled)
    tables = {name: table_of(rows) for name, rows in fleet}
    return overview_of(tables, Path("simulated"), alarms_per_year=rate)


def main() -> int:
    """Run the requested part; 1 where something was lost."""
    parser = argparse.ArgumentParser(prog="python -m validation.fleet", description=__doc__.splitlines()[0])
    parser.add_argument("--years", type=int, metavar="N", help="so many years of ten turbines, faulty and healthy")
    parser.add_argument("--healthy", type=int, metavar="N", help="so many healthy years of ten turbines")
    parser.add_argument("--rate", type=float, default=1.0, help="false alarms a year that are stated for them")
    parser.add_argument("--raw", type=float, metavar="HOURS", help="three raw days, so many hours of records a day")
    parser.add_argument("--levelled", action="store_true", help="damping levels off in strong wind")
    parser.add_argument("--archive", type=Path, help="write the archive of one faulty year")
    parser.add_argument("--seed", type=int, default=0, help="of the first fleet")
    options = parser.parse_args()
    if options.years is not None:
        years(options.years, options.seed, levelled=options.levelled)
    if options.healthy is not None:
        healthy(options.healthy, options.seed, options.rate, levelled=options.levelled)
    if options.raw is not None:
        with tempfile.TemporaryDirectory() as home:
            if not raw_days(options.raw, options.seed, Path(home)):
                return 1
    if options.archive is not None:
        write_fleet(site("tower", 12.0), options.seed, options.archive, faults=FAULTS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
