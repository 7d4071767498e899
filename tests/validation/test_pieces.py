"""The comparison of pieces with whole records runs; by filters `tests/identification/test_pieces.py` compares them."""

import pytest
from validation.pieces import cases, compare


@pytest.mark.slow
def test_pieces_are_compared_with_the_whole_record():
    (case,) = (case for case in cases(None) if case.name.startswith("spectra, tower"))
    assert compare(case).off < 0.5
