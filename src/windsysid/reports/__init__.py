"""Answers as figures and pages. Answers do not know this room: `MODULES` says where the page and the figure of each
type are.

A module of an answer has the function ``files(answer)``, which gives the page, its figures and the JSON by name, or
``figure(answer)``, or both.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from windsysid.output.table import Table
from windsysid.reports import loading

__all__ = ["MODULES", "answer_class", "figure", "files", "fragment"]

MODULES = {
    "Campbell": "campbell",
    "Comparison": "comparison",
    "Fit": "histories",
    "Identification": "histories",
    "Inspection": "inspection",
    "LinearisedModes": "figures.participations",
    "ModeMatch": "figures.matches",
    "OperationalModes": "oma",
    "Overview": "fleet",
    "Plan": "plan",
    "Profile": "profile",
    "Record": "record",
    "Separation": "damping",
    "Watch": "watch",
}
"""The module of each type."""


def files(answer: object) -> dict[str, bytes]:
    """The page of an answer, its figures and its JSON, by name."""
    found: dict[str, bytes] = _module_of(answer).files(answer)
    return {**found, **loading.kept(answer)}


def figure(answer: object, place: Any = None) -> Any:
    """An answer as a Matplotlib `Figure`, or in the place of axes."""
    return _module_of(answer).figure(answer, place)


def fragment(answer: object, contents: Sequence[Table | str]) -> str:
    """Render sentences and tables of an answer, and its figure, as HTML for a notebook."""
    from windsysid.reports import html

    return html.fragment(contents, figure(answer))


def answer_class(name: str) -> type[Any]:
    """The class of answers of some name."""
    found: type[Any] = getattr(import_module(f"windsysid.reports.{MODULES[name]}"), name)
    return found


def _module_of(answer: object) -> Any:
    return import_module(f"windsysid.reports.{MODULES[type(answer).__name__]}")
