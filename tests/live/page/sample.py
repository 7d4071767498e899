"""A store with a week of three turbines: T01 is as it was, T02 lost stiffness, a sensor of T03 sticks.

Rows and spectra are varied from those of two simulated records (``rows.json`` and ``spectra.json``; made anew by
``python -m tests.live.page.sample``). ``python -m tests.live.page.sample --serve [PORT]`` shows the page over them.
"""

import copy
import json
import math
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.live.store.contents import Alarm, Commit, Result, SensorHealth, SeriesLevel, Status
from windsysid.live.store.store import Store

ROWS, SPECTRA = (Path(__file__).with_name(name) for name in ("rows.json", "spectra.json"))

SECOND = 1_000_000_000
WINDOW = 600 * SECOND

LOSS = 0.04
"""Of T02's fore-aft stiffness."""

KEY = "T02/k_fore_aft/1"


def fill(store: Store, *, now: int | None = None, days: float = 7.0, seed: int = 1) -> int:
    """Write the week that ends at `now`; where its last window begins."""
    now = time.time_ns() if now is None else now
    last = now // WINDOW * WINDOW - WINDOW
    count = int(days * 144)
    rows = json.loads(ROWS.read_text(encoding="utf-8"))
    plots = json.loads(SPECTRA.read_text(encoding="utf-8"))
    rng = np.random.default_rng(seed)
    for name, kind in (("T01", "tower"), ("T02", "tower"), ("T03", "verne555")):
        watch = _Watch()
        for first in range(0, count, 200):
            chosen = range(first, min(first + 200, count))
            results = [result(name, rows[kind], last - (count - 1 - i) * WINDOW, i / count, rng, watch) for i in chosen]
            drawn = [one.window // WINDOW % 3 == 2 or one.window == last for one in results]  # two an hour
            results = [
                one._replace(spectra=spectra(one.row, plots[kind], rng)) if some else one
                for one, some in zip(results, drawn, strict=True)
            ]
            store.submit(Commit(results=results)).result(60)
    store.submit(Commit(statuses=statuses(now), healths=healths(now), alarms=alarms(last, count))).result(60)
    return last


def result(
    name: str, like: dict[str, Any], window: int, share: float, rng: np.random.Generator, watch: "_Watch"
) -> Result:
    """One window: like another row, but for what the air, the noise and time do to it."""
    row = copy.deepcopy(like)
    turn = math.sin(2.0 * math.pi * (window / SECOND) / 86400.0)
    gust = 1.0 + 0.25 * turn + 0.08 * rng.standard_normal()
    row |= {"rotor_speed": row["rotor_speed"] * (1.0 + 0.05 * turn + 0.01 * rng.standard_normal()), "trusted": True}
    for channel in row["channels"]:
        channel["mean"] = row["rotor_speed"] if channel["name"] == "rotor_speed" else channel["mean"]
    if name == "T01" and 0.30 < share < 0.33:
        why = "expected at least 120 s without gaps, got 41 s: see the logger"
        row |= {"status": "refused", "why": why, "parameters": [], "modes": [], "statistics": [], "covariance": []}
        row |= {"trusted": None}
        return Result(name, window, window + WINDOW, window + WINDOW + 31 * SECOND, row, (), b"")
    for one in row["parameters"]:
        one["grade"] = "A"
    for mode in row["modes"]:
        mode |= {"frequency_grade": "A", "damping_ratio_grade": "A"}
    if name == "T01" and (share > 0.98 or rng.random() < 0.1):
        row |= {"trusted": False, "reasons": ["a narrow band of the load at 0.31 Hz may be part of the fore-aft mode"]}
        for one in row["parameters"]:
            one["grade"] = {"k_fore_aft": "B", "c_fore_aft": "C"}.get(one["name"], "A")
        row["modes"][1] |= {"frequency_grade": "B", "damping_ratio_grade": "C"}
    if name == "T03" and share > 0.97:
        row |= {"trusted": False, "reasons": ["the model does not explain blade_2_lag_acceleration"]}
        for one in row["parameters"]:
            one["grade"] = "C"
        for mode in row["modes"]:
            mode |= {"frequency_grade": "C", "damping_ratio_grade": "C"}
    for one in row["parameters"]:
        factor = math.exp(one["std"] / abs(one["estimate"]) * 0.8 * rng.standard_normal())
        if one["name"].startswith("c_"):
            factor *= 1.0 + 0.15 * turn
        if name == "T02" and one["name"] == "k_fore_aft" and share > 0.8:
            factor *= 1.0 - LOSS
        for key in ("estimate", "low", "high"):
            one[key] *= factor
    stiff = {one["name"][2:].replace("_", "-"): one for one in row["parameters"] if one["name"].startswith("k_")}
    for mode in row["modes"]:
        part = next((one for axis, one in stiff.items() if mode["name"].endswith(axis)), row["parameters"][0])
        factor = math.sqrt(part["estimate"] / part["reference"]) * (1.0 + 0.001 * rng.standard_normal())
        for key in ("frequency", "frequency_low", "frequency_high"):
            mode[key] *= factor
        factor = (1.0 + 0.15 * turn) * math.exp(0.15 * rng.standard_normal())
        for key in ("damping_ratio", "damping_ratio_low", "damping_ratio_high"):
            mode[key] *= factor
    for one in row["statistics"]:
        factor = math.exp(0.06 * rng.standard_normal()) * (1.0 if one["name"].startswith("noise") else gust)
        for key in ("estimate", "low", "high"):
            one[key] *= factor
    levels = [watch.level(one, name, share) for one in row["parameters"]]
    return Result(name, window, window + WINDOW, window + WINDOW + 31 * SECOND, row, levels, b"")


def spectra(row: Mapping[str, Any], plots: list[dict[str, Any]], rng: np.random.Generator) -> list[str]:
    """Spectra like others, at the frequencies of a row's modes."""
    if not row["modes"]:
        return []
    made = copy.deepcopy(plots)
    for plot in made:
        marks = [mark for mark in plot["marks"] if mark["group"] == "modes" and mark["name"][-2] in "ABC"]
        shift = row["modes"][1]["frequency"] / next((mark["at"] for mark in marks[1:]), row["modes"][1]["frequency"])
        shift = shift if 0.9 < shift < 1.1 else 1.0
        plot["x"] = [x * shift for x in plot["x"]]
        for mark in marks:
            mark["at"] *= shift
        measured = plot["curves"][0]["values"]
        measured[:] = [v * float(np.exp(0.2 * rng.standard_normal())) for v in measured]
    return [json.dumps(plot) for plot in made]


class _Watch:
    """Levels that follow a random walk; its jump is known."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[float, float]] = {}

    def level(self, one: dict[str, Any], turbine: str, share: float) -> SeriesLevel:
        y, std = one["estimate"], (one["high"] - one["low"]) / 4.0
        mean, var = self._known.get(one["name"], (y, std**2))
        jumped = turbine == "T02" and one["name"] == "k_fore_aft" and 0.8 < share < 0.802
        var += (0.0005 * abs(mean)) ** 2 + (std**2 if jumped else 0.0)
        gain = var / (var + std**2)
        mean, var = mean + gain * (y - mean), (1.0 - gain) * var
        self._known[one["name"]] = mean, var
        level, spread = (None, 0.0) if share < 1.0 / 7.0 else (mean, 2.0 * math.sqrt(var))
        statistic = 3.0 if turbine != "T02" or one["name"] != "k_fore_aft" or not 0.8 < share < 0.81 else 19.0
        return SeriesLevel(
            one["name"], one["unit"], one["name"][0], y, one["low"], one["high"],
            level, None if level is None else level - spread, None if level is None else level + spread,
            0.0 if level is None else statistic, 14.0, one["grade"],
        )  # fmt: skip


def statuses(now: int) -> list[Status]:
    counts = {"blocks": 604800, "samples": 12096000, "repeated": 12, "late": 3, "missing samples": 40}
    return [
        Status(
            turbine=name, sequences={"": 604800}, stream=now - age * SECOND, received=now - (age - 1) * SECOND,
            state="running", rotor_speed=speed, counts=counts,
        )
        for name, age, speed in (("T01", 2, 1.267), ("T02", 3, 1.27), ("T03", 2, 7.29))
    ]  # fmt: skip


def healths(now: int) -> list[SensorHealth]:
    towers = ("rotor_azimuth", "rotor_speed", "tower_x_acceleration", "tower_z_acceleration")
    blades = ("rotor_azimuth", "tower_x_acceleration", "tower_y_acceleration", "blade_1_lag_acceleration")
    good = [
        SensorHealth(name, channel, "good", now - 7 * 86400 * SECOND, "")
        for name, channels in (("T01", towers), ("T02", towers), ("T03", blades))
        for channel in channels
    ]
    text = "blade_2_lag_acceleration repeats -0.412 rad/s² for 5 h: see the sensor and its cable"
    return [*good, SensorHealth("T03", "blade_2_lag_acceleration", "stuck", now - 5 * 3600 * SECOND, text)]


def alarms(last: int, count: int) -> list[Alarm]:
    at, gone = last - int(0.2 * count) * WINDOW, last - int(0.7 * count) * WINDOW
    return [
        Alarm(
            key=KEY, turbine="T02", kind="structure", severity="alarm", about="k_fore_aft", opened=at + 9 * WINDOW,
            earliest=at - 2 * WINDOW, latest=at + WINDOW, ended=None,
            text="stiffness of the tower, fore-aft (k_fore_aft) fell by 4.0 ± 0.8 %: inspect foundation and bolts",
        ),
        Alarm(
            key="T03/blade_2_lag_acceleration/1", turbine="T03", kind="sensor", severity="warning",
            about="blade_2_lag_acceleration", opened=last - 29 * WINDOW, earliest=last - 30 * WINDOW,
            latest=last - 30 * WINDOW, ended=None,
            text="blade_2_lag_acceleration repeats one value: see the sensor and its cable",
        ),
        Alarm(
            key="T01//1", turbine="T01", kind="data", severity="notice", about="", opened=gone, earliest=gone,
            latest=gone, ended=gone + 30 * WINDOW, text="no samples came for 5 h: see the logger and the link",
            acknowledged=gone + 10 * WINDOW, by="J. Berg", remark="Power of the logger was off for service.",
        ),
    ]  # fmt: skip


def make_rows() -> None:
    """Identify two simulated records, and write their rows and spectra."""
    import windsysid
    from windsysid.fleet.rows import empty_row, row_of
    from windsysid.reports.interactive.identification import compact_spectra
    from windsysid.reports.interactive.plot import to_json
    from windsysid.results.serialization import finite
    from windsysid.turbine.file import load_turbine

    rows, plots = {}, {}
    for name, duration, rate in (("tower", 600.0, 20.0), ("verne555", 120.0, 50.0)):
        record = windsysid.simulate(name, duration=duration, rate=rate, seed=1)
        found: list[Any] = []
        row = row_of(empty_row(name, 0, ""), record, load_turbine(name), None, "spectral", found.append)
        rows[name] = finite(row)
        plots[name] = [json.loads(to_json(plot)) for plot in compact_spectra(found[0], record)[-2:]]
    ROWS.write_text(json.dumps(_rounded(rows), ensure_ascii=False, separators=(",", ":")), encoding="utf-8")
    SPECTRA.write_text(json.dumps(plots, ensure_ascii=False, separators=(",", ":")), encoding="utf-8")


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.8g}")
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return {key: _rounded(one) for key, one in value.items()} if isinstance(value, dict) else value


def serve(port: int) -> None:
    """Show the page until Ctrl-C."""
    import uvicorn

    from windsysid.live.page.app import app
    from windsysid.live.store import open_store

    store = open_store(":memory:")
    fill(store)
    uvicorn.run(app(store), host="127.0.0.1", port=port, timeout_graceful_shutdown=2)


if __name__ == "__main__":
    serve(int((sys.argv[2:] or ["8765"])[0])) if "--serve" in sys.argv else make_rows()
