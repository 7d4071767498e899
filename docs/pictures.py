"""Make the pictures of the pages anew: `python docs/pictures.py` (playwright and Chromium, 5 minutes).

The records and commands are those of the tutorials; the pictures of the live page are those of `windsysid live --demo`.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

DOCS = Path(__file__).parent
CHROMIUM = shutil.which("chromium")
PROGRAM = [sys.executable, "-m", "windsysid"]


def run(*arguments: str) -> None:
    """Run a command of windsysid."""
    subprocess.run([*PROGRAM, *arguments], check=True, stdout=subprocess.DEVNULL)


def program_of(page: str) -> str:
    """The first Python program of a page."""
    found = re.search(r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None, page
    return found[1]


def shoot(address: str, name: str, width: int, height: int, *, wait: str = "h1") -> None:
    """Take a picture of a page after an element is there."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(address)
        page.locator(wait).first.wait_for()
        page.wait_for_timeout(2000)
        page.screenshot(path=DOCS / "images" / f"{name}.png")
        browser.close()


def shoot_demo(port: str = "8437") -> None:
    """Take pictures of the demo of the live service, after the alarm of T2."""
    service = subprocess.Popen([*PROGRAM, "live", "--demo", "--no-browser", "--port", port], stderr=subprocess.PIPE)
    try:
        assert service.stderr is not None
        next(line for line in service.stderr if b"k_side_side) fell" in line)
        shoot_live(f"http://127.0.0.1:{port}/")
    finally:
        service.terminate()
        service.wait()


def shoot_live(address: str) -> None:
    """Take pictures of a live page's overview and of its turbine T2."""
    shoot(f"{address}#/", "live_overview", 1100, 820, wait="text=T3")
    shoot(f"{address}#/turbine/T2", "live_turbine", 1100, 1990, wait="canvas")


def main() -> None:
    """Make all pictures in `docs/images`."""
    os.chdir(tempfile.mkdtemp())
    run("examples", "ex")
    run("identify", "ex/tower_year1.csv", "--turbine", "tower", "--output", "report")
    shoot(Path("report/report.html").resolve().as_uri(), "report", 1100, 1760)
    exec(program_of("tutorials/openfast_modes.md"), {})
    run("oma", "sample.out", "--turbine", "nrel5mw", "--range", "0.2", "1.6", "--output", "measured")
    run("modes", "--turbine", "nrel5mw", "--measured", "measured", "--output", "diagram")
    shoot(Path("diagram/report.html").resolve().as_uri(), "campbell", 1100, 1930)
    exec(program_of("tutorials/archive.md"), {})
    run("batch", "data", "--fleet", "fleet.toml", "--workers", "1", "--output", "archive")
    run("monitor", "archive", "--turbine", "T02", "--output", "watched")
    shoot(Path("watched/report.html").resolve().as_uri(), "monitor", 1100, 1500)
    shoot_demo()


if __name__ == "__main__":
    main()
