"""What the tests put into a store."""

from typing import Any

import numpy as np

from windsysid.live.blocks.block import Block
from windsysid.live.store.contents import Alarm, Commit, Result, SeriesLevel, Status, StoredBlock

SECOND = 1_000_000_000
WINDOW = 600 * SECOND


def block(number: int, turbine: str = "T01", dtype: str = "float32", stream: str = "") -> Block:
    values = np.random.default_rng(number).standard_normal((10, 2)).astype(dtype)
    values[3, 1] = np.nan
    return Block(turbine, number, number * SECOND, 10.0, ("tower", "δ"), ("m/s²", "m"), values, stream)


def blocks(*numbers: int, window: int = 0, **options: Any) -> Commit:
    return Commit(blocks=[StoredBlock(window, block(number, **options)) for number in numbers])


def level(name: str = "k_x", estimate: float | None = 1.1) -> SeriesLevel:
    return SeriesLevel(name, "N/m", "k", estimate, None, 1.3, 0.1 + 0.2, 5e-324, 1e308, 2.5, float("inf"), "B")


def result(number: int, turbine: str = "T01", text: str = "") -> Result:
    row = {
        "status": "ok",
        "why": text,
        "rate": 0.1 + number,
        "parameters": [{"name": "k_x", "low": None}],
        "trusted": True,
    }
    window = number * WINDOW
    return Result(
        turbine,
        window,
        window + WINDOW,
        window + 2 * WINDOW,
        row,
        [level(), level("c_x", None)],
        b"\0after %d" % number,
    )


def alarm(key: str = "T01/k_x/0", turbine: str = "T01", **changes: Any) -> Alarm:
    return Alarm(key, turbine, "structure", "alarm", "k_x", 5, 1, 4, None, "k_x fell by 3 %")._replace(**changes)


def status(turbine: str = "T01", received: int = 7) -> Status:
    return Status(turbine, {"": 3, "blades": 9}, 6, received, "running", 0.5, {"blocks": 3, "too late": 1})
