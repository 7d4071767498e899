"""Options that a formulation does not take are refused before a segment is read."""

from collections.abc import Iterator
from typing import Any

import pytest

from windsysid.errors import ConfigurationError
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.records.record import Record
from windsysid.turbine.turbine import Turbine


def unread() -> Iterator[Record]:
    raise AssertionError("a segment was read")
    yield


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"formulation": "spectral", "rate": 2.0}, "leave the rate out"),
        ({"formulation": "spectral", "memory": 0.0}, "memory: expected seconds greater than 0, got 0"),
        ({"memory": 10.0}, "joint without a memory, or spectral, got 'joint'"),
        ({"formulation": "force-balance"}, "got 'force-balance'"),
    ],
)
def test_options_of_the_other_formulation_are_refused(verne555: Turbine, options: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message):
        identify_pieces(unread(), verne555, **options)
