"""The wheel as a new user meets it: built, installed into clean environments, and README's commands run in an empty
folder.

Run:  python -m validation.wheel [--python python3.12 …]

Without --python every Python from 3.11 on is tried that is found by name or by pyenv. Nothing of this repository is on
the path of what is tried but the wheel; packages come from the index that pip is configured for.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from shutil import which

ROOT = Path(__file__).parents[1]

MINORS = range(11, 16)
"""Of the Pythons 3.x that are looked for."""

SOURCES = ("*.py", "py.typed", "*.toml", "*.j2", "*.html", "*.css", "*.js", "*.svg", "*.json")
"""What the package consists of; each such file under src must be in the wheel."""


def build(folder: Path) -> tuple[Path, Path]:
    """Wheel and sdist of this repository."""
    _run([sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "--wheel-dir", folder, ROOT], ROOT)
    _run([sys.executable, "-m", "pip", "install", "--quiet", "--target", folder / "tools", "setuptools>=77"], ROOT)
    tools = f"import sys; sys.path.insert(0, {str(folder / 'tools')!r}); import setuptools.build_meta as tools"
    script = f"{tools}; tools.build_sdist({str(folder)!r})"
    _run([sys.executable, "-c", script], ROOT)
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def missing(wheel: Path) -> list[str]:
    """Files of the package that the wheel lacks."""
    held = set(zipfile.ZipFile(wheel).namelist())
    tracked = subprocess.run(["git", "ls-files", "src"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    ours = [name.removeprefix("src/") for name in tracked.splitlines()]
    return [name for name in ours if name not in held and any(fnmatch(Path(name).name, kind) for kind in SOURCES)]


def pythons() -> Iterator[str]:
    """The Pythons that are here."""
    for minor in MINORS:
        versions = sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python"))
        found = str(versions[-1]) if versions else which(f"python3.{minor}")  # a shim of pyenv starts one Python alone
        if found is not None:
            yield found


def readme() -> Iterator[list[str] | str]:
    """README's commands of windsysid, as words, and its Python, as text, in their order."""
    for kind, code in re.findall(
        r"^```(sh|python)\n(.*?)^```", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE
    ):
        if kind == "python":
            yield code
        else:
            yield from (shlex.split(line, comments=True) for line in code.splitlines() if line.startswith("windsysid "))


def try_on(python: str, wheel: Path, folder: Path) -> str:
    """Install the wheel for one Python, run README, and say how it went."""
    begun = time.monotonic()
    _run([python, "-m", "venv", folder / "env"], folder)
    scripts = folder / "env" / "bin"
    _run([scripts / "python", "-m", "pip", "install", "--quiet", "--only-binary", ":all:", wheel], folder)
    installed = time.monotonic()
    empty = folder / "empty"
    empty.mkdir()
    for given in readme():
        command = [scripts / "python", "-c", given] if isinstance(given, str) else [scripts / given[0], *given[1:]]
        _run(command, empty, WINDSYSID_CACHE=str(folder / "cache"))
    for result in ("results/verne555/report.html", "results/inspection/report.html", "results/coefficients.png"):
        if not (empty / result).exists():
            raise SystemExit(f"{python}: README did not make {result}")
    return f"installed in {installed - begun:.0f} s, README in {time.monotonic() - installed:.0f} s"


def _run(command: Sequence[object], folder: Path, **environment: str) -> None:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, env={**clean, **environment}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]
        raise OSError(f"{Path(str(command[0])).name} {' '.join(map(str, command[1:4]))}: {' '.join(last)}")


def main() -> None:
    """Print a line for each Python."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", nargs="*", help="the Pythons to try; all that are here by default")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel, sdist = build(folder)
        lacking = missing(wheel)
        print(f"{wheel.name}: {wheel.stat().st_size / 1e3:.0f} kB; {sdist.name}: {sdist.stat().st_size / 1e3:.0f} kB")
        print(f"files of the package that the wheel lacks: {', '.join(lacking) or 'none'}", flush=True)
        failed = bool(lacking)
        for number, python in enumerate(given.python or pythons()):
            place = folder / str(number)
            place.mkdir()
            try:
                told = try_on(python, wheel, place)
            except OSError as error:
                told, failed = f"FAILED: {error}", True
            print(f"{python}: {told}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
