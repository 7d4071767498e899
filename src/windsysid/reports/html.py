"""One self-contained HTML page: sections, tables, figures inside, readable without a network."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from windsysid.output.table import Table

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure

__all__ = ["Section", "fragment", "png", "report_page"]


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, tables, figures, each with its caption, and text as a file has it; `folded` until it
    is clicked at.

    A figure that is also a file of its own comes as PNG.
    """

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: "Sequence[tuple[Figure | bytes, str]]" = ()
    file: str = ""
    folded: bool = False


def report_page(title: str, subtitle: str, sections: Sequence[Section]) -> bytes:
    """Sections as one HTML file."""
    shown = [
        {
            "title": section.title,
            "text": section.text,
            "tables": section.tables,
            "file": section.file,
            "folded": section.folded,
            "figures": [{"data": _embedded(figure), "caption": caption} for figure, caption in section.figures],
        }
        for section in sections
    ]
    return _template("report").render(title=title, subtitle=subtitle, sections=shown).encode(errors="backslashreplace")


def fragment(contents: Sequence[Table | str], figure: "Figure | None" = None) -> str:
    """Render sentences, tables and a figure as a part of another page, such as a notebook."""
    picture = None if figure is None else _embedded(figure)
    return _template("fragment").render(contents=[part for part in contents if part != ""], picture=picture)


def _template(name: str) -> "Template":
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("windsysid.reports"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template(f"{name}.html.j2")


def png(figure: "Figure") -> bytes:
    """A figure as PNG: drawing is what takes the time, so what is shown twice is drawn once."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def _embedded(figure: "Figure | bytes") -> str:
    return base64.b64encode(figure if isinstance(figure, bytes) else png(figure)).decode("ascii")
