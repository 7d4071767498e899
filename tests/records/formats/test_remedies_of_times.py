"""What the message of a refused file tells users to do makes the file readable."""

import re

import numpy as np
import pytest

from tests.records.formats.helpers import write
from windsysid.errors import WindsysidError
from windsysid.records.formats import read_record
from windsysid.records.record import Record

ROWS = "".join(f"{k / 50:.2f},{k % 7}.5\n" for k in range(60))
COUNTS = "".join(f"{k},{k % 7}.5\n" for k in range(60))


def refusal(path):
    with pytest.raises(WindsysidError) as caught:
        read_record(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("content", "advice", "mapping"),
    [
        ("time,a [m]\n" + COUNTS, r"\[time\] unit", '[time]\nunit = "ms"'),
        ("time,a [m]\n" + COUNTS, r"\[time\] unit or rate", "[time]\nrate = 50.0"),
        ("count,a [m]\n" + COUNTS, r"\[time\] rate", "[time]\nrate = 50.0"),
        ("when,a [m]\n" + ROWS, r"\[time\] column", '[time]\ncolumn = "when"'),
        ("a [m],b [m]\n" + COUNTS, r"\[time\] rate", "[time]\nrate = 50.0"),
        ("time [steps],a [m]\n" + COUNTS, r"\[time\] unit", '[time]\nunit = "ms"'),
        ("time [steps],a [m]\n" + COUNTS, r"\[time\] rate", "[time]\nrate = 50.0"),
        (COUNTS, r"\[time\] unit or rate", "[time]\nrate = 50.0"),
        ("".join(f"{k % 7}.5,{k}\n" for k in range(60)), r"\[time\] rate", "[time]\nrate = 50.0"),
        ("time,a [m]\n" + "".join(f"12:00:{k:02d},1\n" for k in range(60)), "no date.*rate", "[time]\nrate = 1.0"),
        ("time,a [m]\n" + "".join(f"12:00:{k:02d},1\n" for k in range(60)), 'format = "%H:%M:%S"',
         '[time]\nformat = "%H:%M:%S"'),
        ("time [s],tower_x_acceleration\n" + ROWS, "in a mapping",
        '[channels.tower_x_acceleration]\nunit = "m/s^2"'),
        ("time [s],a [furlong]\n" + ROWS, "another in the mapping file", '[channels."a"]\nunit = "m"'),
        ("time [s],a [furlong]\n" + ROWS, 'unit = "as written"', '[channels."a"]\nunit = "as written"'),
        ("time [s];a\n" + "".join(f"{k};1,{100 + k}\n" for k in range(60)), r"\[csv\] decimal", '[csv]\ndecimal = ","'),
    ],
)  # fmt: skip
def test_the_key_of_the_mapping_that_a_message_names_makes_the_file_readable(tmp_path, content, advice, mapping):
    path = write(tmp_path, content)
    assert re.search(advice, refusal(path))
    assert read_record(path, mapping=write(tmp_path, mapping, "m.toml")).samples == 60


@pytest.mark.parametrize(
    ("content", "advice", "old", "new"),
    [
        ("time,a [m]\n" + COUNTS, r"write 'time \[s\]'", "time,", "time [s],"),
        ("time,a [m]\n" + COUNTS, r"or 'time \[ms\]'", "time,", "time [ms],"),
        ("time [steps],a [m]\n" + COUNTS, r"expected 'time \[s\]'", "[steps]", "[s]"),
        ("a [m],time [s]\n" + "".join(f"{k % 7}.5,{k / 50}\n" for k in range(60)), "put the time first",
        "a [m],time [s]\n" + "".join(f"{k % 7}.5,{k / 50}\n" for k in range(60)), "time [s],a [m]\n" + ROWS),
        ("time [s],tower_x_acceleration\n" + ROWS, "in the header", "acceleration", "acceleration [m/s^2]"),
        ("time [s],,b [m]\n" + ROWS.replace("\n", ",1\n"), "name it", ",,", ",a [m],"),
        ("time [s],a [m],a [m]\n" + ROWS.replace("\n", ",1\n"), "rename one", "a [m],a", "a [m],b"),
        ("time [s],a [m]\n" + ROWS + "1.21,x\n", "is not a number", "1.21,x\n", ""),
        ("time [s],a [m]\n" + ROWS + "1.21,1,2\n", "remove that line", "1.21,1,2\n", ""),
        ("time [s],a [m]\n" + ROWS + "1.21,inf\n", "leave the cell empty", "inf", ""),
        ("time [s],a [m]\n" + ROWS + "1.18,1\n", "written twice", "1.18,1\n", ""),
        ("time [s],a [m]\n" + ROWS + ",1\n", "remove that row", ",1\n", ",", ),
    ],
)  # fmt: skip
def test_the_change_of_the_file_that_a_message_names_makes_it_readable(tmp_path, content, advice, old, new):
    path = write(tmp_path, content)
    assert re.search(advice, refusal(path))
    changed = content.removesuffix(old) if new == "," else content.replace(old, new, 1)
    assert read_record(write(tmp_path, changed)).samples >= 60


def test_a_record_whose_clock_was_set_back_is_readable_after_what_the_message_says(tmp_path):
    times = np.concatenate([np.arange(30), np.arange(30) - 3600.0]) / 50.0
    body = [f"{t:.2f},1\n" for t in times]
    assert re.search("set back. shift what follows", refusal(write(tmp_path, "time [s],a [m]\n" + "".join(body))))
    times[30:] += times[29] + 0.02 - times[30]
    assert read_record(write(tmp_path, "time [s],a [m]\n" + "".join(f"{t:.2f},1\n" for t in times))).samples == 60


def test_dates_whose_clock_was_put_back_are_readable_in_two_files(tmp_path):
    body = [f"2021-10-31 02:{59 if k < 30 else 0:02d}:{k % 30:02d},{k}\n" for k in range(60)]
    message = refusal(write(tmp_path, "time,a [m]\n" + "".join(body)))
    found = re.search(r"backwards at line (\d+) .*cut the file in two at that line", message)
    assert found is not None
    line = int(found[1])
    first, second = body[: line - 2], body[line - 2 :]
    for part in (first, second):
        assert read_record(write(tmp_path, "time,a [m]\n" + "".join(part))).samples == 30


def test_irregular_stamps_can_be_resampled():
    from windsysid.signals.condition import resample

    rng = np.random.default_rng(1)
    record = Record(np.cumsum(rng.uniform(0.005, 0.02, 500)), rng.standard_normal((500, 1)), ("a",), ("m",))
    with pytest.raises(WindsysidError, match="resample the record first"):
        record.on_uniform_grid()
    assert resample(record, 40.0).is_uniform
