"""Templates of sentences: `str.format` with lists, shares in percent, counts and magnitudes."""

import string
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["LIKELY_MACHINE", "Data", "Sentence", "Template", "fill"]

Data = Mapping[str, Any]
Template = str | Callable[[Data], str]
"""A format string, or a function of the data."""

Sentence = Template | tuple[Template, Template]
"""One part, or a statement and its likely cause with what to do."""

LIKELY_MACHINE = ": likely a machine or waves; choose a section without it"


class _Formatter(string.Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, list):
            return (" and " if format_spec == "and" else ", ").join(map(str, value))
        if format_spec.endswith("(s)"):
            return f"{value} {format_spec.removesuffix('(s)')}{'s' if value != 1 else ''}"
        if format_spec.endswith(" %"):
            return f"{100.0 * value:{format_spec.removesuffix(' %')}} %"
        if format_spec.startswith("|"):
            return f"{abs(value):{format_spec.strip('|')}}"
        return format(value, format_spec)


_FORMATTER = _Formatter()


def fill(template: Template, data: Data) -> str:
    """The text of a template.

    Formats beyond Python's: a list is joined by commas, or as ``a and b`` by ``:and``; ``:.3g %`` shows a share in
    percent; ``:sample(s)`` counts; ``:|.3g|`` leaves out the sign.

    Examples
    --------
    >>> fill("{share:.2g %} in {count:place(s)} of {names:and}", {"share": 0.05, "count": 2, "names": ["a", "b"]})
    '5 % in 2 places of a and b'
    """
    return template(data) if callable(template) else _FORMATTER.vformat(template, (), data)
