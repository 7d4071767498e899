"""Blocks of unknowns."""

import numpy as np

from windsysid.statespace.unknowns import Unknowns

KNOWN = Unknowns(("k", "c"), ("lag",), ("rms", "noise"), ("gain",), ("clock",))


def test_blocks_cover_every_unknown_once_in_one_order():
    every = [KNOWN.names[KNOWN.of(block)] for block in ("parameters", "lag", "statistics", "tolerances", "clocks")]
    assert sum(every, ()) == KNOWN.names == ("k", "c", "lag", "rms", "noise", "gain", "clock")
    assert KNOWN.size == 7
    assert KNOWN.of("effects") == slice(7, 7)


def test_places_of_several_blocks_and_of_all_others():
    assert KNOWN.of("statistics", "clocks") == slice(3, 7)
    assert KNOWN.places("tolerances", "parameters").tolist() == [5, 0, 1]
    assert KNOWN.but("clocks").tolist() == [0, 1, 2, 3, 4, 5]
    assert KNOWN.only("parameters", "clocks").names == ("k", "c", "clock")


def test_a_vector_holds_the_blocks_that_are_given():
    np.testing.assert_array_equal(KNOWN.vector(lag=0.1, statistics=[1, 2]), [0, 0, 0.1, 1, 2, 0, 0])


def test_values_of_another_problem_go_where_the_blocks_are_the_same():
    other = Unknowns(("k", "c"), ("lag",), ("level",))
    np.testing.assert_array_equal(KNOWN.from_other(np.array([1.0, 2, 3, 4]), other), [1, 2, 3, 0, 0, 0, 0])
