"""The comparison of pieces with whole records runs, by spectra and by filters."""

from validation.pieces import cases, compare


def test_pieces_are_compared_with_the_whole_record():
    chosen = [case for case in cases(None) if case.name.startswith(("spectra, tower", "tower"))]
    assert len(chosen) == 2
    for case in chosen:
        assert compare(case).off < 0.5
