"""Check a page for those who read it by keyboard or screen reader: names, labels, headings of tables."""

from dataclasses import dataclass, field
from html.parser import HTMLParser

__all__ = ["Element", "parsed", "problems"]

VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
CONTROLS = {"a", "button", "input", "select", "textarea", "summary"}


@dataclass
class Element:
    """An element with its attributes, children and texts."""

    tag: str
    attributes: dict[str, str]
    parent: "Element | None" = None
    children: "list[Element]" = field(default_factory=list)
    own_text: str = ""

    def all(self, *tags: str) -> "list[Element]":
        """Descendants with one of some tags, in their order; all without tags."""
        found = []
        for child in self.children:
            found += [child] if not tags or child.tag in tags else []
            found += child.all(*tags)
        return found

    @property
    def text(self) -> str:
        """Text of the element and of what it contains."""
        return " ".join([self.own_text, *(child.text for child in self.children)]).strip()

    def within(self, *tags: str) -> "Element | None":
        """Nearest ancestor with one of some tags."""
        one = self.parent
        while one is not None and one.tag not in tags:
            one = one.parent
        return one

    def __str__(self) -> str:
        return f"<{self.tag} {self.attributes}> {self.text[:60]!r}"


class _Tree(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.root = self.at = Element("", {})

    def handle_starttag(self, tag, attrs):
        one = Element(tag, {name: value or "" for name, value in attrs}, self.at)
        self.at.children.append(one)
        if tag not in VOID:
            self.at = one

    def handle_startendtag(self, tag, attrs):
        self.at.children.append(Element(tag, {name: value or "" for name, value in attrs}, self.at))

    def handle_endtag(self, tag):
        one = self.at if self.at.tag == tag else self.at.within(tag)
        if one is not None and one.parent is not None:
            self.at = one.parent

    def handle_data(self, data):
        if self.at.tag not in ("script", "style"):
            self.at.own_text += data


def parsed(page: str) -> Element:
    """The elements of a page."""
    tree = _Tree()
    tree.feed(page)
    return tree.root


def problems(page: str) -> list[str]:
    """What a reader by keyboard or screen reader lacks, a line each."""
    root = parsed(page)
    everything = root.all()
    ids = [one.attributes["id"] for one in everything if "id" in one.attributes]
    counted = {
        "language of the page": [one for one in root.all("html") if one.attributes.get("lang")],
        "title": [one for one in root.all("head")[0].all("title") if one.text],
        "main heading": root.all("h1")[:1],
        "main": root.all("main"),
    }
    found = [f"{what}: expected one, got {len(them)}" for what, them in counted.items() if len(them) != 1]
    found += [f"id {one!r} is not unique" for one in sorted({one for one in ids if ids.count(one) > 1})]
    found += [f"no name: {one}" for one in everything if _is_reached(one) and not _name(one, root)]
    found += [f"order of Tab: {one}" for one in everything if int(one.attributes.get("tabindex", 0)) > 0]
    found += [f"no alternative text: {one}" for one in root.all("img") if not one.attributes.get("alt")]
    drawn = [one for one in root.all("svg") if one.within("svg") is None and "aria-hidden" not in one.attributes]
    found += [f"no name: {one}" for one in drawn if one.attributes.get("role") != "img" or not _name(one, root)]
    found += [f"no caption: {one}" for one in root.all("figure") if not one.all("figcaption")]
    return found + [line for one in root.all("table") for line in _of_table(one)]


def _is_reached(one: Element) -> bool:
    """Test whether Tab reaches an element."""
    hidden = one.attributes.get("type") == "hidden" or (one.tag == "a" and "href" not in one.attributes)
    return not hidden and (one.tag in CONTROLS or one.attributes.get("tabindex") == "0")


def _name(one: Element, root: Element) -> str:
    """Accessible name of an element."""
    label = one.within("label")
    named = [other.text for other in root.all("label") if one.attributes.get("id", " ") == other.attributes.get("for")]
    written = one.text if one.tag in ("a", "button", "summary") else ""
    return one.attributes.get("aria-label") or written or (label.text if label else "") or " ".join(named)


def _of_table(table: Element) -> list[str]:
    found = [] if table.attributes.get("aria-label") or table.all("caption") else [f"no name: {table}"]
    for heading in (one for head in table.all("thead") for one in head.all("th")):
        found += [] if heading.text and heading.attributes.get("scope") == "col" else [f"heading without text: {table}"]
    for first in (row.children[0] for body in table.all("tbody") for row in body.all("tr") if row.children):
        found += [] if first.attributes.get("scope") == "row" or not first.text else [f"row without heading: {first}"]
    return found
