"""The comparison of pieces with whole records runs; by filters `tests/identification/test_pieces.py` compares them."""

from validation.pieces import cases, compare


def test_pieces_are_compared_with_the_whole_record():
    (case,) = (case for case in cases(None) if case.name.startswith("spectra, tower"))
    assert compare(case).off < 0.5
