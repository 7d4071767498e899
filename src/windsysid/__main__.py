"""`windsysid` as a program: Ctrl-C ends it quietly, even while its modules are still being loaded."""

import signal
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line; interrupted, it ends with exit code 130."""
    usual = signal.signal(signal.SIGINT, signal.SIG_DFL)  # while modules are loaded there is nothing to clean up
    from windsysid.cli import main as run

    signal.signal(signal.SIGINT, usual)
    try:
        run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
