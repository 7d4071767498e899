"""Completion of Sphinx and its extensions: links named by their page's title, figures by their content, and short
cells of tables on one line."""

from pathlib import PurePath
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

__all__ = ["setup"]

SHORT = 14
"""Characters of a cell that stays on one line: a number with its unit."""


def name_links(app: Sphinx, tree: nodes.document) -> None:
    """Show the title of a page where the text names its file, as it does for those who read the repository."""
    for link in tree.findall(addnodes.pending_xref):
        if link.get("refexplicit") and link.astext().endswith(".md"):
            link["refexplicit"] = False


def name_figures(app: Sphinx, tree: nodes.document) -> None:
    """Give figures of the gallery a name for screen readers: the title of the program, and its number on the page."""
    titles = list(tree.findall(nodes.title))
    if not app.env.docname.startswith("gallery/") or not titles:
        return
    drawn = [node for node in tree.findall() if node.tagname == "imgsgnode"]
    for number, node in enumerate(drawn, 1):
        node["alt"] = f"{titles[0].astext()}: figure {number} of {len(drawn)}"
    for image in tree.findall(nodes.image):
        if not image.get("alt"):  # of the list of programs
            program = PurePath(image["uri"]).stem.removeprefix("sphx_glr_").removesuffix("_thumb")
            image["alt"] = f"First figure of {program.replace('_', ' ')}"


def keep_short_cells(app: Sphinx, tree: nodes.document) -> None:
    """Mark cells that hold a number or a word or two."""
    for cell in tree.findall(nodes.entry):
        if len(cell.astext()) <= SHORT:
            cell["classes"].append("short")


def setup(app: Sphinx) -> dict[str, Any]:
    """As an extension."""
    for change in (name_links, name_figures, keep_short_cells):
        app.connect("doctree-read", change)
    return {"parallel_read_safe": True}
