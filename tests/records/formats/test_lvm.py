"""LabVIEW measurement files: headers, segments and their times."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.formats import read_record

HEAD = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
SEGMENT = (
    "Channels\t2\t\t\nSamples\t3\t3\t\nY_Unit_Label\tm\tmm\nX0\t{x0}\t{x0}\nDelta_X\t0,5\t0,5\n***End_of_Header***\n"
)
ROWS = "X_Value\ta\tb\tComment\n\t1,5\t1\n\t2,5\t2\n\t3,5\t3\n"


def written(tmp_path, text):
    path = tmp_path / "x.lvm"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_segment_has_its_units_and_its_grid(tmp_path):
    found = read_record(written(tmp_path, HEAD + SEGMENT.format(x0="2") + ROWS))
    np.testing.assert_allclose(found.time, [2.0, 2.5, 3.0], rtol=1e-15)
    np.testing.assert_allclose(found["a"], [1.5, 2.5, 3.5], rtol=1e-15)
    np.testing.assert_allclose(found["b"], [1e-3, 2e-3, 3e-3], rtol=1e-15)


def test_segments_follow_each_other(tmp_path):
    text = HEAD + SEGMENT.format(x0="0") + ROWS + SEGMENT.format(x0="1,5") + ROWS
    np.testing.assert_allclose(read_record(written(tmp_path, text)).time, 0.5 * np.arange(6), rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + ROWS, "should begin a segment with 'Channels'"),
        (HEAD + SEGMENT.format(x0="0"), "cut off in the header of its last segment"),
        (HEAD + SEGMENT.format(x0="0") + ROWS.replace("\t3,5\t3\n", ""), "a segment says 3 samples and has 2"),
    ],
)
def test_damage_is_named(tmp_path, text, message):
    with pytest.raises(RecordError, match=message):
        read_record(written(tmp_path, text))
