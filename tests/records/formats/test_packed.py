"""OpenFAST's packed binary output, from bytes put together by hand."""

import struct
from pathlib import Path

import numpy as np

from windsysid.records.formats.access.packed import open_packed


def test_packed_numbers_are_taken_off_their_offset_and_then_scaled(tmp_path: Path):
    scale, offset = np.array([200.0, 4.0], dtype="<f4"), np.array([-500.0, 30.0], dtype="<f4")
    packed = np.array([[-500, 30], [-300, 34], [1500, -10]], dtype="<i2")
    values = [[0.0, 0.0], [1.0, 1.0], [10.0, -10.0]]  # (packed − offset)/scale
    texts = [text.ljust(10).encode() for text in ("Time", "RotSpeed", "TTDspSS", "(s)", "(rpm)", "(m)")]
    path = tmp_path / "packed.outb"
    path.write_bytes(
        struct.pack("<hii", 2, 2, 3) + struct.pack("<dd", 5.0, 0.25) + scale.tobytes() + offset.tobytes()
        + struct.pack("<i", 4) + b"test" + b"".join(texts) + packed.tobytes()
    )  # fmt: skip
    found = open_packed(path)
    np.testing.assert_array_equal(found.rows(0, 3), values)
    np.testing.assert_array_equal(found.rows(1, 2), values[1:2])
    np.testing.assert_array_equal(found.time(0, 3), [5.0, 5.25, 5.5])
    assert (found.names, found.units) == (("Time", "RotSpeed", "TTDspSS"), ("s", "rpm", "m"))
