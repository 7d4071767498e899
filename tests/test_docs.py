"""The site: every public name and every command is in the reference, and pages lead to pages that are there."""

import importlib.util
import re
from pathlib import Path

import pytest

import windsysid
from windsysid.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    folder = tmp_path_factory.mktemp("reference")
    module.write_reference(folder)
    return folder


def test_every_public_name_is_in_the_reference_with_a_docstring(reference: Path):
    text = (reference / "api.md").read_text(encoding="utf-8")
    for name in windsysid._PUBLIC:
        assert f":: windsysid.{name}\n" in text
        assert getattr(windsysid, name).__doc__


def test_every_command_is_in_the_reference(reference: Path):
    text = (reference / "commands.md").read_text(encoding="utf-8")
    for command in app.registered_commands:
        name = command.name or command.callback.__name__  # type: ignore[union-attr]
        assert f"## windsysid {name}\n" in text
        assert f"Usage: windsysid {name} " in text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not target.startswith(("http://", "https://", "reference/")):
            assert (page.parent / target).exists(), target


def test_every_page_is_on_the_site():
    listed = set()
    for page in PAGES[2:]:
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL):
            listed |= {line for line in tree.split() if not line.startswith(":")}
    assert {page.stem for page in PAGES[2:]} - {"index"} <= listed
