"""What a waiting user is told: one line, per cent and time left where they are known."""

from windsysid.output.progress import Shown, expect, hear, passed


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_share_tells_per_cent_and_the_time_left():
    clock = Clock()
    shown = Shown("oma", clock)
    shown("modes", 0.0)
    clock.now = 30.0
    shown("modes", 0.25)
    assert shown.line(80) == "oma: modes (25 %, 90 s left)"
    clock.now = 60.0
    assert shown.line(80) == "oma: modes (25 %, 3 min left)"  # it slowed down since


def test_pace_is_that_of_the_step_at_hand():
    clock = Clock()
    shown = Shown("identify", clock)
    shown("reading", 0.0)
    clock.now = 100.0
    shown("reading", 1.0)
    shown("taking in", 0.5)  # a share that falls begins another step: half of it was done before
    clock.now = 110.0
    shown("taking in", 0.75)
    assert shown.line(80).endswith("(75 %, 10 s left)")


def test_unknown_share_tells_the_time_that_passed_and_the_first_seconds_tell_none():
    clock = Clock()
    shown = Shown("identify", clock)
    shown("reading", 0.9)
    shown("spectral formulation")
    assert shown.line(80) == "identify: spectral formulation"
    clock.now = 45.0
    assert shown.line(80) == "identify: spectral formulation (45 s so far)"


def test_line_fits_the_terminal_and_keeps_its_times():
    clock = Clock()
    shown = Shown("inspect", clock)
    shown("reading " + "a_very_long_folder/" * 9, 0.0)
    clock.now = 10.0
    shown(shown.doing, 0.5)
    line = shown.line(78)
    assert len(line) == 78
    assert line.endswith("… (50 %, 10 s left)")


def test_share_of_estimated_work_never_falls_and_ends_below_one():
    told: list[float] = []

    def listen(doing: str, share: float | None) -> None:
        assert doing == "search"
        told.append(share or 0.0)

    expect(1.0, 1.0)  # nobody hears
    with hear(listen, "search"):
        passed(5.0)  # before any estimate: nothing is told
        expect(10.0, 1.0)
        for _ in range(15):
            passed(1.0)
        expect(30.0, 1.0)  # more than was thought
        passed(1.0)
    passed(1.0)
    assert told[:6] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert told == sorted(told)
    assert len(told) == 18
    assert told[-1] == 15.0 / 16.0
