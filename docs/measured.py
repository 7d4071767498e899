"""The page of results that were kept: what `python -m validation.record` wrote, each with its commit and machine."""

from pathlib import Path

__all__ = ["write_measured"]

HEAD = """# Results that were kept

`python -m validation.record NAME -- ARGUMENTS` runs a module of `validation/` and keeps what it printed in
`validation/results/`, with the commit, the machine and the date. `make docs` writes this page from those files.
"""


def write_measured(results: Path, page: Path) -> None:
    """Write the page from the kept results, and from ``older.md``: tables that have not been run since."""
    page.parent.mkdir(exist_ok=True)
    parts = [HEAD]
    for file in sorted(results.glob("*.txt")):
        head, output = file.read_text(encoding="utf-8").split("\n\n", 1)
        facts = dict(line.split(": ", 1) for line in head.splitlines())
        command = facts.pop("command")
        parts += [f"## {file.stem}\n", f"`{command}`\n"]
        parts += ["\n".join(f"- {name}: {value}" for name, value in facts.items()) + "\n"]
        parts += [f"```text\n{output.rstrip()}\n```\n"]
    parts += [(results / "older.md").read_text(encoding="utf-8")]
    page.write_text("\n".join(parts), encoding="utf-8")
