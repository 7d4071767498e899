"""Blocks of a record, for tests of the engine."""

from collections.abc import Sequence

import numpy as np

from windsysid.live.blocks.block import Block
from windsysid.live.windows.timeline import SECOND
from windsysid.records.record import Record

NOON = 1_767_268_800 * SECOND
"""2026-01-01T12:00:00Z."""

CHANNELS = ("tower_x_acceleration", "tower_z_acceleration")


def record(samples: int, rate: float = 20.0, seed: int = 0) -> Record:
    """Noise of two accelerometers."""
    values = np.random.default_rng(seed).normal(size=(samples, 2))
    return Record(np.arange(samples) / rate, values, CHANNELS, ("m/s^2", "m/s^2"))


def blocks_of(
    given: Record, rate: float, size: int | Sequence[int], *, turbine: str = "T01", start: int = NOON, stream: str = ""
) -> list[Block]:
    """A record as blocks of `size` samples, or of the sizes given in turn."""
    sizes = [size] if isinstance(size, int) else list(size)
    blocks: list[Block] = []
    low = 0
    while low < given.samples:
        high = min(low + sizes[len(blocks) % len(sizes)], given.samples)
        begin = start + round(low * SECOND / rate)
        blocks.append(
            Block(turbine, len(blocks), begin, rate, given.channels, given.units, given.values[low:high], stream)
        )
        low = high
    return blocks
