import pytest

from windsysid.errors import ConfigurationError
from windsysid.live.page.access import SESSION_SECONDS, Access, is_loopback

READ, OPERATE = "r" * 20, "o" * 20


def test_tokens_give_their_roles_and_nothing_else_does():
    access = Access(READ, OPERATE)
    assert access.role(READ) == "reader"
    assert access.role(OPERATE) == "operator"
    assert all(access.role(wrong) is None for wrong in ("", "r", READ[:-1], READ + "r", "ö" * 20, "\udc80"))


def test_no_token_shows_in_the_text_of_an_access():
    assert READ not in repr(Access(READ, OPERATE))


def test_a_session_holds_its_role_until_it_ends():
    access = Access(READ, OPERATE)
    for role in ("reader", "operator"):
        cookie = access.session(role, now=0.0)
        assert access.role_of_session(cookie, now=SESSION_SECONDS - 1.0) == role
        assert access.role_of_session(cookie, now=SESSION_SECONDS + 1.0) is None


@pytest.mark.parametrize(
    "cookie", ["", ".", "operator.99999999999.", "operator.99999999999.0", "operator.x.y", "\udc80"]
)
def test_a_session_that_was_not_given_is_none(cookie):
    assert Access(READ, OPERATE).role_of_session(cookie) is None


def test_a_reader_cannot_write_itself_an_operators_session():
    access = Access(READ, OPERATE)
    assert access.role_of_session(access.session("reader").replace("reader", "operator")) is None


def test_other_tokens_end_all_sessions():
    cookie = Access(READ, OPERATE).session("operator")
    assert Access(READ, "p" * 20).role_of_session(cookie) is None


@pytest.mark.parametrize("token", ["short", "with\nline" * 4, "ö" * 20])
def test_a_token_that_protects_nothing_is_refused_and_not_shown(token):
    with pytest.raises(ConfigurationError) as refused:
        Access(read=token)
    assert token not in str(refused.value)
    assert "\n" not in str(refused.value)


def test_both_tokens_the_same_are_refused():
    with pytest.raises(ConfigurationError, match="the same"):
        Access(READ, READ)


def test_without_a_token_only_this_machine_is_listened_on():
    Access().check("127.0.0.1")
    Access(READ).check("0.0.0.0")
    with pytest.raises(ConfigurationError, match="give a read-only or an operator token"):
        Access().check("0.0.0.0")


@pytest.mark.parametrize(
    ("host", "is_own"),
    [("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("site", False)],
)
def test_what_is_this_machine(host, is_own):
    assert is_loopback(host) is is_own
