"""Short text, which NumPy reads, says what long text says, which pandas reads."""

from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.formats import csv, read_record

CELLS = [
    "0.1", "+0.1", "-.5", "5.", "1e-3", "1E+3", "1.7976931348623157e308", "4.9e-324", "0.10000000000000000555111512312",
    "123456789012345678901234567890", " 5", "5 ", "", " ", "nan", "NaN", "-nan", "NA", "null", "NAN(1)", "nanx",
    "1_000", "0x10", "1e400", "1d5", "1,5", "--5", "5-", "1 2", "inf", "-INF", "Infinity", "True", "١", "1e", "1e+",
    "#N/A", "-9999",
]  # fmt: skip


def outcome(path: Path) -> object:
    """The numbers of a file, or why it is refused."""
    try:
        record = read_record(path)
    except RecordError as error:
        return str(error)
    return record.time.tobytes(), record["tower_x_acceleration"].tobytes()


@pytest.mark.parametrize("cell", CELLS)
def test_both_readers_take_a_cell_alike(cell: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "record.csv"
    rows = [f"{0.01 * i:.2f},{np.sin(i)!s},x" for i in range(20)]
    rows[11] = f"0.11,{cell},x"
    path.write_text("\n".join(["time [s],tower_x_acceleration [m/s^2],remark", *rows, ""]), encoding="utf-8")
    short = outcome(path)
    monkeypatch.setattr(csv, "_SHORT", 0)
    assert short == outcome(path)
