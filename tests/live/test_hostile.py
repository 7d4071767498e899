"""Hostile messages end in one line each, and every good block between them is on disk."""

from validation.live_hostile import hostile


def test_a_hundred_hostile_messages_are_accepted_or_refused_in_one_line():
    outcome = hostile(120, 20260101, tell=lambda _: None)
    assert outcome.faults == []
    assert outcome.accepted > 5
    assert outcome.accepted + outcome.refused.total() == 120
