"""`windsysid` as a program: Ctrl-C ends it quietly, even while its modules are still being loaded."""

import os
import signal
import sys
import threading
from typing import Any

__all__ = ["main"]

INTERRUPT_REPEAT_SECONDS = 0.05
"""Seconds after which a dropped interrupt is sent again."""


def main() -> None:
    """Run the command line; interrupted, it ends with exit code 130."""
    usual = signal.signal(signal.SIGINT, signal.SIG_DFL)  # while modules are loaded there is nothing to clean up
    from windsysid.cli import main as run

    signal.signal(signal.SIGINT, usual)
    sys.unraisablehook = _interrupt_again
    try:
        run()
    except KeyboardInterrupt:
        sys.exit(130)


def _interrupt_again(dropped: Any) -> None:
    """Send an interrupt again that Python dropped inside a destructor or a callback of a weak reference."""
    if not issubclass(dropped.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(dropped)
        return
    again = threading.Timer(INTERRUPT_REPEAT_SECONDS, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


if __name__ == "__main__":
    main()
