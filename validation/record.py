"""Run a validation module and keep what it printed, with the command, the commit, the machine and the date.

    python -m validation.record NAME [-- ARGUMENTS]

runs ``python -m validation.NAME ARGUMENTS``, shows its output and writes ``validation/results/NAME.txt``. The site
makes a page of these files (``docs/measured.py``). The working tree must be as committed, apart from the results
themselves.
"""

import os
import platform
import resource
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

__all__ = ["RESULTS", "main"]

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "validation" / "results"
LIBRARIES = ("numpy", "scipy", "numba")


def main(words: list[str]) -> int:
    """Exit code: that of the module; 2 where nothing was run."""
    if not words or (len(words) > 1 and words[1] != "--"):
        return _refuse("expected NAME -- ARGUMENTS, got", " ".join(words) or "nothing")
    name, given = words[0], words[2:]
    if not (ROOT / "validation" / f"{name}.py").is_file() and not (ROOT / "validation" / name).is_dir():
        return _refuse("expected the name of a module of validation/, got", name)
    changed = _git("status", "--porcelain", "--", ".", f":!{RESULTS.relative_to(ROOT).as_posix()}")
    if changed:
        return _refuse("expected a tree without changes, so that the commit says what ran, got", changed.split("\n")[0])
    commit = _git("rev-parse", "--short=10", "HEAD")
    ended = subprocess.run(
        [sys.executable, "-m", f"validation.{name}", *given],
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "120"},  # of tables
        stdout=subprocess.PIPE,
        text=True,
    )
    print(ended.stdout, end="")
    if ended.returncode:
        return ended.returncode
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    facts = {
        "command": shlex.join(["python", "-m", f"validation.{name}", *given]),
        "commit": commit,
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "Python": ", ".join([platform.python_version(), *(f"{library} {version(library)}" for library in LIBRARIES)]),
        "processor time": f"{used.ru_utime + used.ru_stime:.0f} s",
    }
    RESULTS.mkdir(exist_ok=True)
    head = "".join(f"{key}: {value}\n" for key, value in facts.items())
    (RESULTS / f"{name}.txt").write_text(f"{head}\n{ended.stdout.rstrip()}\n", encoding="utf-8")
    return 0


def _refuse(expected: str, got: str) -> int:
    print(f"validation.record: {expected} '{got}'", file=sys.stderr)
    return 2


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def _processor() -> str:
    """The processor's own name, where the system tells it."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
