"""Time and disk space that a live store needs: ``python -m benchmarks.live_store --store sqlite``.

Blocks of one second of 100 Hz and five channels, float32, of 1000 turbines, each with its status, as the engine submits
them; then a month of windows of one turbine.
"""

import argparse
import contextlib
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import numpy as np
from validation.postgres_server import postgres

from windsysid.fleet.rows import empty_row, row_of
from windsysid.identification.identify import identify
from windsysid.live.blocks.block import Block
from windsysid.live.store import open_store
from windsysid.live.store.contents import Commit, Result, SeriesLevel, Status, StoredBlock
from windsysid.live.store.encoding import pack_spectra
from windsysid.live.store.sql_store import SqlStore
from windsysid.reports.interactive.identification import compact_spectra
from windsysid.reports.interactive.plot import to_json
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

SECOND = 1_000_000_000
TURBINES, MONTH, WINDOW = 1000, 30 * 144, 600 * SECOND


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--store", choices=("sqlite", "postgres"), default="sqlite")
    parser.add_argument("--blocks", type=int, default=20_000)
    options = parser.parse_args()
    with _url(options.store) as url:
        store = open_store(url)
        print(f"{options.store}, blocks of 100 samples x 5 channels and a status each")
        for underway in (1, 20, 200):
            _blocks(store, options.blocks if underway > 1 else options.blocks // 20, underway)
        _windows(store)
        store.close()


@contextlib.contextmanager
def _url(store: str) -> Iterator[str]:
    if store == "sqlite":
        with tempfile.TemporaryDirectory() as folder:
            yield str(Path(folder) / "store.sqlite")
    else:
        with postgres(flush=True) as server:
            yield server.url


def _blocks(store: SqlStore, count: int, underway: int) -> None:
    values = np.random.default_rng(0).standard_normal((100, 5)).astype("float32")
    channels = ("rotor_azimuth", "rotor_speed", "nacelle_yaw", "tower_x_acceleration", "tower_z_acceleration")
    units = ("rad", "rad/s", "rad", "m/s^2", "m/s^2")
    waits: list[float] = []
    queue: deque[Future[None]] = deque()
    begun, busy = time.perf_counter(), time.process_time()
    for i in range(count):
        turbine, number = f"T{i % TURBINES:04d}", i // TURBINES
        block = Block(turbine, number, number * SECOND, 100.0, channels, units, values)
        status = Status(turbine, {"": number}, number, number, "running", None, {"blocks": number})
        sent = time.perf_counter()
        future = store.submit(Commit([StoredBlock(underway, block)], [status]))
        future.add_done_callback(lambda _, sent=sent: waits.append(time.perf_counter() - sent))  # type: ignore[misc]
        queue.append(future)
        if len(queue) >= underway:
            queue.popleft().result()
    while queue:
        queue.popleft().result()
    wall, busy = time.perf_counter() - begun, time.process_time() - busy
    print(
        f"  {underway:3d} under way: {count / wall:6.0f} blocks/s, {1e6 * busy / count:4.0f} µs of processor time a"
        f" block, on disk after {1e3 * np.median(waits):.1f} ms (median),"
        f" {1e3 * np.quantile(waits, 0.95):.1f} ms (95 %)"
    )


def _windows(store: SqlStore) -> None:
    record = simulate_record("tower", duration=300.0, rate=10.0, seed=0)
    row = row_of(empty_row("T 2026-01-01", 0, 64 * "0"), record, load_turbine("tower"), None, "spectral")
    random = np.random.default_rng(0)
    before = store.size()["bytes"]
    for first in range(0, MONTH, 100):
        results = [
            Result(
                "T", n * WINDOW, (n + 1) * WINDOW, n * WINDOW, row,
                [SeriesLevel(f"k_{i}", "N/m", "k", *random.standard_normal(8).tolist()) for i in range(12)], b"",
            )
            for n in range(first, min(first + 100, MONTH))
        ]  # fmt: skip
        store.submit(Commit(results=results)).result()
    kept = (store.size()["bytes"] - before) / MONTH
    print(
        f"a month of windows of one turbine, 12 series: {kept / 1000:.1f} kB a window,"
        f" {kept * 52.56 / 1000:.0f} MB a year"
    )
    for name, duration, rate in (("tower", 600.0, 20.0), ("verne555", 120.0, 50.0)):
        record = simulate_record(name, duration=duration, rate=rate, seed=0)
        plots = compact_spectra(identify(record, load_turbine(name), formulation="spectral"), record)
        size = len(pack_spectra([to_json(plot) for plot in plots])) / 1000
        print(f"{name}, {len(plots)} spectra an hour: {size:.1f} kB, {2.16 * size:.0f} MB in 90 days")
    for text, read in (
        ("2000 of them as levels", lambda: store.levels("T", most=2000)),
        ("the newest as a result", lambda: store.results("T", newest=1)),
        ("all turbines' statuses", store.statuses),
    ):
        times = []
        for _ in range(5):
            begun = time.perf_counter()
            read()
            times.append(time.perf_counter() - begun)
        print(f"  read {text}: {1e3 * min(times):.1f} ms")


if __name__ == "__main__":
    main()
