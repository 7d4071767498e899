"""Errors of libraries that read a file."""

import pytest

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.access.files import reading


def test_what_a_library_raises_is_one_line_on_a_damaged_file():
    with pytest.raises(RecordError, match=r"is damaged or cut off \(bad page\)"), reading():
        raise ValueError("bad\n page")


@pytest.mark.parametrize("kind", [RecordError, ConfigurationError, MemoryError])
def test_errors_with_a_message_of_their_own_pass(kind):
    with pytest.raises(kind, match=r"^own message$"), reading():
        raise kind("own message")
