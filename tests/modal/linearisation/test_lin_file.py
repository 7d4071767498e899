"""Linearisation files: what is read, and how a damaged file is refused."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.modal.linearisation.whirling_rotor import NAMES, Rotor, lin_text
from windsysid.errors import ConfigurationError
from windsysid.modal.linearisation.lin_file import read_lin_file


def test_operating_point_states_and_matrix_are_read(tmp_path: Path):
    (path,) = Rotor().write(tmp_path, azimuths=1)
    found = read_lin_file(path)
    assert (found.description, found.wind_speed, found.digits) == ("A rotor", 8.0, 13)
    assert [found.rotor_speed, found.azimuth] == pytest.approx([1.2, 0.3])
    np.testing.assert_allclose(found.A, Rotor().matrix(0.3), rtol=1e-12)
    blade, rate = found.states[2], found.states[7]
    assert (blade.module, blade.name) == ("ED", "1st edgewise bending-mode DOF of blade 1")
    assert (blade.rotating, blade.rate, blade.order) == (True, False, 2)
    assert (rate.name, rate.rate) == (blade.name, True)


def test_rounding_is_half_a_unit_of_the_last_digit_and_none_for_zeros_and_ones(tmp_path: Path):
    path = tmp_path / "a.1.lin"
    A = np.zeros((10, 10))
    A[0, :4] = 1.0, 1.234, -5.678e-7, 9.1e5
    path.write_text(lin_text(A, NAMES, 1.0, 0.0, number="{:12.3E}"))
    found = read_lin_file(path)
    assert found.digits == 4
    np.testing.assert_allclose(found.rounding[0, :5], [0.0, 5e-4, 5e-11, 50.0, 0.0])


def test_numbers_without_an_exponent_letter_are_fortrans(tmp_path: Path):
    path = tmp_path / "a.1.lin"
    text = lin_text(np.full((10, 10), 2.0), NAMES, 1.0, 0.0, number="{:12.3E}")
    path.write_text(text.replace("2.000E+00", "2.000-101", 1).replace("2.000E+00", "2.000D+00", 1))
    assert read_lin_file(path).A[0, :3].tolist() == [2e-101, 2.0, 2.0]


def test_other_matrices_than_that_of_the_states_are_skipped(tmp_path: Path):
    path = tmp_path / "a.1.lin"
    path.write_text(lin_text(np.eye(10), NAMES, 1.0, 0.0) + "B: 9 x 1\n" + "wrong\n" * 9)
    np.testing.assert_array_equal(read_lin_file(path).A, np.eye(10))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Rotor Speed:", "Rotor:", "expected a line 'Rotor Speed:"),
        ("rad/s\n   Azimuth", "rpm\n   Azimuth", "line 8: expected 'Rotor Speed: NUMBER rad/s', got '1.2"),
        ("states:        10", "states:        12", "expected 12 states as its header says, got 10"),
        ("          4  1.0", "          5  1.0", "line 22: expected state 4"),
        ("Order of continuous", "Order of", "is no linearisation of OpenFAST"),
        ("A: 10 x 10", "A: 10 x 9", "line 33: expected a row of 9 numbers, got 10"),
        ("A: 10 x 10", "A: 9 x 10", "expected A of 10 x 10 as its header says, got 9 x 10"),
        ("A: 10 x 10", "a: 10 x 10", "expected a matrix 'A: n x n'"),
        ("A: 10 x 10\n", "A: 2 x 0\n\n\n", "expected a matrix 'A: n x n' of at least one state"),
        ("1.000000000000E+00", "*****", "line 33: expected a number in column 6 of A, got '*****'"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line_with_its_place(tmp_path: Path, old: str, new: str, message: str):
    path = tmp_path / "a.1.lin"
    text = lin_text(Rotor().matrix(0.0), NAMES, 1.2, 0.0)
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigurationError, match=re.escape(message)) as refused:
        read_lin_file(path)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_a_file_that_was_cut_off_names_the_line(tmp_path: Path):
    path = tmp_path / "a.1.lin"
    path.write_text("\n".join(lin_text(np.eye(10), NAMES, 1.2, 0.0).split("\n")[:36]))
    with pytest.raises(ConfigurationError, match=r"line 37: expected a row of 10 numbers, got 0; it may be cut off"):
        read_lin_file(path)
