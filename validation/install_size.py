"""Disk space of an installation: the core, what each extra adds, and the largest packages.

``python -m validation.install_size`` sums the files of the distributions that each extra requires, and their
requirements, in this environment. Byte code that Python writes later, a third more, is not counted.
"""

import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from validation.field import markdown

__all__ = ["main"]

NAME, LARGEST = "windsysid", 6


def required(name: str, extra: str = "") -> Iterator[Requirement]:
    """Requirements of an installed distribution with an extra that hold here."""
    for text in distribution(name).requires or ():
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            yield requirement


def closure(name: str, extra: str = "") -> set[str]:
    """Names of all distributions that an installation of `name` with an extra brings along; what is not installed is
    left out."""
    found, left = set[str](), [(name, extra)]
    done = set[tuple[str, str]]()
    while left:
        if (one := left.pop()) in done:
            continue
        done.add(one)
        try:
            needed = list(required(*one))
        except PackageNotFoundError:
            continue
        found.add(distribution(one[0]).name.lower().replace("_", "-"))
        left += [(r.name, e) for r in needed for e in ("", *r.extras)]
    return found


@cache
def megabytes(name: str) -> float:
    """Size of the files of an installed distribution [MB], without byte code."""
    files = distribution(name).files or ()
    paths = (Path(str(file.locate())) for file in files if "__pycache__" not in file.parts)
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def main() -> int:
    """Print the table."""
    core = closure(NAME)
    rows = [("core", f"{len(core)}", f"{sum(map(megabytes, core)):.0f}", _largest(core))]
    for extra in sorted(distribution(NAME).metadata.get_all("Provides-Extra") or ()):
        more = closure(NAME, extra) - core
        rows.append((f"[{extra}]", f"{len(more)}", f"+{sum(map(megabytes, more)):.0f}", _largest(more)))
    print(markdown(("", "packages", "MB", "largest [MB]"), rows))
    return 0


def _largest(names: set[str]) -> str:
    sizes = sorted(((megabytes(name), name) for name in names), reverse=True)[:LARGEST]
    return ", ".join(f"{name} {size:.0f}" for size, name in sizes)


if __name__ == "__main__":
    sys.exit(main())
