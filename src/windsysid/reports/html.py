"""One self-contained HTML page: sections, tables, figures and interactive plots inside, readable without a network."""

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING

from windsysid.output.console import longest_word
from windsysid.output.table import Table
from windsysid.reports.interactive.plot import Plot, to_json
from windsysid.reports.interactive.svg import static_svg

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure

__all__ = ["Section", "fragment", "png", "reasons_against", "report_page", "static_text", "template"]

UPLOT, UPLOT_CSS = "../../live/page/static/uplot.js", "../../live/page/static/uplot.css"
"""uPlot as the live page has it (MIT licence, uplot-license.txt)."""

PHONE_CHARACTERS, GAP_CHARACTERS = 44, 2
"""Setting: characters of a table that fit a phone, and of the space between two columns; a wider one is shown there as
a card for each row."""

BREAKS = re.compile(r" (?=[%±…[]|: \d)|(?<=[±:…]) (?=[-+−]?\d)")
"""Spaces at which a value is not broken: 1.2 ± 0.3 %, 100 : 1."""

COLOURS = {
    "#000000": "var(--ink)", "#111111": "var(--ink)", "#262626": "var(--ink)", "#555555": "var(--quiet)",
    "#b0b0b0": "var(--rule)", "#1764ab": "var(--estimate)", "#a9cbe8": "var(--band)", "#9a9a9a": "var(--measured)",
    "#d1661b": "var(--error)", "#ffffff": "var(--page)",
}  # fmt: skip
"""Colours of Matplotlib's figures as variables of the page's style, which has others in the dark."""


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, tables, figures, each with its caption, interactive plots, and text as a file has it;
    `folded` until it is clicked at. `markup` is HTML that comes before the tables.

    A figure that is also a file of its own comes as PNG.
    """

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: "Sequence[tuple[Figure, str]]" = ()
    plots: Sequence[Plot] = ()
    file: str = ""
    markup: str = ""
    folded: bool = False


def report_page(title: str, subtitle: str, sections: Sequence[Section]) -> bytes:
    """Sections as one HTML file."""
    shown = [_shown(section, number) for number, section in enumerate(sections)]
    names = (UPLOT_CSS, "plots.css", UPLOT, "plots.js") if any(section.plots for section in sections) else ()
    page = template("report").render(
        title=title, subtitle=subtitle, sections=shown,
        styles=[static_text(name) for name in names if name.endswith(".css")],
        scripts=[static_text(name) for name in names if name.endswith(".js")],
    )  # fmt: skip
    return page.encode(errors="backslashreplace")


def reasons_against(reasons: Sequence[str], otherwise: Sequence[str] = ()) -> list[str]:
    """A paragraph for every reason against a result, the first with the verdict, which pages mark; else `otherwise`."""
    return [f"{'and' if i else 'trust: NO,'} because {reason}" for i, reason in enumerate(reasons)] or [*otherwise]


def _shown(section: Section, number: int) -> dict[str, object]:
    """A section as the template takes it."""
    return {
        "title": section.title,
        "text": section.text,
        "tables": section.tables,
        "file": section.file,
        "folded": section.folded,
        "markup": section.markup,
        "figures": [{"markup": _embedded(figure, caption), "caption": caption} for figure, caption in section.figures],
        "plots": [
            {"plot": plot, "svg": static_svg(plot, f"{number}-{place}"), "json": to_json(plot)}
            for place, plot in enumerate(section.plots)
        ],
    }


def static_text(name: str) -> str:
    """A script or style sheet of the package."""
    return files("windsysid.reports").joinpath("static", name).read_text(encoding="utf-8")


def fragment(contents: Sequence[Table | str], figure: "Figure | None" = None) -> str:
    """Render sentences, tables and a figure as a part of another page, such as a notebook."""
    picture = None if figure is None else _embedded(png(figure), "figure of the result")
    return template("fragment").render(contents=[part for part in contents if part != ""], picture=picture)


def template(name: str) -> "Template":
    """A template of the package, in which text is escaped."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("windsysid.reports"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["unbroken"] = lambda text: BREAKS.sub("\N{NO-BREAK SPACE}", text)
    environment.tests["wide"] = _is_wide
    return environment.get_template(f"{name}.html.j2")


def _is_wide(table: Table) -> bool:
    """Test whether a phone shows each row of a table as a card."""
    columns = zip(table.headings, *table.rows, strict=True)
    words = (longest_word([BREAKS.sub("_", text) for text in own]) for own in columns)
    return sum(word + GAP_CHARACTERS for word in words) > PHONE_CHARACTERS


def png(figure: "Figure") -> bytes:
    """Render a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def _embedded(figure: "Figure | bytes", caption: str) -> str:
    """A figure as SVG whose colours are those of the page, or a PNG as it is."""
    if isinstance(figure, bytes):
        data = base64.b64encode(figure).decode("ascii")
        return f'<img alt="{escape(caption)}" src="data:image/png;base64,{data}">'
    from matplotlib import rc_context

    buffer = io.StringIO()
    with rc_context({"svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r' xmlns(?::xlink)?="[^"]*"', "", text)
    text = re.sub(r"#[0-9a-f]{6}\b", lambda found: COLOURS.get(found[0], found[0]), text)
    text = re.sub(
        r' id="(?:figure|axes|patch|line2d|legend|text|matplotlib.axis|[xy]tick|[A-Za-z]+Collection)_[^"]*"', "", text
    )
    text = text.replace("xlink:href", "href")
    return text.replace("<svg", f'<svg class="drawn" role="img" aria-label="{escape(caption)}"', 1)
