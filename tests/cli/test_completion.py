"""The shell completes commands and options."""

from collections.abc import Callable

import pytest

from tests.conftest import Ended


@pytest.mark.parametrize(
    ("typed", "at", "offered"), [("windsysid ident", 1, "identify"), ("windsysid modes --oper", 2, "--operating")]
)
def test_what_is_typed_is_completed(
    run: Callable[..., Ended], monkeypatch: pytest.MonkeyPatch, typed: str, at: int, offered: str
):
    monkeypatch.setenv("_WINDSYSID_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(at))
    assert run().out.split() == [offered]
