"""`windsysid` as a program: Ctrl-C ends it quietly, even while its modules are still being loaded."""

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line; interrupted, it ends with exit code 130."""
    try:
        from windsysid.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
