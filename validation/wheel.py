"""The wheel as a new user meets it: built, installed into clean environments, README's commands and the tutorials run
in empty folders.

Run:  python -m validation.wheel [--python python3.12 …]

Without --python every Python from 3.11 on is tried that is found by name or by pyenv. The first one tried takes the
tutorials, too. Nothing of this repository is on the path of what is tried but the wheel, and in the tutorials' folders
`examples`; packages come from the index that pip is configured for.
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
from shutil import copytree, ignore_patterns, which

ROOT = Path(__file__).parents[1]

MINORS = range(11, 16)
"""Of the Pythons 3.x that are looked for."""

SOURCES = ("*.py", "py.typed", "*.toml", "*.j2", "*.html", "*.css", "*.js", "*.svg", "*.json")
"""Contents of the package; each such file under src must be in the wheel."""


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


def typed(page: Path) -> list[list[str] | str]:
    """A page's commands of windsysid and pip, as words, and its Python, as text, in their order.

    Blocks of Python that follow each other are one text.
    """
    found: list[list[str] | str] = []
    for kind, code in re.findall(r"^```(sh|python)\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        if kind == "sh":
            lines = code.splitlines()
            found += [shlex.split(line, comments=True) for line in lines if line.startswith(("windsysid ", "pip "))]
        elif found and isinstance(found[-1], str):
            found[-1] += code
        else:
            found.append(code)
    return found


def follow(page: Path, wheel: Path, place: Path, empty: Path) -> float:
    """Do in an empty folder what a page tells to type, with the wheel where it installs windsysid; say how long that
    took [s]."""
    empty.mkdir(exist_ok=True)
    scripts, begun = place / "env" / "bin", time.monotonic()
    for given in typed(page):
        words = ["python", "-c", given] if isinstance(given, str) else given
        if words[0] == "pip":
            words = [word.replace("windsysid[", f"{wheel}[") for word in words]
        _run([scripts / words[0], *words[1:]], empty, WINDSYSID_CACHE=str(place / "cache"))
    return time.monotonic() - begun


def try_on(python: str, wheel: Path, folder: Path) -> str:
    """Install the wheel for one Python, follow README, and say how it went."""
    begun = time.monotonic()
    _run([python, "-m", "venv", folder / "env"], folder)
    scripts = folder / "env" / "bin"
    _run([scripts / "python", "-m", "pip", "install", "--quiet", "--only-binary", ":all:", wheel], folder)
    installed = time.monotonic() - begun
    readme = follow(ROOT / "README.md", wheel, folder, folder / "empty")
    for result in ("results/logger/report.html", "coefficients.png"):
        if not (folder / "empty" / result).exists():
            raise OSError(f"README did not make {result}")
    return f"installed in {installed:.0f} s, README in {readme:.0f} s"


def try_tutorials(wheel: Path, folder: Path) -> Iterator[str]:
    """Follow each tutorial where `try_on` has installed the wheel, and say how it went.

    What README compiled is there already; what a tutorial compiles or installs itself is in its time.
    """
    for page in sorted((ROOT / "docs" / "tutorials").glob("*.md")):
        copytree(ROOT / "examples", folder / page.stem / "examples", ignore=ignore_patterns("__pycache__"))
        try:
            told = f"{follow(page, wheel, folder, folder / page.stem):.0f} s"
        except OSError as error:
            told = f"FAILED: {error}"
        yield f"tutorial {page.stem}: {told}"


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
                told = f"FAILED: {error}"
            named = subprocess.run([python, "--version"], stdout=subprocess.PIPE, text=True).stdout.strip()
            print(f"{named or python}: {told}", flush=True)
            for line in try_tutorials(wheel, place) if number == 0 else ():
                print(f"  {line}", flush=True)
                told += line
            failed = failed or "FAILED" in told
    sys.exit(failed)


if __name__ == "__main__":
    main()
