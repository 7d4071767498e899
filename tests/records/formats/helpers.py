"""Files that loggers could have written, and what must come out of them."""

import numpy as np
import pytest

from windsysid.errors import WindsysidError
from windsysid.records.formats import read_record


def write(folder, content, name="x.csv", encoding="utf-8"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path


def refused(path, match, **options):
    """The file is refused with one line that matches."""
    with pytest.raises(WindsysidError, match=match) as caught:
        read_record(path, **options)
    assert "\n" not in str(caught.value)


def table(rows=40, seed=3):
    """Times [s] (T,) and values (T, 2) of a record at 20 Hz that fit into few digits."""
    rng = np.random.default_rng(seed)
    return np.arange(rows) * 0.05, np.round(rng.standard_normal((rows, 2)) * 100.0, 3)


def text(delimiter=",", decimal=".", end="\n", header="time [s]{d}a [m]{d}b [kN]", rows=40):
    """The same as text, three decimals."""
    time, values = table(rows)
    lines = [header.format(d=delimiter)]
    for t, row in zip(time, values, strict=True):
        lines.append(delimiter.join(f"{x:.3f}".replace(".", decimal) for x in (t, *row)))
    return end.join(lines) + end
