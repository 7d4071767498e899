"""Time that a thread keeps Python's lock while others wait for it.

Python lets one thread run at a time, and by default a thread that has work keeps its turn for 5 ms. A thread that reads
600 rows from a database gives its turn away at every row, and waits 5 ms to get it back: three seconds, in which the
processors may have nothing to do. With 1 000 turbines, windows then wait in a row while the workers are idle
(``python -m validation.live_engine --turbines 100 --hours 0.4 --speed 10``). So turns are short while something of ours
runs that is made of several busy threads.
"""

import sys
import threading
from typing import ClassVar

__all__ = ["TURN_SECONDS", "ShortTurns"]

TURN_SECONDS = 5e-4
"""A turn [s]: a tenth of Python's own."""


class ShortTurns:
    """Short turns in this process until all requests for them have ended."""

    _lock = threading.Lock()
    _asking: ClassVar["set[ShortTurns]"] = set()
    _before = 0.0

    def __init__(self) -> None:
        kind = type(self)
        with self._lock:
            if not self._asking:
                kind._before = sys.getswitchinterval()
                sys.setswitchinterval(min(kind._before, TURN_SECONDS))
            self._asking.add(self)

    def end(self) -> None:
        """Not for us any more; a second call changes nothing."""
        with self._lock:
            if self in self._asking:
                self._asking.remove(self)
                if not self._asking:
                    sys.setswitchinterval(self._before)
