"""Limit on the data that are on their way to the store."""

import threading

__all__ = ["Gate"]


class Gate:
    """Lets blocks in while there is room.

    Parameters
    ----------
    blocks, size
        That may be inside, and their bytes; one block larger than `size` may be there alone.
    """

    def __init__(self, blocks: int, size: int) -> None:
        self._most, self._most_bytes = blocks, size
        self._room = threading.Condition()
        self._open = False
        self.inside = self._bytes = 0

    def enter(self, size: int) -> None:
        """Wait for room, and take it."""
        with self._room:
            self._room.wait_for(lambda: self._open or (self.inside < self._most and self._bytes < self._most_bytes))
            self.inside += 1
            self._bytes += size

    def leave(self, size: int) -> None:
        """Give the room back."""
        with self._room:
            self.inside -= 1
            self._bytes -= size
            self._room.notify_all()

    def open(self) -> None:
        """Release all waiting threads: the engine ends."""
        with self._room:
            self._open = True
            self._room.notify_all()
