"""Advice about times that run backwards: sorting would mix two stretches where a clock was set back."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.checks import check_rows


def message(time):
    with pytest.raises(RecordError) as caught:
        check_rows(time, np.zeros((len(time), 1)), ("a",))
    return str(caught.value)


@pytest.mark.parametrize("seconds", [0.07, 1.0, 1.02, 1.025, 5.013, 3600.0])
def test_what_follows_a_clock_that_was_set_back_is_to_be_shifted(seconds):
    time = np.arange(2000) / 20.0
    time[1000:] -= seconds
    assert "shift what follows" in message(time)


@pytest.mark.parametrize("order", [[1, 0], [2, 1, 0], [3, 0, 1, 2]])
def test_rows_that_were_exchanged_are_to_be_sorted(order):
    time = np.arange(2000) / 20.0
    time[700 : 700 + len(order)] = time[700 + np.array(order)]
    assert "sort the rows" in message(time)


def test_rows_in_no_order_are_to_be_sorted():
    assert "sort the rows" in message(np.random.default_rng(1).permutation(2000) / 20.0)
    assert "sort the rows" in message(np.concatenate([np.arange(1000) * 2, np.arange(1000) * 2 + 1])[::-1] / 20.0)
