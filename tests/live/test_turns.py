"""Threads take short turns while an engine or a publisher runs, and the process has its own back afterwards."""

import sys

import pytest

from tests.live.memory import MemoryStore
from windsysid.live.engine import Engine
from windsysid.live.turns import TURN_SECONDS, ShortTurns


@pytest.fixture(autouse=True)
def own(monkeypatch: pytest.MonkeyPatch):
    """The process's own turns, whatever a test does, and whatever still runs of tests before."""
    monkeypatch.setattr(ShortTurns, "_asking", set())
    before = sys.getswitchinterval()
    sys.setswitchinterval(0.005)
    yield
    sys.setswitchinterval(before)


def test_turns_are_short_until_the_last_has_ended():
    first, second = ShortTurns(), ShortTurns()
    assert sys.getswitchinterval() == pytest.approx(TURN_SECONDS, rel=0.02)
    first.end()
    first.end()
    assert sys.getswitchinterval() == pytest.approx(TURN_SECONDS, rel=0.02)
    second.end()
    assert sys.getswitchinterval() == pytest.approx(0.005, rel=0.02)


def test_turns_that_are_shorter_already_stay():
    sys.setswitchinterval(1e-4)
    turns = ShortTurns()
    assert sys.getswitchinterval() == pytest.approx(1e-4, rel=0.02)
    turns.end()
    assert sys.getswitchinterval() == pytest.approx(1e-4, rel=0.02)


def test_an_engine_takes_short_turns_while_it_runs():
    engine = Engine([], MemoryStore(), workers=0)
    assert sys.getswitchinterval() == pytest.approx(TURN_SECONDS, rel=0.02)
    engine.drain()
    assert sys.getswitchinterval() == pytest.approx(0.005, rel=0.02)
