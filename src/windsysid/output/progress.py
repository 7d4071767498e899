"""Progress of a command that takes seconds: one line that a terminal draws again and again."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, TypeAlias

from windsysid.output.console import printable
from windsysid.units import spell

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

__all__ = ["Progress", "Shown", "expect", "hear", "passed", "unheard"]

Progress: TypeAlias = Callable[[str, float | None], object]
"""Callback with the name of the step and its completed share, from 0 to 1; None if unknown."""

SILENT_SECONDS = 2.0
"""Seconds [s] before times are shown."""


def unheard(doing: str, share: float | None = None) -> None:
    """No progress is shown."""


class Shown:
    """Progress line of a command: the step, its share in per cent, and the time left.

    The time left is that of the step that is named, from the pace since its first share. Where no share is
    known, the line tells the seconds that have passed.
    """

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.title, self.clock = title, clock
        self.doing, self.share = "", 0.0
        self.begun = self.since = clock()
        self.first: float | None = None

    def __call__(self, doing: str, share: float | None = None) -> None:
        """Go on with `doing`, of which `share` (0 to 1) is done; a share that falls is that of another step."""
        if share is None:
            self.first = None
        elif self.first is None or share < self.share:
            self.first, self.since = share, self.clock()
        self.doing, self.share = doing, share or 0.0

    def times(self) -> str:
        """Per cent and the time left, or the time that has passed; nothing in the first seconds."""
        now = self.clock()
        told = [] if self.first is None else [f"{100.0 * self.share:.0f} %"]
        if now - self.begun < SILENT_SECONDS:
            return told[0] if told else ""
        if self.first is not None and self.share > self.first:
            left = (now - self.since) * (1.0 - self.share) / (self.share - self.first)
            told.append(f"{spell(round(left), 2)} left")
        else:
            told.append(f"{spell(round(now - self.begun), 2)} so far")
        return ", ".join(told)

    def line(self, width: int) -> str:
        """One line of at most `width` columns; the step is cut, the times are not."""
        from rich.cells import cell_len

        times = self.times()
        end = f" ({times})" if times else ""
        text = printable(f"{self.title}: {self.doing}" if self.doing else self.title)
        room = max(width - cell_len(end), 1)
        return (text if cell_len(text) <= room else f"{text[: room - 1]}…") + end

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Draw it as it is now: Rich asks twelve times a second."""
        from rich.text import Text

        yield Text(self.line(options.max_width), no_wrap=True, overflow="crop")


class _Work:
    """Work of which only an estimate says how much is left: its share never falls, and is below 1 until it ends."""

    def __init__(self, progress: Progress, doing: str) -> None:
        self.progress, self.doing = progress, doing
        self.done = self.left = self.least = self.share = 0.0

    def expect(self, left: float, least: float) -> None:
        """Update the estimate of the time left; show nothing before the first one."""
        self.left, self.least = left, least
        self.tell()

    def passed(self, amount: float) -> None:
        """Take note that so much was done."""
        if self.least > 0.0:
            self.done, self.left = self.done + amount, max(self.left - amount, self.least)
            self.tell()

    def tell(self) -> None:
        """Tell the share that is done."""
        self.share = max(self.share, self.done / (self.done + self.left))
        self.progress(self.doing, self.share)


_WORK: ContextVar[_Work | None] = ContextVar("work", default=None)


@contextmanager
def hear(progress: Progress, doing: str) -> Iterator[None]:
    """Report the work within to `progress`: all calls of `expect` and `passed` below."""
    token = _WORK.set(_Work(progress, doing))
    try:
        yield
    finally:
        _WORK.reset(token)


def expect(left: float, least: float) -> None:
    """Report how much work is left, and the least that is left until it ends, in the unit of `passed`."""
    if (work := _WORK.get()) is not None:
        work.expect(left, least)


def passed(amount: float) -> None:
    """Report that so much work was done."""
    if (work := _WORK.get()) is not None:
        work.passed(amount)
