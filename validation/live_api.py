"""A fuzz of the live service's HTTP API from its own OpenAPI: no crash, no undocumented answer, no leak.

    python -m validation.live_api --cases 500

Schemathesis makes requests that fit the schema and requests that do not, of every operation, and judges every answer by
the schema: a status that is documented, a body of its model, what is valid accepted and what is not refused. All are
asked three times: without tokens, as an operator, and without one where tokens are required, who must not get anything
but a refusal. Memory is looked at after every operation. A store is behind it that tests fill
(``tests/live/page/sample.py``).
"""

import argparse
import sys
from collections import Counter
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from windsysid.live.page.access import Access
from windsysid.live.page.app import app, streams_of
from windsysid.live.page.guard import RequestLimits
from windsysid.live.page.models import JournalChanges
from windsysid.live.store import open_store
from windsysid.output.console import render
from windsysid.output.table import Table

READ, OPERATE = "reader-of-the-fuzz-0", "operator-of-the-fuzz-0"

OPEN = ("/health",)
"""Paths that need no token."""

KNOWN: dict[str, Any] = {"turbine": "T02", "key": "T03/blade_2_lag_acceleration/1"}
"""Existing objects; of names that are made up there is none."""

SHOWN = 10
"""Failures that are printed."""

WHO: dict[str, tuple[Access, dict[str, str]]] = {
    "no tokens": (Access(), {"Host": "localhost"}),
    "operator": (Access(READ, OPERATE), {"Authorization": f"Bearer {OPERATE}"}),
    "nobody": (Access(READ, OPERATE), {}),
}


def main() -> int:
    """Fuzz, and print how many requests of each operation were answered how."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200, help="of each operation, kind and way to ask (200)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    try:
        import schemathesis  # noqa: F401
    except ImportError:
        print("skipped: schemathesis is not installed (pip install schemathesis)")
        return 0
    from tests.live.page import sample

    store = open_store(":memory:")
    KNOWN["window"] = sample.fill(store, days=0.5) / 1e6
    rows, failures = [], []
    for who, (access, headers) in WHO.items():
        page = app(store, access=access, limits=RequestLimits(rate=1e9, burst=1e9, guesses=1e9))
        streams_of(page).follow = _one_change  # type: ignore[method-assign]
        for label, fuzz in _operations(page, headers, who == "nobody"):
            statuses, failed = fuzz(options.cases, options.seed)
            failures += [f"{who}: {label}: {text}" for text in failed]
            answers = ", ".join(f"{count} × {status}" for status, count in sorted(statuses.items()))
            rows.append((who, label, str(sum(statuses.values())), answers, str(len(failed)), f"{_resident():.0f} MB"))
    store.close()
    columns = ("who asks", "operation", "requests", "answers", "failures", "memory")
    print(render(Table(columns, rows, "HTTP API fuzzed from its OpenAPI", words=(0, 1, 3)), width=120))
    for text in failures[:SHOWN]:
        print(f"\n{text}")
    print(f"\n{sum(int(row[2]) for row in rows)} requests, {len(failures)} failures")
    return 1 if failures else 0


Fuzz = Callable[[int, int], tuple[Counter[int], list[str]]]


def _operations(page: Any, headers: dict[str, str], refused: bool) -> list[tuple[str, Fuzz]]:
    """Every operation of the schema, and what fuzzes it."""
    import schemathesis
    from hypothesis import HealthCheck, Phase, given, seed, settings
    from schemathesis import GenerationMode
    from schemathesis.core.failures import FailureGroup
    from schemathesis.core.result import Ok

    schema = schemathesis.openapi.from_asgi("/api/openapi.json", page, headers={"host": "localhost"})

    def fuzz_of(operation: Any) -> Fuzz:
        def fuzz(cases: int, number: int) -> tuple[Counter[int], list[str]]:
            statuses: Counter[int] = Counter()
            failed: list[str] = []

            def ask(case: Any) -> None:
                answer = case.call(headers=headers)
                statuses[answer.status_code] += 1
                if refused and operation.path not in OPEN:
                    if answer.status_code < 400 or "T01" in answer.text:
                        failed.append(f"answered {answer.status_code} to nobody: {case.as_curl_command()}")
                    return
                if answer.status_code >= 500:
                    failed.append(f"{answer.status_code}: {case.as_curl_command()}: {answer.text[:300]}")
                left_out = [schemathesis.checks.ignored_auth]
                if answer.status_code == 414:  # refused, by a status that the check does not count as a refusal
                    left_out.append(schemathesis.checks.negative_data_rejection)
                try:
                    case.validate_response(answer, excluded_checks=left_out)
                except FailureGroup as group:
                    failed.extend(f"{one}".replace("\n", " ")[:600] for one in group.exceptions)

            known = {one.name: KNOWN[one.name] for one in operation.iter_parameters() if one.name in KNOWN}
            ways: list[tuple[Any, dict[str, Any]]] = [(GenerationMode.POSITIVE, {}), (GenerationMode.NEGATIVE, {})]
            if known:
                ways.append((GenerationMode.POSITIVE, {"path_parameters": known}))
            for mode, given_parts in ways:
                try:
                    strategy = operation.as_strategy(generation_mode=mode, **given_parts)
                    tried = settings(
                        max_examples=cases, deadline=None, database=None, phases=[Phase.generate],
                        suppress_health_check=list(HealthCheck),
                    )  # fmt: skip
                    seed(number)(tried(given(case=strategy)(ask)))()
                except Exception as error:  # nothing can be made that does not fit: there is nothing to get wrong
                    if "Unsatisfiable" not in type(error).__name__ and "negative" not in str(error).lower():
                        failed.append(f"{type(error).__name__}: {error}")
            return statuses, failed

        return fuzz

    found = [result.ok() for result in schema.get_all_operations() if isinstance(result, Ok)]
    return [(operation.label, fuzz_of(operation)) for operation in found]


async def _one_change(after: int | None) -> AsyncIterator[tuple[int, JournalChanges]]:
    """A stream that ends: a fuzz waits for no event."""
    yield (after or 0) + 1, JournalChanges(turbines=[], results=[], alarms=[], all=True)


def _resident() -> float:
    """Memory of this process [MB]."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * 4096 / 1e6


if __name__ == "__main__":
    sys.exit(main())
