"""The whole benchmark runs to its end, and pages have the figures of its tables."""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "docs" / "performance_tables.md"
TABLE = re.compile(r"^\*\*(?P<title>[^\n]+)\*\*\n\n(?P<rows>(?:\|[^\n]*\n)+)", re.MULTILINE)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """benchmarks/bench.py; the modules beside it are forgotten afterwards."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    yield importlib.import_module("bench")
    for name in set(sys.modules) - before:
        if (ROOT / "benchmarks" / f"{name}.py").exists():
            del sys.modules[name]


def sheets_of(text: str, bench: ModuleType) -> list[object]:
    """The tables of a page as the benchmark has them."""
    found = []
    for table in TABLE.finditer(text):
        lines = [tuple(cell.strip() for cell in row.split("|")[1:-1]) for row in table["rows"].splitlines()]
        found.append(bench.Sheet(table["title"], lines[0], lines[2:], {f"{table['title']}: {lines[2][0]}": 1.0}))
    return found


@pytest.mark.parametrize("short", [True, False])
def test_the_benchmark_runs_to_its_end_and_writes_only_where_it_is_whole(
    bench: ModuleType, short: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """With tables that are there in place of an hour of work."""
    tables = sheets_of(TABLES.read_text(encoding="utf-8"), bench)
    asked: list[tuple[str, str, bool]] = []

    def run(python: str, part: str, short: bool) -> list[object]:
        asked.append((python, part, short))
        return tables if part == "speed" else []

    monkeypatch.setattr(bench, "run", run)
    monkeypatch.setattr(bench, "_peer_versions", lambda _: [])
    monkeypatch.setattr(bench, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(bench, "PAGE", tmp_path / "page.md")
    (tmp_path / "results.json").write_text('{"floor": 1e-9, "costs": {}}', encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["bench", "--peers", "PEERS", *(["--short"] if short else [])])
    bench.main()
    said = capsys.readouterr().out
    assert "joint EKF ÷ the faster C" in said
    unmeasured = [line for line in said.splitlines() if "not measured" in line]
    assert all("│ windsysid " in line for line in unmeasured), "the kept tables are older than these rows"
    assert {part for _, part, _ in asked} == {*bench.OURS, *bench.THEIRS} - ({"smc"} if short else set())
    assert all(python == "PEERS" for python, part, _ in asked if part in bench.THEIRS)
    assert (tmp_path / "page.md").exists() is not short
    if not short:
        again = sheets_of((tmp_path / "page.md").read_text(encoding="utf-8"), bench)
        assert [one[:3] for one in again[1:]] == [one[:3] for one in tables]  # type: ignore[index]


def test_pages_have_the_figures_of_the_tables(bench: ModuleType):
    """Whoever runs `make bench` anew changes these pages with its tables."""
    tables = sheets_of(TABLES.read_text(encoding="utf-8"), bench)

    def found(title: str, row: tuple[str, ...], heading: str) -> float:
        value = bench.find(tables, title, row, heading)
        assert value is not None
        return float(value)

    def peer(*row: str) -> float:
        return found("joint, extended", row, "÷ windsysid")

    floor = max(found("One core", ("extended Kalman filter",), f"÷ {how}") for how in ("C", "C, vectors"))
    ours = found("One core", ("extended Kalman filter",), "windsysid")
    dynamax, cuthbert = peer("dynamax", "XLA"), peer("cuthbert", "XLA")
    exact, own = peer("filterpy", "NumPy"), peer("filterpy", "windsysid's")
    particles = "2000 particles, 10000 samples"
    clock, theirs = found(particles, ("windsysid, 2 threads",), "clock s"), found(particles, ("particles",), "÷ ours")
    many, mode = found("Turbines", ("1000",), "× real time"), found("Mode", ("coefficients and statistics",), "seconds")
    whole, bare = ("windsysid identify",), ("windsysid identify --no-report",)
    first, warm, lean = (
        found("Whole commands", row, heading)
        for row, heading in ((whole, "first run"), (whole, "later runs"), (bare, "later runs"))
    )
    online, base = "On line", found("Samples of one record", ("100 000",), "µs per sample")
    later, early = ("from 80 periods to 20 000 samples",), ("the first 10 000 samples",)
    slower, slowest = (found(online, part, "µs per sample") / base for part in (later, early))
    at_once = found(online, later, "turbines in real time, 1 core")
    said = {
        "README.md": [f"takes {floor:.2f} × the time of hand-written C; dynamax takes {dynamax:.0f} ×"],
        "docs/performance.md": [
            f"{ours:.1f} µs per sample on that machine: {floor:.2f} × hand-written C; dynamax takes {dynamax:.0f} ×, "
            f"cuthbert {cuthbert:.0f} ×, filterpy with NumPy and exact Jacobians {exact:.0f} × as long",
            f"| posterior mode of 10 000 samples, 18 unknowns | {mode:.2f} s of the processor |",
            f"| {clock:.2f} s; `particles` takes {theirs:.1f} × as long |",
            f"| {many:.1f} × real time with that filter.",
            f"| {slower:.0f} × as long per sample as that filter, {slowest:.0f} × over the first 100 s: "
            f"1 000 turbines at {at_once / 1000.0:.1f} × real time.",
            f"| {warm:.1f} s; {lean:.1f} s without the report; {first:.0f} s the first time, compilation included |",
        ],
        "docs/other_software.md": [
            f"| {dynamax:.1f} and {exact:.0f} times as fast",
            f"| {own:.1f} times as fast, on a machine with other work |",
        ],
        "docs/particles.md": [f"have {clock:.2f} s for 2 000 particles and 10 000 samples, and {theirs:.1f} times as"],
    }  # fmt: skip
    for page, sentences in said.items():
        text = (ROOT / page).read_text(encoding="utf-8")
        assert [one for one in sentences if one not in text] == [], page
