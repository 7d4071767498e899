"""Time until the demo of ``windsysid live`` shows its events: ``python -m validation.live_demo``.

It is started twice, as a user starts it: with an empty cache of compiled models, and again with what that left. Seconds
count from the command to the page's answer, to the first estimate of any tower, and to the alarm of the tower that
loses stiffness, where the page's API shows them. What else the machine does in the meantime counts too.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from typing import Any

from windsysid.output.console import render
from windsysid.output.table import Table

__all__ = ["main"]

EVERY = 0.5
"""Seconds between two looks at the page."""


SHOWN = {"page": "page", "estimate": "first estimate", "alarm": "alarm of T2"}
"""Stages of the page, in order, by the word that selects each."""


def seconds_until(cache: str, limit: float, last: str) -> dict[str, float]:
    """Seconds from the command to what the page shows, up to `last`; infinite for what it did not show in time."""
    command = [sys.executable, "-m", "windsysid", "live", "--demo", "--no-browser", "--port", "0"]
    names = list(SHOWN.values())
    found = dict.fromkeys(names[: names.index(last) + 1], math.inf)
    begun = time.monotonic()
    environment = os.environ | {"WINDSYSID_CACHE": cache, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as demo:
        try:
            assert demo.stdout is not None
            told = (line.split()[1] for line in demo.stdout if line.startswith("page: "))
            url = next(told).rstrip("/")
            while math.isinf(max(found.values())) and time.monotonic() < begun + limit:
                seen = asked(f"{url}/api/overview")
                now = {
                    "page": seen is not None,
                    "first estimate": any(one["trusted"] is not None for one in (seen or {}).get("turbines", ())),
                    "alarm of T2": any(
                        alarm["kind"] == "structure"
                        for one in (seen or {}).get("turbines", ()) if one["name"] == "T2"
                        for alarm in one["alarms"]
                    ),
                }  # fmt: skip
                for name in (name for name in found if now[name]):
                    found[name] = min(found[name], time.monotonic() - begun)
                time.sleep(EVERY)
        finally:
            demo.terminate()
            demo.wait(timeout=30.0)
    return found


def asked(url: str) -> Any:
    """Answer of the API, None if there is none."""
    try:
        with urllib.request.urlopen(url, timeout=10.0) as answer:
            return json.load(answer)
    except OSError:
        return None


def main() -> int:
    """Print the table; 1 where the demo did not show all of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=float, default=600.0, help="seconds to wait for each start (600)")
    parser.add_argument("--until", choices=list(SHOWN), default="alarm", help="what ends a start (alarm)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        starts = {
            name: seconds_until(cache, options.limit, SHOWN[options.until])
            for name in ("first, nothing compiled", "second")
        }
    rows = [
        (name, *("none" if math.isinf(one) else f"{one:.0f} s" for one in found.values()))
        for name, found in starts.items()
    ]
    table = Table(("start", *next(iter(starts.values()))), rows)
    print(
        render(
            table, f"{os.cpu_count()} processors; {os.getloadavg()[1]:.1f} processes wanted one, a mean of 5 minutes"
        )
    )
    return int(math.isinf(max(max(found.values()) for found in starts.values())))


if __name__ == "__main__":
    sys.exit(main())
